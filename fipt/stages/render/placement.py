"""Whether free cameras stand in the open: not in a wall, in a cupboard or out of the room."""

from collections.abc import Sequence

import numpy as np

from fipt.render.directions import all_around
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera

NEAREST = 0.03
"""A surface nearer than this fills the image, metres."""
_AROUND = 1024
"""Directions in which a camera looks around."""
_GRID = (48, 36)
"""Columns and rows of the rays that tell what a view of the dataset shows."""
_REACH = 0.05
"""Share of the mesh's extent within which a point that a view shows tells about another."""
_SAME_PLANE = 0.03
"""... if it lies in its plane up to this, metres: the two sides of a wall are further apart."""
_KNOWN = 0.02
"""Least share of what lies around a camera that some view shows too."""
_NEIGHBOURS = 8
_ENCLOSED = 0.99
"""Share of the directions in which an object is met by a camera that it is around."""


def unlikely_viewpoints(scene: RayScene, cameras: Sequence[Camera], views: Sequence[Camera]) -> list[str]:
    """Return warnings about cameras that stand where no image can be taken.

    Views were taken in the open, so their sides of surfaces are the right ones. A camera that mostly sees surfaces
    from the other side, or hardly any that they show, is inside something or behind a wall. Windings are not asked:
    scans often have wrong ones.

    Parameters
    ----------
    scene
        The room as the cameras see it.
    cameras
        Those to judge.
    views
        Those of the dataset.
    """
    from scipy.spatial import cKDTree

    seen = [_visible(scene, view.center, _spread(view)) for view in views]
    places, facing = (np.concatenate([found[kind] for found in seen]) for kind in (0, 1))
    tree, around = cKDTree(places) if len(places) else None, all_around(_AROUND)
    reach = _REACH * scene.extent
    near, inside, outside = {}, [], []
    for camera in cameras:
        found, normals, distance = _visible(scene, camera.center, around)
        if len(distance) == 0:
            outside.append(camera.name)
            continue
        if distance.min() < NEAREST:
            near[camera.name] = distance.min()
        if tree is None:
            continue
        away, neighbour = tree.query(found, k=range(1, min(_NEIGHBOURS, len(places)) + 1))
        theirs = facing[neighbour]
        height = np.abs(np.einsum("nkc,nkc->nk", found[:, None] - places[neighbour], theirs))
        alike = np.einsum("nkc,nc->nk", theirs, normals) * ((away < reach) & (height < _SAME_PLANE))
        same, other = (alike > 0.5).any(axis=1), (alike < -0.5).any(axis=1)
        if same.sum() <= max((other & ~same).sum(), _KNOWN * len(found)):
            inside.append(camera.name)
    return _warnings(near, inside, outside, len(cameras))


def inside_objects(scene: RayScene, cameras: Sequence[Camera], first: int) -> list[str]:
    """Return a warning about views that stand in an object: triangles from the ``first`` on are all around them."""
    around = all_around(_AROUND)
    inside = []
    for camera in cameras:
        _, triangle = scene.intersect(camera.center.astype(np.float32), around)
        if (triangle >= first).mean() > _ENCLOSED:
            inside.append(camera.name)
    said = f"an object of the setup is around the cameras of {_listed(inside)}, which see nothing else"
    return [said] if inside else []


def _warnings(near: dict[str, float], inside: list[str], outside: list[str], count: int) -> list[str]:
    warnings = []
    if near:
        least = min(near, key=lambda name: near[name])
        warnings.append(
            f"{len(near)} of {count} cameras stand less than {100 * NEAREST:.0f} cm from a surface: "
            f"{_listed(list(near))} (nearest: {least}, {100 * near[least]:.1f} cm)"
        )
    if inside:
        warnings.append(
            f"{len(inside)} of {count} cameras stand in a wall or object, or outside the room: {_listed(inside)}; they "
            "mostly see sides of surfaces that no view of the dataset shows"
        )
    if outside:
        warnings.append(f"{len(outside)} of {count} cameras have no surface around them: {_listed(outside)}")
    return warnings


def _listed(names: list[str]) -> str:
    return ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")


def _visible(scene: RayScene, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 3), normals turned to the origin (N, 3) and distances (N,) of the rays that meet the mesh."""
    distance, triangle = scene.intersect(origin.astype(np.float32), directions)
    hit = triangle >= 0
    directions, distance, normals = directions[hit], distance[hit], scene.normals[triangle[hit]]
    normals = np.where((normals * directions).sum(axis=1, keepdims=True) > 0, -normals, normals)
    return origin + distance[:, None] * directions, normals, distance


def _spread(view: Camera) -> np.ndarray:
    """(N, 3) float32 directions through a grid of points of a view."""
    x, y = np.meshgrid((np.arange(_GRID[0]) + 0.5) / _GRID[0], (np.arange(_GRID[1]) + 0.5) / _GRID[1])
    return view.directions(x.ravel() * view.width, y.ravel() * view.height)
