"""What a run found: table, picture and JSON."""

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from benchmarks.shading import Curve
from benchmarks.timing import Ratio
from fipt.formats.files import atomic, write_text


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    what
        The measurement, with its unit.
    ours, plain
        Medians of both implementations.
    ratio
        How many times better ours is; above 1 is faster or smaller.
    target
        The least ratio that is aimed at, if any.
    """

    what: str
    ours: float
    plain: float
    ratio: Ratio
    target: float | None = None


def machine(device: str, threads: int) -> dict[str, object]:
    """Date, hardware and versions of a run."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "cpu": name,
        "cores": os.cpu_count(),
        "device": device,
        "threads": threads,
        "load_before": load,
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("fipt", "mitsuba", "drjit", "torch", "numpy")},
    }


def table(rows: Sequence[Row]) -> str:
    """Rows as a Markdown table, readable in a terminal."""
    cells = [("", "ours", "plain", "ratio (spread)", "target")]
    for row in rows:
        target = "" if row.target is None else f">= {row.target:g}x"
        cells.append((row.what, f"{row.ours:.3g}", f"{row.plain:.3g}", str(row.ratio), target))
    widths = [max(len(line[column]) for line in cells) for column in range(5)]

    def line(texts: Sequence[str]) -> str:
        first = texts[0].ljust(widths[0])
        return f"| {' | '.join([first, *(t.rjust(w) for t, w in zip(texts[1:], widths[1:], strict=True))])} |"

    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    return "\n".join([line(cells[0]), line(rule), *(line(texts) for texts in cells[1:])])


def write_json(path: Path, about: dict[str, object], rows: Sequence[Row], curves: dict[str, Curve]) -> None:
    """Write everything that was measured."""
    content = about | {
        "rows": [asdict(row) for row in rows],
        "stage_1_error": {
            who: {
                "samples": curve.samples.tolist(),
                "error": curve.error.tolist(),
                "seconds": curve.seconds.tolist(),
            }
            for who, curve in curves.items()
        },
    }
    write_text(path, json.dumps(content, indent=1) + "\n")


def draw(path: Path, curves: dict[str, Curve], points: int, caption: str) -> None:
    """Draw error against time of both implementations."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure = Figure(figsize=(7, 4.6), layout="constrained", facecolor="white")
    axes = figure.add_subplot(xscale="log", yscale="log")
    looks = {"ours": ("#0b6e99", "o", "fipt"), "plain": ("#c0561f", "s", "plain implementation")}
    for who, curve in curves.items():
        color, marker, label = looks[who]
        per_sample = 1e6 * np.median(curve.seconds, axis=1) / points
        axes.plot(per_sample, curve.error, color=color, marker=marker, label=label)
        for x, y, samples in zip(per_sample, curve.error, curve.samples, strict=True):
            # the curves fall to the right: samples stand below ours and above the plain one
            offset, align = ((-6, -11), "right") if who == "ours" else ((6, 5), "left")
            axes.annotate(str(samples), (x, y), offset, textcoords="offset points", ha=align, fontsize=8, color=color)
    axes.margins(0.08)
    for axis, unit in ((axes.xaxis, 1), (axes.yaxis, 100)):
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter(FuncFormatter(lambda value, _, unit=unit: f"{unit * value:g}"))
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time per sample, microseconds")
    axes.set_ylabel("relative RMSE of all shading outputs, %")
    axes.set_title("Shading initialisation: error against time (numbers: rays per sample)", fontsize=11)
    axes.grid(which="both", color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.legend(frameon=False)
    figure.supxlabel(caption, fontsize=7.5, color="#555555")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=150)
