"""The room's directions, by how sharply the surface that faces them gathers.

Planes of single things tell a direction as well as they are wide: half a metre that is 4 mm off turns it by half a
degree, and a wall of 5 m is then 4 cm off at its end. Everything along a wall tells more, though it is no plane by
itself: its skirting, its cornice, its pictures.
"""

from collections.abc import Iterator, Sequence
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from fipt.stages.geometry.depth_views import DepthView

_FACES = np.cos(np.radians(20.0))
"""Cosine between a direction and the normals of the points that gather along it."""
_BINS = (0.08, 0.04, 0.02, 0.01)
"""Widths of places along a direction, metres: wide ones have no false maximum near a start that is 2 degrees off."""
_FIRST_TURN, _LAST_TURN = 12.5, 2.5
"""First and last step of a search, degrees, per metre of a place: 5 m are turned by its width, then by a fifth."""
_CLEAR = 0.07
"""Mean logarithm of density that another turn than the world's must gain. In four rooms whose axes are the world's,
wrong turns of up to 2 degrees gain 0.01 to 0.07, since depth errs together; a true turn of one degree gains 0.1 to 0.4.
"""
_NEAR = np.cos(np.radians(10.0))
"""Cosine between directions and the axes of the world above which they may be the same."""
_FEWEST = 10
"""Points that a side needs."""
_POINTS = 100_000
"""Points at most, evenly among all."""


def sharpened(directions: np.ndarray, views: Sequence[DepthView]) -> np.ndarray:
    """(3, 3) directions near these, rows, along which the known points of all views gather most sharply.

    The axes of the world, if those found are near them and not clearly sharper: poses were turned to the room by all
    its lines. Axes far from them are no rival: a direction that no surface faces has no spread.

    Parameters
    ----------
    directions
        (3, 3) float64 rotation, rows.
    views
        Their known depth counts, each pixel by the area that it shows.
    """
    places, normals, areas = _known(views)
    if len(places) == 0:
        return directions
    best = -np.inf
    for width in _BINS:
        step, best = _FIRST_TURN * width, _sharpness(directions, places, normals, areas, width)
        while step >= _LAST_TURN * width:
            moved = False
            for turned in _turned(directions, step):
                sharpness = _sharpness(turned, places, normals, areas, width)
                if sharpness > best:
                    best, directions, moved = sharpness, turned, True
                    break
            step = step if moved else step / 2
    if np.diag(directions).min() < _NEAR:
        return directions
    gain = best - _sharpness(np.eye(3), places, normals, areas, _BINS[-1])
    return directions if gain > _CLEAR else np.eye(3)


def _known(views: Sequence[DepthView]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 3), normals (N, 3) and areas (N,) of known pixels."""
    masks = [view.map.known for view in views]
    every = max(sum(int(mask.sum()) for mask in masks) // _POINTS, 1)
    places = np.concatenate([view.points[mask] for view, mask in zip(views, masks, strict=True)])[::every]
    normals = np.concatenate([view.map.normal[mask] for view, mask in zip(views, masks, strict=True)])[::every]
    areas = [(view.map.depth[mask] / view.camera.fx) ** 2 for view, mask in zip(views, masks, strict=True)]
    return places, normals, np.concatenate(areas)[::every]


def cube_turns() -> list[np.ndarray]:
    """The 24 turns of a cube onto itself, (3, 3) each; none comes first."""
    turns = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
            if np.linalg.det(turn) > 0:
                turns.append(turn)
    return turns


def _turned(directions: np.ndarray, degrees: float) -> Iterator[np.ndarray]:
    """Directions turned by an angle, either way about each world axis."""
    for axis in np.radians(degrees) * np.eye(3):
        for turn in (axis, -axis):
            yield directions @ Rotation.from_rotvec(turn).as_matrix()


def _sharpness(
    directions: np.ndarray, places: np.ndarray, normals: np.ndarray, areas: np.ndarray, width: float
) -> float:
    """Mean logarithm of the density of surface that faces up and down each direction, over places of a width."""
    total = 0.0
    for direction in directions:
        along, facing = places @ direction / width, normals @ direction
        for on in (facing > _FACES, facing < -_FACES):
            if on.sum() < _FEWEST:
                continue
            place = along[on] - along[on].min()
            first = place.astype(np.int64)
            share, size = place - first, int(first.max()) + 2
            area = np.bincount(first, (1 - share) * areas[on], size) + np.bincount(first + 1, share * areas[on], size)
            total += float(area.sum() * np.log((area**2).sum() / area.sum() ** 2))
    return total / float(areas.sum())
