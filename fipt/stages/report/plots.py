"""Plots of a comparison: what each ablation changes, and figures against the size of an error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

_SHOWN = ("kd_psnr", "reflectance_psnr", "roughness_l1", "emission_iou", "render_psnr")
"""Columns that are plotted, where the table has them."""
_WIDTH, _HEIGHT = 200.0, 96.0
"""Of the area between the axes, units of the drawing."""


@dataclass(frozen=True)
class PlotPoint:
    """A point of a plot: its place in the drawing, what it says; of a bar how it is meant, else the error's size."""

    x: float
    y: float
    label: str
    text: str
    kind: str = ""


@dataclass(frozen=True)
class SizePlot:
    """A figure against the size of an error.

    Attributes
    ----------
    column
        Of the table.
    points
        By size; the first is the scene's own run.
    line
        They joined, ``points`` of a polyline.
    low, high
        Figures at the lower and upper end, as text.
    """

    column: Mapping[str, Any]
    points: Sequence[PlotPoint]
    line: str
    low: str
    high: str


@dataclass(frozen=True)
class SensitivitySeries:
    """Plots of one kind of error, and what the findings say of each size."""

    name: str
    unit: str
    plots: Sequence[SizePlot]
    findings: Sequence[tuple[str, Sequence[str]]]


def sensitivity_series(table: Mapping[str, Any]) -> list[SensitivitySeries]:
    """Every series of planted errors in the table."""
    own = [row for row in table["methods"] if row["id"] == "fipt"]
    series: dict[str, list[Mapping[str, Any]]] = {}
    for row in table["methods"]:
        if row.get("series"):
            series.setdefault(row["series"], []).append(row)
    columns = [column for column in table["columns"] if column["key"] in _SHOWN]
    found = []
    for name, rows in series.items():
        rows = sorted(rows, key=lambda row: row["size"])
        plots = [plot for column in columns if (plot := _size_plot(column, [*own, *rows])) is not None]
        findings = [(row["label"], [each["cause"] for each in row.get("findings") or ()]) for row in rows]
        found.append(SensitivitySeries(name, rows[0]["unit"], plots, findings))
    return found


def _size_plot(column: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> SizePlot | None:
    cells = [(row, row["figures"][column["key"]]) for row in rows]
    known = [(row, cell) for row, cell in cells if cell["mean"] is not None]
    if len(known) < 2:
        return None
    values = [cell["mean"] for _, cell in known]
    low, high = min(values), max(values)
    least = 1.0 if column["unit"] == "dB" else 0.02  # less is drawn as little
    middle, span = (low + high) / 2, max(high - low, least)
    low, high = middle - span / 2, middle + span / 2
    most = max(row.get("size") or 0.0 for row, _ in known) or 1.0
    points = [
        PlotPoint(
            _WIDTH * (row.get("size") or 0.0) / most,
            _HEIGHT * (high - cell["mean"]) / (high - low),
            row["label"],
            cell["text"],
            f"{row.get('size') or 0:g}",
        )
        for row, cell in known
    ]
    line = " ".join(f"{point.x:.1f},{point.y:.1f}" for point in points)
    digits = 1 if column["unit"] == "dB" else 2
    return SizePlot(column, points, line, f"{low:.{digits}f}", f"{high:.{digits}f}")


@dataclass(frozen=True)
class ChangePlot:
    """Bars of what every ablation changes in a column: the largest fills half of the width."""

    column: Mapping[str, Any]
    bars: Sequence[PlotPoint]


def change_plots(
    columns: Sequence[Mapping[str, Any]], methods: Sequence[Mapping[str, Any]], changes: Sequence[Mapping[str, Any]]
) -> list[ChangePlot]:
    """Bars of the ablations, the largest loss first.

    Parameters
    ----------
    columns
        Of the table, as ``changes`` has its cells.
    changes
        Rows of ``label`` and ``cells`` with ``text`` and ``kind``, of the ablations in the order of ``methods``.
    """
    own = next((row for row in methods if row["id"] == "fipt"), None)
    ablations = [row for row in methods if row["kind"] == "ablation"]
    if own is None or not ablations:
        return []
    plots = []
    for number, column in enumerate(columns):
        if column["key"] not in _SHOWN:
            continue
        key, sign = column["key"], 1 if column["better"] == "higher" else -1
        known = [
            (row["figures"][key]["mean"] - own["figures"][key]["mean"], change)
            for row, change in zip(ablations, changes, strict=True)
            if row["figures"][key]["mean"] is not None and own["figures"][key]["mean"] is not None
        ]
        most = max((abs(value) for value, _ in known), default=0.0) or 1.0
        bars = [
            PlotPoint(
                50 * sign * value / most,
                0.0,
                change["label"],
                change["cells"][number]["text"],
                change["cells"][number]["kind"],
            )
            for value, change in sorted(known, key=lambda entry: sign * entry[0])
        ]
        if bars:
            plots.append(ChangePlot(column, bars))
    return plots
