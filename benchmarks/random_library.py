"""A ninth furnished room as a Mitsuba scene file: a dark library in the evening, with many small lamps of four kinds.

    python -m benchmarks.random_library library --seed 1

FOLDER/scene.xml is a room of 7.2 m x 5.4 m, 3.4 m high: dark panels, a floor of herringbone, shelves with hundreds of
books, a ladder, a long varnished table with chairs of turned spindles, a chandelier of candle bulbs, sconces in pairs,
a green lamp on a desk, a fire, a screen, a window at dusk behind curtains, armchairs with buttons, a globe, a clock
with a brass pendulum, gilded frames, candlesticks. The seed draws colours, books and pictures.
"""

from pathlib import Path

import numpy as np

from benchmarks.random_bedroom import RoomWriter
from benchmarks.random_room import run, write_texture

LENGTH, HEIGHT, DEPTH = 7.2, 3.4, 5.4
"""Along x, y and z, metres."""

_DUSK, _CANDLE, _SCONCE, _GREEN = (1.1, 1.5, 2.4), (120, 82, 42), (13, 9.5, 5.5), (2.2, 4.6, 1.9)
_FIRE, _SCREEN = (21, 7.5, 1.6), (0.5, 0.75, 1.05)
"""Radiance."""


def _textures(library: RoomWriter) -> None:
    """Write herringbone, panels' grain, a rug, marble and three pictures (BGR, as OpenCV writes)."""
    rng, folder = library.rng, library.folder
    rows, columns = np.mgrid[:512, :512]
    piece = (rows + np.where(columns // 64 % 2, columns, -columns)) // 24
    tone = rng.uniform(0.5, 1.25, 200)[piece % 97 + 3 * (columns // 64 % 32)]
    bone = np.array((0.09, 0.17, 0.3)) * tone[..., None]
    bone[(rows + np.where(columns // 64 % 2, columns, -columns)) % 24 < 2] *= 0.4
    write_texture(folder / "bone.png", bone * (0.8 + 0.4 * library.noise(512, 512, 120)[..., None]))
    grain = library.noise(512, 512, 12) + 0.5 * np.sin(columns / 9 + 6 * library.noise(512, 512, 5))
    write_texture(folder / "grain.png", np.array((0.03, 0.06, 0.12)) * (0.7 + 0.5 * grain[..., None]))
    rug = np.tile(rng.uniform(0.05, 0.3, 3), (256, 256, 1))
    y, x = np.mgrid[:256, :256]
    rug[(np.hypot(x % 64 - 32, y % 64 - 32) < 20)] = rng.uniform(0.1, 0.6, 3)
    rug[(np.minimum(np.minimum(x, 255 - x), np.minimum(y, 255 - y)) // 8) % 3 == 1] = rng.uniform(0.3, 0.6, 3)
    write_texture(folder / "rug.png", rug * (0.8 + 0.4 * library.noise(256, 256, 110)[..., None]))
    veins = np.abs(library.noise(256, 256, 8) - 0.5)
    write_texture(folder / "marble.png", np.clip(0.1 + 1.4 * veins, 0, 0.7)[..., None] * (0.8, 0.9, 1))
    for index in range(3):
        picture = np.dstack([library.noise(128, 96, 3 + 2 * index) for _ in range(3)]) * (0.4, 0.6, 0.8)
        write_texture(folder / f"picture{index}.png", 0.02 + 0.8 * picture**2)


def _materials(library: RoomWriter) -> None:
    scene, rng = library.scene, library.rng
    scene.textured("bone", "bone.png", 4, 3, 0.12)
    scene.textured("grain", "grain.png", 2, 1, 0.2)
    scene.textured("rug", "rug.png", 1, 1)
    scene.textured("marble", "marble.png", 1, 1, 0.08)
    for index in range(3):
        scene.textured(f"picture{index}", f"picture{index}.png", 1, 1, 0.1)
    for name, color in {
        "wall": rng.uniform(0.1, 0.45, 3),
        "ceiling": (0.6, 0.58, 0.53),
        "curtain": rng.uniform(0.03, 0.4, 3),
        "soot": (0.015, 0.015, 0.015),
        "log": (0.12, 0.07, 0.04),
        "paper": (0.75, 0.72, 0.62),
        "lamp": (0.5, 0.5, 0.5),
    }.items():
        scene.diffuse(name, color)
    for index in range(12):
        scene.diffuse(f"cloth{index}", rng.uniform(0.02, 0.5, 3) ** 1.3)
    scene.plastic("varnish", (0.16, 0.065, 0.025), 0.06)
    scene.plastic("leather", rng.uniform((0.15, 0.02, 0.02), (0.3, 0.15, 0.08)), 0.25)
    scene.plastic("globe", (0.15, 0.3, 0.4), 0.1)
    scene.metal("brass", "Au", 0.12)
    scene.metal("gilt", "Au", 0.3)
    scene.metal("iron", "Cr", 0.35)
    scene.metal("silver", "Ag", 0.08)


def _shell(library: RoomWriter) -> None:
    """Floor, panelled walls, a ceiling with beams, and a window at dusk behind curtains."""
    scene, x, y, z = library.scene, LENGTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "bone")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "ceiling")
    for middle, u in (((x, y, 0), (x, 0, 0)), ((x, y, DEPTH), (-x, 0, 0)), ((0, y, z), (0, 0, -z)),
                      ((LENGTH, y, z), (0, 0, z))):  # fmt: skip
        scene.rectangle(middle, u, (0, y, 0), "wall")
    for at in np.linspace(0.6, LENGTH - 0.6, 6):
        scene.box((at - 0.08, HEIGHT - 0.16, -0.05), (at + 0.08, HEIGHT + 0.05, DEPTH + 0.05), "grain")
    for low in np.arange(0.05, DEPTH - 0.6, 0.75):
        scene.box((-0.05, 0.1, low), (0.03, 1.1, low + 0.65), "grain")
    scene.box((-0.05, 1.12, 0), (0.05, 1.18, DEPTH), "varnish")
    scene.rectangle((0.02, 2.05, 2.7), (0, 0, -0.55), (0, 0.8, 0), "lamp", _DUSK)
    for at in (2.15, 2.7, 3.25):
        scene.box((-0.03, 1.2, at - 0.025), (0.06, 2.9, at + 0.025), "varnish")
    for at in (1.23, 1.75, 2.3, 2.87):
        scene.box((-0.03, at - 0.025, 2.12), (0.055, at + 0.025, 3.28), "varnish")
    for side in (1.75, 3.2):
        along = np.linspace(0, 0.5, 60)
        fold = 0.14 + 0.045 * np.sin(along * 2 * np.pi / 0.11 + library.rng.uniform(0, 6))
        sheet = np.stack([np.stack([fold, np.full(60, height), side + along], -1) for height in (0.05, 3.05)])
        library.grid(f"curtain{side}", sheet, "curtain")
    scene.cylinder((0.14, 3.07, 1.6), (0.14, 3.07, 3.85), 0.018, "brass")


def _books(library: RoomWriter) -> None:
    """Shelves along the wall z = 0 with books, a rail and a ladder, and piles of books elsewhere."""
    scene, rng = library.scene, library.rng
    for left in (0.5, 2.3, 4.9):
        for height in np.arange(0.08, 2.7, 0.42):
            scene.box((left, height - 0.03, 0), (left + 1.7, height, 0.32), "varnish")
            at = left + 0.03
            while height < 2.5 and at < left + 1.6:
                thick, high = rng.uniform(0.018, 0.06), rng.uniform(0.2, 0.35)
                deep = rng.uniform(0.2, 0.28)
                scene.box((at, height, 0.02), (at + thick, height + high, deep), f"cloth{rng.integers(12)}")
                at += thick + (rng.uniform(0.1, 0.35) if rng.random() < 0.06 else 0.002)
        for side in (left - 0.04, left + 1.7):
            scene.box((side, 0, 0), (side + 0.04, 2.65, 0.34), "varnish")
    scene.cylinder((0.4, 2.5, 0.42), (6.7, 2.5, 0.42), 0.014, "brass")
    for side in (1.2, 1.55):
        scene.cylinder((side, 0.0, 0.95), (side, 2.55, 0.43), 0.018, "varnish")
    for step in np.linspace(0.1, 0.95, 9):
        y, z = 2.55 * step, 0.95 - 0.52 * step
        scene.cylinder((1.2, y, z), (1.55, y, z), 0.013, "varnish")
    for x, z in ((3.0, 2.9), (4.3, 2.6), (6.3, 4.6)):
        level = 0.78
        for _ in range(rng.integers(2, 5)):
            thick = rng.uniform(0.02, 0.05)
            scene.box((x, level, z), (x + rng.uniform(0.15, 0.22), level + thick, z + 0.26), f"cloth{rng.integers(12)}")
            level += thick


def _table(library: RoomWriter) -> None:
    """A long table with papers and candlesticks, chairs with spindles, a rug, a desk with a green lamp."""
    scene = library.scene
    scene.box((2.4, 0.72, 2.3), (5.0, 0.77, 3.3), "varnish")
    leg = [(0.05, 0), (0.03, 0.1), (0.06, 0.25), (0.03, 0.45), (0.055, 0.6), (0.05, 0.72)]
    for index, (x, z) in enumerate(((2.55, 2.42), (4.85, 2.42), (2.55, 3.18), (4.85, 3.18))):
        library.lathe(f"leg{index}", leg, (x, 0, z), "varnish")
    for index, (x, z, way) in enumerate(((3.0, 1.9, -1), (4.2, 1.95, -1), (3.1, 3.7, 1), (4.3, 3.65, 1))):
        scene.box((x - 0.21, 0.43, z - 0.2), (x + 0.21, 0.47, z + 0.2), "varnish")
        library.cushion(f"seat{index}", (x, 0.48, z), (0.19, 0.03, 0.18), "leather")
        for a in (-0.17, 0.17):
            for b in (-0.16, 0.16):
                scene.cylinder((x + a, 0, z + b), (x + a, 0.43, z + b), 0.016, "varnish")
        for a in np.linspace(-0.17, 0.17, 6):
            scene.cylinder((x + a, 0.47, z + way * 0.18), (x + a, 0.95, z + way * 0.21), 0.009, "varnish")
        scene.cylinder((x - 0.2, 0.95, z + way * 0.21), (x + 0.2, 0.95, z + way * 0.21), 0.022, "varnish")
    scene.rectangle((3.7, 0.006, 2.8), (2.0, 0, 0), (0, 0, -1.2), "rug")
    scene.box((3.5, 0.771, 2.6), (3.7, 0.775, 2.9), "paper")
    for index, x in enumerate((3.9, 4.1)):
        stick = [(0.05, 0), (0.045, 0.015), (0.012, 0.03), (0.02, 0.12), (0.01, 0.2), (0.022, 0.24), (0, 0.24)]
        library.lathe(f"stick{index}", stick, (x, 0.77, 2.85), "silver")
        scene.cylinder((x, 1.01, 2.85), (x, 1.19, 2.85), 0.011, "paper")
    scene.box((5.9, 0.72, 4.3), (7.1, 0.77, 5.1), "varnish")
    scene.box((5.95, 0, 4.35), (6.3, 0.72, 5.05), "grain")
    scene.box((6.75, 0, 4.35), (7.05, 0.72, 5.05), "grain")
    scene.box((6.05, 0.95, 5.12), (6.75, 1.35, 5.16), "soot")
    scene.rectangle((6.4, 1.15, 5.115), (-0.32, 0, 0), (0, 0.18, 0), "soot", _SCREEN)
    library.lathe("foot", [(0.08, 0), (0.07, 0.02), (0.012, 0.04), (0.012, 0.3), (0, 0.3)], (6.9, 0.77, 4.6), "brass")
    scene.cylinder((6.9, 1.1, 4.42), (6.9, 1.1, 4.78), 0.055, "lamp", _GREEN)


def _lamps(library: RoomWriter) -> None:
    """A chandelier of twelve candle bulbs, sconces in pairs, and a fire behind a fender."""
    scene, rng = library.scene, library.rng
    x, y, z = 3.7, 2.35, 2.8
    scene.cylinder((x, y, z), (x, HEIGHT, z), 0.012, "brass")
    library.lathe("hub", [(0, -0.12), (0.05, -0.08), (0.02, 0), (0.06, 0.08), (0.015, 0.16)], (x, y, z), "brass")
    for turn in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        end = (x + 0.45 * np.cos(turn), y, z + 0.45 * np.sin(turn))
        scene.cylinder((x, y - 0.02, z), end, 0.008, "brass")
        scene.cylinder(end, (end[0], y + 0.08, end[2]), 0.012, "paper")
        scene.sphere((end[0], y + 0.105, end[2]), 0.022, "lamp", _CANDLE)
    for middle, way in (((7.12, 1.9, 1.4), (-1, 0)), ((7.12, 1.9, 3.9), (-1, 0)), ((2.0, 1.9, 5.32), (0, -1)),
                        ((5.2, 1.9, 5.32), (0, -1))):  # fmt: skip
        at = (middle[0] + 0.08 * way[0], middle[1], middle[2] + 0.08 * way[1])
        scene.cylinder(middle, at, 0.012, "brass")
        for side in (-0.09, 0.09):
            low = (at[0] + side * abs(way[1]), at[1], at[2] + side * abs(way[0]))
            scene.cylinder((low[0], low[1] + 0.02, low[2]), (low[0], low[1] + 0.16, low[2]), 0.05, "lamp", _SCONCE)
    scene.box((6.7, 0, 2.0), (7.2, 1.15, 2.25), "marble")
    scene.box((6.7, 0, 3.15), (7.2, 1.15, 3.4), "marble")
    scene.box((6.65, 1.15, 1.9), (7.2, 1.3, 3.5), "marble")
    scene.rectangle((7.18, 0.55, 2.7), (0, 0, 0.45), (0, 0.6, 0), "soot")
    for index in range(5):
        at = 2.4 + 0.15 * index
        scene.cylinder((6.9, 0.08 + 0.06 * (index % 2), at - 0.2), (7.0, 0.1, at + 0.25), 0.045, "log")
        wide, tall = rng.uniform(0.03, 0.06), rng.uniform(0.15, 0.35)
        flame = [(0, 0.12), (wide, 0.12 + 0.25 * tall), (0.6 * wide, 0.12 + 0.6 * tall), (0, 0.12 + tall)]
        angle = np.linspace(2 * np.pi, 0, 13)  # they shine outwards
        radius, height = np.array(flame).T
        points = np.stack([7.0 + radius[:, None] * np.cos(angle), np.broadcast_to(height[:, None], (4, 13)),
                           at + radius[:, None] * np.sin(angle)], -1)  # fmt: skip
        library.grid(f"flame{index}", points, "lamp")
        light = " ".join(f"{value:.3f}" for value in np.array(_FIRE) * rng.uniform(0.7, 1.2))
        scene.shapes[-1] = scene.shapes[-1].replace(
            "</shape>", f'<emitter type="area"><rgb name="radiance" value="{light}"/></emitter></shape>'
        )
    for height in (0.1, 0.3):
        scene.cylinder((6.55, height, 2.1), (6.55, height, 3.3), 0.008, "brass")
    for at in np.linspace(2.1, 3.3, 9):
        scene.cylinder((6.55, 0, at), (6.55, 0.3, at), 0.006, "brass")


def _things(library: RoomWriter) -> None:
    """Armchairs before the fire, a globe, a clock, pictures in gilded frames."""
    scene = library.scene
    for index, z in enumerate((1.7, 3.75)):
        scene.box((5.5, 0.1, z - 0.38), (6.2, 0.3, z + 0.38), "leather")
        library.cushion(f"chair{index}", (5.85, 0.38, z), (0.33, 0.1, 0.3), "leather")
        library.cushion(f"back{index}", (5.5, 0.72, z), (0.12, 0.4, 0.36), "leather")
        for side in (-0.36, 0.36):
            library.cushion(f"arm{index}{side}", (5.85, 0.48, z + side), (0.36, 0.16, 0.09), "leather")
        for a, b in np.ndindex(3, 3):
            scene.sphere((5.625, 0.55 + 0.16 * a, z - 0.18 + 0.18 * b), 0.014, "brass")
    scene.sphere((1.1, 0.95, 4.5), 0.24, "globe")
    library.lathe("stand", [(0.2, 0), (0.18, 0.03), (0.03, 0.08), (0.03, 0.66), (0.1, 0.7), (0, 0.7)],
                  (1.1, 0, 4.5), "varnish")  # fmt: skip
    scene.box((3.3, 0, DEPTH - 0.3), (3.8, 2.1, DEPTH), "grain")
    scene.cylinder((3.55, 1.75, DEPTH - 0.31), (3.55, 1.75, DEPTH - 0.29), 0.17, "paper")
    scene.cylinder((3.55, 0.75, DEPTH - 0.31), (3.55, 0.75, DEPTH - 0.295), 0.1, "brass")
    scene.cylinder((3.55, 0.85, DEPTH - 0.305), (3.55, 1.5, DEPTH - 0.305), 0.008, "brass")
    for index, (x, half) in enumerate(((1.2, 0.4), (4.5, 0.3), (6.2, 0.35))):
        scene.box((x - half - 0.06, 1.5, DEPTH - 0.04), (x + half + 0.06, 2.5, DEPTH), "gilt")
        scene.rectangle((x, 2.0, DEPTH - 0.042), (-half, 0, 0), (0, 0.44, 0), f"picture{index}")
    scene.box((6.9, 1.3, 2.3), (7.1, 1.55, 2.5), "iron")


def write_library(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    library = RoomWriter(folder, seed)
    for part in (_textures, _materials, _shell, _books, _table, _lamps, _things):
        part(library)
    return library.write()


if __name__ == "__main__":
    run(write_library, "A dark library in the evening as a Mitsuba scene file, by a seed.")
