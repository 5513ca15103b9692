"""What the stages wrote of their runs: times, settings, versions, warnings."""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from fipt import __version__
from fipt.errors import FiptError
from fipt.progress import human
from fipt.registry import SECTIONS
from fipt.scene.dataset import rejected_views
from fipt.stages.report.files import read_json

_WITHIN = (
    *("synthesize", "photograph", "calibrate", "develop", "qa", "import", "truth"),
    *("first_mesh", "check_views", "mesh", "export", "check-export"),
)
"""Runs that share a section, as they follow one another."""
_PLACED = {"truth": "import", "check_views": "geometry"}
"""Runs that follow, or stand among, those of another section than their own."""
_PACKAGES = ("numpy", "torch", "mitsuba", "drjit", "pyoidn", "OpenEXR")


@dataclass(frozen=True)
class StageRun:
    """Figures that one run of a stage wrote; ``round`` is None outside the rounds."""

    stage: str
    round: int | None
    figures: Mapping[str, Any]


@dataclass(frozen=True)
class StageTime:
    """Time of a stage (of one round), summed over its shards.

    Attributes
    ----------
    label
        Stage and round.
    seconds
        Wall time, summed over shards.
    shards
        Number of runs.
    memory
        Largest peak memory, bytes; 0 where unknown.
    rate
        Mean rate in words, or empty.
    """

    label: str
    seconds: float
    shards: int
    memory: int
    rate: str


def read_runs(folder: Path) -> list[StageRun]:
    """Read every file of stats/."""
    found = []
    for path in sorted(folder.glob("*.json")):
        stage, *rest = path.stem.split(".")
        rounds = [part[6:] for part in rest if part.startswith("round-") and part[6:].isdigit()]
        content = read_json(path)
        if not isinstance(content, Mapping):
            raise FiptError(f"{path} holds no figures", "delete it and run its stage again")
        found.append(StageRun(stage, int(rounds[0]) if rounds else None, content))
    return found


def _order(run: StageRun) -> tuple[int, int, int, int]:
    """Place of a run in the pipeline: before the rounds, in round k, after them."""
    sections = list(SECTIONS)
    section = _PLACED.get(run.stage, str(run.figures.get("stage", run.stage)).replace("-", "_"))
    number = sections.index(section) if section in sections else len(sections)
    within = _WITHIN.index(run.stage) if run.stage in _WITHIN else 0
    if run.round is not None:
        return 1, run.round, number, within
    return (0 if number < sections.index("bake") else 2), 0, number, within


def stage_times(runs: Sequence[StageRun]) -> list[StageTime]:
    """Time of every stage and round, in the pipeline's order."""
    grouped: dict[tuple[str, int | None], list[Mapping[str, Any]]] = {}
    for run in sorted(runs, key=_order):
        if run.stage != "report":  # its own time is not known before the page is written
            grouped.setdefault((run.stage, run.round), []).append(run.figures)
    return [
        StageTime(
            label=stage if number is None else f"{stage} · round {number}",
            seconds=sum(float(figures.get("wall_s", 0.0)) for figures in own),
            shards=len(own),
            memory=max(int(figures.get("peak_memory_bytes", 0)) for figures in own),
            rate=_rate(own),
        )
        for (stage, number), own in grouped.items()
    ]


def _rate(shards: Sequence[Mapping[str, Any]]) -> str:
    """Mean of the first figure called ``..._per_s``, in words."""
    for key in shards[0]:
        if key.endswith("_per_s"):
            values = [float(figures[key]) for figures in shards if figures.get(key) is not None]
            unit = key.removesuffix("_per_s").replace("_", " ")
            return f"{human(float(np.mean(values)))} {unit}/s" if values else ""
    return ""


def stage_settings(runs: Sequence[StageRun]) -> dict[str, str]:
    """Settings of each stage, as its first run recorded them."""
    found: dict[str, str] = {}
    for run in sorted(runs, key=_order):
        if run.figures.get("settings"):
            found.setdefault(run.stage, pretty(run.figures["settings"]))
    return found


def pretty(values: Any) -> str:
    """Format settings as JSON for people."""
    return json.dumps(values, indent=2, ensure_ascii=False)


def versions_used(runs: Sequence[StageRun]) -> dict[str, str]:
    """Version of fipt that wrote the results, and of Python and the packages that matter."""
    wrote = sorted({str(run.figures["fipt"]) for run in runs if "fipt" in run.figures})
    versions = {"fipt": ", ".join(wrote) or __version__}
    versions["Python"] = platform.python_version()
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def warnings_of(dataset: Path, runs: Sequence[StageRun]) -> list[str]:
    """What the stages noticed and a reader should know."""
    sparse = [view for run in runs for view in run.figures.get("views_mostly_off_mesh", ())]
    warnings = []
    if sparse:
        warnings.append(f"More than half of the pixels miss the mesh in {', '.join(sorted(sparse))}.")
    warnings += [f"View {name} was rejected: {reason}." for name, reason in rejected_views(dataset).items()]
    for run in runs:
        warnings += [f"{run.stage}: {text}" for text in run.figures.get("warnings", ())]
    if any(run.stage == "fit" and run.figures.get("segments") == "none" for run in runs):
        warnings.append(
            "The fit ran without segments: roughness and metallic are unsure wherever no view sees a highlight."
        )
    return warnings
