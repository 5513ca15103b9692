"""A fourth furnished room as a Mitsuba scene file: cloth, curved things, open windows with sun and sky.

    python -m benchmarks.random_bedroom bedroom --seed 1

FOLDER/scene.xml is a bedroom of 5.4 m x 4.4 m: planks, a wallpaper with a pattern, a bed with pillows and a wrinkled
cover, curtains in folds, two open windows with bars, lamps of lathed porcelain whose bulbs stand inside shades, a bowl
with fruit, a vase with twigs, a chest of drawers with brass knobs, a mirror in a round frame, a rug, a radiator. What
does not shine of the lamps only reflects. The seed draws textures, wrinkles, colours and the sun's place.
"""

from pathlib import Path

import cv2
import numpy as np

from benchmarks.random_room import SceneWriter, Vector, run, write_texture
from fipt.formats.files import make_folder, write_text

LENGTH, HEIGHT, DEPTH = 5.4, 2.7, 4.4
"""Along x, y and z, metres."""

_WINDOWS = ((0.9, 2.0), (2.9, 4.0))
"""Where the windows in the wall z = 0 begin and end along x; they reach from 0.8 m to 2.3 m."""
_BULB, _CEILING = (48, 38, 26), (14, 12.5, 10)
"""Radiance."""
_BED = (3.1, 5.3, 1.6, 3.3)
"""Of the mattress: from and to along x (the head is at the larger x), and along z."""


class RoomWriter:
    """A scene and the folder of its meshes, and what the seed draws."""

    def __init__(self, folder: Path, seed: int) -> None:
        make_folder(folder)
        self.folder, self.scene, self.rng = folder, SceneWriter(), np.random.default_rng(seed)

    def noise(self, rows: int, columns: int, cells: int) -> np.ndarray:
        """Return smooth noise (rows, columns), 0 to 1, of so many cells across."""
        coarse = self.rng.random((cells, cells)).astype(np.float32)
        return np.clip(cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC), 0, 1)

    def grid(self, name: str, points: np.ndarray, material: str) -> None:
        """Add a surface through a grid of points (H, W, 3), as an OBJ file of its own."""
        rows, columns = points.shape[:2]
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1) + 1).ravel()
        lines = [f"v {x:f} {y:f} {z:f}" for x, y, z in points.reshape(-1, 3)]
        lines += [f"f {a} {a + 1} {a + columns + 1}\nf {a} {a + columns + 1} {a + columns}" for a in corner]
        write_text(self.folder / f"{name}.obj", "\n".join(lines) + "\n")
        self.scene.shapes.append(
            f'<shape type="obj"><string name="filename" value="{name}.obj"/><ref id="{material}"/></shape>'
        )

    def lathe(self, name: str, profile: list[tuple[float, float]], foot: Vector, material: str) -> None:
        """Turn a profile of (radius, height) around the upright axis that stands on `foot`."""
        radius, height = np.array(profile, float).T
        angle = np.linspace(0, 2 * np.pi, 33)
        points = np.stack(
            [
                foot[0] + radius[:, None] * np.cos(angle),
                np.broadcast_to(foot[1] + height[:, None], (len(radius), len(angle))),
                foot[2] + radius[:, None] * np.sin(angle),
            ],
            axis=-1,
        )
        self.grid(name, points, material)

    def cushion(self, name: str, middle: Vector, half: Vector, material: str) -> None:
        """Add a rounded box of cloth with wrinkles."""
        u, v = np.meshgrid(np.linspace(-np.pi, np.pi, 49), np.linspace(-np.pi / 2, np.pi / 2, 25))

        def power(values: np.ndarray, exponent: float) -> np.ndarray:
            return np.sign(values) * np.abs(values) ** exponent

        shape = np.stack([power(np.cos(v), 0.5) * power(np.cos(u), 0.5), power(np.sin(v), 0.7),
                          power(np.cos(v), 0.5) * power(np.sin(u), 0.5)], axis=-1)  # fmt: skip
        wrinkles = self.noise(25, 49, 9)
        wrinkles[:, -1] = wrinkles[:, 0]
        self.grid(name, np.array(middle) + shape * np.array(half) * (0.9 + 0.15 * wrinkles[..., None]), material)

    def plant(self, foot: Vector, leaves: int, lean: Vector, length: Vector, wide: float) -> None:
        """Add bent leaves that grow out of `foot`; how far each leans and how long it is is drawn between two ends."""
        along = np.linspace(0, 1, 9)
        for leaf in range(leaves):
            turn, leans, long = self.rng.uniform(0, 6.3), self.rng.uniform(*lean), self.rng.uniform(*length)
            out = long * np.sin(leans) * along**1.5
            up = long * along * (1 - 0.4 * along * leans)
            middle = foot + np.stack([out * np.cos(turn), up, out * np.sin(turn)], -1)
            half = wide * np.sin(np.pi * np.clip(along + 0.05, 0, 1))[:, None] * (-np.sin(turn), 0, np.cos(turn))
            self.grid(f"leaf{leaf}", np.stack([middle - half, middle + half]), "leaf")

    def write(self) -> Path:
        """Write scene.xml beside textures and meshes; return the file."""
        write_text(self.folder / "scene.xml", self.scene.xml())
        return self.folder / "scene.xml"


def _textures(room: RoomWriter) -> None:
    """Write planks, wallpaper, a rug and two pictures (BGR, as OpenCV writes)."""
    planks = np.zeros((512, 512, 3), np.float32)
    for row in range(8):
        for start in (0, int(room.rng.integers(150, 350))):
            tone = room.rng.uniform(0.6, 1.1)
            planks[row * 64 : row * 64 + 63, start + 2 :] = np.array((0.12, 0.24, 0.42)) * tone
    planks *= 0.75 + 0.5 * cv2.resize(room.rng.random((256, 8)).astype(np.float32), (512, 512))[..., None]
    write_texture(room.folder / "planks.png", planks)
    y, x = np.mgrid[:256, :256]
    paper = np.tile(room.rng.uniform(0.45, 0.7, 3), (256, 256, 1))
    paper[(np.sin(x * np.pi / 32) + np.cos(y * np.pi / 64) * np.cos(x * np.pi / 64)) > 0.6] *= (0.7, 0.8, 1.1)
    write_texture(room.folder / "wallpaper.png", paper)
    rug = np.tile((0.15, 0.1, 0.35), (256, 256, 1))
    rug[(np.abs(x - 128) + np.abs(y - 128)) % 48 < 20] = (0.5, 0.6, 0.65)
    rug[(x < 20) | (x > 235) | (y < 20) | (y > 235)] = (0.3, 0.2, 0.08)
    write_texture(room.folder / "rug.png", rug * (0.8 + 0.4 * room.noise(256, 256, 90)[..., None]))
    for index in range(2):
        picture = np.dstack([room.noise(128, 96, 4 + 3 * index) for _ in range(3)])
        write_texture(room.folder / f"picture{index}.png", 0.05 + 0.7 * picture)


def _materials(room: RoomWriter) -> None:
    scene, rng = room.scene, room.rng
    scene.textured("planks", "planks.png", 3, 2.5, 0.15)
    scene.textured("wallpaper", "wallpaper.png", 6, 3)
    scene.textured("rug", "rug.png", 1, 1)
    for index in range(2):
        scene.textured(f"picture{index}", f"picture{index}.png", 1, 1, 0.08)
    for name, color in {
        "white": (0.82, 0.82, 0.8),
        "ceiling": (0.78, 0.78, 0.76),
        "linen": (0.75, 0.73, 0.68),
        "cover": rng.uniform(0.1, 0.6, 3),
        "pillow": rng.uniform(0.2, 0.8, 3),
        "curtain": rng.uniform(0.3, 0.7, 3),
        "shade": (0.72, 0.66, 0.55),
        "twig": (0.2, 0.12, 0.07),
        "bulb": (0.5, 0.5, 0.5),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("oak", (0.35, 0.2, 0.1), 0.25)
    scene.plastic("porcelain", rng.uniform(0.1, 0.7, 3), 0.08)
    scene.plastic("vase", rng.uniform(0.05, 0.5, 3), 0.1)
    scene.plastic("apple", (0.5, 0.06, 0.04), 0.15)
    scene.metal("brass", "Au", 0.15)
    scene.metal("steel", "Cr", 0.2)
    scene.metal("mirror", "Ag", 0.02)


def _shell(room: RoomWriter) -> None:
    scene = room.scene
    x, y, z = LENGTH / 2, HEIGHT / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "planks")
    scene.rectangle((x, HEIGHT, z), (x, 0, 0), (0, 0, z), "ceiling")
    scene.rectangle((x, y, DEPTH), (-x, 0, 0), (0, y, 0), "wallpaper")
    scene.rectangle((0, y, z), (0, 0, -z), (0, y, 0), "wallpaper")
    scene.rectangle((LENGTH, y, z), (0, 0, z), (0, y, 0), "wallpaper")
    scene.box((0, 0, -0.2), (LENGTH, 0.8, 0), "white")
    scene.box((0, 2.3, -0.2), (LENGTH, HEIGHT, 0), "white")
    edges = [0, *(edge for window in _WINDOWS for edge in window), LENGTH]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        scene.box((low, 0.8, -0.2), (high, 2.3, 0), "white")
    for low, high in _WINDOWS:
        middle = (low + high) / 2
        scene.box((middle - 0.02, 0.8, -0.12), (middle + 0.02, 2.3, -0.08), "white")
        scene.box((low, 1.75, -0.12), (high, 1.79, -0.08), "white")
        for side in (low - 0.3, high - 0.1):
            along = np.linspace(0, 0.4, 60)
            fold = 0.1 + 0.035 * np.sin(along * 2 * np.pi / 0.1 + room.rng.uniform(0, 6))
            sheet = np.stack([np.stack([side + along, np.full(60, height), fold], -1) for height in (0.05, 2.45)])
            room.grid(f"curtain{side:.1f}", sheet, "curtain")
        scene.cylinder((low - 0.4, 2.47, 0.1), (high + 0.4, 2.47, 0.1), 0.015, "brass")
    for wall in (0.02, DEPTH - 0.02):
        scene.box((0, 0, wall - 0.02), (LENGTH, 0.1, wall + 0.02), "white")
    scene.box((0, 0, 0), (0.02, 0.1, DEPTH), "white")


def _bed(room: RoomWriter) -> None:
    scene, (left, right, near, far) = room.scene, _BED
    scene.box((left - 0.05, 0.1, near - 0.04), (right + 0.02, 0.32, far + 0.04), "oak")
    scene.box((right + 0.02, 0, near - 0.04), (right + 0.07, 1.15, far + 0.04), "oak")
    scene.box((left, 0.32, near), (right, 0.52, far), "linen")
    for index, z in enumerate((near + 0.45, far - 0.45)):
        room.cushion(f"pillow{index}", (right - 0.28, 0.62, z), (0.22, 0.1, 0.36), "pillow")
    u, v = np.meshgrid(np.linspace(0, 1, 60), np.linspace(-0.22, 1.22, 70))
    over = np.clip(np.maximum(-v, v - 1), 0, None)
    height = 0.545 + 0.07 * room.noise(70, 60, 9) * (over == 0) - over * 1.9
    side = np.clip(v, 0, 1) + np.sign(v - 0.5) * np.minimum(over, 0.03) + 0.012 * (room.noise(70, 60, 12) - 0.5)
    room.grid("cover", np.stack([left - 0.04 + u * 1.5, height, near + side * (far - near)], -1), "cover")


def _lamps(room: RoomWriter) -> None:
    scene = room.scene
    for index, z in enumerate((_BED[2] - 0.35, _BED[3] + 0.45)):
        x = LENGTH - 0.35
        scene.box((x - 0.22, 0, z - 0.22), (x + 0.22, 0.5, z + 0.22), "oak")
        scene.sphere((x - 0.23, 0.35, z), 0.015, "brass")
        foot = (x, 0.5, z)
        profile = [(0.0, 0), (0.07, 0.0), (0.09, 0.06), (0.1, 0.12), (0.06, 0.2), (0.02, 0.26), (0.015, 0.34)]
        room.lathe(f"lamp{index}", profile, foot, "porcelain")
        room.lathe(f"shade{index}", [(0.17, 0.32), (0.1, 0.56)], foot, "shade")
        scene.sphere((x, 0.93, z), 0.035, "bulb", _BULB)
    scene.cylinder((2.2, HEIGHT - 0.5, 2.4), (2.2, HEIGHT, 2.4), 0.01, "brass")
    scene.sphere((2.2, HEIGHT - 0.6, 2.4), 0.12, "bulb", _CEILING)


def _furniture(room: RoomWriter) -> None:
    scene, rng = room.scene, room.rng
    scene.box((0.02, 0, 2.0), (0.5, 0.9, 3.4), "oak")
    for row in range(3):
        for z in (2.03, 2.73):
            scene.box((0.5, 0.05 + row * 0.28, z), (0.515, 0.3 + row * 0.28, z + 0.64), "white")
            scene.sphere((0.53, 0.18 + row * 0.28, z + 0.32), 0.018, "brass")
    room.lathe("bowl", [(0.0, 0), (0.05, 0.005), (0.12, 0.05), (0.16, 0.1)], (0.27, 0.9, 2.4), "porcelain")
    for angle in (0, 2.1, 4.2):
        scene.sphere((0.27 + 0.055 * np.cos(angle), 0.97, 2.4 + 0.055 * np.sin(angle)), 0.042, "apple")
    profile = [(0.0, 0), (0.06, 0), (0.1, 0.1), (0.09, 0.2), (0.04, 0.28), (0.055, 0.33)]
    room.lathe("vase", profile, (0.27, 0.9, 3.0), "vase")
    for _ in range(9):
        top = np.array((0.27, 1.6, 3.0)) + rng.normal(size=3) * (0.12, 0.1, 0.18)
        scene.cylinder((0.27, 1.2, 3.0), top, 0.006, "twig")
    scene.cylinder((0.03, 1.65, 2.7), (0.05, 1.65, 2.7), 0.36, "brass")
    scene.shapes.append(
        '<shape type="disk"><transform name="to_world"><scale value="0.32"/><rotate y="1" angle="90"/>'
        '<translate x="0.055" y="1.65" z="2.7"/></transform><ref id="mirror"/></shape>'
    )
    scene.rectangle((1.9, 0.004, 1.6), (1.0, 0, 0), (0, 0, -0.8), "rug")
    for index, x in enumerate((1.4, 2.6)):
        scene.box((x - 0.27, 1.2, DEPTH - 0.03), (x + 0.27, 1.9, DEPTH), "oak")
        scene.rectangle((x, 1.55, DEPTH - 0.032), (-0.24, 0, 0), (0, 0.32, 0), f"picture{index}")
    for x in np.arange(1.0, 1.95, 0.07):
        scene.box((x, 0.15, 0.03), (x + 0.045, 0.7, 0.1), "white")
    scene.cylinder((1.0, 0.12, 0.07), (1.95, 0.12, 0.07), 0.015, "steel")


def write_bedroom(folder: Path, seed: int) -> Path:
    """Write scene.xml, its textures and meshes; return the file."""
    room = RoomWriter(folder, seed)
    for part in (_textures, _materials, _shell, _bed, _lamps, _furniture):
        part(room)
    x, y, z = room.rng.uniform(-0.6, 0.6), room.rng.uniform(0.5, 0.9), -1.0
    sky = (
        f'<emitter type="sunsky"><vector name="sun_direction" x="{x:.3f}" y="{y:.3f}" z="{z:.3f}"/>'
        '<transform name="to_world"><rotate x="1" angle="-90"/></transform></emitter>'
    )
    room.scene.shapes.append(sky)
    return room.write()


if __name__ == "__main__":
    run(write_bedroom, "A bedroom with sun and sky as a Mitsuba scene file, by a seed.")
