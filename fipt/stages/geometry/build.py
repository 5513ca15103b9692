"""The room's mesh from the depth maps of its views."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fipt.meshing.prepare import prepared
from fipt.meshing.radiance_edges import Radiance
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView, depth_noise
from fipt.stages.geometry.fusing import check_memory, fuse, voxel_size
from fipt.stages.geometry.mesh_settings import GeometrySettings

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Geometry:
    """A mesh, and what is to be said about it: ``about`` lasts, ``figures`` hold times too."""

    mesh: Mesh
    about: dict[str, Any]
    figures: dict[str, Any]


def build(views: Sequence[DepthView], radiance: Radiance, settings: GeometrySettings) -> Geometry:
    """Make the mesh; Mitsuba's variant must be set.

    Raises
    ------
    FiptError
        If the depth maps are empty or agree on nothing, memory is short, or open3d is missing.
    """
    start = time.perf_counter()
    noise, voxel = depth_noise(views), voxel_size(views, settings.voxel)
    check_memory(views, voxel, settings.memory_gb)
    known = sum(float(view.map.known.mean()) for view in views) / len(views)
    log.info("%d depth maps, %.0f %% known; noise %.2g mm at 1 m; voxels of %.2g mm",
             len(views), 100 * known, 1e3 * noise, 1e3 * voxel)  # fmt: skip
    mesh = fuse(views, [view.map.known for view in views], noise, voxel)
    mesh, about = prepared(mesh, [view.camera for view in views], radiance, settings)
    lasting = {
        "views": len(views),
        "known": round(known, 4),
        "noise_mm_at_1m": round(1e3 * noise, 4),
        "voxel_mm": round(1e3 * voxel, 3),
        "prepared": {name: value for name, value in about.items() if name != "seconds"},
    }
    return Geometry(mesh, lasting, {**lasting, "seconds": round(time.perf_counter() - start, 2)})
