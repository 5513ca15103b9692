"""Distortion and vignetting by a lens's name, from lensfun's database (which lensfunpy carries)."""

from __future__ import annotations

from typing import Any

import numpy as np

from fipt.scene.lens import Lens
from fipt.stages.capture.calibration import Vignetting
from fipt.stages.capture.raw import Shot

_GRID = 48
"""Points along the longer side at which lensfun's models are sampled."""


def find_lens(shot: Shot, width: int, height: int, distance: float) -> tuple[str, Lens, Vignetting | None] | None:
    """Return name, lens and vignetting of a shot's lens; None where lensfun does not know camera, lens or distortion.

    Lensfun has several models of distortion; they are sampled and brought to Brown-Conrady's radial terms, and its
    vignetting to our polynomial, so that everything after sees one model.

    Parameters
    ----------
    shot
        With the names of camera and lens, focal length and aperture.
    width, height
        Size of the photographs in pixels: the full frame, before any crop.
    distance
        Focus distance in metres; vignetting depends on it.
    """
    import lensfunpy

    if not (shot.camera and shot.lens and shot.focal_length):
        return None
    database = lensfunpy.Database()
    cameras = _cameras(database, shot.camera)
    lenses = database.find_lenses(cameras[0], None, shot.lens) if cameras else []
    if not lenses:
        return None
    lens, crop = lenses[0], cameras[0].crop_factor
    # Focal lengths are in millimetres on a sensor whose diagonal is that of 36 x 24 mm over the crop factor.
    focal = shot.focal_length / (np.hypot(36, 24) / crop) * np.hypot(width, height)
    modifier = lensfunpy.Modifier(lens, crop, width, height)
    flags = lensfunpy.ModifyFlags
    modifier.initialize(
        shot.focal_length,
        shot.aperture or 8.0,
        distance,
        scale=1.0,
        pixel_format=np.float32,
        flags=flags.DISTORTION | flags.VIGNETTING,
    )
    found = modifier.apply_geometry_distortion()
    if found is None:
        return None
    step = max(1, max(width, height) // _GRID)
    map_ = found[::step, ::step].astype(np.float64)
    rows, columns = np.mgrid[0:height:step, 0:width:step]
    x, y = (columns - (width - 1) / 2) / focal, (rows - (height - 1) / 2) / focal
    x_d, y_d = (map_[..., 0] - (width - 1) / 2) / focal, (map_[..., 1] - (height - 1) / 2) / focal
    r2 = x * x + y * y
    powers = np.stack([r2**0, r2, r2**2, r2**3], axis=-1)
    design = np.concatenate([(x[..., None] * powers).reshape(-1, 4), (y[..., None] * powers).reshape(-1, 4)])
    factors = np.linalg.lstsq(design, np.concatenate([x_d.ravel(), y_d.ravel()]), rcond=None)[0]
    # Lensfun's models may scale the middle of the image; in ours that is the focal length.
    scale, (k1, k2, k3) = factors[0], (factors[1:] / factors[0]).tolist()
    f = float(focal * scale)
    result = Lens(width, height, f, f, width / 2, height / 2, (k1, k2, 0.0, 0.0, k3))
    return f"{lens.maker} {lens.model}", result, _vignetting(modifier, width, height)


def _cameras(database: Any, name: str) -> list[Any]:
    """Entries of a camera by the name that photographs give: maker and model.

    Many makers repeat their name in the model ("Canon", "Canon EOS 5D Mark III"), which `fipt.stages.capture.raw` says
    once; some have names of several words ("NIKON CORPORATION").
    """
    words = name.split(" ")
    for count in range(1, len(words)):
        for model in (" ".join(words[count:]), name):
            found = database.find_cameras(" ".join(words[:count]), model)
            if found:
                return found
    return []


def _vignetting(modifier: Any, width: int, height: int) -> Vignetting | None:
    """Lensfun's correction, applied to ones, as a polynomial of the falloff."""
    gain = np.ones((height, width, 3), np.float32)  # lensfun corrects in place, contiguous float32 only
    if not modifier.apply_color_modification(gain):
        return None
    radius = np.hypot(width, height) / 2
    step = max(1, max(width, height) // _GRID)
    rows, columns = np.mgrid[0:height:step, 0:width:step] + 0.5
    r2 = (((columns - width / 2) ** 2 + (rows - height / 2) ** 2) / radius**2).ravel()
    light = 1 / gain[::step, ::step, 1].ravel().astype(np.float64)
    powers = np.stack([r2, r2**2, r2**3, r2**4], axis=-1)
    coefficients = np.linalg.lstsq(powers, light - 1, rcond=None)[0]
    return Vignetting((width / 2, height / 2), float(radius), tuple(coefficients.tolist()))
