"""The first section of the page: what is wrong with the run, and what to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.scene.findings import read_findings, read_measured
from fipt.stages.report.images import EmbeddedImage, embedded

_WIDTH = 960
"""Of a picture, pixels: several images stand side by side in it."""
_LISTED = 6
"""Of what a finding is about, in the page; findings.json has all."""


@dataclass(frozen=True)
class ListedFinding:
    """A finding in words, with its picture."""

    severity: str
    cause: str
    remedy: str
    measure: str
    where: str
    image: EmbeddedImage | None


@dataclass(frozen=True)
class FindingsReport:
    """Findings, worst first, and every measure in words."""

    rows: Sequence[ListedFinding]
    measured: Sequence[str]


def read_room_findings(results: Path) -> FindingsReport | None:
    """Read findings.json of a results folder; None where the stage has not run."""
    path = results / "findings.json"
    if not path.is_file():
        return None
    rows = [
        ListedFinding(
            found.severity,
            found.cause,
            found.remedy,
            found.measure.text,
            _where(found.where),
            _embedded(results / found.file) if found.file else None,
        )
        for found in read_findings(path)
    ]
    return FindingsReport(rows, [measure.text for measure in read_measured(path)])


def _where(where: Mapping[str, Any]) -> str:
    texts = []
    for name, value in where.items():
        if name == "position":
            texts.append("near (" + ", ".join(f"{v:.2f}" for v in value) + ") m")
        else:
            more = f" and {len(value) - _LISTED} more" if len(value) > _LISTED else ""
            texts.append(f"{name} {', '.join(map(str, value[:_LISTED]))}{more}")
    return "; ".join(texts)


def _embedded(path: Path) -> EmbeddedImage | None:
    if not path.is_file():
        return None
    from PIL import Image

    with Image.open(path) as image:
        pixels = np.array(image.convert("RGB"))
    return EmbeddedImage("finding", "What tells it", *embedded(pixels, _WIDTH))
