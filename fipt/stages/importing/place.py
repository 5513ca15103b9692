"""A source brought to metres and near the origin, and whether its mesh and its cameras are of one scale."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.meshing.mend import far_origin, mended
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.scene.sources import ImageSource

log = logging.getLogger(__name__)

Geometry = tuple[np.ndarray, np.ndarray]
"""Vertices (V, 3) float64 and triangles (T, 3) int32."""
_UNITS = {"millimetres": 0.001, "centimetres": 0.01, "inches": 0.0254, "feet": 0.3048, "kilometres": 1000.0}
"""Unit -> metres."""
_ROOM = (0.1, 100.0)
"""Metres from cameras to what they see, by the median: lenses do not focus nearer, no room is wider."""
_LIKELY = 20.0
"""Metres to what is seen that make a unit likely: few rooms are wider."""
_SEEN = 0.01
"""Share of the pixels that must see the mesh: with fewer, a view in a hundred is not of this room."""
_GRID = 12
"""Rays along a side of a view: a hundred and more tell shares of a hundredth."""
_VIEWS = 16
"""Views that are asked at most."""


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


def check_scale(mesh: Mesh, cameras: Sequence[Camera]) -> None:
    """Refuse mesh and cameras that another unit would explain better; Mitsuba's variant must be set.

    Raises
    ------
    FiptError
        One line that says what is seen, and which unit would explain it.
    """
    chosen = cameras[:: max(1, len(cameras) // _VIEWS)]
    share, median, far = _seen(mesh, chosen)
    if share < _SEEN:
        for name, unit in _UNITS.items():
            _refuse_scaled(mesh, chosen, share, (name, unit, 1.0))
            _refuse_scaled(mesh, chosen, share, (name, 1.0, unit))
        log.warning("%.0f%% of the cameras' rays meet the mesh; check axes, unit and place of both", 100 * share)
        return
    extent = float(np.ptp(mesh.vertices, axis=0).max())
    if far > _ROOM[1] or extent > 10 * _ROOM[1]:  # a landscape, or cameras in a corner of what seems a huge room
        for name in ("millimetres", "centimetres"):
            _refuse_scaled(mesh, chosen, share, (name, _UNITS[name], 1.0))
    if not _ROOM[0] <= median <= _ROOM[1]:
        raise _of_another_unit(median)


def _refuse_scaled(mesh: Mesh, cameras: Sequence[Camera], share: float, unit: tuple[str, float, float]) -> None:
    """Raise FiptError if the cameras see the mesh as they see a room once one of both is scaled.

    Parameters
    ----------
    share
        Of the rays that meet the mesh as it is.
    unit
        Name, and factors of the mesh and of the cameras.
    """
    name, of_mesh, of_cameras = unit
    scaled = Mesh((mesh.vertices * np.float64(of_mesh / of_cameras)).astype(np.float32), mesh.triangles)
    seen, distance, _ = _seen(scaled, cameras)
    distance *= of_cameras
    if seen <= 0.5 or not _ROOM[0] <= distance <= _LIKELY:
        return
    what = "the mesh" if of_cameras == 1.0 else "the cameras"
    raise FiptError(
        f"mesh and cameras must have one unit; {share:.0%} of the rays meet the mesh. If {what} were in {name}, "
        f"{seen:.0%} would, half of these within {distance:.2g} m",
        f"scale {what} by {of_mesh * of_cameras:g}",
    )


def _of_another_unit(median: float) -> FiptError:
    likely = [f"{name} (import.unit: {unit:g})" for name, unit in _UNITS.items() if 0.5 <= median * unit <= _LIKELY]
    return FiptError(
        f"cameras must see the room from {_ROOM[0]:g} to {_ROOM[1]:g} m away; their median is {median:.3g} m",
        f"give the unit of mesh and cameras; likely {' or '.join(likely) or 'import.unit'}",
    )


def _seen(mesh: Mesh, cameras: Sequence[Camera]) -> tuple[float, float, float]:
    """Share of rays through pixels that meet a mesh; the 0.5 and 0.9 quantiles of their lengths, metres."""
    from fipt.render.scene import RayScene

    scene, lengths = RayScene(mesh), []
    for camera in cameras:
        x, y = (np.arange(_GRID) + 0.5) / _GRID * camera.width, (np.arange(_GRID) + 0.5) / _GRID * camera.height
        columns, rows = (grid.ravel() for grid in np.meshgrid(x, y))
        lengths.append(scene.intersect(camera.center, camera.directions(columns, rows))[0])
    length = np.concatenate(lengths)
    met = length[np.isfinite(length)]
    if len(met) == 0:
        return 0.0, np.inf, np.inf
    median, far = np.quantile(met, (0.5, 0.9)).tolist()
    return len(met) / len(length), median, far
