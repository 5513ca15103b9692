"""Light setups: found emitters changed, new area lights added to the mesh; and one light at a time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from fipt.render.crowding import crowded
from fipt.render.objects import light_mesh
from fipt.render.reach import LightPoints, points_on, unreached
from fipt.render.scene import RayScene
from fipt.render.spots import spots_of
from fipt.render.surface import EmitterSet
from fipt.scene.cameras import Camera
from fipt.scene.emitters import BOTH, Emitters, chosen_emitters, default_name, edited_radiance, read_names
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.scene.setup import AreaLight, EnvironmentEdit, MeshLight, NewLight, RelightSetup, SphereLight, SpotLight

_SPHERE_SUBDIVISIONS = 3


def apply_setup(
    mesh: Mesh, emitters: Emitters, setup: RelightSetup, names: Sequence[str] | None = None
) -> tuple[Mesh, EmitterSet]:
    """Return the mesh with the new lights' triangles appended, and what emits.

    ``names`` are those of the emitters; None: their default names.

    Raises
    ------
    FiptError
        If the setup names an emitter that was not found.
    """
    radiance = emitters.radiance.astype(np.float64)
    for edit in setup.emitters:
        chosen = chosen_emitters(edit, read_names(None, emitters) if names is None else names)
        own = np.isin(emitters.emitter, chosen)
        radiance[own] = edited_radiance(radiance[own], edit)
    vertices, triangles = [mesh.vertices], [mesh.triangles]
    lit, emitted, sides = [emitters.triangle], [radiance], [emitters.sides]
    next_vertex, next_triangle = len(mesh.vertices), len(mesh.triangles)
    for light in setup.lights:
        if isinstance(light, SpotLight):  # shines without a surface
            continue
        v, t = _geometry(light)
        vertices.append(v.astype(np.float32))
        triangles.append((t + next_vertex).astype(np.int32))
        lit.append(np.arange(next_triangle, next_triangle + len(t)))
        emitted.append(np.tile(np.array(light.radiance), (len(t), 1)))
        sides.append(np.full(len(t), BOTH, np.int8))
        next_vertex, next_triangle = next_vertex + len(v), next_triangle + len(t)
    return replace(mesh, vertices=np.concatenate(vertices), triangles=np.concatenate(triangles)), EmitterSet(
        np.concatenate(lit).astype(np.int32),
        np.concatenate(emitted).astype(np.float32),
        np.concatenate(sides),
    )


def idle_lights(mesh: Mesh, setup: RelightSetup, cameras: Sequence[Camera]) -> list[str]:
    """Warnings about new lights that light nothing the cameras see: outside the room, or shut in.

    ``mesh`` is the room's, with lights and objects of the setup.
    """
    shining = [(number, light) for number, light in enumerate(setup.lights) if any(_emission(light))]
    if not shining:
        return []
    idle = unreached(RayScene(mesh), cameras, [_light_points(light) for _, light in shining])
    return [
        f"lights.{number} of the setup, a {light.shape}, lights nothing that the cameras see: it is outside the room "
        "or shut in; fipt point tells positions in the room"
        for number, light in (shining[place] for place in idle)
    ]


def idle_edits(setup: RelightSetup) -> list[str]:
    """Warnings about a setup, or parts of it, that change nothing."""
    if setup == RelightSetup(cameras=setup.cameras, reference=setup.reference):
        here = setup.cameras is None
        return ["the setup changes nothing: its images are those of the room as it is"] if here else []
    said = [
        f"emitters.{number} of the setup changes nothing: it has no off, scale, color or radiance"
        for number, edit in enumerate(setup.emitters)
        if not edit.off and edit.scale is None and edit.color is None and edit.radiance is None
    ]
    unlit = [number for number, light in enumerate(setup.lights) if not any(_emission(light))]
    said += [f"lights.{number} of the setup gives no light" for number in unlit]
    if setup.environment == EnvironmentEdit():
        said.append("environment of the setup changes nothing: it has no file, radiance, scale or rotation")
    return said


def idle_objects(mesh: Mesh, counts: Sequence[int], cameras: Sequence[Camera]) -> list[str]:
    """Warnings about objects that the cameras do not see, nor any surface around: outside the room, or shut in.

    ``mesh`` is the room's; its last triangles are those of the objects, ``counts`` of each.
    """
    if not counts:
        return []
    starts = len(mesh.triangles) - sum(counts) + np.cumsum([0, *counts])
    surfaces = [LightPoints(points_on(mesh.vertices, mesh.triangles[a:b])) for a, b in pairwise(starts)]
    return [
        f"objects.{number} of the setup is seen by no camera and no surface that they see: it is outside the room or "
        "shut in, and changes nothing; fipt point tells positions in the room"
        for number in unreached(RayScene(mesh), cameras, surfaces)
    ]


def crowded_things(mesh: Mesh, setup: RelightSetup, counts: Sequence[int]) -> list[str]:
    """Warnings about lights and objects of a setup in one place; ``mesh`` and ``counts``: those of `idle_objects`."""
    starts = len(mesh.triangles) - sum(counts) + np.cumsum([0, *counts])
    things = {
        f"lights.{number}": _geometry(light)
        for number, light in enumerate(setup.lights)
        if not isinstance(light, SpotLight)
    }
    things |= {f"objects.{n}": (mesh.vertices, mesh.triangles[a:b]) for n, (a, b) in enumerate(pairwise(starts))}
    return [
        f"{one} and {other} of the setup fill the same place: rays meet now one, now the other; move or remove one"
        for one, other in crowded(things)
    ] + [
        f"lights.{one} and lights.{other} of the setup are the same spot twice: its light counts twice"
        for one, other in combinations(range(len(setup.lights)), 2)
        if setup.lights[one] == setup.lights[other] and isinstance(setup.lights[one], SpotLight)
    ]


def _emission(light: NewLight) -> tuple[float, ...]:
    return light.intensity if isinstance(light, SpotLight) else light.radiance


def _light_points(light: NewLight) -> LightPoints:
    if not isinstance(light, SpotLight):
        return LightPoints(points_on(*_geometry(light)))
    (spot,) = spots_of([light])
    return LightPoints(spot.position[None], spot.direction, float(np.cos(spot.cutoff)))


@dataclass(frozen=True)
class Illumination:
    """The light of a room: emitting triangles, and what comes from outside."""

    emitters: EmitterSet
    environment: EnvironmentMap


def missing_light(lit: Illumination, setup: RelightSetup) -> list[str]:
    """Warnings where a setup leaves no light, or changes light from outside that there is not."""
    edit, outside = setup.environment, lit.environment.emits
    said = []
    if edit is not None and not outside and (edit.rotation or edit.scale):
        said.append("environment of the setup turns or scales light from outside, of which there is none")
    spots = any(any(light.intensity) for light in setup.lights if isinstance(light, SpotLight))
    if not (spots or outside or lit.emitters.radiance.any()):
        said.append("nothing shines under this setup: all images are black")
    return said


def one_at_a_time(emitters: Emitters, environment: EnvironmentMap, separate: int) -> dict[str, Illumination]:
    """Split a room's light into parts that add up to it.

    Parameters
    ----------
    separate
        So many emitters, the most powerful ones, are parts of their own; the others are one part together.

    Returns
    -------
    dict
        Default name of each emitter of emitters.json, most powerful first; ``rest``; ``outside``. In each part all
        emitting triangles are named, those of other parts with no radiance.
    """
    strength = emitters.power
    power = np.bincount(emitters.emitter, strength) if len(strength) else np.zeros(0)
    order = [int(number) for number in np.argsort(-power, kind="stable") if power[number] > 0]
    groups = {default_name(number): [number] for number in order[:separate]}
    if order[separate:]:
        groups["rest"] = order[separate:]
    night = replace(environment, radiance=np.zeros_like(environment.radiance))
    parts = {}
    for name, numbers in groups.items():
        own = np.isin(emitters.emitter, numbers)[:, None]
        radiance = np.where(own, emitters.radiance, 0).astype(np.float32)
        parts[name] = Illumination(EmitterSet(emitters.triangle, radiance, emitters.sides), night)
    if environment.emits:
        dark = EmitterSet(emitters.triangle, np.zeros_like(emitters.radiance), emitters.sides)
        parts["outside"] = Illumination(dark, environment)
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
