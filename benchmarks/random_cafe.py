"""A sixth furnished room as a Mitsuba scene file: a cafe around a corner, with coloured light, bottles and ducts.

    python -m benchmarks.random_cafe cafe --seed 1

FOLDER/scene.xml is a room around a corner, 8 m x 6 m, 3.1 m high: a wall of bricks, a floor of polished concrete, a
counter of checked tiles, bottles on shelves before a mirror, stools on chrome legs, round tables, a bench with buttons,
ducts of steel below beams, a blackboard, a shop window with two panes of different brightness, tubes of coloured light,
lamps that shine down out of deep black tubes, a menu whose picture shines, bulbs on a cable. The seed draws colours,
textures, bottles and lamps.
"""

from pathlib import Path

import numpy as np

from benchmarks.random_bedroom import RoomWriter
from benchmarks.random_room import run, write_texture

LENGTH, HEIGHT, DEPTH = 8.0, 3.1, 6.0
"""Along x, y and z, metres."""
CORNER = (4.6, 3.4)
"""Where the walls of the corner meet that stands into the room, x and z: what has more of both is outside."""

_SKY, _STREET, _SPOT, _BULB = (11, 12.5, 15), (4.5, 4.3, 4), (95, 80, 60), (40, 28, 14)
"""Radiance."""


def _textures(cafe: RoomWriter) -> None:
    """Write bricks, concrete, checked tiles, a blackboard and a poster (BGR, as OpenCV writes)."""
    rng = cafe.rng
    bricks = np.full((256, 256, 3), 0.45)
    for row in range(8):
        for column in range(-1, 4):
            left = max(column * 64 + (row % 2) * 32, 0)
            color = np.array((0.1, 0.15, 0.42)) * rng.uniform(0.5, 1.3) * rng.uniform(0.8, 1.2, 3)
            bricks[row * 32 + 2 : row * 32 + 30, left + 2 : max(column * 64 + (row % 2) * 32 + 62, 0)] = color
    write_texture(cafe.folder / "bricks.png", bricks * (0.8 + 0.4 * cafe.noise(256, 256, 100)[..., None]))
    clouds = 0.5 * cafe.noise(512, 512, 7) + 0.3 * cafe.noise(512, 512, 40) + 0.2 * cafe.noise(512, 512, 200)
    write_texture(cafe.folder / "concrete.png", (0.1 + 0.25 * clouds)[..., None] * (0.95, 1, 1))
    rows, columns = np.mgrid[:256, :256] // 32
    tiles = np.where(((rows + columns) % 2)[..., None], (0.75, 0.78, 0.8), rng.uniform(0.02, 0.3, 3))
    write_texture(cafe.folder / "tiles.png", tiles)
    board = np.full((192, 256, 3), 0.025)
    for line in range(9):
        end = int(rng.integers(90, 230))
        board[14 + 20 * line : 20 + 20 * line, 20:end] = np.where(rng.random((6, end - 20, 1)) > 0.45, 0.6, 0.03)
    write_texture(cafe.folder / "board.png", board)
    poster = np.dstack([cafe.noise(160, 112, cells) for cells in (3, 5, 9)]) ** 2
    write_texture(cafe.folder / "poster.png", 0.02 + 0.75 * poster)


def _materials(cafe: RoomWriter) -> None:
    scene, rng = cafe.scene, cafe.rng
    scene.textured("bricks", "bricks.png", 6, 3)
    scene.textured("concrete", "concrete.png", 2, 2, 0.12)
    scene.textured("tiles", "tiles.png", 3, 1, 0.06)
    scene.textured("board", "board.png", 1, 1)
    scene.textured("poster", "poster.png", 1, 1, 0.1)
    for name, color in {
        "wall": rng.uniform(0.35, 0.85, 3),
        "back": rng.uniform(0.08, 0.4, 3),
        "ceiling": (0.75, 0.75, 0.74),
        "black": (0.02, 0.02, 0.02),
        "leaf": (0.08, 0.24, 0.06),
        "lamp": (0.5, 0.5, 0.5),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("wood", (0.3, 0.16, 0.07), 0.2)
    scene.plastic("leather", rng.uniform(0.05, 0.3, 3), 0.3)
    scene.plastic("white", (0.82, 0.81, 0.78), 0.1)
    for index in range(8):
        scene.plastic(f"bottle{index}", rng.uniform(0.02, 0.6, 3) ** 1.5, 0.05)
    scene.metal("chrome", "Cr", 0.06)
    scene.metal("duct", "Al", 0.3)
    scene.metal("brass", "Au", 0.2)
    scene.metal("mirror", "Ag", 0.01)


def _shell(cafe: RoomWriter) -> None:
    scene, y = cafe.scene, HEIGHT / 2
    (x, z), right, far = CORNER, (LENGTH + CORNER[0]) / 2, (DEPTH + CORNER[1]) / 2
    for height, way, material in ((0, -1, "concrete"), (HEIGHT, 1, "ceiling")):
        scene.rectangle((x / 2, height, DEPTH / 2), (x / 2, 0, 0), (0, 0, way * DEPTH / 2), material)
        scene.rectangle((right, height, z / 2), ((LENGTH - x) / 2, 0, 0), (0, 0, way * z / 2), material)
    scene.rectangle((LENGTH / 2, y, 0), (LENGTH / 2, 0, 0), (0, y, 0), "bricks")
    scene.rectangle((0, y, DEPTH / 2), (0, 0, -DEPTH / 2), (0, y, 0), "wall")
    scene.rectangle((LENGTH, y, z / 2), (0, 0, z / 2), (0, y, 0), "wall")
    scene.rectangle((x / 2, y, DEPTH), (-x / 2, 0, 0), (0, y, 0), "back")
    scene.rectangle((x, y, far), (0, 0, (DEPTH - z) / 2), (0, y, 0), "wall")
    scene.rectangle((right, y, z), ((x - LENGTH) / 2, 0, 0), (0, y, 0), "back")
    for beam in np.linspace(0.9, x - 0.6, 4):
        scene.box((beam - 0.07, HEIGHT - 0.2, -0.1), (beam + 0.07, HEIGHT + 0.1, DEPTH + 0.1), "wood")


def _window(cafe: RoomWriter) -> None:
    """A shop window in the wall x = 0: sky in the upper panes, the street in the lower ones, a frame before them."""
    scene, z = cafe.scene, 2.0
    scene.rectangle((0.02, 1.95, z), (0, 0, -1.25), (0, 0.55, 0), "lamp", _SKY)
    scene.rectangle((0.02, 0.95, z), (0, 0, -1.25), (0, 0.45, 0), "lamp", _STREET)
    for height in (0.47, 1.4, 2.52):
        scene.box((-0.05, height - 0.03, z - 1.3), (0.1, height + 0.03, z + 1.3), "black")
    for side in np.linspace(z - 1.27, z + 1.27, 4):
        scene.box((-0.05, 0.45, side - 0.025), (0.09, 2.54, side + 0.025), "black")


def _counter(cafe: RoomWriter) -> None:
    """A counter before the wall x = LENGTH, bottles on shelves before a mirror behind it, stools before it."""
    scene, rng, z = cafe.scene, cafe.rng, CORNER[1]
    front = LENGTH - 1.7
    scene.box((front, 0.08, 0.5), (front + 0.06, 1.05, z - 0.5), "white")
    scene.rectangle((front - 0.004, 0.56, z / 2), (0, 0, z / 2 - 0.5), (0, 0.46, 0), "tiles")
    scene.box((front - 0.15, 1.05, 0.4), (front + 0.5, 1.1, z - 0.4), "wood")
    scene.rectangle((LENGTH - 0.02, 1.85, z / 2), (0, 0, z / 2 - 0.4), (0, 0.7, 0), "mirror")
    for height in (1.15, 1.6, 2.05):
        scene.box((LENGTH - 0.26, height - 0.03, 0.4), (LENGTH, height, z - 0.4), "wood")
        for index, at in enumerate(np.arange(0.5, z - 0.45, 0.13)):
            wide, tall = rng.uniform(0.028, 0.045), rng.uniform(0.16, 0.3)
            profile = [(0, 0), (wide, 0), (wide, 0.6 * tall), (wide / 3, 0.75 * tall), (wide / 3, tall), (0, tall)]
            cafe.lathe(f"bottle{height:.2f}_{index}", profile, (LENGTH - 0.14 + rng.normal() * 0.02, height, at),
                       f"bottle{rng.integers(8)}")  # fmt: skip
    for at in (0.9, 1.6, 2.3):
        x = front - 0.5
        scene.cylinder((x, 0.7, at), (x, 0.75, at), 0.17, "leather")
        cafe.cushion(f"seat{at:.1f}", (x, 0.74, at), (0.17, 0.05, 0.17), "leather")
        scene.cylinder((x, 0, at), (x, 0.7, at), 0.025, "chrome")
        cafe.lathe(f"foot{at:.1f}", [(0.2, 0), (0.2, 0.012), (0.03, 0.04)], (x, 0, at), "chrome")
    cafe.lathe("machine", [(0, 0), (0.16, 0), (0.16, 0.32), (0.1, 0.42), (0, 0.44)], (front + 0.2, 1.1, 1.0), "brass")


def _tables(cafe: RoomWriter) -> None:
    """Round tables with cups, a bench with buttons along the wall z = 0, a plant, a blackboard and a poster."""
    scene, rng = cafe.scene, cafe.rng
    for x, z in ((1.6, 1.0), (3.4, 1.0), (1.5, 4.6), (3.3, 4.4)):
        scene.cylinder((x, 0, z), (x, 0.72, z), 0.03, "black")
        cafe.lathe(f"table{x}{z}", [(0, 0.76), (0.36, 0.76), (0.36, 0.73), (0.0, 0.72)], (x, 0, z), "wood")
        cafe.lathe(f"foot{x}{z}", [(0.24, 0), (0.24, 0.015), (0.03, 0.05)], (x, 0, z), "black")
        for _ in range(2):
            at = (x + rng.uniform(-0.2, 0.2), 0.76, z + rng.uniform(-0.2, 0.2))
            profile = [(0, 0.006), (0.025, 0.006), (0.042, 0.07), (0.038, 0.07), (0.022, 0.012), (0, 0.012)]
            cafe.lathe(f"cup{at[0]:.3f}", profile, at, "white")
    scene.box((0.6, 0, -0.1), (4.4, 0.3, 0.55), "wood")
    for index, x in enumerate(np.linspace(0.95, 4.05, 5)):
        cafe.cushion(f"bench{index}", (x, 0.38, 0.3), (0.38, 0.1, 0.28), "leather")
        cafe.cushion(f"rest{index}", (x, 0.78, 0.1), (0.38, 0.28, 0.1), "leather")
        scene.sphere((x, 0.8, 0.195), 0.015, "brass")
    scene.rectangle((1.5, 1.75, DEPTH - 0.02), (-0.8, 0, 0), (0, 0.6, 0), "board")
    scene.rectangle((CORNER[0] - 0.015, 1.7, 4.9), (0, 0, 0.42), (0, 0.6, 0), "poster")
    cafe.plant((0.5, 0.4, DEPTH - 0.6), 20, (0.2, 0.9), (0.4, 0.8), 0.04)
    cafe.lathe("pot", [(0, 0), (0.15, 0), (0.2, 0.42), (0.17, 0.42), (0.15, 0.35), (0, 0.35)],
               (0.5, 0, DEPTH - 0.6), "white")  # fmt: skip


def _lamps(cafe: RoomWriter) -> None:
    """Lamps in deep tubes, tubes of coloured light, a menu that shines, bulbs on a cable, and ducts above them."""
    scene, rng = cafe.scene, cafe.rng
    for at in (1.0, 2.4):
        scene.cylinder((0, HEIGHT - 0.45, at), (LENGTH, HEIGHT - 0.45, at), 0.16, "duct")
    for x in np.linspace(0.8, CORNER[0] - 0.7, 4):
        scene.cylinder((x, HEIGHT - 0.5, 4.6), (x, HEIGHT, 4.6), 0.06, "black")
        scene.rectangle((x, HEIGHT - 0.35, 4.6), (0.04, 0, 0), (0, 0, 0.04), "lamp", _SPOT)
    low, high = sorted(rng.uniform(0.05, 1, 2))
    for height, color in ((2.45, (9, 9 * low, 9 * low)), (2.6, (9 * low, 9 * high, 9))):
        scene.cylinder((5.0, height, CORNER[1] - 0.06), (7.4, height, CORNER[1] - 0.06), 0.018, "lamp", color)
    for row in range(4):
        for column in range(6):
            middle = (5.1 + 0.2 * column, 1.9 - 0.15 * row, CORNER[1] - 0.02)
            scene.rectangle(middle, (-0.1, 0, 0), (0, 0.075, 0), "black", rng.uniform(0.15, 1.6, 3))
    for x in np.linspace(5.2, 6.8, 3):
        y, z = 2.15 + rng.uniform(-0.1, 0.1), 1.7
        scene.cylinder((x, y, z), (x, HEIGHT, z), 0.006, "black")
        scene.sphere((x, y - 0.05, z), 0.05, "lamp", _BULB)


def write_cafe(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    cafe = RoomWriter(folder, seed)
    for part in (_textures, _materials, _shell, _window, _counter, _tables, _lamps):
        part(cafe)
    return cafe.write()


if __name__ == "__main__":
    run(write_cafe, "A cafe around a corner with coloured light as a Mitsuba scene file, by a seed.")
