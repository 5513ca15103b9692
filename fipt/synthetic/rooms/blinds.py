"""A dining room lit through blinds: slats of 4 cm, 3.8 cm apart, hide most of the one large window."""

from collections.abc import Iterator

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import BLACK, BRASS, OUTLINES, WHITE_PAINT, RoomPart, cushion, lathed, palette
from fipt.synthetic.rooms.design import RoomDesign
from fipt.synthetic.rooms.pieces import (
    BOOK_COLORS,
    GAP,
    books,
    chair,
    cupboard,
    foliage,
    framed,
    handles,
    placed,
    skirting,
    table,
)
from fipt.synthetic.rooms.shell import Hole, sides
from fipt.synthetic.shapes import ball, box, joined, rod

SIZE = (6.4, 2.9, 5.0)
"""Interior along x, y, z, metres."""

_WINDOW = Hole(0.4, 6.0, 0.25, 2.65, 0.22)
"""In the wall z = 0: 13 m2."""
_SLAT = 0.040
"""Width of a slat, metres."""
_PITCH = 0.038
_TILT = 38.0
"""Degrees from level; the inner edge is lower."""
_BLINDS = 4
"""Blinds side by side."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, the pane first; ``rng`` draws the grain of woods, books and leaves."""
    return [
        RoomPart("window pane", "window", sides(SIZE)["north"].pane(_WINDOW), BLACK, radiance=(9.4, 10.0, 10.8)),
        *_shell(rng),
        *_blinds(),
        *_dining(rng),
        *_bench(rng),
        *_sideboard(rng),
        *_wall_art(rng),
    ]


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    room = sides(SIZE)
    width, _, depth = SIZE
    yield RoomPart("north wall", "wall", room["north"].surface((_WINDOW,)), (0.68, 0.66, 0.62))
    yield RoomPart("west wall", "wall", room["west"].surface(), (0.60, 0.46, 0.34))
    yield RoomPart("east wall", "wall", room["east"].surface(), (0.68, 0.66, 0.62))
    yield RoomPart("south wall", "wall", room["south"].surface(), (0.36, 0.44, 0.38))
    yield RoomPart("floor", "floor", room["floor"].surface(), textures.planks(rng, (depth, width)), 0.35)
    yield RoomPart("ceiling", "ceiling", room["ceiling"].surface(), (0.74, 0.74, 0.72))
    yield RoomPart("skirting", "wall", skirting(SIZE), WHITE_PAINT, 0.6)


def _blinds() -> Iterator[RoomPart]:
    # In the recess, a centimetre and more from its sides and from the bars behind.
    left, right = _WINDOW.left + 0.012, _WINDOW.right - 0.012
    width = (right - left) / _BLINDS
    top, low, z = _WINDOW.high - 0.062, _WINDOW.low + 0.03, -0.075
    slats, strings, rails = [], [], []
    for k in range(_BLINDS):
        middle, length = left + (k + 0.5) * width, width - 0.016
        heights = np.arange(low + 0.045, top - 0.02, _PITCH)
        for y in heights:
            slat = box((length, 0.0012, _SLAT)).moved(0, -0.0006, 0).turned(_TILT, "x")
            slats.append(slat.moved(middle, y, z))
        for dx in (-0.38, 0.38):
            strings.append(
                rod((middle + dx * length, low, z + 0.024), (middle + dx * length, top, z + 0.024), 0.0015, 6)
            )
        rails.append(box((length, 0.035, 0.045), 0.004).moved(middle, top + 0.002, z))
        rails.append(box((length, 0.018, 0.045), 0.004).moved(middle, low - 0.02, z))
    bars = [
        box((0.06, _WINDOW.high - _WINDOW.low - 2 * GAP, 0.05)).moved(x, _WINDOW.low + GAP, -0.16)
        for x in (_WINDOW.left + 0.031, *(_WINDOW.left + 5.6 * k / 4 for k in (1, 2, 3)), _WINDOW.right - 0.031)
    ]
    yield RoomPart("slats", "blinds", joined(slats), (0.66, 0.64, 0.60), 0.45)
    yield RoomPart("strings", "blinds", joined(strings), (0.60, 0.58, 0.54), 0.9)
    yield RoomPart("rails", "blinds", joined(rails), (0.68, 0.67, 0.64), 0.4)
    yield RoomPart("window frame", "window", joined(bars), (0.10, 0.095, 0.09), 0.4)


def _dining(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = 2.6, 2.35
    rug = box((3.0, 0.010, 2.1), 0.004).moved(x, GAP, z).projected(0, 2)
    top, legs = table((1.9, 0.75, 0.95), 0.035, 0.06)
    ash = textures.wood(rng, 110, 220, (0.56, 0.40, 0.24), (0.42, 0.27, 0.14))
    shapes = [
        [placed(shape, turn, (x + dx, 0.012, z + dz)) for shape in chair()]
        for dx, dz, turn in (
            (-0.5, -0.66, 3), (0.45, -0.72, -12), (-0.48, 0.70, 176), (0.5, 0.66, 188),
            (1.25, 0.03, 262), (-1.3, 0.02, 95),
        )
    ]  # fmt: skip
    yield RoomPart("rug", "rug", rug, textures.rug())
    yield RoomPart("dining table", "table", top.moved(x, 0.012, z), ash, 0.3)
    yield RoomPart("dining table legs", "table", legs.moved(x, 0.012, z), (0.20, 0.12, 0.065), 0.45)
    yield RoomPart("chairs", "chair", joined([shape[0] for shape in shapes]), (0.09, 0.20, 0.19), 0.4)
    yield RoomPart("chair legs", "chair", joined([shape[1] for shape in shapes]), **BRASS, roughness=0.3)
    level = 0.763
    bowl = lathed(OUTLINES["bowl"]).moved(x + 0.3, level, z + 0.05)
    vase = lathed(OUTLINES["ceramic vase"], 36).moved(x - 0.35, level, z - 0.05)
    fruit = [
        ball(0.036, 16).moved(x + 0.3 + dx, level + dy, z + 0.05 + dz).tinted(k % 2, 2)
        for k, (dx, dy, dz) in enumerate(((0.03, 0.056, 0.02), (-0.045, 0.060, 0.012), (0.005, 0.058, -0.055)))
    ]
    yield RoomPart("bowl", "vase", bowl, (0.62, 0.60, 0.56), 0.25)
    yield RoomPart("fruit", "vase", joined(fruit), palette((0.52, 0.07, 0.03), (0.60, 0.34, 0.04)), 0.35)
    yield RoomPart("vase", "vase", vase, (0.06, 0.14, 0.30), 0.15)


def _bench(rng: np.random.Generator) -> Iterator[RoomPart]:
    seat = [
        cushion(1.7, 0.20, 0.78, 0.05).moved(0, 0.16, 0.42),
        cushion(1.7, 0.48, 0.20, 0.07).moved(0, 0.30, 0.13),
        *(cushion(0.18, 0.34, 0.76, 0.06).moved(x, 0.17, 0.43) for x in (-0.80, 0.80)),
        *(cushion(0.70, 0.14, 0.62, 0.05).moved(x, 0.34, 0.48) for x in (-0.36, 0.36)),
    ]
    feet = [rod((x, GAP, z), (x, 0.159, z), 0.02, 8) for x in (-0.7, 0.7) for z in (0.12, 0.72)]
    pillow = cushion(0.40, 0.38, 0.13, 0.06).turned(-18, "x").moved(-0.42, 0.49, 0.36)
    place = (5.0, 0, SIZE[2] - 0.02)
    grey = textures.weave(rng, (0.42, 0.40, 0.37), 160, 300)
    yield RoomPart("sofa", "sofa", placed(joined(seat).projected(0, 1), 180, place), grey)
    yield RoomPart("sofa feet", "sofa", placed(joined(feet), 180, place), (0.20, 0.12, 0.065), 0.5)
    yield RoomPart("pillow", "sofa", placed(pillow, 180, place), (0.50, 0.26, 0.05))


def _sideboard(rng: np.random.Generator) -> Iterator[RoomPart]:
    size, place = (1.8, 0.82, 0.42), (0.25, 0.0, 2.5)
    yield RoomPart("sideboard", "cupboard", placed(cupboard(size, (3, 1)), 90, place), (0.60, 0.59, 0.55), 0.25)
    grips = placed(handles(size, (3, 1), 0.2), 90, place)
    yield RoomPart("sideboard handles", "cupboard", grips, **BRASS, roughness=0.25)
    row = books(rng, 0.0, 0.42, (0.26, 0.19))
    yield RoomPart("books", "book", placed(row, 90, (0.10, 0.822, 3.25)), palette(*BOOK_COLORS), 0.8)
    jug = lathed(OUTLINES["copper vase"], 36).moved(0.26, 0.822, 2.0)
    yield RoomPart("jug", "vase", jug, (0.86, 0.47, 0.31), 0.3, 1.0)


def _wall_art(rng: np.random.Generator) -> Iterator[RoomPart]:
    hills, hills_frame = framed(1.2, 0.8, 90, (0.002, 1.70, 2.3))
    arches, arches_frame = framed(0.6, 0.8, 180, (1.3, 1.60, SIZE[2] - 0.002))
    yield RoomPart("landscape", "picture", hills, textures.landscape(), 0.8)
    yield RoomPart("print", "picture", arches, textures.shapes_print(), 0.8)
    yield RoomPart("picture frames", "picture", joined([hills_frame, arches_frame]), (0.10, 0.055, 0.025), 0.4)
    leaves = foliage(rng, 18, (0.40, 0.58), 0.14, (0.5, 1.1), 0.5, (-0.4, -0.45), (0.4, 0.45)).moved(5.9, 0.29, 1.0)
    yield RoomPart(
        "plant pot", "plant", lathed(OUTLINES["plant pot"], 32).moved(5.9, GAP, 1.0), (0.50, 0.22, 0.12), 0.6
    )
    yield RoomPart("plant", "plant", leaves, (0.06, 0.18, 0.05), 0.5)


DESIGN = RoomDesign(SIZE, 0.61, furnish)
