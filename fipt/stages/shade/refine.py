"""Later rounds: shading path traced with the current materials and emitters (method.md, Later rounds)."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fipt.model.fitted import FittedScene
from fipt.render.environment import sky_of
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, Materials, SurfaceCache, Triangles, emitter_set
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import Mesh, surface_points
from fipt.scene.voxels import voxel_keys


def fitted_shader(room: FittedScene, path: PathSettings, filled: bool = False) -> Shader:
    """Return a shader whose paths follow the current model of a room, loaded with its cache.

    Parameters
    ----------
    filled
        Paths end in the cache at their first vertex, as in round 0, or on an emitter. Unseen surface has the light of
        the nearest seen one. For materials that were fitted to a light that was wrong.
    """
    cache = room.cache
    if filled:
        everything = np.ones_like(cache["count"])
        cache = {**cache, "radiance": cache["radiance"][cache["source"]], "count": everything}
        path = replace(path, cache_roughness=-1.0)
    return path_shader(room.mesh, cache, room.cached_materials(), emitter_set(room.emitters), path, room.environment)


def path_shader(
    mesh: Mesh,
    cache: Mapping[str, np.ndarray],
    materials: Materials,
    emitters: EmitterSet | None,
    path: PathSettings,
    environment: EnvironmentMap = NOTHING,
) -> Shader:
    """Return a shader whose paths follow the given materials and emitters.

    Voxels that hold a point of an emitter are unknown to the cache: their pixels mix emitter and frame (method.md).

    Parameters
    ----------
    cache
        As `fipt.stages.cache.build.build` returns it.
    """
    known = cache["count"] > 0
    if emitters is not None and len(emitters.triangle):
        known &= ~np.isin(cache["key"], emitter_voxels(mesh, cache, emitters.triangle))
    surface = SurfaceCache(cache, cache["radiance"], known, materials)
    return Shader(RayScene(mesh), Triangles(mesh, emitters), surface, path, sky_of(environment))


def emitter_voxels(mesh: Mesh, cache: Mapping[str, np.ndarray], triangles: np.ndarray) -> np.ndarray:
    """Keys of the voxels that emitting triangles pass through."""
    center, side, n = cache["center"], float(cache["side"]), int(cache["resolution"])
    emitting = Mesh(mesh.vertices, mesh.triangles[triangles])
    points, _ = surface_points(emitting, side / n / 2, center - side / 2, center + side / 2, seed=0)
    return np.unique(voxel_keys(points, center, side, n))
