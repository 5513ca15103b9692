"""Depth maps closed where nothing tells what a pixel shows: by what lies beside it, or by the room's walls."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.other_views import THROUGH, OtherViews
from fipt.stages.geometry.room_box import RoomBox

_CLOSED = 1e-3
"""Confidence of a closed pixel, in units of the view's median: any other depth outweighs it."""
_EVERY = 4
"""Pixels along a row and a column of which other views are asked about one."""
_CONTRAST = 0.1
"""Step of log radiance between pixels across which depth goes on half as well: twice or a fifth change little."""
_ITS_OWN = 0.5
"""Share of a continued depth that comes from known pixels, at least; the rest of it is the wall's."""


def closed(view: DepthView, number: int, others: OtherViews, box: RoomBox, noise: float) -> DepthView:
    """Give unknown pixels the depth of what lies beside them, or of a wall that the other views do not see through.

    Known depth goes on over pixels of like brightness: bare furniture is where its seams and outlines are. Where that
    tells little, or other views see through it, a pixel shows the nearest wall, else the box's face behind it. It stays
    unknown where the box has no wall on that side: it ends anywhere then.

    Parameters
    ----------
    number
        Of this view among the others.
    noise
        Deviation of depth at one metre, metres.
    """
    found, shape = view.map, view.map.depth.shape
    wall, normal, walled = _walls(view, number, others, box, noise)
    depth, share = _continued(view, 1 / wall.reshape(shape))
    goes_on = (share > _ITS_OWN) & ~_seen_through(view, number, others, depth.ravel(), noise).reshape(shape)
    depth = np.where(goes_on, depth, wall.reshape(shape))
    normal = np.where(goes_on[..., None], _normals(view, depth), normal.reshape(*shape, 3))
    add = ~found.known & (goes_on | walled.reshape(shape))
    usual = float(np.median(found.confidence[found.known])) if found.known.any() else 1.0
    return view.with_map(
        DepthMap(
            np.where(add, depth, found.depth).astype(np.float32),
            np.where(add, _CLOSED * usual, found.confidence).astype(np.float32),
            np.where(add[..., None], normal, found.normal).astype(np.float32),
        )
    )


def _continued(view: DepthView, wall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth (H, W) of known pixels gone on over the others, and the share of it that is theirs and not a wall's.

    The smoothest inverse depth: squared steps between neighbours count, less where their brightness differs; and steps
    to the wall's inverse depth ``wall`` (H, W), so weakly that they count from an image's width away.
    """
    found = view.map
    known, unknown = found.known, ~found.known
    inverse = np.where(known, 1 / np.where(known, found.depth, 1.0), wall)
    count = int(unknown.sum())
    if count == 0 or not known.any():
        return 1 / inverse, known.astype(np.float64)
    number = np.where(unknown, np.cumsum(unknown.ravel()).reshape(unknown.shape) - 1, -1)
    least = 1e-4 * float(np.median(view.radiance)) + 1e-9
    level = np.log(np.maximum(view.radiance.mean(axis=-1), least))
    tie = 1 / unknown.shape[1] ** 2
    diagonal, right = np.full(count, tie), np.stack([tie * inverse[unknown], np.zeros(count)], axis=1)
    rows, columns, values = [np.arange(count)], [np.arange(count)], [diagonal]
    for one, other in ((np.s_[:, 1:], np.s_[:, :-1]), (np.s_[1:], np.s_[:-1])):
        weight = 1 / (1 + ((level[one] - level[other]) / _CONTRAST) ** 2)
        for here, there in ((one, other), (other, one)):
            own = number[here] >= 0
            row, beside, w = number[here][own], number[there][own], weight[own]
            np.add.at(diagonal, row, w)
            tells = beside < 0
            np.add.at(right, row[tells], w[tells, None] * np.stack([inverse[there][own], np.ones(len(w))], 1)[tells])
            rows.append(row[~tells])
            columns.append(beside[~tells])
            values.append(-w[~tells])
    matrix = sparse.csc_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))))
    inverse[unknown], share = (solution := splu(matrix).solve(right))[:, 0], known.astype(np.float64)
    share[unknown] = solution[:, 1]
    return 1 / np.maximum(inverse, 1e-6), share


def _normals(view: DepthView, depth: np.ndarray) -> np.ndarray:
    """(H, W, 3) normals of a depth map (H, W), facing the camera."""
    points = view.rays * depth[..., None]
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-30)
    return normal * -np.sign((normal * view.rays).sum(axis=-1, keepdims=True))


def _walls(
    view: DepthView, number: int, others: OtherViews, box: RoomBox, noise: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depth (N,) and normal (N, 3) of the nearest wall that no view sees through, and whether there is one (N,)."""
    rays = view.rays.reshape(-1, 3)
    nearest, normal, walled = _faces(view, rays, box)
    for side, axis in zip(*np.nonzero(np.isfinite(box.walls)), strict=True):
        wall = box.directions[axis] * (1.0 if side == 0 else -1.0)
        toward, before = -rays @ wall, wall @ view.camera.center - (wall @ box.directions[axis]) * box.walls[side, axis]
        if before <= 0:
            continue
        depth = np.where(toward > 1e-6, before / np.maximum(toward, 1e-6), np.inf)
        nearer = (depth < nearest) & ~_seen_through(view, number, others, depth, noise)
        nearest = np.where(nearer, depth, nearest)
        normal[nearer] = wall
        walled |= nearer
    return nearest, normal, walled


def _faces(view: DepthView, rays: np.ndarray, box: RoomBox) -> tuple[np.ndarray, ...]:
    """Depth (N,) at which (N, 3) rays leave the box, inward normals (N, 3), and (N,) whether a wall is on that side."""
    along = rays @ box.directions.T
    end = np.where(along > 0, box.high, box.low) - box.directions @ view.camera.center
    depth = np.where(np.abs(along) > 1e-9, end / np.where(np.abs(along) > 1e-9, along, 1.0), np.inf)
    axis = depth.argmin(axis=1)
    sign = np.sign(np.take_along_axis(along, axis[:, None], 1))
    walled = np.isfinite(box.walls[(sign[:, 0] > 0).astype(np.int64), axis])
    return np.maximum(depth.min(axis=1), 1e-3), -sign * box.directions[axis], walled


def _seen_through(view: DepthView, number: int, others: OtherViews, depth: np.ndarray, noise: float) -> np.ndarray:
    """(N,) bool: pixels whose surrounding, were it at these depths, other views see through."""
    shape = view.map.depth.shape
    some = np.s_[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    there = depth.reshape(shape)[some]
    reached = np.isfinite(there)
    points = view.camera.center + view.rays[some][reached] * there[reached][:, None]
    through, same = others.say(points, number, noise)
    free = np.zeros(there.shape, bool)
    free[reached] = through > np.maximum(1, THROUGH * (through + same))
    row, column = (
        np.minimum(np.arange(size) // _EVERY, blocks - 1) for size, blocks in zip(shape, there.shape, strict=True)
    )
    return free[row[:, None], column].ravel()
