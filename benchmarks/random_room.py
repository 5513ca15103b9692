"""A furnished room as a Mitsuba scene file, its colours and books by a seed: a room that no setting was tuned on.

    python -m benchmarks.random_room studio --seed 3

FOLDER/scene.xml is a room of 6.2 m x 4.6 m: a table with chairs of thin steel legs, a shelf of some hundred books, a
screen that is dimmer than white surface, a window behind a frame, three pendant lamps, a lamp with a shade, a mirror, a
painting, a fridge, a sofa. It is a room as `source: mitsuba` takes it; `benchmarks.scan` makes its scan.
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from fipt.formats.files import make_folder, write_text

WIDTH, HEIGHT, DEPTH = 6.2, 2.8, 4.6
"""Along x, y and z, metres."""

_WINDOW, _PENDANT, _SHADE, _SCREEN = (9, 10.5, 13), (22, 17, 11), (3.2, 2.6, 1.8), (0.7, 0.9, 1.3)
"""Radiance."""

Vector = Sequence[float] | np.ndarray


class SceneWriter:
    """Shapes and materials of a scene file, in the order in which they are added."""

    def __init__(self) -> None:
        self.shapes: list[str] = []
        self.materials: dict[str, str] = {}

    def material(self, name: str, inner: str) -> None:
        """Add a two-sided material."""
        self.materials[name] = f'<bsdf type="twosided" id="{name}">{inner}</bsdf>'

    def diffuse(self, name: str, color: Vector) -> None:
        """Add a diffuse material of a colour."""
        self.material(name, f'<bsdf type="diffuse">{_rgb("reflectance", color)}</bsdf>')

    def plastic(self, name: str, color: Vector, alpha: float) -> None:
        """Add a coloured plastic."""
        self.material(
            name,
            f'<bsdf type="roughplastic">{_rgb("diffuse_reflectance", color)}<float name="alpha" value="{alpha}"/>'
            '<boolean name="nonlinear" value="false"/></bsdf>',
        )

    def metal(self, name: str, kind: str, alpha: float) -> None:
        """Add one of Mitsuba's metals."""
        self.material(
            name,
            f'<bsdf type="roughconductor"><string name="material" value="{kind}"/>'
            f'<float name="alpha" value="{alpha}"/></bsdf>',
        )

    def textured(self, name: str, file: str, across: float, along: float, alpha: float | None = None) -> None:
        """Add a material with a texture that is laid some times: plastic of a roughness, else diffuse."""
        color = "reflectance" if alpha is None else "diffuse_reflectance"
        texture = (
            f'<texture type="bitmap" name="{color}"><string name="filename" value="{file}"/>'
            f'<transform name="to_uv"><scale x="{across}" y="{along}"/></transform></texture>'
        )
        rough = "" if alpha is None else f'<float name="alpha" value="{alpha}"/>'
        self.material(name, f'<bsdf type="{"diffuse" if alpha is None else "roughplastic"}">{texture}{rough}</bsdf>')

    def box(self, low: Vector, high: Vector, material: str) -> None:
        """Add a box between two corners."""
        middle, half = (np.array(low) + np.array(high)) / 2, (np.array(high) - np.array(low)) / 2
        placed = f"<scale {_xyz(half)}/><translate {_xyz(middle)}/>"
        self.shapes.append(
            f'<shape type="cube"><transform name="to_world">{placed}</transform><ref id="{material}"/></shape>'
        )

    def rectangle(self, middle: Vector, u: Vector, v: Vector, material: str, radiance: Vector | None = None) -> None:
        """Add a rectangle of half sides u and v, which faces along u x v."""
        normal = np.cross(u, v)
        matrix = np.eye(4)
        matrix[:3] = np.column_stack([u, v, normal / np.linalg.norm(normal), middle])
        numbers = " ".join(f"{number:.5f}" for number in matrix.ravel())
        self.shapes.append(
            f'<shape type="rectangle"><transform name="to_world"><matrix value="{numbers}"/></transform>'
            f'<ref id="{material}"/>{_light(radiance)}</shape>'
        )

    def sphere(self, middle: Vector, radius: float, material: str, radiance: Vector | None = None) -> None:
        """Add a sphere."""
        self.shapes.append(
            f'<shape type="sphere"><point name="center" {_xyz(middle)}/><float name="radius" value="{radius}"/>'
            f'<ref id="{material}"/>{_light(radiance)}</shape>'
        )

    def cylinder(self, low: Vector, high: Vector, radius: float, material: str, radiance: Vector | None = None) -> None:
        """Add a cylinder between two points."""
        self.shapes.append(
            f'<shape type="cylinder"><point name="p0" {_xyz(low)}/><point name="p1" {_xyz(high)}/>'
            f'<float name="radius" value="{radius}"/><ref id="{material}"/>{_light(radiance)}</shape>'
        )

    def xml(self) -> str:
        """The scene file."""
        head = (
            '<integrator type="path"/>\n<sensor type="perspective"><float name="fov" value="70"/><transform '
            'name="to_world"><lookat origin="0.6,1.5,4" target="4,1.2,1" up="0,1,0"/></transform></sensor>'
        )
        return "\n".join(['<scene version="3.0.0">', head, *self.materials.values(), *self.shapes, "</scene>", ""])


def _rgb(name: str, color: Vector) -> str:
    return f'<rgb name="{name}" value="{color[0]:.3f} {color[1]:.3f} {color[2]:.3f}"/>'


def _xyz(values: Vector) -> str:
    return f'x="{values[0]:.4f}" y="{values[1]:.4f}" z="{values[2]:.4f}"'


def _light(radiance: Vector | None) -> str:
    return "" if radiance is None else f'<emitter type="area">{_rgb("radiance", radiance)}</emitter>'


def write_texture(path: Path, linear: np.ndarray) -> None:
    """Write linear colours (H, W, 3), BGR as OpenCV has them, as a PNG image."""
    cv2.imwrite(str(path), (np.clip(linear, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8))


def _textures(folder: Path, rng: np.random.Generator) -> None:
    """Write floor boards, striped wallpaper and a painting (BGR, as OpenCV writes)."""
    boards, rows = np.zeros((256, 256, 3)), np.arange(256)[:, None]
    for board in range(8):
        color = np.array([0.16, 0.3, 0.45]) * rng.uniform(0.6, 1.3)
        grain = 1 + 0.12 * np.sin(rows / rng.uniform(3, 9) + rng.uniform(0, 6) + 0.6 * np.sin(rows / 17 + board))
        boards[:, board * 32 : (board + 1) * 32] = color * grain[..., None]
        boards[:, board * 32] *= 0.5
    paper = np.full((256, 256, 3), 0.55) * [0.75, 0.95, 0.9]
    for stripe in range(0, 256, 32):
        paper[:, stripe : stripe + 14] *= [0.8, 0.72, 0.7]
    painting = cv2.resize(rng.random((12, 16, 3)).astype(np.float32), (256, 192), interpolation=cv2.INTER_CUBIC)
    for name, linear in (("floor", boards), ("stripes", paper)):
        write_texture(folder / f"{name}.png", linear)
    cv2.imwrite(str(folder / "painting.png"), (np.clip(painting, 0, 1) * 255).astype(np.uint8))


def _materials(scene: SceneWriter, rng: np.random.Generator) -> None:
    scene.textured("floor", "floor.png", 3, 3, 0.25)
    scene.textured("stripes", "stripes.png", 4, 1)
    scene.textured("painting", "painting.png", 1, 1)
    scene.diffuse("ceiling", (0.82, 0.82, 0.8))
    scene.diffuse("wall_a", rng.uniform(0.3, 0.8, 3))
    scene.diffuse("wall_b", rng.uniform(0.25, 0.7, 3))
    scene.diffuse("dark", (0.04, 0.04, 0.045))
    scene.diffuse("white", (0.85, 0.85, 0.85))
    scene.diffuse("cloth", rng.uniform(0.1, 0.6, 3))
    scene.plastic("lacquer", rng.uniform(0.05, 0.7, 3), 0.1)
    scene.plastic("wood", (0.4, 0.24, 0.12), 0.3)
    scene.metal("steel", "Cr", 0.2)
    scene.metal("gold", "Au", 0.15)
    scene.metal("mirror", "Ag", 0.02)


def _shell(scene: SceneWriter) -> None:
    """Floor, ceiling, walls, and what hangs on them."""
    x, y, z = WIDTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "floor")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "ceiling")
    scene.rectangle((x, y, 0), (x, 0, 0), (0, y, 0), "wall_a")
    scene.rectangle((x, y, DEPTH), (-x, 0, 0), (0, y, 0), "wall_b")
    scene.rectangle((0, y, z), (0, 0, -z), (0, y, 0), "stripes")
    scene.rectangle((WIDTH, y, z), (0, 0, z), (0, y, 0), "white")
    scene.rectangle((1.5, 1.5, 0.02), (0.4, 0, 0), (0, 0.55, 0), "mirror")
    scene.box((1.05, 0.9, 0), (1.95, 0.95, 0.04), "gold")
    scene.box((1.05, 2.05, 0), (1.95, 2.1, 0.04), "gold")
    scene.box((1.05, 0.9, 0), (1.1, 2.1, 0.04), "gold")
    scene.box((1.9, 0.9, 0), (1.95, 2.1, 0.04), "gold")
    scene.box((3.0, 1.2, 0), (4.1, 2.0, 0.04), "wood")
    scene.rectangle((3.55, 1.6, 0.045), (0.5, 0, 0), (0, 0.35, 0), "painting")


def _lights(scene: SceneWriter) -> None:
    """A window, three pendant lamps, a lamp with a shade, a screen."""
    z, y = 1.6, 1.5
    scene.rectangle((WIDTH - 0.02, y, z), (0, 0, 0.6), (0, 0.55, 0), "dark", _WINDOW)
    for at in (z - 0.62, z, z + 0.62):
        scene.box((WIDTH - 0.06, y - 0.6, at - 0.025), (WIDTH - 0.01, y + 0.6, at + 0.025), "white")
    for at in (y - 0.58, y + 0.58):
        scene.box((WIDTH - 0.06, at - 0.03, z - 0.64), (WIDTH - 0.01, at + 0.03, z + 0.64), "white")
    for x in (2.0, 2.9, 3.8):
        scene.sphere((x, 1.95, 2.3), 0.09, "white", _PENDANT)
        scene.cylinder((x, 2.04, 2.3), (x, HEIGHT, 2.3), 0.008, "dark")
    scene.cylinder((0.55, 1.25, 0.5), (0.55, 1.6, 0.5), 0.2, "white", _SHADE)
    scene.cylinder((0.55, 0, 0.5), (0.55, 1.25, 0.5), 0.015, "gold")
    scene.cylinder((0.55, 0, 0.5), (0.55, 0.03, 0.5), 0.16, "gold")
    scene.box((3.6, 1.0, DEPTH - 0.05), (4.9, 1.75, DEPTH - 0.01), "dark")
    scene.rectangle((4.25, 1.375, DEPTH - 0.055), (-0.6, 0, 0), (0, 0.33, 0), "dark", _SCREEN)


def _furniture(scene: SceneWriter) -> None:
    scene.box((2.2, 0.72, 1.8), (4.0, 0.76, 2.8), "wood")
    for x in (2.25, 3.9):
        for z in (1.85, 2.7):
            scene.box((x, 0, z), (x + 0.06, 0.72, z + 0.06), "steel")
    for x, z in ((2.5, 1.3), (3.5, 1.3), (2.6, 3.1), (3.4, 3.1)):
        scene.box((x, 0.42, z), (x + 0.42, 0.46, z + 0.42), "lacquer")
        for a in (0, 0.38):
            for b in (0, 0.38):
                scene.box((x + a, 0, z + b), (x + a + 0.04, 0.42, z + b + 0.04), "steel")
        back = z if z < 2 else z + 0.38
        scene.box((x, 0.46, back), (x + 0.42, 0.9, back + 0.04), "lacquer")
    for number, material in enumerate(("gold", "lacquer", "white")):
        scene.sphere((2.6 + 0.45 * number, 0.82, 2.2 + 0.1 * number), 0.06, material)
    for low, high in (
        ((4.4, 0.1, 3.3), (6.0, 0.42, 4.2)),
        ((4.4, 0.42, 4.0), (6.0, 0.85, 4.25)),
        ((4.3, 0.1, 3.3), (4.5, 0.6, 4.25)),
        ((5.9, 0.1, 3.3), (6.1, 0.6, 4.25)),
    ):
        scene.box(low, high, "cloth")
    scene.box((5.4, 0, 0.05), (6.1, 1.9, 0.7), "steel")
    scene.box((5.38, 1.0, 0.2), (5.4, 1.5, 0.23), "dark")
    scene.rectangle((3.1, 0.008, 2.3), (1.5, 0, 0), (0, 0, -1.0), "cloth")


def _shelf(scene: SceneWriter, rng: np.random.Generator) -> None:
    for y in (0.05, 0.45, 0.85, 1.25, 1.65):
        scene.box((0, y, 1.6), (0.3, y + 0.03, 3.4), "wood")
    scene.box((0, 0, 1.57), (0.3, 1.7, 1.6), "wood")
    scene.box((0, 0, 3.4), (0.3, 1.7, 3.43), "wood")
    for y in (0.08, 0.48, 0.88, 1.28):
        z = 1.62
        while z < 3.3:
            thick, high, name = rng.uniform(0.03, 0.07), rng.uniform(0.2, 0.33), f"book{len(scene.materials)}"
            scene.diffuse(name, rng.uniform(0.05, 0.8, 3))
            scene.box((0.03, y, z), (0.03 + rng.uniform(0.15, 0.24), y + high, z + thick - 0.003), name)
            z += thick
            if rng.random() < 0.12:
                z += rng.uniform(0.1, 0.3)


def write_room(folder: Path, seed: int) -> Path:
    """Write scene.xml and its textures; return the file."""
    rng, scene = np.random.default_rng(seed), SceneWriter()
    make_folder(folder)
    _textures(folder, rng)
    _materials(scene, rng)
    _shell(scene)
    _lights(scene)
    _furniture(scene)
    _shelf(scene, rng)
    write_text(folder / "scene.xml", scene.xml())
    return folder / "scene.xml"


def run(write: Callable[[Path, int], Path], description: str) -> None:
    """Write a room as the command line asks for: a folder and a seed."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(write(arguments.folder, arguments.seed))


if __name__ == "__main__":
    run(write_room, "A furnished room as a Mitsuba scene file, by a seed.")
