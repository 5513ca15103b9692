"""A seventh furnished room as a Mitsuba scene file: a salon in whites, lit by a skylight and lamps of opal glass.

    python -m benchmarks.random_salon salon --seed 1

FOLDER/scene.xml is a room of 6.6 m x 5.2 m, 3 m high, in which most surface is white of some kind: painted panels in
relief, slabs that mirror a little, a fireplace of marble, shelves with white boxes, sofas, a sheepskin, a blind, a
radiator. What is not white stands out: a black grand piano, plants, spines of books, a gilded mirror, a brass lamp with
a curved arm, glossy red chairs on thin steel legs. Light comes from a skylight that few views show, from globes, from
strips below the shelves and from a television. Half of the shades of white are the same. The seed draws them.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.random_bedroom import RoomWriter
from benchmarks.random_room import run, write_texture

LENGTH, HEIGHT, DEPTH = 6.6, 3.0, 5.2
"""Along x, y and z, metres."""

_SKY, _GLOBE, _STRIP, _SCREEN = (16, 18, 21), (14, 12, 9), (10, 9, 7), (0.9, 1.2, 1.7)
"""Radiance."""


def _textures(salon: RoomWriter) -> None:
    """Write slabs, marble and a drawing (BGR, as OpenCV writes)."""
    slabs = np.full((512, 512, 3), 0.66)
    for row, column in np.ndindex(4, 4):
        slabs[row * 128 : row * 128 + 126, column * 128 : column * 128 + 126] = salon.rng.uniform(0.74, 0.86)
    write_texture(salon.folder / "slabs.png", slabs * (0.97 + 0.05 * salon.noise(512, 512, 60)[..., None]))
    veins = np.abs(salon.noise(256, 256, 6) - 0.5) + 0.3 * np.abs(salon.noise(256, 256, 24) - 0.5)
    write_texture(salon.folder / "marble.png", np.clip(0.35 + 1.8 * veins, 0, 0.82)[..., None] * (1, 0.98, 0.96))
    sheet = np.full((192, 256, 3), 0.85)
    for _ in range(14):
        row, column = salon.rng.integers(10, 150), salon.rng.integers(10, 200)
        sheet[row : row + 2 + salon.rng.integers(20), column : column + salon.rng.integers(10, 50)] *= 0.15
    write_texture(salon.folder / "drawing.png", sheet)


def _materials(salon: RoomWriter) -> None:
    scene, rng = salon.scene, salon.rng
    scene.textured("slabs", "slabs.png", 3, 3, 0.15)
    scene.textured("marble", "marble.png", 1, 1, 0.06)
    scene.textured("drawing", "drawing.png", 1, 1, 0.05)
    shades = [rng.uniform(0.68, 0.9) * np.array((1, rng.uniform(0.97, 1), rng.uniform(0.9, 0.99))) for _ in range(3)]
    for index, name in enumerate(("wall", "ceiling", "panel", "sofa", "fleece", "blind")):
        scene.diffuse(name, shades[index % 3])
    scene.plastic("lacquer", shades[0], 0.08)
    scene.plastic("piano", (0.012, 0.012, 0.012), 0.04)
    scene.plastic("red", rng.uniform((0.4, 0.01, 0.01), (0.6, 0.1, 0.05)), 0.06)
    scene.plastic("iron", (0.78, 0.78, 0.76), 0.3)
    scene.diffuse("leaf", (0.05, 0.2, 0.05))
    scene.diffuse("lamp", (0.6, 0.6, 0.6))
    for index in range(6):
        scene.diffuse(f"spine{index}", rng.uniform(0.05, 0.7, 3))
    scene.metal("brass", "Au", 0.12)
    scene.metal("steel", "Cr", 0.1)
    scene.metal("mirror", "Ag", 0.01)


def _shell(salon: RoomWriter) -> None:
    """Floor, walls with panels in relief, and a ceiling around a deep skylight."""
    scene, x, y, z = salon.scene, LENGTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "slabs")
    for middle, u in (((x, y, 0), (x, 0, 0)), ((x, y, DEPTH), (-x, 0, 0)), ((0, y, z), (0, 0, -z)),
                      ((LENGTH, y, z), (0, 0, z))):  # fmt: skip
        scene.rectangle(middle, u, (0, y, 0), "wall")
    low, high, near, far = 2.4, 4.4, 1.7, 3.3
    for a, b in (((0, 0), (low, DEPTH)), ((high, 0), (LENGTH, DEPTH)), ((low, 0), (high, near)),
                 ((low, far), (high, DEPTH))):  # fmt: skip
        scene.box((a[0], HEIGHT, a[1]), (b[0], HEIGHT + 0.6, b[1]), "ceiling")
    scene.rectangle((x, HEIGHT + 0.58, z), (1.1, 0, 0), (0, 0, 0.9), "lamp", _SKY)
    for side in np.arange(0.5, LENGTH - 0.8, 1.2):
        for bottom, top in ((0.2, 0.9), (1.1, 2.6)):
            for wall in (0.0, DEPTH):
                scene.box((side, bottom, wall - 0.025), (side + 0.9, top, wall + 0.025), "panel")
                scene.box((side + 0.06, bottom + 0.06, wall - 0.015), (side + 0.84, top - 0.06, wall + 0.035), "wall")
    for wall in (0.0, DEPTH):
        scene.box((0, -0.1, wall - 0.03), (LENGTH, 0.15, wall + 0.03), "panel")
        scene.box((0, HEIGHT - 0.14, wall - 0.07), (LENGTH, HEIGHT + 0.1, wall + 0.07), "panel")


def _shelves(salon: RoomWriter) -> None:
    """White shelves at the wall x = 0 with boxes and books, strips of light below them, a television."""
    scene, rng = salon.scene, salon.rng
    for height in (0.5, 1.0, 2.0, 2.4):
        scene.box((-0.05, height, 1.0), (0.35, height + 0.04, 4.2), "lacquer")
    for height in (1.0, 2.0):
        scene.rectangle((0.2, height - 0.003, 2.6), (0.02, 0, 0), (0, 0, 1.4), "lamp", _STRIP)
    for height in (0.04, 0.54, 2.04):
        z = 1.05
        while z < 4.0:
            if rng.random() < 0.5:
                wide = rng.uniform(0.2, 0.35)
                box = "panel" if rng.random() < 0.5 else "lacquer"
                scene.box((0.05, height, z), (0.32, height + 0.25, z + wide), box)
                z += wide + 0.04
            else:
                wide = rng.uniform(0.02, 0.06)
                top = height + rng.uniform(0.18, 0.3)
                scene.box((0.06, height, z), (0.28, top, z + wide - 0.003), f"spine{rng.integers(6)}")
                z += wide
    scene.box((0.02, 1.12, 2.0), (0.07, 1.88, 3.2), "piano")
    scene.rectangle((0.075, 1.5, 2.6), (0, 0, -0.56), (0, 0.34, 0), "piano", _SCREEN)


def _seats(salon: RoomWriter) -> None:
    """Sofas of cushions, a sheepskin, a low table of marble, red chairs on thin legs."""
    scene, rng = salon.scene, salon.rng
    for index, (x, turn) in enumerate(((2.2, 1), (3.9, -1))):
        scene.box((x - 0.4, 0.08, 1.4), (x + 0.4, 0.3, 3.4), "sofa")
        for part, z in enumerate((1.9, 2.9)):
            salon.cushion(f"seat{index}{part}", (x, 0.38, z), (0.4, 0.1, 0.49), "sofa")
            salon.cushion(f"back{index}{part}", (x - 0.35 * turn, 0.62, z), (0.12, 0.28, 0.48), "sofa")
        salon.cushion(f"arm{index}", (x, 0.45, 1.36), (0.42, 0.2, 0.1), "sofa")
    u, v = np.meshgrid(np.linspace(-1, 1, 70), np.linspace(-1, 1, 70))
    edge = np.clip(1 - u**4 - v**4 + 0.3 * (salon.noise(70, 70, 6) - 0.5), 0, 1)
    fur = np.stack([3.05 + 0.42 * u, 0.005 + 0.05 * edge * (0.4 + salon.noise(70, 70, 40)), 3.9 + 0.6 * v], -1)
    salon.grid("fleece", fur, "fleece")
    scene.box((2.75, 0.36, 1.8), (3.35, 0.4, 3.0), "marble")
    for x, z in ((2.8, 1.85), (3.3, 1.85), (2.8, 2.95), (3.3, 2.95)):
        scene.cylinder((x, 0, z), (x, 0.36, z), 0.012, "brass")
    for x, z in ((5.5, 1.0), (5.9, 1.8)):
        salon.cushion(f"chair{x}", (x, 0.48, z), (0.23, 0.03, 0.23), "red")
        salon.cushion(f"rest{x}", (x + 0.22, 0.75, z), (0.03, 0.2, 0.22), "red")
        for a, b in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            scene.cylinder((x + 0.22 * a, 0, z + 0.22 * b), (x + 0.15 * a, 0.46, z + 0.15 * b), 0.011, "steel")
    salon.lathe("bowl", [(0, 0.01), (0.06, 0.01), (0.15, 0.07), (0.14, 0.07), (0.05, 0.02), (0, 0.02)],
                (3.05, 0.4, 2.2 + rng.uniform(0, 0.4)), "lacquer")  # fmt: skip


def _things(salon: RoomWriter) -> None:
    """A fireplace under a mirror, a grand piano, a blind, a radiator, a plant, a drawing, the lamps."""
    scene, wall = salon.scene, LENGTH
    for deep, low, near, high, far in ((0.3, 0, 2.0, 1.1, 2.3), (0.3, 0, 3.3, 1.1, 3.6), (0.36, 1.1, 1.9, 1.18, 3.7),
                                       (0.3, 0.85, 2.2, 1.1, 3.4)):  # fmt: skip
        scene.box((wall - deep, low, near), (wall, high, far), "marble")
    scene.box((wall - 0.04, 0, 2.3), (wall + 0.1, 0.85, 3.3), "piano")
    scene.box((wall - 0.05, 1.25, 2.1), (wall, 2.45, 3.5), "brass")
    scene.rectangle((wall - 0.055, 1.85, 2.8), (0, 0, 0.64), (0, 0.54, 0), "mirror")
    angle = np.linspace(0, np.pi, 25)
    side = np.stack([4.9 + 0.75 * np.cos(angle), np.full(25, 0.7), 4.0 + 0.8 * np.sin(angle) ** 0.7], -1)
    salon.grid("piano", np.stack([side, side + np.array((0, 0.3, 0))]), "piano")
    scene.box((4.15, 0.7, 3.75), (5.65, 1.0, 4.0), "piano")
    salon.grid("lid", np.stack([side + np.array((0, 0.31, 0)), side * (1, 1, 0) + np.array((0, 0.31, 4.0))]), "piano")
    scene.box((4.25, 0.74, 3.55), (5.55, 0.78, 3.75), "lacquer")
    for x in (4.3, 5.5):
        scene.cylinder((x, 0, 3.9), (x, 0.7, 3.9), 0.05, "piano")
    for slat in np.arange(0.9, 2.5, 0.07):
        scene.box((1.1, slat, DEPTH - 0.12), (2.3, slat + 0.006, DEPTH - 0.07), "blind")
    for fin in np.arange(1.2, 2.2, 0.06):
        scene.box((fin, 0.15, DEPTH - 0.14), (fin + 0.03, 0.75, DEPTH - 0.05), "iron")
    salon.plant((0.6, 0.45, 0.6), 14, (0.2, 0.8), (0.5, 1.0), 0.05)
    salon.lathe("pot", [(0, 0), (0.18, 0), (0.22, 0.45), (0.19, 0.45), (0.17, 0.4), (0, 0.4)], (0.6, 0, 0.6), "lacquer")
    scene.box((3.3, 1.25, DEPTH - 0.06), (4.2, 1.95, DEPTH), "iron")
    scene.rectangle((3.75, 1.6, DEPTH - 0.063), (-0.4, 0, 0), (0, 0.3, 0), "drawing")
    arm = np.stack([1.2 + 0.8 * np.cos(angle), 1.2 + 0.9 * np.sin(angle), np.full(25, 0.9)], -1)
    for a, b in pairwise(arm[:-3]):
        scene.cylinder(a, b, 0.012, "brass")
    scene.cylinder((2.0, 0, 0.9), (2.0, 1.2, 0.9), 0.012, "brass")
    for middle, radius in (((0.48, 1.62, 0.9), 0.13), ((5.4, 2.3, 1.2), 0.1), ((5.75, 2.1, 1.35), 0.1)):
        scene.sphere(middle, radius, "lamp", _GLOBE)
        if middle[0] > 1:
            scene.cylinder(middle, (middle[0], HEIGHT, middle[2]), 0.006, "brass")


def write_salon(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    salon = RoomWriter(folder, seed)
    for part in (_textures, _materials, _shell, _shelves, _seats, _things):
        part(salon)
    return salon.write()


if __name__ == "__main__":
    run(write_salon, "A salon in whites as a Mitsuba scene file, by a seed.")
