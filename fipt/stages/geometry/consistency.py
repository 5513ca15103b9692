"""What the depth maps of several views agree on: each pixel is carried into other views and back."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.stereo_view import StereoView, normals_of, transfer

_PIXELS = 1.0
"""Pixels by which a point may miss itself when it comes back: what correlation tells at worst."""
_DEPTH = 0.01
"""Share of its depth by which it may differ: pixels tell nothing of depth along a short baseline. (Both as Yao et al.
2018 have it.)"""
_TURN = 0.8
"""Cosine between the normals of two views, at least (37 degrees): normals of small windows are rough."""


@dataclass(frozen=True)
class Matched:
    """A view with its planes, before others were asked.

    Attributes
    ----------
    view
        The view.
    planes
        (3, H, W) float32: inverse depth and its slopes along u and v.
    score
        (H, W) float32 correlation, -1 to 1.
    """

    view: StereoView
    planes: np.ndarray
    score: np.ndarray


def agreed(
    matched: Sequence[Matched], sources: Sequence[Sequence[int]], index: int, least: int, correlation: float
) -> DepthMap:
    """Depth that at least ``least`` other views confirm, as the mean of what they say.

    Parameters
    ----------
    sources
        Sources of every view; those that have this view as a source are asked as well.
    correlation
        Least correlation of a pixel.

    Returns
    -------
    DepthMap
        Its confidence is the correlation, less where few views confirm.
    """
    here = matched[index]
    others = sorted({*sources[index], *(i for i, row in enumerate(sources) if index in row)})
    q = here.planes[0].astype(np.float64)
    normal = normals_of(here.view, here.planes)
    own = (here.score > correlation) & (q > 0)
    total, count = q.copy(), np.zeros(q.shape, np.int32)
    for other in others:
        found, same = _confirmed(here, matched[other], normal, correlation)
        total += np.where(same, found, 0.0)
        count += same
    keep = own & (count >= least) & np.isfinite(here.view.light)
    mean = total / (count + 1)
    depth = np.where(keep, 1 / np.maximum(mean, 1e-9), 0.0)
    confidence = np.where(keep, np.clip(here.score, 0, 1) * count / (count + 1.0), 0.0)
    return DepthMap(
        depth.astype(np.float32), confidence.astype(np.float32), np.where(keep[..., None], normal, 0).astype(np.float32)
    )


def _confirmed(here: Matched, there: Matched, normal: np.ndarray, correlation: float) -> tuple[np.ndarray, np.ndarray]:
    """Inverse depth here that another view tells, and whether it is the same surface, both (H, W)."""
    rows, columns = here.score.shape
    v, u = np.mgrid[:rows, :columns].astype(np.float64)
    turn, shift = transfer(here.view, there.view)
    at = np.stack([u, v, np.ones_like(u)], -1) @ turn.T + here.planes[0][..., None] * shift
    pixel, inside = _pixels(at, there.score.shape)
    column, row = np.rint(pixel[..., 0]).astype(int), np.rint(pixel[..., 1]).astype(int)
    q, along_u, along_v = (part[row, column].astype(np.float64) for part in there.planes)
    q = q + along_u * (pixel[..., 0] - column) + along_v * (pixel[..., 1] - row)
    back, shift_back = transfer(there.view, here.view)
    returned = np.concatenate([pixel, np.ones((rows, columns, 1))], -1) @ back.T + q[..., None] * shift_back
    ahead = (returned[..., 2] > 1e-6) & (q > 0)
    depth_ratio = np.where(ahead, returned[..., 2], 1.0)
    found = np.where(ahead, q / depth_ratio, 0.0)
    missed = np.hypot(returned[..., 0] / depth_ratio - u, returned[..., 1] / depth_ratio - v)
    near = here.planes[0].astype(np.float64)
    other_normal = normals_of(there.view, there.planes)[row, column]
    same = (
        inside
        & ahead
        & (there.score[row, column] > correlation)
        & (missed < _PIXELS)
        & (np.abs(found - near) < _DEPTH * near)
        & ((normal * other_normal).sum(-1) > _TURN)
    )
    return found, same


def _pixels(at: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 2) pixels of homogeneous points, moved into the frame where they are outside, and whether they are not."""
    ahead = at[..., 2] > 1e-6
    pixel = at[..., :2] / np.where(ahead, at[..., 2], 1.0)[..., None]
    last = np.array([shape[1] - 1, shape[0] - 1], np.float64)
    inside = ahead & (pixel >= 0).all(-1) & (pixel <= last).all(-1)
    return np.where(inside[..., None], pixel, 0.0), inside
