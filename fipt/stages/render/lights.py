"""Light setups: found emitters changed, new area lights added to the mesh; and each lamp alone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fipt.render.objects import light_mesh
from fipt.render.surface import EmitterSet
from fipt.scene.emitters import Emitters, chosen_emitters, default_name, edited_radiance, read_names
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.scene.setup import AreaLight, MeshLight, RelightSetup, SphereLight, SpotLight

_SPHERE_SUBDIVISIONS = 3


def apply_setup(
    mesh: Mesh, emitters: Emitters, setup: RelightSetup, names: Sequence[str] | None = None
) -> tuple[Mesh, EmitterSet]:
    """Return the mesh with the new lights' triangles appended, and what emits.

    ``names`` are those of the lamps; None: ``emitter-N``.

    Raises
    ------
    FiptError
        If the setup names a lamp that was not found.
    """
    radiance = emitters.radiance.astype(np.float64)
    for edit in setup.emitters:
        chosen = chosen_emitters(edit, read_names(None, emitters) if names is None else names)
        own = np.isin(emitters.emitter, chosen)
        radiance[own] = edited_radiance(radiance[own], edit)
    vertices, triangles = [mesh.vertices], [mesh.triangles]
    lit, shine = [emitters.triangle], [radiance]
    next_vertex, next_triangle = len(mesh.vertices), len(mesh.triangles)
    for light in setup.lights:
        if isinstance(light, SpotLight):  # shines without a surface
            continue
        v, t = _geometry(light)
        vertices.append(v.astype(np.float32))
        triangles.append((t + next_vertex).astype(np.int32))
        lit.append(np.arange(next_triangle, next_triangle + len(t)))
        shine.append(np.tile(np.array(light.radiance), (len(t), 1)))
        next_vertex, next_triangle = next_vertex + len(v), next_triangle + len(t)
    return Mesh(np.concatenate(vertices), np.concatenate(triangles)), EmitterSet(
        np.concatenate(lit).astype(np.int32),
        np.concatenate(shine).astype(np.float32),
        emitters.two_sided,
    )


def lights_alone(
    emitters: Emitters, outside: EnvironmentMap, separate: int
) -> dict[str, tuple[EmitterSet, EnvironmentMap]]:
    """Split a room's light into parts that add up to it.

    Parameters
    ----------
    separate
        So many lamps, the most powerful ones, are parts of their own; the others are one part together.

    Returns
    -------
    dict
        ``emitter-N`` for lamp N of emitters.json, most powerful first; ``rest``; ``outside``. What shines in each part:
        all emitting triangles are named, those of other parts with no radiance, and the light from outside.
    """
    strength = emitters.area * emitters.radiance.astype(np.float64).mean(axis=1)
    power = np.bincount(emitters.emitter, strength) if len(strength) else np.zeros(0)
    order = [int(lamp) for lamp in np.argsort(-power, kind="stable") if power[lamp] > 0]
    groups = {default_name(lamp): [lamp] for lamp in order[:separate]}
    if order[separate:]:
        groups["rest"] = order[separate:]
    night = replace(outside, radiance=np.zeros_like(outside.radiance))
    parts = {}
    for name, lamps in groups.items():
        own = np.isin(emitters.emitter, lamps)[:, None]
        radiance = np.where(own, emitters.radiance, 0).astype(np.float32)
        parts[name] = (EmitterSet(emitters.triangle, radiance, emitters.two_sided), night)
    if outside.shines:
        dark = EmitterSet(emitters.triangle, np.zeros_like(emitters.radiance), emitters.two_sided)
        parts["outside"] = (dark, outside)
    return parts


def _geometry(light: AreaLight) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and triangles (T, 3) of a new light."""
    if isinstance(light, MeshLight):
        mesh = light_mesh(light)
        return mesh.vertices, mesh.triangles
    center = np.array(light.center)
    if isinstance(light, SphereLight):
        import trimesh

        sphere = trimesh.creation.icosphere(_SPHERE_SUBDIVISIONS, light.radius)
        return np.asarray(sphere.vertices) + center, np.asarray(sphere.faces)
    n = np.array(light.normal, np.float64)
    n /= np.linalg.norm(n)
    u = np.cross(n, [0.0, 1.0, 0.0] if abs(n[1]) < 0.9 else [1.0, 0.0, 0.0])
    u *= 0.5 * light.size[0] / np.linalg.norm(u)
    v = np.cross(n, u)
    v *= 0.5 * light.size[1] / np.linalg.norm(v)
    corners = center + np.array([-u - v, u - v, u + v, -u + v])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])
