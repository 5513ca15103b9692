"""Depth maps with their cameras and pictures, as what fuses them sees them."""

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.robust import deviation
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.depth_maps import DepthMap, read_depth_map

_SAMPLES = 2_000
"""Pixels of a view whose depth is compared with that of others: a deviation is then known to two percent."""
_PARTNERS = 4
"""Nearest other views that it is compared with."""
_SAME = 0.05
"""Share of its depth by which two views' depths of one surface may differ: above, one sees past the other."""
_BINS = 10
"""Parts of equal size, by confidence, whose noise is measured."""
_WORSE = 3.0
"""Noise, in that of the best part, above which depth is not believed where planes tell another."""
_FINEST = 0.05
"""Noise of depth that is assumed at least, in pixels of parallax over a baseline as long as the depth."""
_AVERAGED = 2.0
"""Noise of depth that is a mean of what several views say (confidence below 1), in that which is measured between these
views: they agree better than they are right. It is 5 times as large against the truth, outliers included; with 2 to 3
planes are found best."""


@dataclass(frozen=True)
class DepthView:
    """A view with its depth.

    Attributes
    ----------
    camera
        Of these pixels.
    map
        Its depth map.
    radiance
        (H, W, 3) float32 linear RGB.
    """

    camera: Camera
    map: DepthMap
    radiance: np.ndarray

    @cached_property
    def rays(self) -> np.ndarray:
        """(H, W, 3) float64 from the camera's centre to the points at depth 1 of the pixels' centres, world axes."""
        rows, columns = np.mgrid[: self.camera.height, : self.camera.width] + 0.5
        return self.camera.rays(columns, rows)

    @cached_property
    def points(self) -> np.ndarray:
        """(H, W, 3) float64 places of the pixels, metres; the camera's centre where the depth is unknown."""
        return self.camera.center + self.rays * self.map.depth[..., None]

    def confident(self, least: float) -> "DepthView":
        """Return the view without the depth of less confident pixels."""
        return self.without(self.map.confidence < least)

    def without(self, pixels: np.ndarray) -> "DepthView":
        """Return the view without the depth of (H, W) bool pixels."""
        keep = self.map.known & ~pixels
        return self.with_map(
            DepthMap(
                np.where(keep, self.map.depth, 0), np.where(keep, self.map.confidence, 0),
                np.where(keep[..., None], self.map.normal, 0),
            )
        )  # fmt: skip

    def with_map(self, changed: DepthMap) -> "DepthView":
        """Return the view with another depth map."""
        return replace(self, map=changed)


def pixels_of(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Row, column (0 where outside), depth and whether they are in the image, (N,) each, of (N, 3) points."""
    image, depth = camera.project(points)
    inside = (depth > 1e-6) & (image >= 0).all(axis=1) & (image < [camera.width, camera.height]).all(axis=1)
    column, row = np.where(inside[:, None], image, 0).astype(np.int64).T
    return row, column, depth, inside


@dataclass(frozen=True)
class DepthNoise:
    """How well depth is known.

    Attributes
    ----------
    at_1m
        Deviation of depth at one metre, metres: it grows with the square of the depth.
    confident
        Confidence above which that holds; below, depth is worse.
    """

    at_1m: float
    confident: float


def depth_noise(views: Sequence[DepthView], seed: int = 0) -> DepthNoise:
    """Measure noise: points of each view against the tangent planes that its nearest views have there."""
    rng = np.random.default_rng(seed)
    centers = np.array([view.camera.center for view in views])
    off, confidence = [np.zeros(0)], [np.zeros(0)]
    for view in views:
        row, column = np.nonzero(view.map.known)
        if len(row) == 0:
            continue
        some = rng.choice(len(row), min(_SAMPLES, len(row)), replace=False)
        row, column = row[some], column[some]
        near = np.argsort(np.linalg.norm(centers - view.camera.center, axis=1))
        for other in [views[number] for number in near if views[number] is not view][:_PARTNERS]:
            values, same, at = _off(view, row, column, other)
            off.append(values)
            confidence.append(np.minimum(view.map.confidence[row, column][same], other.map.confidence[at]))
    floor = _FINEST / float(np.median([view.camera.fx for view in views]))
    values, certain = np.concatenate(off), np.concatenate(confidence)
    if len(values) < _BINS**2:
        return DepthNoise(floor, 0.0)
    parts = np.array_split(np.argsort(certain, kind="stable"), _BINS)
    noise = np.array([deviation(values[part]) for part in parts])
    # the lowest confidence from which on no part is much worse than the best
    worse = np.flatnonzero(noise > _WORSE * max(noise.min(), floor))
    first = 0 if len(worse) == 0 else min(int(worse[-1]) + 1, _BINS - 1)
    good = np.concatenate(parts[first:])
    measured = float(deviation(values[good]))
    averaged = _AVERAGED if float(np.median(certain)) < 1 else 1.0
    return DepthNoise(max(averaged * measured, floor), float(certain[good].min()) if first else 0.0)


def _off(
    view: DepthView, row: np.ndarray, column: np.ndarray, other: DepthView
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Distances of pixels' points from the tangent planes that another view has there, in what one unit of noise makes.

    Also which (N,) bool pixels see the same surface, and where the other view sees them.
    """
    points = view.points[row, column]
    at_row, at_column, depth, inside = pixels_of(other.camera, points)
    normal, there = other.map.normal[at_row, at_column], other.map.depth[at_row, at_column]
    same = inside & (there > 0) & (np.abs(there - depth) < _SAME * depth) & ((normal**2).sum(axis=1) > 0.5)
    across = ((points - other.points[at_row, at_column]) * normal).sum(axis=1)
    # either depth moves its point along its ray
    own = view.map.depth[row, column] ** 2 * (view.rays[row, column] * normal).sum(axis=1)
    its = there**2 * (other.rays[at_row, at_column] * normal).sum(axis=1)
    values = np.abs(across[same]) / np.maximum(np.hypot(own, its)[same], 1e-12)
    return values, same, (at_row[same], at_column[same])


def read_views(dataset: Dataset, folder: Path, rejected: Container[str] = ()) -> list[DepthView]:
    """Read depth maps and pictures of the training views of a dataset, but for rejected ones.

    Raises
    ------
    FiptError
        If there is no training view, or a depth map is missing or not of its camera's size.
    """
    cameras = [camera for camera in dataset.cameras if camera.split == "train" and camera.name not in rejected]
    if not cameras:
        raise FiptError(f"{dataset.root} must have training views; it has none", "look at its views.json")
    views = []
    for camera in cameras:
        path = folder / f"{camera.name}.exr"
        found = read_depth_map(path)
        if found.depth.shape != (camera.height, camera.width):
            raise FiptError(
                f"{path} must be {camera.width}x{camera.height} like its view; it is "
                f"{found.depth.shape[1]}x{found.depth.shape[0]}",
                "make the depth maps of these views",
            )
        views.append(DepthView(camera, found, dataset.image(camera.name)[0]))
    return views
