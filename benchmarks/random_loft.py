"""A second furnished room as a Mitsuba scene file, of another style than `benchmarks.random_room`.

    python -m benchmarks.random_loft loft --seed 1

FOLDER/scene.xml is a loft of 8 m x 4.4 m: glossy tiles, walls of strong colours, beams, a partition, a wardrobe of
mirrors, a window with bars and a curtain, spots in the ceiling, a chandelier of eight small bulbs, a lamp with a shade,
a strip below a shelf, a fire, a screen that is off, a round sofa, chairs of thin tubes, a plant. The seed draws the
veins of the tiles, what stands on the shelf, and the leaves.
"""

from pathlib import Path

import cv2
import numpy as np

from benchmarks.random_room import SceneWriter, run, write_texture
from fipt.formats.files import make_folder, write_text

LENGTH, HEIGHT, DEPTH = 8.0, 3.2, 4.4
"""Along x, y and z, metres."""

_LEAVES = 60


def _textures(folder: Path, rng: np.random.Generator) -> None:
    """Write tiles and a carpet (BGR, as OpenCV writes)."""
    row, column = np.mgrid[:256, :256] // 32
    tiles = np.where(((row + column) % 2 > 0)[..., None], (0.62, 0.6, 0.57), (0.12, 0.13, 0.16))
    veins = cv2.resize(rng.random((40, 40)).astype(np.float32), (256, 256), interpolation=cv2.INTER_CUBIC)
    write_texture(folder / "marble.png", tiles * (0.8 + 0.4 * veins[..., None]))
    y, x = np.mgrid[:192, :256]
    carpet = np.tile((0.08, 0.08, 0.4), (192, 256, 1))
    carpet[np.sin((((y - 96) / 90) ** 2 + ((x - 128) / 120) ** 2) * 14) > 0] = (0.1, 0.35, 0.6)
    carpet[(x // 16 + y // 16) % 5 == 0] = (0.5, 0.55, 0.6)
    write_texture(folder / "carpet.png", carpet)


def _write_curtain(folder: Path) -> None:
    """Write a waving sheet of 1.6 m x 2.6 m as OBJ."""
    x = np.linspace(0, 1.6, 60)
    lines = [f"v {a:f} {y:f} {0.06 * np.sin(a * 2 * np.pi / 0.16):f}" for a in x for y in (0, 2.6)]
    for first in range(1, 2 * len(x) - 2, 2):
        lines += [f"f {first} {first + 1} {first + 2}", f"f {first + 1} {first + 3} {first + 2}"]
    write_text(folder / "curtain.obj", "\n".join(lines) + "\n")


def _materials(scene: SceneWriter) -> None:
    scene.textured("marble", "marble.png", 4, 2.2, 0.08)
    scene.textured("carpet", "carpet.png", 1, 1)
    for name, color in {
        "terra": (0.55, 0.22, 0.14),
        "green": (0.08, 0.2, 0.13),
        "cream": (0.78, 0.74, 0.62),
        "white": (0.85, 0.85, 0.85),
        "ceiling": (0.8, 0.8, 0.82),
        "black": (0.03, 0.03, 0.03),
        "curtain": (0.6, 0.55, 0.3),
        "sofa": (0.2, 0.25, 0.45),
        "leaf": (0.1, 0.3, 0.08),
        "shade": (0.7, 0.65, 0.5),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("screen", (0.02, 0.02, 0.02), 0.05)
    scene.plastic("walnut", (0.25, 0.13, 0.07), 0.2)
    scene.plastic("red", (0.6, 0.05, 0.04), 0.15)
    scene.plastic("porcelain", (0.8, 0.8, 0.78), 0.1)
    scene.metal("copper", "Cu", 0.2)
    scene.metal("chrome", "Cr", 0.1)
    scene.metal("mirror", "Ag", 0.02)


def _shell(scene: SceneWriter) -> None:
    """Floor, ceiling, walls, beams, skirting, a partition, a window with its curtain, a wardrobe of mirrors."""
    x, y, z = LENGTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "marble")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "ceiling")
    scene.rectangle((x, y, 0), (x, 0, 0), (0, y, 0), "terra")
    scene.rectangle((x, y, DEPTH), (-x, 0, 0), (0, y, 0), "cream")
    scene.rectangle((0, y, z), (0, 0, -z), (0, y, 0), "green")
    scene.rectangle((LENGTH, y, z), (0, 0, z), (0, y, 0), "cream")
    for at in (1.6, 3.2, 4.8, 6.4):
        scene.box((at - 0.08, HEIGHT - 0.2, 0), (at + 0.08, HEIGHT, DEPTH), "walnut")
    scene.box((0, 0, 0), (LENGTH, 0.12, 0.02), "white")
    scene.box((0, 0, DEPTH - 0.02), (LENGTH, 0.12, DEPTH), "white")
    scene.box((0, 0, 0), (0.02, 0.12, DEPTH), "white")
    scene.box((5.2, 0, 2.9), (5.35, HEIGHT, DEPTH), "cream")
    scene.rectangle((LENGTH - 0.02, 1.6, 1.3), (0, 0, 0.8), (0, 1.0, 0), "black", (10, 11, 12))
    for at in (0.55, 1.3, 2.05):
        scene.box((LENGTH - 0.07, 0.6, at - 0.03), (LENGTH - 0.01, 2.6, at + 0.03), "white")
    for at in (0.62, 1.6, 2.58):
        scene.box((LENGTH - 0.07, at - 0.03, 0.5), (LENGTH - 0.01, at + 0.03, 2.1), "white")
    scene.shapes.append(
        '<shape type="obj"><string name="filename" value="curtain.obj"/><transform name="to_world">'
        f'<rotate y="1" angle="90"/><translate x="{LENGTH - 0.2:f}" y="0.1" z="3.3"/></transform>'
        '<ref id="curtain"/></shape>'
    )
    scene.box((0.4, 0, 0), (2.4, 2.4, 0.5), "white")
    scene.rectangle((1.4, 1.2, 0.505), (0.9, 0, 0), (0, 1.1, 0), "mirror")


def _lights(scene: SceneWriter) -> None:
    """Spots, a chandelier, a lamp with a shade, a strip below a shelf, a fire."""
    for k in range(5):
        scene.rectangle((1.0 + 1.6 * k, HEIGHT - 0.005, 1.2), (0.05, 0, 0), (0, 0, 0.05), "black", (60, 52, 40))
    for angle in 2 * np.pi * np.arange(8) / 8:
        x, z = 3.6 + 0.35 * np.cos(angle), 2.5 + 0.35 * np.sin(angle)
        scene.sphere((x, 2.35, z), 0.03, "white", (90, 70, 45))
        scene.cylinder((3.6, 2.3, 2.5), (x, 2.3, z), 0.008, "copper")
    scene.cylinder((3.6, 2.3, 2.5), (3.6, HEIGHT, 2.5), 0.012, "copper")
    scene.sphere((3.6, 2.3, 2.5), 0.06, "copper")
    scene.cylinder((0.5, 1.3, 3.8), (0.5, 1.6, 3.8), 0.18, "shade", (2.4, 1.9, 1.2))
    scene.cylinder((0.5, 0, 3.8), (0.5, 1.3, 3.8), 0.014, "copper")
    scene.box((5.6, 1.5, 0), (7.4, 1.54, 0.3), "walnut")
    scene.box((5.6, 1.1, 0), (7.4, 1.14, 0.3), "walnut")
    scene.rectangle((6.5, 1.499, 0.25), (0.85, 0, 0), (0, 0, 0.01), "black", (8, 8, 9))
    scene.rectangle((2.9, 0.35, DEPTH - 0.01), (-0.35, 0, 0), (0, 0.25, 0), "black", (3.0, 1.2, 0.3))
    scene.box((2.45, 0, DEPTH - 0.15), (2.55, 0.75, DEPTH), "porcelain")
    scene.box((3.25, 0, DEPTH - 0.15), (3.35, 0.75, DEPTH), "porcelain")
    scene.box((2.35, 0.7, DEPTH - 0.2), (3.45, 0.78, DEPTH), "porcelain")


def _furniture(scene: SceneWriter, rng: np.random.Generator) -> None:
    """A screen on its board, things on shelves, a sofa, two tables, chairs."""
    scene.box((3.2, 1.0, 0), (4.7, 1.85, 0.05), "screen")
    scene.box((3.0, 0, 0), (4.9, 0.45, 0.45), "walnut")
    for k in range(14):
        x, high = 5.65 + 0.12 * k + rng.uniform(-0.02, 0.02), rng.uniform(0.1, 0.3)
        scene.diffuse(f"book{k}", rng.uniform(0.05, 0.8, 3))
        scene.box((x, 1.54, 0.03), (x + rng.uniform(0.03, 0.08), 1.54 + high, 0.2), f"book{k}")
    for k, material in enumerate(("porcelain", "red", "chrome", "copper")):
        scene.sphere((5.8 + 0.4 * k, 1.23, 0.15), 0.09, material)
    scene.box((1.2, 0.1, 2.9), (3.0, 0.4, 3.7), "sofa")
    scene.cylinder((1.2, 0.5, 3.7), (3.0, 0.5, 3.7), 0.22, "sofa")
    for x in (1.15, 3.05):
        scene.cylinder((x, 0.4, 2.9), (x, 0.4, 3.75), 0.16, "sofa")
    scene.sphere((1.6, 0.5, 3.3), 0.17, "red")
    scene.sphere((2.6, 0.5, 3.3), 0.16, "porcelain")
    scene.cylinder((1.7, 0.4, 2.0), (1.7, 0.43, 2.0), 0.45, "porcelain")
    scene.rectangle((1.7, 0.43, 2.0), (0.3, 0, 0), (0, 0, -0.3), "porcelain")
    for angle in 2.1 * np.arange(3):
        scene.cylinder((1.7 + 0.35 * np.cos(angle), 0, 2 + 0.35 * np.sin(angle)), (1.7, 0.4, 2.0), 0.012, "chrome")
    scene.rectangle((2.0, 0.006, 2.1), (1.3, 0, 0), (0, 0, -0.9), "carpet")
    scene.box((5.7, 0.72, 1.3), (7.2, 0.76, 2.2), "walnut")
    for x in (5.8, 7.1):
        for z in (1.4, 2.1):
            scene.cylinder((x, 0, z), (x, 0.72, z), 0.02, "chrome")
    for x, z in ((6.0, 0.85), (6.8, 0.85), (6.0, 2.45), (6.8, 2.45)):
        _chair(scene, x, z, back=z - 0.2 if z < 1.5 else z + 0.2)
    scene.sphere((6.4, 0.85, 1.75), 0.09, "porcelain")


def _chair(scene: SceneWriter, x: float, z: float, back: float) -> None:
    """A chair of tubes around (x, z), its back at z = ``back``."""
    scene.box((x - 0.2, 0.44, z - 0.2), (x + 0.2, 0.47, z + 0.2), "red")
    for right in (-0.19, 0.19):
        for deep in (-0.19, 0.19):
            scene.cylinder((x + right, 0, z + deep), (x + right, 0.44, z + deep), 0.012, "chrome")
    scene.box((x - 0.2, 0.6, back - 0.015), (x + 0.2, 0.9, back + 0.015), "red")
    for right in (-0.19, 0.19):
        scene.cylinder((x + right, 0.44, back), (x + right, 0.9, back), 0.012, "chrome")


def _plant(scene: SceneWriter, rng: np.random.Generator) -> None:
    scene.cylinder((4.6, 0, 3.8), (4.6, 0.4, 3.8), 0.16, "porcelain")
    for _ in range(_LEAVES):
        along = rng.normal(size=3)
        along[1] = abs(along[1])
        along /= np.linalg.norm(along)
        middle = np.array((4.6, 0.7, 3.8)) + along * rng.uniform(0.1, 0.45) * np.array((1, 1.3, 1))
        across = np.cross(along, (0, 1, 0.1))
        scene.rectangle(middle, across / np.linalg.norm(across) * 0.035, along * 0.09, "leaf")


def write_loft(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and its curtain; return the file."""
    rng, scene = np.random.default_rng(seed), SceneWriter()
    make_folder(folder)
    _textures(folder, rng)
    _write_curtain(folder)
    _materials(scene)
    _shell(scene)
    _lights(scene)
    _furniture(scene, rng)
    _plant(scene, rng)
    write_text(folder / "scene.xml", scene.xml())
    return folder / "scene.xml"


if __name__ == "__main__":
    run(write_loft, "A loft as a Mitsuba scene file, its small things by a seed.")
