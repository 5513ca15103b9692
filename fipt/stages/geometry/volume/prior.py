"""Predicted depth, of any scale and shift, brought to the depth that is known of each view."""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.given_depth import nearest_pixels, read_values
from fipt.stages.geometry.settings import given_file

log = logging.getLogger(__name__)

_LEAST = 50
"""Known pixels of a view that scale and shift are solved with."""
_ROUNDS = 20
"""Solutions by least squares, each with weights of the last: their limit is that of least absolute difference."""
_NORMAL = ("normal.X", "normal.Y", "normal.Z")
_METRES = 1.0
"""Of a unit of a PNG: its scale is solved."""


def with_prior(views: Sequence[DepthView], folder: Path) -> list[DepthView]:
    """Views with predicted depth and normals in place of their own; a view of which too little is known has no depth.

    Predicted depth may be negative, since its scale and shift are solved; 0 and what is not finite is unknown.

    Raises
    ------
    FiptError
        If a file is missing, of another shape than its view, or depth falls where that of the view grows.
    """
    found, bare = [], []
    for view in views:
        path = given_file(folder, view.camera.name)
        if not path.is_file():
            raise FiptError(f"geometry.prior must hold VIEW.exr or VIEW.png of every view; {path} is missing", "add it")
        prior = nearest_pixels(read_values(view.camera, path, _METRES), view.camera.height, view.camera.width)
        predicted = np.isfinite(prior) & (prior != 0)
        normal = _normals(path, view) if path.suffix.lower() == ".exr" else np.zeros((*prior.shape, 3), np.float32)
        both = view.map.known & predicted
        if both.sum() < _LEAST:
            bare.append(view.camera.name)
            empty = np.zeros_like(view.map.depth)
            found.append(view.with_map(DepthMap(empty, empty, normal)))
            continue
        scale, shift = scale_and_shift(prior[both], view.map.depth[both], view.map.confidence[both])
        if scale <= 0:
            raise FiptError(
                f"{path} must be depth, which grows with the distance; that of known pixels falls",
                "invert it if it is inverse depth, or check that it shows this view",
            )
        depth = np.maximum(np.where(predicted, scale * prior + shift, 0), 0).astype(np.float32)
        found.append(view.with_map(DepthMap(depth, (depth > 0).astype(np.float32), normal)))
    if bare:
        log.warning("predicted depth of %s is left out: nothing is known that it could be brought to", ", ".join(bare))
    return found


def scale_and_shift(prior: np.ndarray, depth: np.ndarray, confidence: np.ndarray) -> tuple[float, float]:
    """Scale and shift that bring (N,) predicted depth to (N,) known depth: least absolute difference, by confidence."""
    columns = np.stack([prior, np.ones_like(prior)], axis=1).astype(np.float64)
    weight, solution = confidence.astype(np.float64), np.zeros(2)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        solution = np.linalg.lstsq(columns * root[:, None], depth * root, rcond=None)[0]
        weight = confidence / np.maximum(np.abs(columns @ solution - depth), 1e-3)
    return float(solution[0]), float(solution[1])


def _normals(path: Path, view: DepthView) -> np.ndarray:
    """(H, W, 3) float32 unit world normals of a file, 0 where it has none."""
    channels = read_exr(path)
    if not all(name in channels for name in _NORMAL):
        return np.zeros((*view.map.depth.shape, 3), np.float32)
    normal = np.stack([channels[name] for name in _NORMAL], axis=-1).astype(np.float32)
    if normal.shape != view.radiance.shape:
        raise FiptError(
            f"normals of {path} must have the size of their view, {view.camera.width}x{view.camera.height}; they are "
            f"{normal.shape[1]}x{normal.shape[0]}",
            "resample them",
        )
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    good = np.isfinite(length) & (length > 0.5)
    return np.where(good, normal / np.where(good, length, 1), 0).astype(np.float32)
