"""An eighth furnished room as a Mitsuba scene file: a bath with mosaic, curved ceramics, chrome and a lit mirror.

    python -m benchmarks.random_bath bath --seed 1

FOLDER/scene.xml is a room of 4.6 m x 3.8 m, 2.7 m high: walls of glossy mosaic with grout, a wall of slate, a floor of
wooden planks, a ceiling of slats, a tub that stands free, two basins on a board, a wall of drawers, taps and a shower
of thin chrome, a mirror with a rim of light around it, a round mirror on an arm, a rail with towels, a ladder of
chrome, bottles, a basket, a plant before a window of frosted panes, spots in the ceiling, a strip in a niche. The seed
draws colours, textures and things.
"""

from pathlib import Path

import numpy as np

from benchmarks.random_bedroom import RoomWriter
from benchmarks.random_room import run, write_texture

LENGTH, HEIGHT, DEPTH = 4.6, 2.7, 3.8
"""Along x, y and z, metres."""

_SPOT, _STRIP, _RIM = (85, 74, 58), (7, 5.5, 3.6), (6.5, 6.8, 7)
"""Radiance."""


def _textures(bath: RoomWriter) -> None:
    """Write mosaic, slate, planks, a mat and a towel's stripes (BGR, as OpenCV writes)."""
    rng = bath.rng
    tone = rng.uniform(0.25, 0.75, 3)
    mosaic = np.full((512, 512, 3), 0.7)
    for row, column in np.ndindex(16, 16):
        mosaic[row * 32 + 2 : row * 32 + 30, column * 32 + 2 : column * 32 + 30] = tone * rng.uniform(0.6, 1.2)
    write_texture(bath.folder / "mosaic.png", mosaic)
    clouds = 0.6 * bath.noise(512, 512, 9) + 0.4 * bath.noise(512, 512, 90)
    slate = (0.03 + 0.14 * clouds)[..., None] * (1.1, 1, 0.95)
    slate[::128], slate[1::128], slate[:, ::256] = 0.02, 0.02, 0.02
    write_texture(bath.folder / "slate.png", slate)
    planks = np.zeros((512, 512, 3))
    for row in range(8):
        planks[row * 64 : row * 64 + 62] = np.array((0.15, 0.28, 0.45)) * rng.uniform(0.6, 1.15)
    write_texture(bath.folder / "planks.png", planks * (0.75 + 0.5 * bath.noise(512, 512, 40).T[..., None]))
    mat = np.where((np.mgrid[:128, :128].sum(axis=0) // 16 % 2)[..., None], rng.uniform(0.1, 0.7, 3), 0.75)
    write_texture(bath.folder / "mat.png", mat)
    towel = np.tile(rng.uniform(0.4, 0.8, 3), (128, 128, 1))
    towel[96:104], towel[110:114] = rng.uniform(0.05, 0.4, 3), 0.1
    write_texture(bath.folder / "towel.png", towel)


def _materials(bath: RoomWriter) -> None:
    scene, rng = bath.scene, bath.rng
    scene.textured("mosaic", "mosaic.png", 3, 3, 0.06)
    scene.textured("slate", "slate.png", 2, 2, 0.25)
    scene.textured("planks", "planks.png", 1, 3, 0.2)
    scene.textured("mat", "mat.png", 3, 2)
    scene.textured("towel", "towel.png", 1, 1)
    for name, color in {
        "plaster": rng.uniform(0.65, 0.85) * np.ones(3),
        "grey": rng.uniform(0.2, 0.4) * np.ones(3),
        "wicker": (0.4, 0.27, 0.14),
        "leaf": (0.07, 0.25, 0.06),
        "lamp": (0.5, 0.5, 0.5),
        "black": (0.03, 0.03, 0.03),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("ceramic", (0.85, 0.85, 0.83), 0.04)
    scene.plastic("oak", (0.38, 0.24, 0.13), 0.25)
    scene.plastic("lacquer", rng.uniform(0.05, 0.7, 3), 0.1)
    scene.plastic("board", (0.06, 0.055, 0.05), 0.15)
    for index in range(5):
        scene.plastic(f"bottle{index}", rng.uniform(0.05, 0.8, 3), 0.08)
    scene.metal("chrome", "Cr", 0.04)
    scene.metal("satin", "Al", 0.25)
    scene.metal("copper", "Cu", 0.15)
    scene.metal("mirror", "Ag", 0.01)


def _shell(bath: RoomWriter) -> None:
    """Floor, walls with a niche, and a ceiling of slats below plaster."""
    scene, x, y, z = bath.scene, LENGTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "planks")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "plaster")
    scene.rectangle((x, y, 0), (x, 0, 0), (0, y, 0), "mosaic")
    scene.rectangle((x, y, DEPTH), (-x, 0, 0), (0, y, 0), "plaster")
    scene.rectangle((0, y, z), (0, 0, -z), (0, y, 0), "slate")
    scene.rectangle((LENGTH, y, z), (0, 0, z), (0, y, 0), "mosaic")
    for at in np.arange(2.9, LENGTH, 0.11):
        scene.box((at, HEIGHT - 0.07, 0), (at + 0.05, HEIGHT - 0.03, DEPTH), "oak")
    scene.box((2.4, 0, -0.02), (2.5, 2.1, 0.9), "grey")  # a low wall beside the shower
    scene.box((0, 1.2, 2.9), (0.14, 1.24, 3.6), "oak")
    scene.rectangle((0.03, 1.19, 3.25), (0, 0, -0.33), (0, 0.006, 0), "lamp", _STRIP)
    scene.rectangle((0.05, 1.198, 3.25), (0.03, 0, 0), (0, 0, 0.33), "lamp", _STRIP)


def _window(bath: RoomWriter) -> None:
    """Frosted panes in the wall z = DEPTH, brighter above than below, behind bars, and a plant before them."""
    scene, z = bath.scene, DEPTH - 0.02
    for column in range(3):
        for row, level in enumerate((5, 7.5, 10.5)):
            middle = (2.2 + 0.5 * column, 1.15 + 0.42 * row, z)
            scene.rectangle(middle, (-0.235, 0, 0), (0, 0.195, 0), "lamp", level * np.array((0.85, 1, 1.12)))
    for at in np.linspace(1.95, 3.45, 4):
        scene.box((at - 0.02, 0.92, DEPTH - 0.06), (at + 0.02, 2.22, DEPTH), "grey")
    for at in np.linspace(0.94, 2.2, 4):
        scene.box((1.93, at - 0.02, DEPTH - 0.055), (3.47, at + 0.02, DEPTH), "grey")
    scene.box((1.85, 0.86, DEPTH - 0.22), (3.55, 0.9, DEPTH), "ceramic")
    bath.plant((2.1, 0.98, DEPTH - 0.13), 16, (0.2, 0.9), (0.25, 0.5), 0.03)
    bath.lathe("pot", [(0, 0), (0.06, 0), (0.085, 0.14), (0.07, 0.14), (0, 0.1)], (2.1, 0.9, DEPTH - 0.13), "copper")


def _tub(bath: RoomWriter) -> None:
    """A tub that stands free, with a tap on a pipe, a mat before it and a stool with towels."""
    angle, level = np.meshgrid(np.linspace(0, 2 * np.pi, 49), np.linspace(0, 1, 25))
    # up the outside, over the rim, down the inside
    out = np.interp(level, [0, 0.45, 0.5, 0.55, 0.85, 1], [0.78, 1, 1.02, 0.94, 0.72, 0])
    up = np.interp(level, [0, 0.45, 0.5, 0.55, 0.85, 1], [0.02, 0.55, 0.57, 0.55, 0.14, 0.12])
    points = np.stack([1.1 + 0.82 * out * np.cos(angle), up, 2.75 + 0.42 * out * np.sin(angle)], -1)
    bath.grid("tub", points, "ceramic")
    scene = bath.scene
    scene.cylinder((2.05, 0, 2.75), (2.05, 0.85, 2.75), 0.018, "chrome")
    scene.cylinder((2.05, 0.84, 2.75), (1.85, 0.84, 2.75), 0.016, "chrome")
    scene.sphere((2.05, 0.86, 2.75), 0.03, "chrome")
    scene.rectangle((2.7, 0.012, 2.3), (0.4, 0, 0), (0, 0, -0.6), "mat")
    scene.cylinder((2.6, 0.42, 3.2), (2.6, 0.46, 3.2), 0.17, "oak")
    for turn in (0.3, 2.4, 4.5):
        foot = (2.6 + 0.15 * np.cos(turn), 0, 3.2 + 0.15 * np.sin(turn))
        scene.cylinder(foot, (2.6, 0.42, 3.2), 0.014, "oak")
    bath.cushion("folded", (2.6, 0.51, 3.2), (0.15, 0.06, 0.13), "towel")


def _basins(bath: RoomWriter) -> None:
    """A board with two basins, drawers below, a mirror with a rim of light above, taps, bottles, a mirror on an arm."""
    scene, rng = bath.scene, bath.rng
    front = LENGTH - 0.55
    scene.box((front, 0.8, 0.6), (LENGTH, 0.85, 2.9), "board")
    scene.box((front + 0.04, 0.3, 0.65), (LENGTH, 0.8, 2.85), "lacquer")
    for at in np.linspace(0.65, 2.85, 5)[1:-1]:
        scene.box((front + 0.036, 0.32, at - 0.004), (front + 0.045, 0.78, at + 0.004), "black")
    for at in np.linspace(0.92, 2.58, 4):
        scene.cylinder((front + 0.02, 0.7, at - 0.08), (front + 0.02, 0.7, at + 0.08), 0.008, "satin")
    profile = [(0.0, 0), (0.12, 0), (0.21, 0.14), (0.2, 0.145), (0.18, 0.13), (0.1, 0.03), (0, 0.03)]
    for at in (1.2, 2.3):
        bath.lathe(f"basin{at}", profile, (LENGTH - 0.28, 0.85, at), "ceramic")
        scene.cylinder((LENGTH - 0.06, 0.85, at), (LENGTH - 0.06, 1.12, at), 0.014, "chrome")
        scene.cylinder((LENGTH - 0.06, 1.11, at), (LENGTH - 0.2, 1.11, at), 0.011, "chrome")
    scene.rectangle((LENGTH - 0.035, 1.65, 1.75), (0, 0, 1.0), (0, 0.42, 0), "mirror")
    for middle, u, v in (
        ((LENGTH - 0.036, 2.09, 1.75), (0, 0, 1.02), (0, 0.018, 0)),
        ((LENGTH - 0.036, 1.21, 1.75), (0, 0, 1.02), (0, 0.018, 0)),
        ((LENGTH - 0.036, 1.65, 0.72), (0, 0, 0.018), (0, 0.42, 0)),
        ((LENGTH - 0.036, 1.65, 2.78), (0, 0, 0.018), (0, 0.42, 0)),
    ):
        scene.rectangle(middle, u, v, "lamp", _RIM)
    scene.cylinder((LENGTH - 0.05, 1.5, 3.2), (LENGTH - 0.3, 1.5, 3.2), 0.01, "chrome")
    scene.cylinder((LENGTH - 0.315, 1.5, 3.2), (LENGTH - 0.3, 1.5, 3.2), 0.1, "satin")
    for _ in range(9):
        at, wide, tall = rng.uniform(0.65, 2.85), rng.uniform(0.02, 0.035), rng.uniform(0.08, 0.2)
        if min(abs(at - 1.2), abs(at - 2.3)) > 0.25:
            profile = [(0, 0), (wide, 0), (wide, 0.7 * tall), (wide / 2.5, 0.8 * tall), (wide / 2.5, tall), (0, tall)]
            bath.lathe(f"bottle{at:.3f}", profile, (LENGTH - rng.uniform(0.1, 0.4), 0.85, at),
                       f"bottle{rng.integers(5)}")  # fmt: skip


def _shower(bath: RoomWriter) -> None:
    """A shower in the corner of the mosaic, a shelf with bottles, a ladder of chrome with towels, a basket."""
    scene, rng = bath.scene, bath.rng
    scene.cylinder((1.3, 1.0, 0.04), (1.3, 2.2, 0.04), 0.012, "chrome")
    scene.cylinder((1.3, 2.2, 0.04), (1.3, 2.2, 0.4), 0.012, "chrome")
    scene.cylinder((1.3, 2.17, 0.4), (1.3, 2.19, 0.4), 0.13, "chrome")
    scene.box((1.15, 1.05, 0), (1.45, 1.1, 0.09), "chrome")
    scene.box((0.3, 0, 0), (2.4, 0.04, 0.95), "ceramic")
    for at in (0.5, 0.62, 0.75):
        scene.cylinder((at, 1.2, 0.08), (at, 1.2 + rng.uniform(0.12, 0.22), 0.08), 0.03, f"bottle{rng.integers(5)}")
    scene.box((0.4, 1.17, 0), (0.9, 1.2, 0.15), "oak")
    for at in (1.2, 1.75):
        scene.cylinder((0.06, 0.4, at), (0.06, 1.9, at), 0.012, "chrome")
    for height in np.linspace(0.45, 1.85, 12):
        scene.cylinder((0.06, height, 1.2), (0.06, height, 1.75), 0.009, "chrome")
    for height, drop in ((1.85, 0.55), (1.0, 0.4)):
        u, v = np.meshgrid(np.linspace(1.27, 1.68, 30), np.linspace(0, 1, 20))
        fold = 0.085 + 0.012 * np.sin(u * 40 + rng.uniform(0, 6)) * v
        bath.grid(f"towel{height}", np.stack([fold, height + 0.02 - drop * v, u], -1), "towel")
    profile = [(0, 0), (0.17, 0), (0.2, 0.2), (0.19, 0.42), (0.17, 0.42), (0.17, 0.05), (0, 0.05)]
    bath.lathe("basket", profile, (0.4, 0, 3.45), "wicker")
    bath.cushion("laundry", (0.4, 0.36, 3.45), (0.15, 0.1, 0.15), "grey")


def _lamps(bath: RoomWriter) -> None:
    """Spots flush with the plaster, one of them over the shower."""
    scene = bath.scene
    for x, z in ((0.8, 0.5), (0.8, 2.0), (0.8, 3.3), (2.2, 2.0), (2.2, 3.3)):
        scene.cylinder((x, HEIGHT - 0.004, z), (x, HEIGHT, z), 0.055, "satin")
        scene.rectangle((x, HEIGHT - 0.005, z), (0.035, 0, 0), (0, 0, 0.035), "lamp", _SPOT)


def write_bath(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    bath = RoomWriter(folder, seed)
    for part in (_textures, _materials, _shell, _window, _tub, _basins, _shower, _lamps):
        part(bath)
    return bath.write()


if __name__ == "__main__":
    run(write_bath, "A bath with mosaic and curved ceramics as a Mitsuba scene file, by a seed.")
