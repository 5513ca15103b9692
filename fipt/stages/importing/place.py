"""A source brought to metres and near the origin, and whether its mesh and its cameras are of one scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.meshing.mend import far_origin, mended
from fipt.scene.cameras import LEAST_BASELINE, Camera, parallax
from fipt.scene.mesh import Mesh
from fipt.scene.sources import ImageSource

Geometry = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) float64 and triangles (T, 3) int32."""
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "feet": 0.3048, "kilometres": 1000.0}
"""Unit -> metres."""
_ROOM = (0.1, 100.0)
"""Metres from cameras to what they see, by the median: miniatures are nearer, halls are no wider."""
_FOCUS = 0.01
"""Metres from cameras to what they see: no lens focuses nearer."""
_LIKELY = 20.0
"""Metres to what is seen that make a unit likely: few rooms are wider."""
_SEEN = 0.01
"""Share of the pixels that must see the mesh, and of the mesh that must lie near the cameras: less is none of it."""
_BEHIND, _PARALLEL, _TWICE = 0.05, 0.95, 0.5
"""Metres behind a surface, and cosine, within which another one repeats it, and share of what is seen that must be so.

Eight sound rooms have up to 0.26, by panels and panes; the same meshes twice, 2 cm apart, have 0.74 or more."""
_CLOSE = 0.03
"""Share of the distance of what is seen within which it repeats it: in miniatures things are nearer to each other."""
_GRAZING = 0.2
"""Cosine between ray and surface, at least: slanting rays cross much else on their way."""
_GRID = 12
"""Rays along a side of a view: a hundred and more tell shares of a hundredth."""
_VIEWS = 16
"""Views that are asked at most."""


@dataclass(frozen=True)
class _Seen:
    """What rays through pixels meet.

    Attributes
    ----------
    share
        Of the rays that meet the mesh.
    likely
        Share of the rays that meet it as far away as walls and things of rooms are.
    near, median, far
        The 0.1, 0.5 and 0.9 quantiles of the lengths of those that meet it, metres.
    """

    share: float
    likely: float
    near: float
    median: float
    far: float


@dataclass(frozen=True)
class PlacedMesh:
    """The mesh of a source in metres, near the origin.

    Attributes
    ----------
    mesh
        Without what no mesh should have; None: there are views alone.
    origin
        (3,) float64 metres that were subtracted from the source's positions.
    figures
        What was done: ``mended``, ``origin``, ``warnings``.
    """

    mesh: Mesh | None
    origin: np.ndarray
    figures: dict[str, Any]


def placed(
    source: ImageSource, geometry: tuple[np.ndarray, np.ndarray] | None, unit: float
) -> tuple[ImageSource, PlacedMesh]:
    """Bring cameras and mesh to metres, near the origin; take out of the mesh what none should have.

    Parameters
    ----------
    geometry
        (V, 3) float64 vertices and (T, 3) int32 triangles; None: there is no mesh.
    unit
        Metres in a unit of the source.
    """
    poses = [np.array(frame.world_from_camera, np.float64) for frame in source.frames]
    centers = np.array([pose[:3, 3] for pose in poses]) * unit
    if not np.isfinite(centers).all():  # which view it is, the check of its camera tells
        found = None if geometry is None else mended(*geometry, np.zeros(3)).mesh
        return source, PlacedMesh(found, np.zeros(3), {})
    origin = far_origin(centers)
    frames = source.frames
    if unit != 1.0 or origin.any():
        moved = []
        for frame, pose, center in zip(frames, poses, centers, strict=True):
            pose[:3, 3] = center - origin
            moved.append(replace(frame, world_from_camera=tuple(map(tuple, pose.tolist()))))
        frames = tuple(moved)
    found = None if geometry is None else mended(geometry[0] * unit, geometry[1], origin)
    warnings = [] if found is None else found.warnings()
    if origin.any():
        shift = ", ".join(f"{x:.0f}" for x in origin)
        warnings.append(f"positions are those of a map: ({shift}) is subtracted, see origin in transforms.json")
    figures = {"origin": origin.tolist(), "warnings": warnings}
    if found is None:
        return replace(source, frames=frames), PlacedMesh(None, origin, figures)
    return replace(source, frames=frames), PlacedMesh(found.mesh, origin, figures | {"mended": found.figures})


def undone(source: ImageSource) -> ImageSource:
    """The source in its original world, before what it says was applied to that (nerfstudio's applied_transform).

    Raises
    ------
    FiptError
        There is nothing to undo, or it is no rotation with one scale.
    """
    if all(frame.applied is None for frame in source.frames):
        raise FiptError(f"{source.root}: there is no applied_transform to undo", "remove import.undo_transform")
    frames = []
    for frame in source.frames:
        if frame.applied is not None:
            applied, pose = np.array(frame.applied), np.array(frame.world_from_camera)
            scale = np.cbrt(np.linalg.det(applied[:3, :3]))
            turn = applied[:3, :3] / scale if scale > 0 else np.zeros((3, 3))
            if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-4):
                raise FiptError(
                    f"{source.root}: applied_transform must be a rotation with a shift; found "
                    f"{np.round(applied[:3], 3).tolist()}",
                    "bring the mesh into the coordinates of the cameras, without import.undo_transform",
                )
            pose[:3, :3] = turn.T @ pose[:3, :3]
            pose[:3, 3] = turn.T @ (pose[:3, 3] - applied[:3, 3]) / scale
            frame = replace(frame, world_from_camera=tuple(map(tuple, pose.tolist())), applied=None)
        frames.append(frame)
    return replace(source, frames=tuple(frames))


def scale_warnings(mesh: Mesh, cameras: Sequence[Camera], certain: bool) -> list[str]:
    """Judge whether mesh and cameras are of one scale, in metres; Mitsuba's variant must be set.

    Parameters
    ----------
    certain
        Somebody has named the unit: what would be refused is a warning.

    Returns
    -------
    list of str
        What is odd, but may be so: domes, landscapes, miniatures.

    Raises
    ------
    FiptError
        Another unit fits much better.
    """
    chosen = cameras[:: max(1, -(-len(cameras) // _VIEWS))]
    seen = _seen(mesh, chosen)
    found = _mixed(mesh, chosen, seen) or _of_another_unit(seen)
    if found is not None and not certain:
        raise FiptError(*found)
    if found is not None:
        return [found[0]]
    if seen.share < _SEEN:
        return [f"{seen.share:.0%} of the cameras' rays meet the mesh; check axes, unit and place of both"]
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    if _ROOM[0] <= seen.median and seen.far <= _ROOM[1] and extent <= 10 * _ROOM[1]:
        return []
    return [
        f"the mesh is {extent:.3g} m large, and cameras see half of it within {seen.median:.3g} m, nine tenths within "
        f"{seen.far:.3g} m; if that is not so, give import.unit, or scale the mesh"
    ]


def viewpoint_warnings(mesh: Mesh, cameras: Sequence[Camera]) -> list[str]:
    """Say that all training views are from one place: a panorama, or positions that were lost."""
    training = [camera for camera in cameras if camera.split == "train"]
    baseline, near = parallax(training, mesh.vertices)
    if baseline >= LEAST_BASELINE * near:
        return []
    return [
        f"all {len(training)} training views are from one place, within {100 * baseline:.2g} cm: nothing tells whether "
        "the mesh is where the images show it, and roughness and metallic are guessed; photograph from several "
        "places, or correct the poses"
    ]


def double_warnings(mesh: Mesh, cameras: Sequence[Camera]) -> list[str]:
    """Say that most surface is there twice, one close behind the other; Mitsuba's variant must be set."""
    from fipt.render.scene import RayScene

    scene, lengths, gaps = RayScene(mesh), [], []
    for camera in cameras[:: max(1, -(-len(cameras) // _VIEWS))]:
        directions = _directions(camera)
        length, triangle = scene.intersect(camera.center, directions)
        cosine = np.abs((scene.normals[triangle] * directions).sum(axis=1))
        used = (triangle >= 0) & (cosine > _GRAZING)
        on = (camera.center + directions[used] * (length[used] * (1 + 1e-4) + 1e-4)[:, None]).astype(np.float32)
        further, behind = scene.intersect(on, directions[used])
        alike = (scene.normals[triangle[used]] * scene.normals[behind]).sum(axis=1) > _PARALLEL
        lengths.append(length[used])
        gaps.append(np.where((behind >= 0) & alike, further * cosine[used], np.inf))
    if not sum(map(len, gaps)):
        return []
    near = min(_BEHIND, _CLOSE * float(np.median(np.concatenate(lengths))))
    share = float((np.concatenate(gaps) < near).mean())
    if share < _TWICE:
        return []
    return [
        f"most of the mesh is there twice: behind {share:.0%} of what cameras see lies the same surface again, within "
        f"{100 * near:.2g} cm; views then see one or the other, and disagree; give one of the two meshes"
    ]


def _mixed(mesh: Mesh, cameras: Sequence[Camera], seen: _Seen) -> tuple[str, str] | None:
    """What is wrong and what to do, if mesh and cameras fit much better with one of them in another unit; else None.

    Either hardly any ray meets the mesh. Or most meet it farther away than in rooms, and nothing is modelled near the
    cameras, where a dome or a landscape has its room.
    """
    unmet = seen.share < _SEEN
    if not unmet and (seen.likely > 0.5 or _modelled_near(mesh, cameras) > _SEEN):
        return None
    for name, unit in _UNITS.items():
        for what, of_mesh, of_cameras in (("the mesh", unit, 1.0), ("the cameras", 1.0, unit)):
            scaled = Mesh((mesh.vertices * np.float64(of_mesh / of_cameras)).astype(np.float32), mesh.triangles)
            other = _seen(scaled, cameras)
            distance = other.median * of_cameras
            if other.share > 0.5 and _ROOM[0] <= distance <= _LIKELY and (unmet or of_mesh < 1.0):
                return (
                    f"mesh and cameras must have one unit; {seen.share:.0%} of the rays meet the mesh, half of these "
                    f"within {seen.median:.2g} m. If {what} were in {name}, {other.share:.0%} would, half of these "
                    f"within {distance:.2g} m",
                    f"scale {what} by {of_mesh * of_cameras:g}, or set import.unit: 1 if both are in metres",
                )
    return None


def _of_another_unit(seen: _Seen) -> tuple[str, str] | None:
    """What is wrong and what to do, if lenses or rooms have no such distances and a unit mends that; else None."""
    likely = [
        f"{name} (import.unit: {unit:g})" for name, unit in _UNITS.items() if 0.5 <= seen.median * unit <= _LIKELY
    ]
    if not likely or seen.share < _SEEN or (seen.far > _FOCUS and seen.near < _ROOM[1]):
        return None
    return (
        f"cameras see nine tenths of what they see from {seen.near:.3g} m and farther, half of it within "
        f"{seen.median:.3g} m; that is no room in metres",
        f"give the unit of mesh and cameras, likely {' or '.join(likely)}; import.unit: 1 if it is metres",
    )


def _modelled_near(mesh: Mesh, cameras: Sequence[Camera]) -> float:
    """Share of the vertices that lie no farther from a camera than walls do."""
    near = np.zeros(len(mesh.vertices), bool)
    for camera in cameras:
        near |= np.linalg.norm(mesh.vertices - camera.center.astype(np.float32), axis=1) < _LIKELY
    return float(near.mean())


def _seen(mesh: Mesh, cameras: Sequence[Camera]) -> _Seen:
    """Trace rays through pixels of all over the views."""
    from fipt.render.scene import RayScene

    scene, lengths = RayScene(mesh), []
    for camera in cameras:
        lengths.append(scene.intersect(camera.center, _directions(camera))[0])
    length = np.concatenate(lengths)
    met = length[np.isfinite(length)]
    if len(met) == 0:
        return _Seen(0.0, 0.0, np.inf, np.inf, np.inf)
    near, median, far = np.quantile(met, (0.1, 0.5, 0.9)).tolist()
    likely = np.count_nonzero((met >= _ROOM[0]) & (met <= _LIKELY)) / len(length)
    return _Seen(len(met) / len(length), likely, near, median, far)


def _directions(camera: Camera) -> np.ndarray:
    """(N, 3) directions of rays through pixels of all over a view."""
    x, y = (np.arange(_GRID) + 0.5) / _GRID * camera.width, (np.arange(_GRID) + 0.5) / _GRID * camera.height
    columns, rows = (grid.ravel() for grid in np.meshgrid(x, y))
    return camera.directions(columns, rows)
