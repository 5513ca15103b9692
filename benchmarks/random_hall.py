"""A fifth furnished room as a Mitsuba scene file: a hall of two storeys with stairs, panels, a wall of mirror, tubes.

    python -m benchmarks.random_hall hall --seed 1

FOLDER/scene.xml is a hall of some 7 m x 4.6 m, 4.9 m high: a polished floor of tiles, dark panels of wood, a staircase
with steel balusters, a gallery, a mirror that covers half a wall with tubes of light beside it, spots sunk into the
ceiling, strips that only the wall before them sees, a frosted window over both storeys, gilded frames, a wash stand
with chrome taps, a plant, an umbrella stand. Its meshes are as modellers leave them: boxes stand in each other, sheets
have one side and no thickness, steps end inside walls. The seed draws the size, colours, textures and the lamps.
"""

from pathlib import Path

import numpy as np

from benchmarks.random_bedroom import RoomWriter
from benchmarks.random_room import run, write_texture

HEIGHT, STOREY = 4.9, 2.6
"""Of the ceiling and of the gallery's floor, metres."""

_WINDOW, _TUBE, _SPOT, _STRIP, _LANTERN = (7, 8, 9.5), (26, 25, 22), (60, 50, 38), (14, 10, 6), (6, 4.2, 2.2)
"""Radiance."""


class _Hall(RoomWriter):
    """A scene, and what the seed draws: the length along x and the depth along z."""

    def __init__(self, folder: Path, seed: int) -> None:
        super().__init__(folder, seed)
        self.length, self.depth = self.rng.uniform(6.4, 7.6), self.rng.uniform(4.2, 5.0)


def _textures(hall: _Hall) -> None:
    """Write tiles of two stones, panels of wood, a runner and three paintings (BGR, as OpenCV writes)."""
    rng = hall.rng
    tiles = np.zeros((512, 512, 3), np.float32)
    for row in range(4):
        for column in range(4):
            stone = np.array((0.62, 0.66, 0.7) if (row + column) % 2 else (0.2, 0.22, 0.25))
            veins = 0.8 + 0.4 * hall.noise(128, 128, int(rng.integers(4, 10)))[..., None]
            tiles[row * 128 : row * 128 + 126, column * 128 : column * 128 + 126] = (stone * veins)[:126, :126]
    write_texture(hall.folder / "tiles.png", tiles)
    rows, columns = np.mgrid[:256, :256]
    wood = np.array(rng.uniform((0.02, 0.05, 0.12), (0.06, 0.12, 0.25)))
    panel = wood * (0.7 + 0.6 * np.abs(np.sin(columns / 9 + 3 * hall.noise(256, 256, 6))))[..., None]
    panel[(columns < 6) | (rows < 6)] *= 0.4
    write_texture(hall.folder / "panel.png", panel)
    runner = np.tile(rng.uniform((0.03, 0.03, 0.2), (0.2, 0.15, 0.5)), (256, 256, 1))
    runner[(columns < 24) | (columns > 231)] = (0.1, 0.4, 0.5)
    runner[(rows % 64 < 6) & (columns > 40) & (columns < 215)] = (0.4, 0.5, 0.6)
    write_texture(hall.folder / "runner.png", runner * (0.85 + 0.3 * hall.noise(256, 256, 80)[..., None]))
    for index in range(3):
        write_texture(hall.folder / f"painting{index}.png", 0.03 + 0.5 * np.dstack([hall.noise(96, 96, 8)] * 3) ** 2)


def _materials(hall: _Hall) -> None:
    scene, rng = hall.scene, hall.rng
    scene.textured("tiles", "tiles.png", 3, 2, 0.08)
    scene.textured("panel", "panel.png", 6, 1, 0.2)
    scene.textured("runner", "runner.png", 1, 2)
    for index in range(3):
        scene.textured(f"painting{index}", f"painting{index}.png", 1, 1, 0.12)
    for name, color in {
        "plaster": rng.uniform(0.6, 0.85, 3),
        "upper": rng.uniform(0.25, 0.75, 3),
        "ceiling": (0.84, 0.84, 0.82),
        "black": (0.03, 0.03, 0.03),
        "coat": rng.uniform(0.05, 0.4, 3),
        "leaf": (0.06, 0.2, 0.04),
        "lamp": (0.5, 0.5, 0.5),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("step", (0.36, 0.2, 0.09), 0.15)
    scene.plastic("riser", (0.8, 0.79, 0.76), 0.2)
    scene.plastic("enamel", (0.85, 0.85, 0.84), 0.05)
    scene.plastic("pot", rng.uniform(0.05, 0.6, 3), 0.1)
    scene.metal("chrome", "Cr", 0.05)
    scene.metal("steel", "Cr", 0.25)
    scene.metal("gilt", "Au", 0.2)
    scene.metal("mirror", "Ag", 0.01)


def _shell(hall: _Hall) -> None:
    scene, x, y, z = hall.scene, hall.length / 2, HEIGHT / 2, hall.depth / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "tiles")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "ceiling")
    scene.rectangle((x, y, 0), (x, 0, 0), (0, y, 0), "plaster")
    scene.rectangle((x, y, hall.depth), (-x, 0, 0), (0, y, 0), "upper")
    scene.rectangle((0, y, z), (0, 0, -z), (0, y, 0), "plaster")
    scene.rectangle((hall.length, y, z), (0, 0, z), (0, y, 0), "plaster")
    scene.rectangle((x, 0.55, hall.depth - 0.02), (-x, 0, 0), (0, 0.55, 0), "panel")
    scene.box((-0.1, 1.08, hall.depth - 0.06), (hall.length + 0.1, 1.14, hall.depth + 0.1), "step")
    for wall in (0.0, hall.depth):
        scene.box((-0.1, -0.1, wall - 0.03), (hall.length + 0.1, 0.12, wall + 0.03), "riser")


def _window(hall: _Hall) -> None:
    """Frosted glass over both storeys in the wall of the larger x, behind bars."""
    scene, x, z = hall.scene, hall.length, hall.depth * 0.6
    scene.rectangle((x - 0.02, 2.3, z), (0, 0, 0.6), (0, 1.7, 0), "lamp", _WINDOW)
    for side in (z - 0.62, z, z + 0.62):
        scene.box((x - 0.08, 0.55, side - 0.03), (x + 0.05, 4.05, side + 0.03), "riser")
    for height in np.linspace(0.58, 4.02, 5):
        scene.box((x - 0.07, height - 0.03, z - 0.65), (x + 0.05, height + 0.03, z + 0.65), "riser")


def _stairs(hall: _Hall) -> None:
    """Steps along the wall z = 0 up to the gallery, whose ends stand in the walls, with a rail of balusters."""
    scene, count = hall.scene, 14
    rise, run_ = STOREY / count, 0.25
    first = hall.length - 1.1 - count * run_
    for step in range(count):
        x, top = first + step * run_, (step + 1) * rise
        scene.box((x, 0, -0.05), (x + run_ + 0.02, top - 0.03, 1.0), "riser")
        scene.box((x - 0.03, top - 0.03, -0.05), (x + run_ + 0.01, top, 1.03), "step")
        scene.cylinder((x + 0.12, top - 0.01, 0.96), (x + 0.12, top + 0.88, 0.96), 0.012, "steel")
    end = first + count * run_
    scene.cylinder((first + 0.12, rise + 0.88, 0.96), (end - 0.12, STOREY + 0.88, 0.96), 0.03, "step")
    scene.box((end, STOREY - 0.18, -0.05), (hall.length + 0.05, STOREY, hall.depth * 0.45), "riser")
    scene.rectangle((first + 1.2, 0.004, 1.7), (1.1, 0, 0), (0, 0, -0.45), "runner")


def _mirror(hall: _Hall) -> None:
    """A wash stand before a mirror of two metres with tubes of light beside it, at the wall x = 0."""
    scene, z = hall.scene, hall.depth * 0.62
    scene.box((-0.02, 0.8, z - 1.05), (0.02, 2.3, z + 1.05), "chrome")
    scene.rectangle((0.025, 1.55, z), (0, 0, -1.0), (0, 0.72, 0), "mirror")
    for side in (z - 1.15, z + 1.15):
        scene.cylinder((0.07, 0.95, side), (0.07, 2.15, side), 0.022, "lamp", _TUBE)
        for end in (0.93, 2.13):
            scene.box((0, end, side - 0.03), (0.1, end + 0.04, side + 0.03), "chrome")
    scene.box((0, 0.55, z - 0.9), (0.5, 0.7, z + 0.9), "step")
    for at in (z - 0.45, z + 0.45):
        profile = [(0.0, 0.02), (0.1, 0.02), (0.19, 0.08), (0.22, 0.15), (0.2, 0.15), (0.16, 0.08), (0.0, 0.05)]
        hall.lathe(f"basin{at:.1f}", profile, (0.27, 0.68, at), "enamel")
        scene.cylinder((0.08, 0.7, at), (0.08, 0.98, at), 0.015, "chrome")
        scene.cylinder((0.08, 0.98, at), (0.24, 0.96, at), 0.013, "chrome")
    hall.cushion("towel", (0.3, 0.74, z), (0.12, 0.05, 0.16), "coat")


def _lamps(hall: _Hall) -> None:
    """Spots sunk into the ceiling, a strip behind a moulding, a lantern on a chain."""
    scene, rng = hall.scene, hall.rng
    for x in np.linspace(1.0, hall.length - 1.2, 4):
        scene.rectangle((x, HEIGHT - 0.012, hall.depth - 0.8), (0.045, 0, 0), (0, 0, 0.045), "lamp", _SPOT)
        hall.lathe(f"ring{x:.1f}", [(0.05, -0.03), (0.075, -0.03), (0.075, 0.01)],
                   (x, HEIGHT, hall.depth - 0.8), "chrome")  # fmt: skip
    scene.box((0.9, STOREY - 0.1, hall.depth - 0.16), (hall.length - 0.9, STOREY - 0.07, hall.depth), "riser")
    scene.box((0.9, STOREY - 0.1, hall.depth - 0.16), (hall.length - 0.9, STOREY, hall.depth - 0.13), "riser")
    scene.rectangle(
        (hall.length / 2, STOREY - 0.06, hall.depth - 0.09), (hall.length / 2 - 1, 0, 0), (0, 0, -0.02), "lamp", _STRIP
    )
    x, y, z = rng.uniform(2.2, 3.2), 3.1, 2.2
    scene.cylinder((x, y, z), (x, HEIGHT, z), 0.008, "gilt")
    scene.sphere((x, y - 0.14, z), 0.15, "lamp", _LANTERN)
    hall.lathe("cap", [(0.02, 0.05), (0.1, 0.0), (0.11, -0.04)], (x, y, z), "gilt")


def _furniture(hall: _Hall) -> None:
    scene, rng = hall.scene, hall.rng
    for index, x in enumerate(np.linspace(1.4, hall.length - 1.6, 3)):
        y, half = 1.85, rng.uniform(0.24, 0.33)
        scene.box((x - half - 0.05, y - half - 0.05, hall.depth - 0.04), (x + half + 0.05, y + half + 0.05, hall.depth),
                  "gilt")  # fmt: skip
        scene.rectangle((x, y, hall.depth - 0.043), (-half, 0, 0), (0, half, 0), f"painting{index}")
    profile = [(0.0, 0), (0.16, 0), (0.2, 0.2), (0.17, 0.36), (0.15, 0.36), (0.15, 0.3), (0.0, 0.3)]
    x, z = hall.length - 0.6, hall.depth - 0.6
    hall.lathe("pot", profile, (x, 0, z), "pot")
    hall.plant((x, 0.3, z), 16, (0.2, 0.9), (0.5, 1.1), 0.05)
    scene.cylinder((0.5, 0, 0.4), (0.5, 0.55, 0.4), 0.13, "gilt")
    for _ in range(3):
        top = np.array((0.5, 0.95, 0.4)) + rng.normal(size=3) * (0.06, 0.03, 0.06)
        scene.cylinder((0.5, 0.05, 0.4), top, 0.02, "black")
    for index, x in enumerate((1.1, 1.45)):
        hall.cushion(f"coat{index}", (x, 1.25, 0.1), (0.16, 0.5, 0.09), "coat")
    scene.box((0.8, 1.72, 0), (1.75, 1.8, 0.03), "step")


def write_hall(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    hall = _Hall(folder, seed)
    for part in (_textures, _materials, _shell, _window, _stairs, _mirror, _lamps, _furniture):
        part(hall)
    return hall.write()


if __name__ == "__main__":
    run(write_hall, "A hall of two storeys with stairs and a wall of mirror as a Mitsuba scene file, by a seed.")
