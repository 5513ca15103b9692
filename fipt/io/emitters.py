"""emitters.npz for programs and emitters.json for people."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.io.arrays import load_npz, save_npz
from fipt.io.files import write_text
from fipt.io.meshes import Mesh


@dataclass(frozen=True)
class Emitters:
    """Emitting triangles of a room.

    Attributes
    ----------
    triangle
        (E,) int32 indices into the mesh.
    radiance
        (E, 3) float32.
    area
        (E,) float32 square metres.
    emitter
        (E,) int32 number of the connected patch (lamp).
    views
        (E,) int32 training views that see the patch.
    confidence
        (E,) float32 in [0, 1]: agreement and number of the pixels that see it.
    clipped
        (E,) float32 share of the patch's pixels that are clipped.
    lower_bound
        (E,) bool: its radiance comes from clipped pixels, and may be higher.
    two_sided
        Whether they shine from both sides.
    """

    triangle: np.ndarray
    radiance: np.ndarray
    area: np.ndarray
    emitter: np.ndarray
    views: np.ndarray
    confidence: np.ndarray
    clipped: np.ndarray
    lower_bound: np.ndarray
    two_sided: bool = True


_ARRAYS = ("triangle", "radiance", "area", "emitter", "views", "confidence", "clipped", "lower_bound")


def write_emitters(path: str | Path, emitters: Emitters, mesh: Mesh) -> None:
    """Write ``path`` (npz) and, beside it, the JSON for people."""
    lamps = []
    sides = 2 if emitters.two_sided else 1
    centers = mesh.corners.mean(axis=1)
    for number in range(int(emitters.emitter.max(initial=-1)) + 1):
        own = emitters.emitter == number
        area = emitters.area[own].astype(np.float64)
        radiance = (emitters.radiance[own] * area[:, None]).sum(0) / area.sum()
        lamps.append(
            {
                "index": number,
                "triangles": int(own.sum()),
                "area": float(area.sum()),
                "radiance": [float(v) for v in radiance],
                "power": [float(v) for v in sides * np.pi * area.sum() * radiance],
                "center": [float(v) for v in (centers[emitters.triangle[own]] * area[:, None]).sum(0) / area.sum()],
                "views": int(emitters.views[own].max()),
                "confidence": float(emitters.confidence[own].mean()),
                "clipped": float(emitters.clipped[own].mean()),
                "lower_bound": bool(emitters.lower_bound[own].any()),
            }
        )
    save_npz(
        path,
        two_sided=np.array(emitters.two_sided),
        **{name: getattr(emitters, name) for name in _ARRAYS},
    )
    content = {"two_sided": emitters.two_sided, "emitters": lamps}
    write_text(Path(path).with_suffix(".json"), json.dumps(content, indent=1) + "\n")


def read_emitters(path: str | Path) -> Emitters:
    """Read emitters.npz.

    Raises
    ------
    FiptError
        If it is missing, damaged or lacks an array.
    """
    arrays = load_npz(path)
    missing = [name for name in (*_ARRAYS, "two_sided") if name not in arrays]
    if missing:
        raise FiptError(f"{path} lacks {', '.join(missing)}", "run the emitters stage again")
    return Emitters(**{name: arrays[name] for name in _ARRAYS}, two_sided=bool(arrays["two_sided"]))
