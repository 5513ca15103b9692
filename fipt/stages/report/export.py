"""What the page says of the exported room: how near each file, loaded back, comes to our pictures."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED

_LABELS = {"glb": "glTF", "usd": "USD", "mitsuba": "Mitsuba, principled", "exact": "Mitsuba, our reflectance"}


@dataclass(frozen=True)
class ExportedFile:
    """One file: kind, heading, path in the folder; PSNR against our pictures (by view, too) and photographs."""

    kind: str
    label: str
    file: str
    psnr: float
    photo: float
    views: Mapping[str, float]


@dataclass(frozen=True)
class ExportCheck:
    """export/check.json: the PSNR that is aimed at, that of our own pictures against the photographs, every file."""

    goal: float
    ours_photo: float
    files: Sequence[ExportedFile]


def read_check(path: Path) -> ExportCheck | None:
    """Read export/check.json; None where there is none.

    Raises
    ------
    FiptError
        If it is damaged.
    """
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        files = [
            ExportedFile(
                kind,
                str(_LABELS.get(kind, kind)),
                str(entry["file"]),
                float(entry["psnr"]),
                float(entry["photo"]),
                {view: float(value) for view, value in entry["views"].items()},
            )
            for kind, entry in content["formats"].items()
        ]
        return ExportCheck(float(content["goal"]), float(content["ours_photo"]), files)
    except MALFORMED as error:
        raise FiptError(f"{path} is not the check of an export ({error!r})", "run fipt check-export again") from error
