"""What the join of segments found of its parts: which are metal, and which are not. metals.json beside ids.

A join pools evidence that no part has alone: other regions prove the metal, or its colour does.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.text import MALFORMED, read_json
from fipt.scene.segments import LARGEST_ID

METALS = "metals.json"
"""Name of the file beside the ids."""

_REMEDY = "run the join of segments again"


@dataclass(frozen=True)
class JudgedMetals:
    """Judgement about parts, by id from 1; of those in neither nothing is known.

    Attributes
    ----------
    roughness
        Parts that are metal -> their roughness in [0, 1].
    dielectric
        Parts that are no metal, or of which no pixel tells: nothing may prove a metal there.
    """

    roughness: Mapping[int, float] = field(default_factory=dict)
    dielectric: frozenset[int] = frozenset()


def write_metals(folder: str | Path, metals: JudgedMetals) -> None:
    """Write a judgement into a folder of segment ids."""
    roughness = {str(part): float(value) for part, value in sorted(metals.roughness.items())}
    content = {"roughness": roughness, "dielectric": sorted(metals.dielectric)}
    write_text(Path(folder) / METALS, json.dumps(content, indent=1) + "\n")


def read_metals(path: str | Path) -> JudgedMetals:
    """Read metals.json.

    Raises
    ------
    FiptError
        If the file is damaged or missing.
    """
    content = read_json(path, "the metals among segments", _REMEDY)
    try:
        roughness = {int(part): value for part, value in content["roughness"].items()}
        dielectric = frozenset(content["dielectric"])
        numbers = all(type(value) is float and 0 <= value <= 1 for value in roughness.values())
        parts = all(type(part) is int and 0 < part <= LARGEST_ID for part in (*roughness, *dielectric))
        if not numbers or not parts or dielectric & set(roughness):
            raise ValueError("parts from 1 to 65535, each once, and of metals a roughness in [0, 1]")
    except MALFORMED as error:
        raise FiptError(f"{path} is damaged ({error!r})", _REMEDY) from error
    return JudgedMetals(roughness, dielectric)
