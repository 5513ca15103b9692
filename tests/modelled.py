"""A modelled room as code: what reading a scene file gives, a few boxes and quads."""

from pathlib import Path

import numpy as np

from fipt.io.background import NOTHING, Background
from fipt.synthesize.material import Material
from fipt.synthesize.scenefile.scene import SceneContent, Surface
from fipt.synthesize.shapes import Shape, box, panel

SIZE = np.array([4.0, 2.6, 3.5])
"""Of the room, which stands with one lower corner at the origin; metres."""
GAP = 1.0
"""Between the room's walls and the house's outer walls."""
CUPBOARD = np.array([[0.1, 0.0, 0.1], [1.3, 1.6, 1.3]])
"""A closed hollow box in a corner."""
TILE = 0.5
"""Metres after which the floor's texture repeats."""
LAMP = (6.0, 5.0, 4.0)


def constant(name: str, color: tuple[float, float, float], roughness: float = 0.8, metallic: float = 0.0) -> Material:
    return Material(name, np.float32([[color]]), np.float32([[roughness]]), np.float32([[metallic]]))


def checks(name: str = "tiles") -> Material:
    """Four colours, two roughnesses: 2 x 2 and 1 x 2 texels."""
    color = np.float32([[[0.8, 0.2, 0.2], [0.2, 0.8, 0.2]], [[0.2, 0.2, 0.8], [0.6, 0.6, 0.1]]])
    return Material(name, color, np.float32([[0.2, 0.6]]), np.float32([[0.0]]))


def surface(name: str, shape: Shape, material: int, radiance: tuple[float, float, float] | None = None) -> Surface:
    light = None if radiance is None else np.float32(radiance)
    return Surface(
        name, shape.vertices.astype(np.float32), shape.triangles.astype(np.int32), shape.uv.astype(np.float32),
        material, light,
    )  # fmt: skip


def _around(low: np.ndarray, high: np.ndarray) -> Shape:
    middle = (low + high) / 2
    return box(high - low).moved(middle[0], low[1], middle[2])


def content(window: bool = False, background: Background = NOTHING, lamp: bool = True) -> SceneContent:
    """Return the room: floor, four walls, ceiling, cupboard, lamp below the ceiling; the house around it.

    With a ``window`` the wall at z = 0 and the house are missing.
    """
    x, y, z = SIZE
    floor = panel((0, 0, 0), (0, 0, z), (x, 0, 0))
    floor = Shape(floor.vertices, floor.triangles, floor.vertices[:, [0, 2]] / TILE)
    walls = {
        "west": panel((0, 0, 0), (0, y, 0), (0, 0, z)),
        "east": panel((x, 0, 0), (0, 0, z), (0, y, 0)),
        "south": panel((0, 0, z), (0, y, 0), (x, 0, 0)),
        "north": panel((0, 0, 0), (x, 0, 0), (0, y, 0)),
    }
    if window:
        del walls["north"]
    surfaces = [
        surface("floor", floor, 1),
        surface("ceiling", panel((0, y, 0), (x, 0, 0), (0, 0, z)), 0),
        *(surface(f"{name} wall", wall, 0) for name, wall in walls.items()),
        surface("cupboard", _around(*CUPBOARD), 2),
    ]
    if lamp:
        shade = panel((1.8, 2.3, 1.8), (0.4, 0, 0), (0, 0, 0.4))
        surfaces.append(surface("lamp", shade, 0, LAMP))
    house = np.array([[-GAP, -0.01, -GAP], [x + GAP, y + 0.01, z + GAP]])
    if not window:
        surfaces.append(surface("house", _around(*house), 0))
    materials = [constant("paint", (0.7, 0.7, 0.6)), checks(), constant("steel", (0.6, 0.6, 0.6), 0.3, 1.0)]
    limits = np.array([np.zeros(3), SIZE]) if window else house
    return SceneContent(
        surfaces, materials, background, limits.astype(np.float32), ["made in code"], [Path("room.xml")]
    )
