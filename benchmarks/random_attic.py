"""A third furnished room as a Mitsuba scene file: slopes, few right angles, lamps of many sizes and colours.

    python -m benchmarks.random_attic attic --seed 1

FOLDER/scene.xml is an attic of 7 m x 5 m below a roof of 40 degrees: walls of bricks and of a deep colour, windows in
the roof and in the gable, a hallway behind an open door with a lamp of its own, a warm lamp beside the bed, a desk lamp
in a metal shade, fairy lights along a beam, a round mirror, a radiator of thin fins, a staircase rail, a blanket of
many colours, a bath of enamel. The seed draws colours, textures and what lies on the desk.
"""

from pathlib import Path

import numpy as np

from benchmarks.random_room import SceneWriter, run, write_texture
from fipt.formats.files import make_folder, write_text

LENGTH, DEPTH = 7.0, 5.0
"""Along x and z, metres."""
KNEE, RIDGE = 1.1, 3.2
"""Height of the roof at z = 0 and z = DEPTH, and in the middle, metres."""

_SKY, _GABLE, _HALL = (11, 13, 16), (8, 8.5, 9), (14, 12, 9)
_BEDSIDE, _DESK, _FAIRY = (9, 6, 3), (70, 62, 50), (45, 30, 12)
"""Radiance."""


def _textures(folder: Path, rng: np.random.Generator) -> None:
    """Write bricks, planks and a blanket of patches (BGR, as OpenCV writes)."""
    bricks = np.full((256, 256, 3), 0.5)
    for row in range(8):
        for column in range(-1, 4):
            left, top = column * 64 + (row % 2) * 32, row * 32
            color = np.array((0.12, 0.17, 0.42)) * rng.uniform(0.6, 1.3)
            bricks[top + 2 : top + 30, max(left + 2, 0) : max(left + 62, 0)] = color
    planks, across = np.zeros((256, 256, 3)), np.arange(256)
    for plank in range(5):
        grain = 1 + 0.15 * np.sin(across / rng.uniform(4, 12) + np.cumsum(rng.normal(size=256)) / 8)
        color = np.array((0.2, 0.34, 0.46)) * rng.uniform(0.7, 1.2)
        planks[plank * 51 : plank * 51 + 50] = color * grain[None, :, None]
    blanket = np.kron(rng.uniform(0.05, 0.8, (6, 8, 3)), np.ones((32, 32, 1)))
    for name, linear in (("bricks", bricks), ("planks", planks), ("blanket", blanket)):
        write_texture(folder / f"{name}.png", linear)


def _materials(scene: SceneWriter, rng: np.random.Generator) -> None:
    scene.textured("bricks", "bricks.png", 4, 2)
    scene.textured("planks", "planks.png", 3, 2, 0.2)
    scene.textured("blanket", "blanket.png", 1, 1)
    for name, color in {
        "plaster": (0.86, 0.85, 0.82),
        "blue": (0.06, 0.12, 0.28) * rng.uniform(0.7, 1.4, 3),
        "hall": (0.7, 0.62, 0.3),
        "white": (0.82, 0.82, 0.82),
        "black": (0.03, 0.03, 0.03),
        "linen": (0.75, 0.72, 0.66),
        "pillow": rng.uniform(0.2, 0.7, 3),
        "rug": rng.uniform(0.1, 0.5, 3),
    }.items():
        scene.diffuse(name, color)
    scene.plastic("oak", (0.33, 0.2, 0.1), 0.25)
    scene.plastic("lacquer", rng.uniform(0.1, 0.6, 3), 0.08)
    scene.plastic("enamel", (0.83, 0.83, 0.81), 0.06)
    scene.plastic("leather", (0.05, 0.03, 0.02), 0.15)
    scene.metal("brass", "Au", 0.25)
    scene.metal("steel", "Cr", 0.3)
    scene.metal("aluminium", "Al", 0.12)
    scene.metal("mirror", "Ag", 0.02)


def _slope(scene: SceneWriter, near: bool, material: str, span: tuple[float, float, float, float],
           radiance: tuple[float, ...] | None = None, out: float = 0.0) -> None:  # fmt: skip
    """Add a rectangle in a slope of the roof.

    Parameters
    ----------
    near
        The slope above z = 0, else that above z = DEPTH.
    span
        From and to along x, metres, and from and to up the slope, as shares of its length.
    out
        How far it lies below the slope, metres.
    """
    foot = np.array((0, KNEE, 0 if near else DEPTH))
    up = np.array((0, RIDGE - KNEE, DEPTH / 2 if near else -DEPTH / 2))
    along = np.array((1.0 if near else -1.0, 0, 0))
    first, last, low, high = span
    middle = foot + up * (low + high) / 2 + np.array(((first + last) / 2, 0, 0))
    inwards = np.cross(along, up)
    inwards *= -np.sign(inwards[1]) / np.linalg.norm(inwards)
    if np.cross(along, up) @ inwards < 0:
        along = -along
    scene.rectangle(middle + out * inwards, along * (last - first) / 2, up * (high - low) / 2, material, radiance)


def _shell(scene: SceneWriter) -> None:
    """Floor, low walls, slopes, gables (boxes cut by nothing: the roof hides what stands out), beams, a rug."""
    x, z = LENGTH / 2, DEPTH / 2
    scene.rectangle((x, 0, z), (x, 0, 0), (0, 0, -z), "planks")
    scene.rectangle((x, KNEE / 2, 0), (x, 0, 0), (0, KNEE / 2, 0), "blue")
    scene.rectangle((x, KNEE / 2, DEPTH), (-x, 0, 0), (0, KNEE / 2, 0), "plaster")
    for near in (True, False):
        _slope(scene, near, "plaster", (0, LENGTH, 0, 1))
    scene.rectangle((0, RIDGE / 2, z), (0, 0, -z), (0, RIDGE / 2, 0), "bricks")
    _wall_with_door(scene)
    for at in (1.75, 3.5, 5.25):
        scene.box((at - 0.06, 2.45, 0.9), (at + 0.06, 2.6, DEPTH - 0.9), "oak")
        scene.box((at - 0.06, 2.5, z - 0.06), (at + 0.06, RIDGE, z + 0.06), "oak")
    scene.rectangle((3.2, 0.008, 2.9), (1.0, 0, 0), (0, 0, -0.7), "rug")


def _wall_with_door(scene: SceneWriter) -> None:
    """The gable at x = LENGTH around an open door, and the hallway behind it."""
    low, high, top = 2.0, 2.9, 2.05
    for first, last, bottom, end in ((0, low, 0, RIDGE), (high, DEPTH, 0, RIDGE), (low, high, top, RIDGE)):
        middle = (LENGTH, (bottom + end) / 2, (first + last) / 2)
        scene.rectangle(middle, (0, 0, (last - first) / 2), (0, (end - bottom) / 2, 0), "plaster")
    away, middle = LENGTH + 1.4, (low + high) / 2
    scene.rectangle((LENGTH + 0.7, 0, middle), (0.7, 0, 0), (0, 0, -1.2), "planks")
    scene.rectangle((LENGTH + 0.7, 2.4, middle), (0.7, 0, 0), (0, 0, 1.2), "plaster")
    scene.rectangle((away, 1.2, middle), (0, 0, 1.2), (0, 1.2, 0), "hall")
    for side in (-1, 1):
        scene.rectangle((LENGTH + 0.7, 1.2, middle + side * 1.2), (-side * 0.7, 0, 0), (0, 1.2, 0), "hall")
    scene.rectangle((LENGTH + 0.7, 2.39, middle + 0.6), (0.18, 0, 0), (0, 0, 0.18), "black", _HALL)
    for at in (low - 0.03, high + 0.03):
        scene.box((LENGTH - 0.03, 0, at - 0.04), (LENGTH + 0.03, top + 0.04, at + 0.04), "white")
    scene.box((LENGTH - 0.03, top, low), (LENGTH + 0.03, top + 0.07, high), "white")


def _lights(scene: SceneWriter) -> None:
    """Windows in the roof and the gable, a lamp beside the bed, one on the desk, fairy lights."""
    for first in (1.0, 4.2):
        _slope(scene, False, "black", (first, first + 0.8, 0.3, 0.65), _SKY, 0.005)
        for left, right, low, high in (
            (first - 0.06, first, 0.28, 0.67),
            (first + 0.8, first + 0.86, 0.28, 0.67),
            (first, first + 0.8, 0.28, 0.3),
            (first, first + 0.8, 0.65, 0.67),
        ):
            _slope(scene, False, "oak", (left, right, low, high), out=0.03)
    scene.rectangle((0.01, 1.75, 2.5), (0, 0, -0.45), (0, 0.45, 0), "black", _GABLE)
    for at in (2.03, 2.5, 2.97):
        scene.box((0, 1.27, at - 0.025), (0.06, 2.23, at + 0.025), "white")
    for at in (1.28, 1.75, 2.22):
        scene.box((0, at - 0.025, 2.03), (0.06, at + 0.025, 2.97), "white")
    scene.cylinder((0.45, 0.75, 0.4), (0.45, 0.95, 0.4), 0.11, "linen", _BEDSIDE)
    scene.cylinder((0.45, 0.55, 0.4), (0.45, 0.75, 0.4), 0.012, "brass")
    scene.cylinder((5.6, 1.18, 0.45), (5.6, 1.32, 0.45), 0.09, "steel")
    scene.cylinder((5.6, 1.32, 0.45), (5.6, 1.35, 0.45), 0.02, "steel")
    scene.cylinder((5.75, 0.76, 0.2), (5.6, 1.35, 0.45), 0.01, "steel")
    scene.sphere((5.6, 1.22, 0.45), 0.035, "white", _DESK)
    for k in range(14):
        scene.sphere((3.5, 2.42 - 0.05 * (k % 2), 1.0 + 0.22 * k), 0.02, "white", _FAIRY)


def _furniture(scene: SceneWriter, rng: np.random.Generator) -> None:
    """A bed, a chest, a desk with what lies on it, a chair, a bath, a mirror, a radiator, a rail."""
    scene.box((0.9, 0.1, 0.05), (2.5, 0.4, 2.1), "oak")
    scene.box((0.95, 0.4, 0.1), (2.45, 0.56, 2.05), "linen")
    scene.rectangle((1.7, 0.57, 1.35), (0.78, 0, 0), (0, 0, -0.72), "blanket")
    for at in (1.35, 2.05):
        scene.sphere((at, 0.58, 0.4), 0.16, "pillow")
    scene.box((0.15, 0, 0.15), (0.75, 0.55, 0.65), "lacquer")
    scene.box((4.6, 0.72, 0.05), (6.4, 0.76, 0.8), "oak")
    for at in (4.65, 6.35):
        for deep in (0.1, 0.75):
            scene.cylinder((at, 0, deep), (at, 0.72, deep), 0.02, "steel")
    for k in range(9):
        scene.diffuse(f"thing{k}", rng.uniform(0.05, 0.8, 3))
        at, size = 4.75 + 0.08 * k, rng.uniform(0.03, 0.12, 3)
        scene.box((at, 0.76, 0.1), (at + 0.07, 0.76 + size[1] * 2, 0.1 + size[2]), f"thing{k}")
    scene.box((6.0, 0.76, 0.3), (6.3, 0.78, 0.6), "aluminium")
    scene.box((5.2, 0.44, 0.9), (5.7, 0.52, 1.4), "leather")
    scene.box((5.2, 0.52, 1.35), (5.7, 1.0, 1.42), "leather")
    scene.cylinder((5.45, 0.05, 1.15), (5.45, 0.44, 1.15), 0.03, "steel")
    scene.cylinder((5.45, 0, 1.15), (5.45, 0.05, 1.15), 0.25, "steel")
    for low, high in (
        ((4.3, 0.1, 4.0), (6.1, 0.16, 4.85)),
        ((4.3, 0.1, 4.0), (6.1, 0.62, 4.06)),
        ((4.3, 0.1, 4.79), (6.1, 0.62, 4.85)),
        ((4.3, 0.1, 4.0), (4.36, 0.62, 4.85)),
        ((6.04, 0.1, 4.0), (6.1, 0.62, 4.85)),
    ):
        scene.box(low, high, "enamel")
    scene.cylinder((6.3, 0, 4.4), (6.3, 0.9, 4.4), 0.02, "aluminium")
    scene.cylinder((6.3, 0.9, 4.4), (5.95, 0.9, 4.4), 0.015, "aluminium")
    scene.shapes.append(
        '<shape type="disk"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="-90"/>'
        f'<translate x="{LENGTH - 0.03}" y="1.5" z="1.2"/></transform><ref id="mirror"/></shape>'
    )
    for angle in 2 * np.pi * np.arange(24) / 24:
        ends = [(LENGTH - 0.03, 1.5 + 0.41 * np.sin(a), 1.2 + 0.41 * np.cos(a)) for a in (angle, angle + np.pi / 12)]
        scene.cylinder(*ends, 0.015, "brass")
    for k in range(16):
        scene.box((2.9 + 0.05 * k, 0.12, DEPTH - 0.14), (2.92 + 0.05 * k, 0.72, DEPTH - 0.03), "white")
    scene.box((2.0, 0, 4.2), (2.06, 0.9, 4.26), "oak")
    scene.box((0.4, 0.88, 4.2), (2.06, 0.93, 4.26), "oak")
    for k in range(11):
        scene.cylinder((0.45 + 0.14 * k, 0, 4.23), (0.45 + 0.14 * k, 0.88, 4.23), 0.01, "black")


def write_attic(folder: Path, seed: int) -> Path:
    """Write scene.xml and its textures; return the file."""
    rng, scene = np.random.default_rng(seed), SceneWriter()
    make_folder(folder)
    _textures(folder, rng)
    _materials(scene, rng)
    _shell(scene)
    _lights(scene)
    _furniture(scene, rng)
    write_text(folder / "scene.xml", scene.xml())
    return folder / "scene.xml"


if __name__ == "__main__":
    run(write_attic, "An attic as a Mitsuba scene file, by a seed.")
