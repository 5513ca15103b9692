"""findings.json: what is wrong with a run, why, and what to do; for programs, the report and the command line."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import existing_file, write_text
from fipt.formats.text import MALFORMED

SEVERITIES = ("serious", "warning")
"""Worst first. With a serious finding the results are not to be trusted."""


@dataclass(frozen=True)
class Measure:
    """A number that tells a finding: what it is, its value, and the threshold that it crossed, in one unit.

    The unit is put behind the number; ``%`` stands for shares, whose values are in [0, 1].
    """

    name: str
    value: float
    threshold: float
    unit: str = "%"

    @property
    def text(self) -> str:
        """The measure in words."""
        return f"{self.name}: {_shown(self.value, self.unit)} (told from {_shown(self.threshold, self.unit)})"


@dataclass(frozen=True)
class RoomFinding:
    """Something that is wrong with a run.

    Attributes
    ----------
    id
        Which check found what, stable over versions.
    severity
        One of `SEVERITIES`.
    cause
        One plain sentence.
    measure
        The number that tells it.
    remedy
        What a person can do.
    where
        Views, ``position`` (metres), ``segments`` or ``triangles`` where it shows; plain JSON types.
    numbers
        More numbers by name.
    file
        File of its picture, relative to findings.json; None: there is none.
    image
        (H, W, 3) uint8 picture before it is written.
    """

    id: str
    severity: str
    cause: str
    measure: Measure
    remedy: str
    where: Mapping[str, Any] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    file: str | None = None
    image: np.ndarray | None = None

    @property
    def headline(self) -> str:
        """One line for the command line."""
        return f"{self.severity}: {self.cause} {self.remedy}"

    @property
    def row(self) -> dict[str, Any]:
        """The finding as plain JSON types."""
        return {
            "id": self.id,
            "severity": self.severity,
            "cause": self.cause,
            "measure": vars(self.measure),
            "remedy": self.remedy,
            "where": dict(self.where),
            "numbers": dict(self.numbers),
            "file": None if self.image is None else f"findings/{self.id}.png",
        }


def write_findings(path: Path, findings: Sequence[RoomFinding], measured: Mapping[str, tuple[Measure, float]]) -> None:
    """Write findings.json, in the order given.

    Parameters
    ----------
    measured
        Id of a finding that a check might have made -> the measure and its standard error, also where nothing is wrong.
        An error of infinity, of a single view for example, is written as null.
    """
    looked = {
        key: vars(measure) | {"error": error if np.isfinite(error) else None}
        for key, (measure, error) in measured.items()
    }
    content = {"findings": [finding.row for finding in findings], "measured": looked}
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def read_findings(path: str | Path) -> list[RoomFinding]:
    """Read findings.json, or another file that has findings.

    Raises
    ------
    FiptError
        If it is missing or damaged.
    """
    content = existing_file(path, "the findings").read_text(encoding="utf-8")
    try:
        rows = json.loads(content)["findings"]
        return [RoomFinding(**{**row, "measure": Measure(**row["measure"])}) for row in rows]
    except MALFORMED as error:
        raise FiptError(f"{path} is not a list of findings ({error!r})", "run what wrote it again") from error


def read_measured(path: str | Path) -> list[Measure]:
    """Read every measure of findings.json, also where nothing is wrong; errors as of `read_findings`."""
    content = existing_file(path, "the findings").read_text(encoding="utf-8")
    try:
        rows = json.loads(content)["measured"].values()
        return [Measure(row["name"], row["value"], row["threshold"], row["unit"]) for row in rows]
    except MALFORMED as error:
        raise FiptError(f"{path} is not a list of findings ({error!r})", "run fipt findings again") from error


def _shown(value: float, unit: str) -> str:
    if unit == "%":
        return f"{100 * value:.3g} %"
    return f"{value:.3g} {unit}".rstrip()
