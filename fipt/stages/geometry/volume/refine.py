"""The surface of fused depth maps, fitted to the photographs: a narrow band around it is rendered."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from fipt.model.networks import SceneBox
from fipt.render.scene import RayScene
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.mesh_settings import VolumeGeometry
from fipt.stages.geometry.volume.blocks import BlockGrid
from fipt.stages.geometry.volume.field import VolumeField
from fipt.stages.geometry.volume.isosurface import changed_by
from fipt.stages.geometry.volume.loop import check_volume_memory, fit_field
from fipt.stages.geometry.volume.pixels import VolumePixels
from fipt.stages.geometry.volume.sampling import NarrowBand
from fipt.stages.geometry.volume.start import BlockDistance

_BAND = 3.0
"""Voxels before and behind the surface that are rendered: what the fusion holds."""
_BETA = 0.5
"""First width of the density, voxels."""
_RADIANCE_FIRST = 0.3
"""Share of the steps in which the surface stays: radiance that is not learned yet would move it anywhere."""


def refined(
    grid: BlockGrid, views: Sequence[DepthView], settings: VolumeGeometry, device: str
) -> tuple[Mesh, dict[str, Any]]:
    """Fit the distances of a fusion to views; Mitsuba's variant must be set.

    Parameters
    ----------
    grid
        What was fused.
    views
        With the depth and the normals that the surface shall keep to.

    Returns
    -------
    mesh, figures

    Raises
    ------
    FiptError
        If memory is short, the loss is not finite or nothing was fused.
    """
    check_volume_memory(settings, settings.samples, views)
    mesh = grid.surface()
    box = SceneBox.around(mesh.vertices, 1.02)
    half_side = box.side / 2
    scene = RayScene(mesh)
    met = [_distances(scene, view) / half_side for view in views]
    pixels = VolumePixels(views, box, [np.isfinite(each) for each in met])
    distance = np.concatenate([each[np.isfinite(each)] for each in met]).astype(np.float32)
    step = grid.voxel / half_side
    field = VolumeField(BlockDistance(grid, box), settings, _BETA * step, directional=False).to(device)
    band = NarrowBand(distance, _BAND * step, settings.samples)
    figures = fit_field(field, pixels, band, settings, lambda _: step, _RADIANCE_FIRST)
    after = changed_by(field, grid, box, step)
    moved = 1e3 * np.abs(after.distance - grid.distance)[grid.known & (np.abs(grid.distance) < grid.voxel)]
    figures["moved_mm"] = {"median": round(float(np.median(moved)), 3), "p90": round(float(np.quantile(moved, 0.9)), 3)}
    return after.surface(), figures


def _distances(scene: RayScene, view: DepthView) -> np.ndarray:
    """(H, W) metres along the rays of a view to a surface, infinite where it shows none."""
    ways = view.rays / np.linalg.norm(view.rays, axis=-1, keepdims=True)
    far, _ = scene.intersect(view.camera.center, ways.reshape(-1, 3).astype(np.float32))
    return far.reshape(view.map.depth.shape)
