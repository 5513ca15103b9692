"""The room's mesh from a scan that exists, in coordinates of its own: brought to the cameras, and shown beside them."""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fipt.meshing.mend import far_origin
from fipt.meshing.prepare import prepared
from fipt.meshing.radiance_edges import Radiance
from fipt.render.scene import RayScene
from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh, read_geometry
from fipt.stages.geometry.build import Geometry
from fipt.stages.geometry.completion import Completed
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.evidence import evidence, regions
from fipt.stages.geometry.mesh_settings import ScanSettings
from fipt.stages.geometry.overview import overview
from fipt.stages.geometry.registration import REACH, registered

_SAME = 0.02
"""Share of its depth by which scan and views may differ in the picture: the noise of far depth is no difference."""


def from_scan(
    views: Sequence[DepthView], path: Path, radiance: Radiance, settings: ScanSettings, origin: np.ndarray
) -> Geometry:
    """Bring a scan to the cameras, and make it fit for the pipeline; Mitsuba's variant must be set.

    ``origin``, (3,) metres, was subtracted from the positions of the cameras' source.

    Raises
    ------
    FiptError
        If the scan cannot be read, fits nowhere, or open3d is missing.
    """
    start = time.perf_counter()
    vertices, triangles = read_geometry(path)
    vertices = vertices * settings.scan_unit
    scan_origin = far_origin(vertices)  # before the rounding to float32
    scan = Mesh((vertices - scan_origin).astype(np.float32), triangles)
    mesh, placed = registered(scan, views, scan_origin, origin, settings.scan_unit)
    mesh, prepare = prepared(mesh, [view.camera for view in views], radiance, settings)
    known = float(np.mean([view.map.known.mean() for view in views]))
    lasting = {"views": len(views), "known": round(known, 4), "registration": placed}
    lasting["prepared"] = {name: value for name, value in prepare.items() if name != "seconds"}
    figures = {**lasting, "warnings": placed["warnings"], "seconds": round(time.perf_counter() - start, 2)}
    compared = _compared(mesh, views)
    support = evidence(mesh, compared)
    lasting["surface"] = figures["surface"] = support.share(mesh.areas)
    by_region = regions(mesh, np.full(len(mesh.triangles), -1), support)
    return Geometry(mesh, overview(compared), {"planes": [], "regions": by_region}, lasting, figures)


def _compared(mesh: Mesh, views: Sequence[DepthView]) -> list[Completed]:
    """Views with the depth of a mesh: ``measured`` where their own is the same, ``closed`` where it is another."""
    scene, compared = RayScene(mesh), []
    for view in views:
        rays = view.rays.reshape(-1, 3)
        length = np.linalg.norm(rays, axis=1)
        far, triangle = scene.intersect(view.camera.center, (rays / length[:, None]).astype(np.float32))
        depth = np.where(triangle >= 0, far / length, 0).reshape(view.map.depth.shape).astype(np.float32)
        same = view.map.known & (depth > 0) & (np.abs(depth - view.map.depth) < np.maximum(REACH, _SAME * depth))
        shown = view.with_map(DepthMap(depth, view.map.confidence, view.map.normal))
        compared.append(Completed(shown, same, view.map.known & ~same))
    return compared
