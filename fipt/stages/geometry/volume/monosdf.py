"""A room's surface from its photographs alone, after MonoSDF (Yu et al. 2022): from a sphere that is seen from inside.

What differs from the published code: gradients are differences, from a coarse cell to a fine one; the sphere is added
to the network, not put into its weights; hidden layers are ReLU, without weight norm; depth beyond a fiftieth of the
box counts linearly.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.model.networks import SceneBox
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.mesh_settings import MonosdfGeometry, VolumeGeometry
from fipt.stages.geometry.volume.field import COARSEST, VolumeField
from fipt.stages.geometry.volume.isosurface import of_field
from fipt.stages.geometry.volume.loop import check_volume_memory, fit_field
from fipt.stages.geometry.volume.pixels import VolumePixels
from fipt.stages.geometry.volume.prior import with_prior
from fipt.stages.geometry.volume.sampling import ErrorBounded
from fipt.stages.geometry.volume.start import Sphere

_BETA = 0.1
"""First width of the density, half sides."""
_OUTLIERS = 0.002
"""Share of known points, on either side of each axis, that may lie outside the scene box."""
_MARGIN = 1.15
"""Side of the scene box over the extent of what is seen: the sphere and the room's corners lie in it."""
_BLIND = 3.0
"""Metres that the box exceeds the cameras by, where no depth is known."""


def from_sphere(
    views: Sequence[DepthView], settings: MonosdfGeometry, voxel: float, device: str
) -> tuple[Mesh, dict[str, Any]]:
    """Fit signed distance and radiance to views with depth maps, and mesh its zero.

    Parameters
    ----------
    voxel
        Side of a voxel of the mesh, metres.
    device
        Torch's.

    Returns
    -------
    mesh, figures

    Raises
    ------
    FiptError
        If memory is short, predicted depth is wrong, the loss is not finite or there is no surface.
    """
    check_volume_memory(settings, settings.samples + settings.even_samples + 2, views)
    box = box_of(views)
    met = views if settings.prior is None else with_prior(views, Path(settings.prior))
    field = VolumeField(Sphere(), settings, _BETA).to(device)
    pixels = VolumePixels(met, box)
    figures = fit_field(field, pixels, ErrorBounded(settings), settings, lambda done: tap_step(settings, done))
    return of_field(field, box, voxel, tap_step(settings, 1.0)).surface(), figures


def tap_step(settings: VolumeGeometry, done: float) -> float:
    """Half sides to the places that tell a gradient: half a coarse cell at first, half a fine one from the middle on.

    ``done`` is the share of the steps.
    """
    coarse, fine = 1 / COARSEST, 1 / settings.finest
    return coarse * math.exp(min(2 * done, 1.0) * math.log(fine / coarse))


def box_of(views: Sequence[DepthView]) -> SceneBox:
    """Scene box of views: around the surface that they know of, but for outliers, and their cameras."""
    centers = np.array([view.camera.center for view in views])
    known = np.concatenate([view.points[view.map.known] for view in views])
    if len(known) == 0:
        low, high = centers.min(axis=0), centers.max(axis=0)
        return SceneBox(tuple((low + high) / 2), float((high - low).max()) + _BLIND)
    ends = np.quantile(known, [_OUTLIERS, 1 - _OUTLIERS], axis=0)
    return SceneBox.around(np.concatenate([ends, centers]), _MARGIN)
