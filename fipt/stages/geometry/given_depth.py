"""Depth maps that exist: of a depth camera or a laser scanner, checked through the cameras of the views."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.images import read_pixels
from fipt.scene.cameras import Camera
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.depth_views import DepthView, pixels_of
from fipt.stages.geometry.stereo_view import StereoView, noise_of, normals_of

log = logging.getLogger(__name__)

_CHANNELS = ("depth", "Z", "Y", "R", "V")
"""Channels of an EXR file that hold depth, the first of them that is there."""
_WINDOWS = (4, 2, 1)
"""Half sides of the windows that a normal is fitted in, pixels; the largest that shows one surface."""
_SURFACE = 0.01
"""Share of its depth by which pixels lie off the plane of a window that shows one surface, root mean square."""
_NOISY = 1.5
"""The same in the noise of the depth map, where that is more."""
_SAME = 0.05
"""Share of its depth by which two views' depths of one place may differ."""
_AGREE = 0.5
"""Share of the pixels that other views know, of which they must say the same."""
_EVERY = 8
"""Pixels along a row and a column of which one is carried into other views; fewer in small maps."""
_FARTHEST = 1000.0
"""Metres from which on depth is that of no surface: a renderer's 65504 or 1e10 where nothing is."""
_STEEPEST = 2.0
"""Depths of a plane within one pixel of its map, the farther one over the nearer one, up to which it is believed."""
_UNITS = (1e-3, 1e-2, 0.1, 0.3048, 10.0, 100.0, 1000.0)
"""Factors of units that are often taken for each other."""


def given_maps(
    views: Sequence[StereoView], shown: Sequence[np.ndarray], files: Mapping[str, Path], unit: float
) -> Iterator[tuple[str, DepthMap]]:
    """Read the depth maps of views, and give each pixel its normal.

    Parameters
    ----------
    shown
        (H, W) bool of each view: pixels that show the room; the depth of others is unknown.
    files
        View -> EXR in metres, or PNG of 16 bits in units of ``unit`` metres; depth along the viewing axis, 0 where
        unknown.

    Raises
    ------
    FiptError
        If a map is missing, of another shape than its view, or the maps of several views contradict each other or show
        nothing in common.
    """
    depths, cameras = [], []
    for view, counts in zip(views, shown, strict=True):
        values = read_values(view.camera, files[view.camera.name], unit)
        known = np.isfinite(values) & (values > 0) & nearest_pixels(counts, *values.shape)
        depths.append(np.where(known, values, 0))
        cameras.append(_camera_of(view, values))
    check_agreement(cameras, depths)
    for view, depth, counts in zip(views, depths, shown, strict=True):
        yield view.camera.name, _continued(view, _near(depth), counts)


def read_values(camera: Camera, path: Path, unit: float) -> np.ndarray:
    """(h, w) float32 values of a view's depth map at its own size, metres; a map is at most as large as its view."""
    if path.suffix.lower() == ".exr":
        channels = read_exr(path)
        name = next((name for name in _CHANNELS if name in channels), None)
        if name is None:
            raise FiptError(
                f"{path} must have one of the channels {', '.join(_CHANNELS)}; it has {', '.join(sorted(channels))}",
                "export depth under one of these names",
            )
        depth = channels[name].astype(np.float32)
    else:
        pixels = read_pixels(path, f"the depth of {camera.name}: EXR or PNG")
        if pixels.ndim != 2 or pixels.dtype.itemsize < 2:
            raise FiptError(f"{path} must be a grey PNG of 16 bits; it is {pixels.dtype}", "export it with 16 bits")
        depth = (pixels * unit).astype(np.float32)
    rows, columns = depth.shape
    if abs(columns / rows - camera.width / camera.height) > 1 / min(rows, columns):
        raise FiptError(
            f"{path} must have the shape of its view, {camera.width}x{camera.height} or smaller in proportion; it is "
            f"{columns}x{rows}",
            "crop it like the view",
        )
    return depth


def nearest_pixels(values: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """(rows, columns, ...) image of another size: each pixel takes the one of (h, w, ...) that holds its centre."""
    row = (np.arange(rows) + 0.5) * values.shape[0] / rows
    column = (np.arange(columns) + 0.5) * values.shape[1] / columns
    return values[row.astype(np.int64)[:, None], column.astype(np.int64)]


def check_agreement(cameras: Sequence[Camera], depths: Sequence[np.ndarray]) -> None:
    """Raise FiptError where views do not show the same surface: another unit, another room, other cameras.

    Where no view has depth of a room, that is told; where one alone has, nothing can be compared: that is a warning.
    """
    agree = _agreement(cameras, depths)
    if agree >= _AGREE:
        return
    known = [camera.name for camera, depth in zip(cameras, depths, strict=True) if depth.any()]
    if not known:
        raise FiptError(
            "the depth maps must hold depth; it is 0 or not finite in every pixel that shows the room",
            "check how they were exported, and the masks of the views",
        )
    near = any(_near(depth).any() for depth in depths)
    if len(known) == 1 and near:
        log.warning("%s alone has depth: no other view can tell whether it is right, or in metres", known[0])
        return
    in_units = {unit: _agreement(cameras, [depth * np.float32(unit) for depth in depths]) for unit in _UNITS}
    factor, better = max(in_units.items(), key=lambda item: np.nan_to_num(item[1]))
    if better >= _AGREE:
        remedy = f"depth is {1 / factor:g} times too large for metres: set depth.unit, or export metres"
    elif not near:
        remedy = "set depth.unit, or export metres"
    elif np.isnan(agree):
        remedy = "check the cameras, or give depth of views that overlap"
    else:
        remedy = "check that they are of these views, and depth along the viewing axis"
    if not near:
        nearest = min(float(depth[depth > 0].min()) for depth in depths if depth.any())
        found = f"all of it is beyond {_FARTHEST:g} m, the nearest at {nearest:.4g} m"
    elif np.isnan(agree):
        found = "no view shows surface of another"
    else:
        found = f"other views confirm {agree:.0%} of their pixels"
    raise FiptError(f"the depth maps must show one room through these cameras; {found}", remedy)


def _agreement(cameras: Sequence[Camera], depths: Sequence[np.ndarray]) -> float:
    """Share of pixels that another view confirms, of those where another view knows a depth; NaN where none does."""
    black = np.zeros((1, 1, 3), np.float32)
    views = [
        DepthView(camera, DepthMap(depth, depth, np.zeros((*depth.shape, 3), np.float32)), black)
        for camera, depth in zip(cameras, map(_near, depths), strict=True)
    ]
    known, same = 0, 0
    for view in views:
        every = min(_EVERY, max(1, min(view.map.depth.shape) // _EVERY))
        some = np.s_[every // 2 :: every, every // 2 :: every]
        points = view.points[some][view.map.known[some]]
        seen, right = np.zeros(len(points), bool), np.zeros(len(points), bool)
        for other in views:
            if other is not view:
                row, column, depth, inside = pixels_of(other.camera, points)
                there = other.map.depth[row, column]
                inside &= there > 0
                seen |= inside
                right |= inside & (np.abs(there - depth) < _SAME * depth)
        known, same = known + int(seen.sum()), same + int(right.sum())
    return same / known if known else np.nan


def _near(depth: np.ndarray) -> np.ndarray:
    """Depth without what is no surface of a room, but what a renderer writes where nothing is."""
    return np.where(depth <= _FARTHEST, depth, 0)


def _camera_of(view: StereoView, depth: np.ndarray) -> Camera:
    """Camera of a view whose pixels are those of its depth map (h, w)."""
    return view.camera.resized(depth.shape[1], depth.shape[0])


def _continued(view: StereoView, depth: np.ndarray, shown: np.ndarray) -> DepthMap:
    """Depth map of a view of (h, w) depth, 0 where unknown: pixels lie on the plane that the map has around them.

    Pixels that do not show the room, (H, W) bool, are unknown.
    """
    small = StereoView(_camera_of(view, depth), depth, 0.0)
    normal = _normals(small, depth)
    offset = depth * ((normal @ view.rotation.T) * small.rays).sum(axis=-1)  # of the plane: normal . point
    normal, offset, depth = (
        nearest_pixels(values, view.camera.height, view.camera.width) for values in (normal, offset, depth)
    )
    facing = ((normal @ view.rotation.T) * view.rays).sum(axis=-1)
    here = np.divide(offset, facing, out=np.zeros_like(facing), where=facing < 0)
    known = shown & (here > depth / _STEEPEST) & (here < depth * _STEEPEST)
    return DepthMap(
        np.where(known, here, 0).astype(np.float32), known.astype(np.float32), np.where(known[..., None], normal, 0)
    )


def _normals(view: StereoView, depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32 world normals: planes fitted to inverse depth in windows; 0 where no window shows a surface."""
    import cv2

    known = (depth > 0).astype(np.float64)
    q = np.where(depth > 0, 1 / np.where(depth > 0, depth, 1), 0.0).astype(np.float64)
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]].astype(np.float64)
    result = np.zeros((*depth.shape, 3), np.float32)
    noise = noise_of(np.where(depth > 0, depth, np.nan))  # metres
    within = np.maximum(_SURFACE * q, _NOISY * noise * q * q)
    for half in _WINDOWS:
        size = (2 * half + 1, 2 * half + 1)

        def mean(values: np.ndarray, size: tuple[int, int] = size) -> np.ndarray:
            return cv2.boxFilter(values * known, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)

        count = np.maximum(mean(known), 1)
        mu, mv, mq = mean(u) / count, mean(v) / count, mean(q) / count
        uu, vv, uv = mean(u * u) / count - mu**2, mean(v * v) / count - mv**2, mean(u * v) / count - mu * mv
        uq, vq = mean(u * q) / count - mu * mq, mean(v * q) / count - mv * mq
        spread = mean(q * q) / count - mq**2
        determinant = uu * vv - uv * uv
        flat = np.where(determinant > 0.05, determinant, 1.0)
        along_u, along_v = (uq * vv - vq * uv) / flat, (vq * uu - uq * uv) / flat
        off = np.sqrt(np.maximum(spread - along_u * uq - along_v * vq, 0))
        fits = (known > 0) & (determinant > 0.05) & (off < within) & ~result.any(axis=-1)
        planes = np.stack([mq + along_u * (u - mu) + along_v * (v - mv), along_u, along_v])
        result[fits] = normals_of(view, planes)[fits]
    return result
