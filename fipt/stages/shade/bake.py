"""Round 0: shading integrals with incoming light read from the radiance cache (method.md, Round 0)."""

from collections.abc import Mapping

import numpy as np

from fipt.render.environment import sky_of
from fipt.render.scene import RayScene
from fipt.render.surface import SurfaceCache, Triangles
from fipt.render.tracer import Shader
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import Mesh


def cache_shader(
    mesh: Mesh, cache: Mapping[str, np.ndarray], fill: bool, environment: EnvironmentMap = NOTHING
) -> Shader:
    """Return a shader whose rays end in the cache at the first surface they meet, or outside.

    Parameters
    ----------
    cache
        As `fipt.stages.cache.build.build` returns it.
    fill
        Give unseen voxels the light of the nearest seen one; black otherwise, as the paper.
    """
    radiance = cache["radiance"][cache["source"]] if fill else cache["radiance"]
    surface = SurfaceCache(cache, radiance, cache["count"] > 0)
    return Shader(RayScene(mesh), Triangles(mesh, None), surface, None, sky_of(environment))
