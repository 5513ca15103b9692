"""What a view, reduced, shows of the mesh, and where another camera sees the same surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.scene.blocks import block_mean
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset

_GRAZING = 0.15
"""Cosine between surface and view, at least."""

_OFFSET = 0.02
"""Distances that differ by less than this share are of one surface."""

_SCAN = 400
"""Pixels of a view by which the views are found that share most with it."""


@dataclass(frozen=True)
class ReducedView:
    """A view, reduced, and what its pixels show.

    Attributes
    ----------
    camera
        Of the reduced view.
    light
        (H, W) float32 log luminance.
    valid
        (H, W) bool.
    points
        (H, W, 3) float32 footprint samples.
    hit
        (H, W) bool: whether there is one that is not seen at a grazing angle.
    normals
        (H, W, 3) float32 of the surface, turned to the camera.
    color
        (H, W, 2) float32 logs of red over blue, and of green over the geometric mean of both.
    """

    camera: Camera
    light: np.ndarray
    valid: np.ndarray
    points: np.ndarray
    hit: np.ndarray
    normals: np.ndarray
    color: np.ndarray


def shown_views(scene: RayScene, dataset: Dataset, width: int) -> list[ReducedView]:
    """All views of a dataset, reduced to at most ``width`` columns."""
    views = []
    with progress("check poses: footprint samples", len(dataset.cameras), " views") as bar:
        for camera in dataset.cameras:
            views.append(surface_shown(scene, *reduced(dataset, camera, width)))
            bar.advance(1, camera.name)
    return views


def visible(
    scene: RayScene, here: ReducedView, there: ReducedView, index: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where another camera sees footprint samples of a view.

    Parameters
    ----------
    index
        Which pixels of ``here``, flat.

    Returns
    -------
    pixels
        (H W, 2) image coordinates in ``there``; NaN for pixels that were not asked for.
    front, back
        Flat pixels of ``here`` whose surface ``there`` sees from the same side, and from the other one.
    """
    points = here.points.reshape(-1, 3)[index].astype(np.float64)
    projected, depth = there.camera.project(points)
    size = (there.camera.width, there.camera.height)
    inside = (depth > 1e-6) & ((projected > 0) & (projected < size)).all(axis=1)
    index, points = index[inside], points[inside]
    pixels = np.full((here.hit.size, 2), np.nan)
    pixels[index] = projected[inside]
    if len(index) == 0:
        return pixels, index, index
    center = there.camera.center
    away = points - center
    distance = np.linalg.norm(away, axis=1)
    away /= np.maximum(distance, 1e-9)[:, None]
    found, _ = scene.intersect(center.astype(np.float32), away.astype(np.float32))
    reached = np.abs(found - distance) < _OFFSET * distance
    cosine = -(here.normals.reshape(-1, 3)[index] * away).sum(axis=1)
    return pixels, index[reached & (cosine > _GRAZING)], index[reached & (cosine < -_GRAZING)]


def shared_pixels(scene: RayScene, views: Sequence[ReducedView]) -> tuple[np.ndarray, np.ndarray]:
    """(V, V) shares of each view's pixels that each other one shows, and (V,) most that one shows from behind only."""
    shared = np.zeros((len(views), len(views)))
    behind = np.zeros(len(views))
    for i, here in enumerate(views):
        hit = np.flatnonzero(here.hit)
        some = hit[:: max(len(hit) // _SCAN, 1)]
        for j, there in enumerate(views):
            if i != j and len(some):
                _, front, back = visible(scene, here, there, some)
                shared[i, j] = len(front) / len(some)
                behind[i] = max(behind[i], len(back) / len(some))
    return shared, behind


def reduced(dataset: Dataset, camera: Camera, width: int) -> tuple[Camera, np.ndarray, np.ndarray, np.ndarray]:
    """Camera, log luminance, mask and colour of a view, reduced by whole blocks to at most ``width`` columns.

    A view that is lower than such a block keeps one row, and more columns.
    """
    image, weight = dataset.image(camera.name)
    block = min(-(-camera.width // width), camera.height)
    share = block_mean(weight > 0, block)
    valid = share > 0.5
    means = block_mean(image, block) / np.maximum(share, 1e-6)[..., None]  # masked pixels are black
    light = means @ np.array(LUMINANCE, np.float32)
    least = 1e-3 * max(float(np.median(light[valid])) if valid.any() else 1.0, 1e-6)
    red, green, blue = np.moveaxis(np.log(np.maximum(means, least)), -1, 0)
    color = np.stack([red - blue, green - 0.5 * (red + blue)], axis=-1).astype(np.float32)
    return camera.reduced(block), np.log(np.maximum(light, least)).astype(np.float32), valid, color


def surface_shown(
    scene: RayScene, camera: Camera, light: np.ndarray, valid: np.ndarray, color: np.ndarray
) -> ReducedView:
    """Trace the pixel centres of a reduced view."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns, rows).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center, directions)
    normals = scene.normals[triangle]
    cosine = -(normals * directions).sum(axis=1)
    hit = (triangle >= 0) & (np.abs(cosine) > _GRAZING)
    points = camera.center + np.where(hit, distance, 0.0)[:, None] * directions
    normals = normals * np.sign(cosine)[:, None]
    shape = light.shape
    return ReducedView(
        camera, light, valid, points.reshape(*shape, 3).astype(np.float32), hit.reshape(shape),
        normals.reshape(*shape, 3).astype(np.float32), color,
    )  # fmt: skip
