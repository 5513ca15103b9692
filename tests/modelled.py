"""A modelled room as code: what reading a scene file gives, a few boxes and quads."""

from pathlib import Path

import numpy as np

from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.scenefile.scene import SceneContent, SceneShape
from fipt.synthetic.shapes import Shape, box, panel

SIZE = np.array([4.0, 2.6, 3.5])
"""Of the room, which stands with one lower corner at the origin; metres."""
GAP = 1.0
"""Between the room's walls and the house's outer walls."""
CUPBOARD = np.array([[0.1, 0.0, 0.1], [1.3, 1.6, 1.3]])
"""A closed hollow box in a corner."""
TILE = 0.5
"""Metres after which the floor's texture repeats."""
LAMP = (6.0, 5.0, 4.0)


def constant(
    name: str, color: tuple[float, float, float], roughness: float = 0.8, metallic: float = 0.0
) -> RoomMaterial:
    return RoomMaterial(name, np.float32([[color]]), np.float32([[roughness]]), np.float32([[metallic]]))


def checks(name: str = "tiles") -> RoomMaterial:
    """Four colours, two roughnesses: 2 x 2 and 1 x 2 texels."""
    color = np.float32([[[0.8, 0.2, 0.2], [0.2, 0.8, 0.2]], [[0.2, 0.2, 0.8], [0.6, 0.6, 0.1]]])
    return RoomMaterial(name, color, np.float32([[0.2, 0.6]]), np.float32([[0.0]]))


def surface(name: str, shape: Shape, material: int, radiance: tuple[float, float, float] | None = None) -> SceneShape:
    light = None if radiance is None else np.float32(radiance)
    return SceneShape(
        name, shape.vertices.astype(np.float32), shape.triangles.astype(np.int32), shape.uv.astype(np.float32),
        material, light,
    )  # fmt: skip


def _around(low: np.ndarray, high: np.ndarray) -> Shape:
    middle = (low + high) / 2
    return box(high - low).moved(middle[0], low[1], middle[2])


def content(window: bool = False, environment: EnvironmentMap = NOTHING, lamp: bool = True) -> SceneContent:
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
        surfaces, materials, environment, limits.astype(np.float32), ["made in code"], [Path("room.xml")]
    )


XML = """<scene version="3.0.0">
  <bsdf type="twosided" id="paint"><bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.7, 0.6"/></bsdf></bsdf>
  <bsdf type="roughplastic" id="tiles">
    <texture type="bitmap" name="diffuse_reflectance">
      <string name="filename" value="textures/tiles.png"/>
      <transform name="to_uv"><scale x="8" y="7"/></transform>
    </texture>
    <float name="alpha" value="0.2"/>
  </bsdf>
  <shape type="cube" id="walls">
    <transform name="to_world"><scale x="2" y="1.3" z="1.75"/><translate x="2" y="1.3" z="1.75"/></transform>
    <ref id="paint"/>
  </shape>
  <shape type="rectangle" id="floor">
    <transform name="to_world">
      <scale x="2" y="1.75"/><rotate x="1" angle="-90"/><translate x="2" y="0.01" z="1.75"/>
    </transform>
    <ref id="tiles"/>
  </shape>
  <shape type="obj" id="cupboard"><string name="filename" value="models/cupboard.obj"/><ref id="paint"/></shape>
  <shape type="rectangle" id="lamp">
    <transform name="to_world">
      <scale value="0.3"/><rotate x="1" angle="90"/><translate x="2" y="2.55" z="1.75"/>
    </transform>
    <emitter type="area"><rgb name="radiance" value="6, 5, 4"/></emitter>
  </shape>
</scene>
"""
"""A closed room of 4 x 2.6 x 3.5 m; the lamp faces down."""


def write_scene(folder: Path) -> Path:
    """Write the scene file of a room with a mesh and a texture; return its path."""
    from PIL import Image

    (folder / "models").mkdir(parents=True)
    (folder / "textures").mkdir()
    shape = _around(*CUPBOARD)
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in shape.vertices]
    lines += ["f " + " ".join(str(k + 1) for k in triangle) for triangle in shape.triangles]
    (folder / "models" / "cupboard.obj").write_text("\n".join(lines) + "\n")
    Image.fromarray(np.uint8([[[230, 60, 60], [60, 230, 60]], [[60, 60, 230], [200, 200, 40]]])).save(
        folder / "textures" / "tiles.png"
    )
    (folder / "room.xml").write_text(XML)
    return folder / "room.xml"
