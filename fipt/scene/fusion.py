"""Fused segments on disk: ids of every triangle, ids of every view, and what each segment is."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.files import existing_file, write_text
from fipt.formats.text import MALFORMED

_ARRAYS = ("part", "semantic", "agreement", "seen", "split")
_FORMS: dict[str, str] = dict(zip(_ARRAYS, ("number T", "number T", "share T", "amount T", "bool T"), strict=True))


@dataclass(frozen=True)
class Fusion:
    """Segments of the T triangles of the room's mesh.

    Attributes
    ----------
    part, semantic
        (T,) uint16 ids, 0 = unknown; a triangle that is split has the id of most of its area.
    agreement
        (T,) float32 share of the votes on the triangle that its id (of each of its cells) got; 0 where none voted.
    seen
        (T,) float32 area that votes, square metres.
    split
        (T,) bool: a segment ends inside the triangle.
    """

    part: np.ndarray
    semantic: np.ndarray
    agreement: np.ndarray
    seen: np.ndarray
    split: np.ndarray


def write_fusion(path: str | Path, fusion: Fusion, about: dict[str, Any]) -> None:
    """Write fusion.npz, and ``about`` (segments, figures, settings) as JSON beside it."""
    path = Path(path)
    save_npz(path, **{name: getattr(fusion, name) for name in _ARRAYS})
    write_text(path.with_suffix(".json"), json.dumps(about, indent=1) + "\n")


def read_fusion(path: str | Path) -> tuple[Fusion, dict[str, Any]]:
    """Read what `write_fusion` wrote.

    Raises
    ------
    FiptError
        If a file is missing or damaged.
    """
    path = Path(path)
    arrays = load_npz(path, forms=_FORMS)
    about = existing_file(path.with_suffix(".json"), "the list of fused segments")
    try:
        return Fusion(**{name: arrays[name] for name in _ARRAYS}), json.loads(about.read_text(encoding="utf-8"))
    except MALFORMED as error:
        raise FiptError(f"{about} is not JSON ({error})", "run fipt fuse again") from error
