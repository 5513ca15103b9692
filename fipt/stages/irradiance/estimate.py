"""Albedo of parts as radiance over irradiance; emitters by a threshold with the median radiance in them.

The emitter rule is that of FVP (Philip et al. 2021); its network is not to be had, so that albedo is what irradiance
alone tells.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median

from fipt.model.parts import PartLabels, PartMaterials, centre_samples
from fipt.model.reflectance import Brdf
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import ALONE
from fipt.scene.shading import diffuse_shading

_DARK = 1e-3
"""Diffuse shading below this tells no albedo."""
_GREY = 0.5
"""Albedo where no pixel tells any."""


def threshold_emitters(mesh: Mesh, shards: Sequence[ObservedShard], threshold: float) -> Emitters:
    """Triangles whose median brightest channel exceeds ``threshold``; a connected emitter has its median radiance.

    Clipped pixels count: what is at least that bright is above the threshold all the more.
    """
    radiance, _, triangle = observed(shards, clipped=True)
    shown, index = np.unique(triangle, return_inverse=True)
    brightest = median(radiance.max(axis=1), index, np.arange(len(shown))) if len(shown) else np.zeros(0)
    chosen = shown[brightest > threshold]
    if len(chosen) == 0:
        return Emitters.none()
    patch = connected_parts(Mesh(mesh.vertices, mesh.triangles[chosen]))
    own = np.isin(triangle, chosen)
    of_pixel = patch[np.searchsorted(chosen, triangle[own])]
    return Emitters.plain(mesh, chosen, medians(radiance[own], of_pixel, int(patch.max()) + 1)[patch], patch)


def albedo_of_parts(labels: PartLabels, shards: Sequence[ObservedShard], emitters: Emitters) -> PartMaterials:
    """Median of radiance over diffuse shading of every part, in [0, 1]; roughness 1 and metallic 0 are assumed."""
    radiance, diffuse, triangle = observed(shards, clipped=False)
    part = labels.of_triangle[triangle]
    lit = (diffuse.min(axis=1) > _DARK) & ~np.isin(triangle, emitters.triangle)
    count = labels.count
    ratio = radiance[lit] / diffuse[lit]
    albedo = medians(ratio, part[lit], count)
    albedo = np.where(np.isnan(albedo), np.median(ratio, axis=0) if len(ratio) else _GREY, albedo)
    ones = np.ones(count, np.float32)
    return PartMaterials(labels, Brdf(np.float32(albedo.clip(0, 1)), ones, 0 * ones))


def observed(shards: Sequence[ObservedShard], clipped: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Radiance (N, 3), diffuse shading (N, 3) and triangle (N,) of pixels that one piece of surface fills.

    With ``clipped`` also those whose radiance is only a lower bound.
    """
    found = []
    for shard in shards:
        pixel, sample = centre_samples(shard.samples)
        whole = (shard.weight[pixel] > 0) & (clipped | ~shard.clipped[pixel])
        whole &= np.asarray(shard.samples.weight)[sample] >= ALONE
        pixel, sample = pixel[whole], sample[whole]
        triangle = np.asarray(shard.samples.triangle)[sample].astype(np.int64)
        found.append((shard.radiance[pixel], diffuse_shading(shard.shading, sample), triangle))
    radiance, diffuse, triangle = (np.concatenate(each) for each in zip(*found, strict=True))
    return radiance, diffuse, triangle


def medians(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) median of values (N, 3) in each group (N,); NaN in groups without any."""
    result = np.full((count, values.shape[1]), np.nan)
    known = np.unique(group)
    for channel in range(values.shape[1]) if len(known) else ():
        result[known, channel] = median(values[:, channel], group, known)
    return result
