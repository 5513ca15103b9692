"""Lights of a scene file: what shines from outside as a map, small lamps as small emitting shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fipt.errors import FiptError
from fipt.render.assets import sky_map
from fipt.scene.environment import NOTHING, EnvironmentMap, constant, read_map, solid_angles, texel_directions, texel_of
from fipt.synthetic.scenefile import textures
from fipt.synthetic.scenefile.shapes import AROUND
from fipt.synthetic.scenefile.source import SceneFileReader
from fipt.synthetic.scenefile.values import COLORS, color, point, transform, vector
from fipt.synthetic.scenefile.xml import Node

_SUN_RADIUS = 1.5
"""Radius of the disc that a directional light becomes in the background, degrees."""
_MAP_ROWS = 256
"""Most rows of an environment map, and those of a directional light's."""
_POINT_RADIUS = 0.03
"""Radius of what a point or spot light becomes, metres."""
Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Turns what has z up: x stays, z becomes y, y becomes -z."""
_SKY = ("sky", "sun", "sunsky")
_SKY_NUMBERS = (
    "turbidity", "sun_scale", "sky_scale", "sun_aperture", "latitude", "longitude", "timezone",
    "year", "month", "day", "hour", "minute", "second",
)  # fmt: skip


@dataclass(frozen=True)
class PointEmitter:
    """A small light in the file's world: a ball, or a disc that shines to one side.

    Attributes
    ----------
    name
        The emitter's id or type.
    position
        (3,) float64.
    direction
        (3,) unit vector where a disc shines; None for a ball.
    intensity
        (3,) radiant intensity (along the disc's axis), file units: radiance times square units of length.
    """

    name: str
    position: np.ndarray
    direction: np.ndarray | None
    intensity: np.ndarray


def radiance(node: Node, source: SceneFileReader) -> np.ndarray | None:
    """(3,) radiance of the area light of a shape, or None where it has none; a textured one counts with its mean."""
    lights = node.objects("emitter")
    if not lights:
        return None
    found = textures.read_map(lights[0].get("radiance", "intensity"), 1.0, source, light=True)
    if not found.constant:
        source.note(f"light {node.id or node.where}: its radiance has a texture; the mean is used")
    if lights[0].type not in ("area", "directionalarea"):
        source.refuse(lights[0], f"emitter {lights[0].type} on a shape")
    return found.mean


def outside(scene: Node, world_from_file: np.ndarray, source: SceneFileReader) -> EnvironmentMap:
    """Return the light from outside, all its emitters together.

    Parameters
    ----------
    scene
        The scene element.
    world_from_file
        (3, 3) rotation that makes y up.
    source
        Takes problems and notes.
    """
    # The sky's own up axis is z since Mitsuba 2, and was y before.
    z_up = not scene.attributes.get("version", "0").startswith("0")
    found = NOTHING
    for node in scene.objects("emitter"):
        if node.type == "constant":
            more = constant(_light_color(node, "radiance"))
        elif node.type == "envmap":
            more = _envmap(node, world_from_file, source)
        elif node.type in _SKY:
            more = _sky(node, world_from_file, z_up, source)
        elif node.type in ("directional", "distant"):
            more = _directional(node, world_from_file)
            source.note(
                f"light {_name(node)}: directional; a disc of {2 * _SUN_RADIUS:g} degrees outside shines as much"
            )
        else:
            continue
        found = more if not found.known else _sum(found, more)
    return found


def point_emitters(scene: Node, source: SceneFileReader) -> list[PointEmitter]:
    """Return point and spot lights; emitters without a rule become problems."""
    found = []
    for node in scene.objects("emitter"):
        to_world = transform(node.get("to_world"))
        place = to_world[:3, 3]
        if node.type == "point":
            position = node.get("position")
            place = place if position is None else point(position)
            found.append(PointEmitter(_name(node), place, None, _intensity(node, source)))
            source.note(f"light {_name(node)}: a point; a ball of radius {_POINT_RADIUS} m shines as much")
        elif node.type in ("spot", "projector"):
            ahead = to_world[:3, 2] / np.linalg.norm(to_world[:3, 2])
            found.append(PointEmitter(_name(node), place, ahead, _intensity(node, source)))
            source.note(
                f"light {_name(node)}: a {node.type}; a disc of radius {_POINT_RADIUS} m shines as much along its "
                "axis, and in a wider cone"
            )
        elif node.type not in ("constant", "envmap", "directional", "distant", *_SKY):
            source.refuse(node, f"emitter {node.type}")
    return found


def emitter_shape(
    emitter: PointEmitter, position: np.ndarray, direction: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """(V, 3) vertices in metres and (T, 3) triangles of a lamp at a position of the room."""
    import trimesh

    if direction is None:
        ball = trimesh.creation.icosphere(2, _POINT_RADIUS)
        return ball.vertices + position, np.asarray(ball.faces, np.int32)
    side = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    side /= np.linalg.norm(side)
    phi = 2 * np.pi * np.arange(AROUND)[:, None] / AROUND
    rim = position + _POINT_RADIUS * (np.cos(phi) * side + np.sin(phi) * np.cross(direction, side))
    k = np.arange(AROUND)
    triangles = np.column_stack([k * 0 + AROUND, k, (k + 1) % AROUND]).astype(np.int32)
    return np.concatenate([rim, position[None]]), triangles


def emitter_radiance(emitter: PointEmitter, scale: float) -> np.ndarray:
    """(3,) radiance of `emitter_shape`: intensity over its visible area; lengths grow by ``scale``."""
    return emitter.intensity * scale**2 / (np.pi * _POINT_RADIUS**2)


def _name(node: Node) -> str:
    return node.id or f"{node.type} ({node.where})"


def _intensity(node: Node, source: SceneFileReader) -> np.ndarray:
    """(3,) radiant intensity of a small light, along its axis if it has one."""
    if node.type != "projector":
        return _light_color(node, "intensity")
    # The irradiance of the image one unit ahead, which Mitsuba multiplies by pi.
    image = textures.read_map(node.get("irradiance"), 1.0, source, light=True)
    return np.pi * node.number("scale", 1.0) * image.mean


def _light_color(node: Node, *names: str) -> np.ndarray:
    found = node.get(*names)
    if found is None:
        return np.ones(3)
    if found.tag not in (*COLORS, "texture"):
        raise found.wrong(f"{names[0]} must be a colour")
    return color(found, light=True)


# --- maps -----------------------------------------------------------------------------------------------


def _envmap(node: Node, world_from_file: np.ndarray, source: SceneFileReader) -> EnvironmentMap:
    path = source.file(node.get("filename"))
    if path is None:
        return NOTHING
    if path.suffix.lower() in (".exr", ".hdr"):
        try:
            radiance_map = read_map(path).radiance
        except FiptError as error:
            source.note(str(error))
            source.refuse(node, f"environment map {path.name}, which cannot be read")
            return NOTHING
    else:
        wrapped = Node("texture", {"type": "bitmap"}, node.children, node.where)
        radiance_map = textures.read_map(wrapped, 1.0, source, light=True).values
    size = radiance_map.shape[:2]
    radiance_map = textures.shrunk(radiance_map, 2 * _MAP_ROWS, None)
    height, width = radiance_map.shape[:2]
    if size != (height, width):
        source.note(f"environment map {path.name}: {size[1]}x{size[0]} averaged down to {width}x{height}")
    # Mitsuba's map is seen from inside with -z at its sides; ours has -z in the centre.
    scaled = np.roll(radiance_map, width // 2, axis=1) * np.float32(node.number("scale", 1.0))
    turn = world_from_file @ _rotation_of(transform(node.get("to_world")))
    if turn[1, 1] > 1 - 1e-6 and np.linalg.det(turn) > 0:
        return EnvironmentMap("given", scaled, rotation=float(np.degrees(np.arctan2(turn[0, 2], turn[0, 0]))))
    turned = EnvironmentMap("given", scaled).lookup(texel_directions(height, width) @ turn)
    return EnvironmentMap("given", turned.reshape(height, width, 3).astype(np.float32))


def _rotation_of(matrix: np.ndarray) -> np.ndarray:
    """(3, 3) rotation of a transform, its scale left out; mirrored axes stay mirrored."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    return u @ vt


def _sky(node: Node, world_from_file: np.ndarray, z_up: bool, source: SceneFileReader) -> EnvironmentMap:
    options: dict[str, float | list[float]] = {
        name: node.number(name, 0.0) for name in _SKY_NUMBERS if node.get(name) is not None
    }
    scale = node.number("scale", 1.0)
    if node.type == "sky":
        options["sun_scale"] = 0.0
    if node.type == "sun":
        options["sky_scale"] = 0.0
    if node.get("albedo") is not None:
        options["albedo"] = textures.read_map(node.get("albedo"), 0.3, source).mean.tolist()
    sun = node.get("sun_direction")
    if sun is not None:
        options["sun_direction"] = (world_from_file @ vector(sun)).tolist()
    turn = world_from_file @ _rotation_of(transform(node.get("to_world")))
    source.note(f"light {_name(node)}: {node.type} by the model of Mitsuba 3, as a map; black below the horizon")
    try:
        made = sky_map(options, turn if z_up else turn @ Z_UP)
    except ValueError as error:
        raise node.wrong(f"Mitsuba refuses this {node.type}: {error}") from error
    return EnvironmentMap("given", made * np.float32(scale))


def _directional(node: Node, world_from_file: np.ndarray) -> EnvironmentMap:
    ahead = node.get("direction")
    direction = transform(node.get("to_world"))[:3, 2] if ahead is None else vector(ahead)
    toward = -(world_from_file @ direction) / np.linalg.norm(direction)
    directions = texel_directions(_MAP_ROWS, 2 * _MAP_ROWS)
    disc = np.clip((directions @ toward - np.cos(np.radians(_SUN_RADIUS))) * 1e9, 0, 1).reshape(_MAP_ROWS, -1)
    if not disc.any():
        row, column = texel_of(toward[None], _MAP_ROWS, 2 * _MAP_ROWS).astype(int)[0]
        disc[min(row, _MAP_ROWS - 1), column % (2 * _MAP_ROWS)] = 1
    share = disc / (disc * solid_angles(_MAP_ROWS, 2 * _MAP_ROWS)).sum()
    return EnvironmentMap("given", (share[..., None] * _light_color(node, "irradiance")).astype(np.float32))


def _sum(first: EnvironmentMap, second: EnvironmentMap) -> EnvironmentMap:
    """Add two backgrounds with y up, on the finer one's map."""
    height, width = max((b.radiance.shape[:2] for b in (first, second)), key=lambda shape: shape[0])
    directions = texel_directions(height, width)
    total = first.lookup(directions) + second.lookup(directions)
    return EnvironmentMap("given", total.reshape(height, width, 3))
