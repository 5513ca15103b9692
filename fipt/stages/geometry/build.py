"""The room's mesh from the depth maps of its views."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.meshing.prepare import prepared
from fipt.meshing.radiance_edges import Radiance
from fipt.meshing.topology import compact
from fipt.render.variant import active_device, set_variant
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.completion import Completed, complete
from fipt.stages.geometry.depth_views import DepthView, depth_noise
from fipt.stages.geometry.evidence import evidence, regions
from fipt.stages.geometry.fusing import check_memory, fuse, fuse_blocks, voxel_size
from fipt.stages.geometry.mesh_settings import AnyGeometry, MonosdfGeometry, RefinedGeometry
from fipt.stages.geometry.openings import find_openings
from fipt.stages.geometry.overview import overview
from fipt.stages.geometry.room_box import RoomBox
from fipt.stages.geometry.shell import shell_behind, with_shell
from fipt.stages.geometry.snapping import snapped

log = logging.getLogger(__name__)

_SNAPPED = 0.25
"""Voxels within which surface is put onto a plane: what fusion rounds off. Shallow furniture stands farther out."""


@dataclass(frozen=True)
class Geometry:
    """A mesh, and what is to be said about it: ``about`` lasts, ``figures`` hold times too.

    ``planes`` holds the room's planes, and what speaks for each region of the surface, as plain types.

    ``image`` (H, W, 3) uint8 shows where the depth of some views comes from.
    """

    mesh: Mesh
    image: np.ndarray
    planes: dict[str, Any]
    about: dict[str, Any]
    figures: dict[str, Any]


def build(views: Sequence[DepthView], radiance: Radiance, settings: AnyGeometry) -> Geometry:
    """Make the mesh; Mitsuba's variant must be set.

    Raises
    ------
    FiptError
        If the depth maps are empty or agree on nothing, memory is short, open3d is missing, or nothing can be fitted to
        the views.
    """
    start = time.perf_counter()
    noise, voxel = depth_noise(views), voxel_size(views, settings.voxel)
    own = [view.map.known for view in views]
    log.info("%d depth maps, %.0f %% known; noise %.2g mm at 1 m; voxels of %.2g mm",
             len(views), 100 * _share(own), 1e3 * noise.at_1m, 1e3 * voxel)  # fmt: skip
    maps = [Completed(view, mask, np.zeros_like(mask)) for view, mask in zip(views, own, strict=True)]
    found = complete(views, noise) if settings.planes else None
    if found is not None:
        maps = found.views
        log.info("%d planes, %d along the room's directions; %.0f %% of the pixels show walls alone, or nothing",
                 len(found.planes), (found.planes.axis >= 0).sum(), 100 * _share([m.closed for m in maps]))  # fmt: skip
    measured, views = views, [m.view for m in maps]
    check_memory(views, voxel, settings.memory_gb)
    mesh, fitted = _surface(measured, maps, settings, noise.at_1m, voxel)
    mesh, prepare = prepared(mesh, [view.camera for view in views], radiance, settings)
    plane = np.full(len(mesh.triangles), -1)
    if found is not None:
        mesh, plane = snapped(mesh, found.planes, _SNAPPED * voxel)
    closed, area = mesh, 0.0
    if found is not None:
        closed, kept, area = _closed(mesh, found.box, voxel, measured if settings.openings else ())
        mesh, plane = Mesh(mesh.vertices, mesh.triangles[kept]), plane[kept]
    support = evidence(mesh, maps)
    by_region = regions(mesh, plane, support)
    lasting = {
        "method": settings.method,
        "views": len(views),
        **_of_pixels(maps, own),
        "surface": support.share(mesh.areas),
        "open_area": round(area, 4),
        "box": None if found is None else found.box.plain(),
        "noise_mm_at_1m": round(1e3 * noise.at_1m, 4),
        "confident": round(noise.confident, 4),
        "voxel_mm": round(1e3 * voxel, 3),
        "planes": 0 if found is None else len(found.planes),
        "prepared": {name: value for name, value in prepare.items() if name != "seconds"},
    }
    if fitted:
        lasting["volume"] = {name: value for name, value in fitted.items() if name != "steps_per_s"}
    figures = {name: value for name, value in lasting.items() if name != "of_view"}
    if fitted:
        figures["volume"] = fitted
    figures["seconds"] = round(time.perf_counter() - start, 2)
    planes = {"planes": [] if found is None else found.planes.plain(), "regions": by_region}
    return Geometry(closed, overview(maps), planes, lasting, figures)


def _closed(mesh: Mesh, box: RoomBox, voxel: float, views: Sequence[DepthView]) -> tuple[Mesh, np.ndarray, float]:
    """The mesh with the shell, but for openings that views show; which (T,) triangles stay, and metres^2 of others."""
    whole, count = with_shell(mesh, box, voxel), len(mesh.triangles)
    open_ = find_openings(whole, views) if views else np.zeros(len(whole.triangles), bool)
    gone = open_ | shell_behind(whole, count, open_, voxel)
    area = float(mesh.areas[gone[:count]].sum())
    return compact(whole.vertices, whole.triangles[~gone]), ~gone[:count], area


def _surface(
    views: Sequence[DepthView], maps: Sequence[Completed], settings: AnyGeometry, noise: float, voxel: float
) -> tuple[Mesh, dict[str, Any]]:
    """The surface as the method finds it, before it is prepared; figures of what was fitted.

    ``views`` have depth of their own only; ``maps`` are the same, completed.
    """
    set_variant()
    if isinstance(settings, MonosdfGeometry):
        from fipt.stages.geometry.volume.monosdf import from_sphere

        return from_sphere(views, settings, voxel, active_device())
    complete, carves = [m.view for m in maps], [m.view.map.known & ~m.closed for m in maps]
    if isinstance(settings, RefinedGeometry):
        from fipt.stages.geometry.volume.refine import refined

        return refined(fuse_blocks(complete, carves, noise, voxel), complete, settings, active_device())
    return fuse(complete, carves, noise, voxel), {}


def _of_pixels(maps: Sequence[Completed], own: Sequence[np.ndarray]) -> dict[str, Any]:
    """Shares of pixels that have a depth of their own, that planes completed, that are closed; of each view too."""
    known, closed = _share(own), _share([m.closed for m in maps])
    with_planes = _share([m.view.map.known & ~m.closed for m in maps])
    return {
        "known": round(known, 4),
        "completed": round(with_planes - known, 4),
        "closed": round(closed, 4),
        "of_view": {
            m.view.camera.name: {"known": round(float(mask.mean()), 4), "closed": round(float(m.closed.mean()), 4)}
            for m, mask in zip(maps, own, strict=True)
        },
    }


def _share(masks: Sequence[np.ndarray]) -> float:
    """Mean over views of the share of pixels that a mask holds."""
    return float(np.mean([mask.mean() for mask in masks]))
