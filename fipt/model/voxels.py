"""Materials of the surface voxels of the radiance cache, asked from the networks once a round."""

from collections.abc import Mapping

import numpy as np

from fipt.model.networks import Brdf, Field


def voxel_materials(field: Field, voxels: Mapping[str, np.ndarray]) -> Brdf:
    """Reflectance of the K voxels of cache.npz; those that no view sees take that of the voxel standing for them."""
    seen, index = np.unique(voxels["source"], return_inverse=True)
    size = np.full(len(seen), float(voxels["side"]) / int(voxels["resolution"]), np.float32)
    brdf = field.query(voxels["point"][seen], size)
    return Brdf(brdf.base_color[index], brdf.roughness[index], brdf.metallic[index])
