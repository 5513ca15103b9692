"""Light that is lost towards the corners of all images: the same surface is then darker where it lies near a corner.

    log a_i(p) - log a_j(q) = k (r(p)^2 - r(q)^2) + what differs for all pixels of the two views + error

r is the distance from the principal point over half of the image's diagonal, and exp(k) the light that is left in the
corners. Gloss and noise have no side. k is told by weighted least squares, where outliers count little.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates

from fipt.render.scene import RayScene
from fipt.robust import deviation
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.check_poses.surface import ReducedView, visible
from fipt.stages.check_poses.verdict import Verdict, accepted_partners

_STEP = 3
"""One pixel in so many is looked at."""

_FEWEST = 1000
"""Pixels that must tell, in all."""

_LOST = 0.05
"""Share of light in the corners from which on it is said; sound rooms have up to 0.008."""

_ROUNDS = 20
"""Of weighting anew."""


def dark_corners(scene: RayScene, views: Sequence[ReducedView], verdicts: Sequence[Verdict]) -> list[RoomFinding]:
    """Say that images are darker, or brighter, towards their corners; nothing where they are not."""
    light = corner_light(scene, views, accepted_partners(verdicts))
    if light is None or abs(light - 1) < _LOST:
        return []
    return [
        RoomFinding(
            "vignetting",
            "warning",
            f"The corners of the images show {light:.2f} times the light that their middle shows of the same surface: "
            "vignetting, or its correction made twice.",
            Measure("light lost or won in the corners", abs(light - 1), _LOST),
            "Give images that are corrected once.",
        )
    ]


def corner_light(scene: RayScene, views: Sequence[ReducedView], partners: Sequence[Sequence[int]]) -> float | None:
    """Light in the corners of the images over that in their middle, exp(k); None where too little tells it.

    Parameters
    ----------
    partners
        Of each view the numbers of those it is compared with.
    """
    shared = [_compared(scene, views[i], views[j]) for i, others in enumerate(partners) for j in others]
    if sum(len(light) for light, _ in shared) < _FEWEST:
        return None
    light, radius = (np.concatenate(parts) for parts in zip(*shared, strict=True))
    slope = 0.0
    for _ in range(_ROUNDS):
        error = light - slope * radius
        scale = 1.5 * float(deviation(error)) + 1e-9
        weight = radius / (1 + (error / scale) ** 2) ** 2
        slope = float(weight @ light) / max(float(weight @ radius), 1e-9)
    return float(np.exp(slope))


def _compared(scene: RayScene, here: ReducedView, there: ReducedView) -> tuple[np.ndarray, np.ndarray]:
    """Differences (N,) of log luminance and of r^2 on what two views share, without what all of it has in common."""
    pixels, front, _ = visible(scene, here, there, np.flatnonzero(here.hit & here.valid)[::_STEP])
    where = [pixels[front, 1] - 0.5, pixels[front, 0] - 0.5]
    known = map_coordinates(there.valid.astype(np.float32), where, order=1, mode="nearest") > 0.99
    light = here.light.reshape(-1)[front] - map_coordinates(there.light, where, order=1, mode="nearest")
    radius = _radius(here).reshape(-1)[front] - map_coordinates(_radius(there), where, order=1, mode="nearest")
    light, radius = light[known], radius[known]
    return (light - np.median(light), radius - radius.mean()) if len(light) else (light, radius)


def _radius(view: ReducedView) -> np.ndarray:
    """(H, W) r^2 of a view's pixels."""
    camera = view.camera
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    return 4 * ((columns - camera.cx) ** 2 + (rows - camera.cy) ** 2) / (camera.width**2 + camera.height**2)
