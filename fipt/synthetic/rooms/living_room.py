"""The living room, which the demo shows: its shell, lamps and furniture, piece by piece.

Lengths in metres, y up, the floor at y = 0; x runs along the window wall (z = 0), away from the
sofa's wall (x = 0). Pieces stand a millimetre apart, so that no two surfaces coincide.
"""

from collections.abc import Iterator

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import (
    BLACK,
    BRASS,
    COPPER,
    OUTLINES,
    SEMANTICS,
    SILVER,
    STEEL,
    WHITE_PAINT,
    RoomPart,
    cushion,
    lathed,
    palette,
    upright_rods,
)
from fipt.synthetic.rooms.design import RoomDesign
from fipt.synthetic.rooms.pieces import BOOK_COLORS, foliage, framed
from fipt.synthetic.shapes import (
    Shape,
    ball,
    box,
    curtain,
    disc,
    joined,
    panel,
    ring,
    rod,
)

SIZE = (5.0, 2.7, 4.0)
"""Interior along x, y, z, metres; one lower corner is the origin."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, lamps first; ``rng`` draws the grain of woods, the books and the leaves."""
    return [
        *_emitters(),
        *_shell(rng),
        *_window(rng),
        *_sofa(rng),
        *_chairs(rng),
        *_coffee_table(rng),
        *_desk(rng),
        *_sideboard(),
        *_bookcase(rng),
        *_wall_art(),
        *_plant(rng),
        *_door(),
    ]


# --- shell and lamps --------------------------------------------------------------------------

_CELL = 0.25
"""Side of the cells that walls are split into: visibility is counted by triangle."""
_HOLE = (0.85, 2.95, 0.90, 2.25)
"""The window's opening in the wall z = 0: x from, x to, y from, y to."""
_RECESS = 0.18
"""Its depth; the pane closes the far end."""
_CEILING_EMITTER = (2.5, 2.595, 2.05)
_GLOBE = (4.70, 1.13, 1.45)


def _emitters() -> Iterator[RoomPart]:
    x0, x1, y0, y1 = _HOLE
    pane = panel((x0, y0, -_RECESS), (x1 - x0, 0, 0), (0, y1 - y0, 0), cell=0.7)
    light = disc(0.33).moved(*_CEILING_EMITTER).moved(0, 0.02, 0)
    globe = ball(0.12).moved(*_GLOBE)
    yield RoomPart("window pane", "window", pane, BLACK, radiance=(3.2, 3.9, 5.0))
    yield RoomPart("ceiling lamp", "lamp", light, BLACK, radiance=(9.0, 7.6, 5.7))
    yield RoomPart("table lamp globe", "lamp", globe, BLACK, radiance=(12.0, 7.8, 4.0))


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    width, height, depth = SIZE
    x0, x1, y0, y1 = _HOLE
    inward = (0, 0, _RECESS)
    across, up = (x1 - x0, 0, 0), (0, y1 - y0, 0)

    def around(left: float, right: float, low: float, high: float) -> Shape:
        return panel((left, low, 0), (right - left, 0, 0), (0, high - low, 0), _CELL)

    north = [
        around(0, x0, 0, height),
        around(x1, width, 0, height),
        around(x0, x1, 0, y0),
        around(x0, x1, y1, height),
        panel((x0, y0, -_RECESS), up, inward, _CELL),
        panel((x1, y0, -_RECESS), inward, up, _CELL),
        panel((x0, y0, -_RECESS), inward, across, _CELL),
        panel((x0, y1, -_RECESS), across, inward, _CELL),
    ]
    west = panel((0, 0, 0), (0, height, 0), (0, 0, depth), _CELL)
    east = panel((width, 0, 0), (0, 0, depth), (0, height, 0), _CELL)
    south = panel((0, 0, depth), (0, height, 0), (width, 0, 0), _CELL)
    floor = panel((0, 0, 0), (0, 0, depth), (width, 0, 0), _CELL).projected(0, 2)
    ceiling = panel((0, height, 0), (width, 0, 0), (0, 0, depth), _CELL)
    skirting = [
        box((width, 0.08, 0.016)).moved(width / 2, 0.001, 0.009),
        box((3.45, 0.08, 0.016)).moved(1.725, 0.001, depth - 0.009),
        box((0.016, 0.08, depth)).moved(0.009, 0.001, depth / 2),
        box((0.016, 0.08, depth)).moved(width - 0.009, 0.001, depth / 2),
    ]
    housing = lathed(OUTLINES["lamp housing"], 48).moved(*_CEILING_EMITTER)
    yield RoomPart("north wall", "wall", joined(north), (0.72, 0.69, 0.63))
    yield RoomPart("west wall", "wall", west, (0.22, 0.38, 0.34))
    yield RoomPart("east wall", "wall", east, (0.62, 0.33, 0.22))
    yield RoomPart("south wall", "wall", south, (0.70, 0.60, 0.42))
    yield RoomPart("floor", "floor", floor, textures.planks(rng, (width, depth)), 0.3)
    yield RoomPart("ceiling", "ceiling", ceiling, (0.76, 0.76, 0.74))
    yield RoomPart("skirting", "wall", joined(skirting), WHITE_PAINT, 0.6)
    yield RoomPart("ceiling lamp housing", "lamp", housing, (0.70, 0.70, 0.68), 0.4)


def _window(rng: np.random.Generator) -> Iterator[RoomPart]:
    x0, x1, y0, y1 = _HOLE
    width, height, middle = x1 - x0, y1 - y0, (x0 + x1) / 2
    bars = [
        box((width, 0.07, 0.06)).moved(middle, y0, -0.14),
        box((width, 0.07, 0.06)).moved(middle, y1 - 0.07, -0.14),
        box((width, 0.04, 0.05)).moved(middle, y0 + 0.68 * height, -0.14),
        box((0.07, height, 0.06)).moved(x0 + 0.035, y0, -0.14),
        box((0.07, height, 0.06)).moved(x1 - 0.035, y0, -0.14),
        box((0.06, height, 0.06)).moved(middle, y0, -0.14),
    ]
    sill = box((width + 0.12, 0.03, 0.30), 0.008).moved(middle, y0 - 0.028, 0.03)
    cloths = [curtain(0.62, 2.28, 0.045, 5, taper=0.16).moved(x, 2.46, 0.16) for x in (x0 - 0.20, x1 + 0.20)]
    pole = [
        rod((0.22, 2.48, 0.16), (3.58, 2.48, 0.16), 0.014),
        *(ball(0.03, 12).moved(x, 2.48, 0.16) for x in (0.22, 3.58)),
        *(rod((x, 2.48, 0.0), (x, 2.48, 0.16), 0.008, 6) for x in (0.45, 1.9, 3.35)),
    ]
    cotton = textures.weave(rng, (0.62, 0.50, 0.36))
    yield RoomPart("window frame", "window", joined(bars), (0.72, 0.71, 0.68), 0.5)
    yield RoomPart("window sill", "window", sill, (0.70, 0.67, 0.62), 0.35)
    yield RoomPart("curtains", "curtain", joined(cloths), cotton)
    yield RoomPart("curtain pole", "curtain", joined(pole), (0.62, 0.45, 0.22), 0.3, 1.0)


def _door() -> Iterator[RoomPart]:
    x = 4.22
    leaves = [
        box((0.92, 2.08, 0.04), 0.006).moved(x, 0.001, 3.978),
        box((0.62, 0.72, 0.02), 0.008).moved(x, 0.18, 3.952),
        box((0.62, 0.86, 0.02), 0.008).moved(x, 1.06, 3.952),
    ]
    jamb = [
        *(box((0.07, 2.16, 0.05), 0.006).moved(x + dx, 0.001, 3.972) for dx in (-0.495, 0.495)),
        box((0.92, 0.07, 0.05), 0.006).moved(x, 2.09, 3.972),
    ]
    handle = [
        rod((3.84, 1.02, 3.955), (3.84, 1.02, 3.905), 0.010, 10),
        rod((3.832, 1.02, 3.905), (3.96, 1.02, 3.905), 0.010, 10),
        rod((3.84, 0.98, 3.956), (3.84, 1.06, 3.956), 0.018, 10),
    ]
    yield RoomPart("door", "door", joined(leaves), (0.60, 0.62, 0.60), 0.5)
    yield RoomPart("door frame", "door", joined(jamb), WHITE_PAINT, 0.5)
    yield RoomPart("door handle", "door", joined(handle), **STEEL, roughness=0.25)


# --- seats ------------------------------------------------------------------------------------


def _sofa(rng: np.random.Generator) -> Iterator[RoomPart]:
    # Two metres wide, its back to the west wall.
    seats = (1.635, 2.465)
    sofa = [
        cushion(0.92, 0.24, 2.00, 0.05).moved(0.52, 0.12, 2.05),
        cushion(0.24, 0.66, 2.00, 0.09).moved(0.18, 0.16, 2.05),
        *(cushion(0.90, 0.42, 0.20, 0.08).moved(0.54, 0.16, z) for z in (1.12, 2.98)),
        *(cushion(0.66, 0.17, 0.82, 0.06).moved(0.62, 0.345, z) for z in seats),
        *(cushion(0.18, 0.44, 0.80, 0.08).turned(12, "z").moved(0.37, 0.47, z) for z in seats),
    ]
    light = cushion(0.14, 0.40, 0.40, 0.065).turned(24, "z").turned(-12).moved(0.58, 0.50, 1.45)
    red = cushion(0.14, 0.36, 0.36, 0.060).turned(26, "z").turned(16).moved(0.58, 0.50, 2.68)
    pillows = joined([light.tinted(0, 2), red.tinted(1, 2)])
    feet = joined(upright_rods((0.14, 0.86), (1.2, 2.9), 0.13, 0.02))
    mustard = textures.weave(rng, (0.55, 0.35, 0.08), 160, 300)
    yield RoomPart("sofa", "sofa", joined(sofa).projected(2, 1), mustard)
    yield RoomPart("sofa feet", "sofa", feet, (0.08, 0.05, 0.03), 0.5)
    yield RoomPart("pillows", "sofa", pillows, palette((0.60, 0.55, 0.47), (0.40, 0.10, 0.07)))


def _chairs(rng: np.random.Generator) -> Iterator[RoomPart]:
    def placed(shapes: list[Shape]) -> Shape:
        """Stand the armchair in its corner, turned to the coffee table."""
        return joined(shapes).turned(218).moved(3.42, 0, 3.30)

    armchair = [
        cushion(0.66, 0.22, 0.62, 0.06).moved(0, 0.18, 0),
        cushion(0.66, 0.62, 0.16, 0.07).turned(10, "x").moved(0, 0.22, -0.33),
        *(cushion(0.14, 0.36, 0.70, 0.06).moved(x, 0.20, 0) for x in (-0.36, 0.36)),
        cushion(0.56, 0.13, 0.54, 0.05).moved(0, 0.375, 0.03),
    ]
    feet = [rod((x, 0.008, z), (0.72 * x, 0.2, 0.72 * z), 0.016, 8) for x in (-0.31, 0.31) for z in (-0.27, 0.27)]
    chair = [
        box((0.42, 0.035, 0.42), 0.015).moved(0, 0.45, 0),
        box((0.40, 0.20, 0.025), 0.01).turned(8, "x").moved(0, 0.68, -0.205),
        *upright_rods((-0.18, 0.18), (0.18,), 0.45, 0.016),
        *(rod((x, 0.003, -0.18), (x, 0.86, -0.21), 0.016, 8) for x in (-0.18, 0.18)),
    ]
    walnut = textures.wood(rng, 64, 256, (0.30, 0.16, 0.08), (0.14, 0.065, 0.03))
    at_desk = joined(chair).turned(160).moved(4.12, 0, 0.98).projected(0, 1)
    yield RoomPart("armchair", "chair", placed(armchair), (0.075, 0.13, 0.26), 0.9)
    yield RoomPart("armchair feet", "chair", placed(feet), (0.22, 0.12, 0.05), 0.45)
    yield RoomPart("chair", "chair", at_desk, walnut, 0.45)


# --- tables -----------------------------------------------------------------------------------


def _coffee_table(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z, level = 1.85, 2.05, 0.4385
    top = lathed(OUTLINES["table top"], 56).moved(0, 0.40, 0).projected(0, 2).moved(x, 0, z)
    frame = [ring(0.33, 0.012).moved(0, 0.385, 0), ring(0.24, 0.010).moved(0, 0.12, 0)]
    for degrees in (30, 150, 270):
        leg = rod((0.20, 0.012, 0), (0.34, 0.395, 0), 0.014)
        frame.append(leg.turned(degrees))
    magazines = [
        box((0.26, 0.028, 0.19), 0.004).turned(20).tinted(0, 2),
        box((0.22, 0.024, 0.16), 0.004).turned(38).moved(0, 0.0285, 0).tinted(1, 2),
    ]
    rug = box((2.30, 0.014, 1.65), 0.006).moved(1.98, 0.001, 2.05).projected(0, 2)
    cherry = textures.wood(rng, 128, 128, (0.30, 0.085, 0.035), (0.19, 0.042, 0.018))
    covers = palette((0.07, 0.22, 0.27), (0.66, 0.50, 0.20))
    vase = lathed(OUTLINES["copper vase"], 40).moved(x + 0.14, level, z - 0.14)
    bowl = lathed(OUTLINES["bowl"]).moved(x - 0.20, level, z - 0.10)
    drum = lathed(OUTLINES["drum"], 48).moved(0.42, 0.001, 3.42)
    yield RoomPart("rug", "rug", rug, textures.rug())
    yield RoomPart("coffee table", "table", top, cherry, 0.2)
    legs = joined(frame).moved(x, 0.014, z)
    yield RoomPart("coffee table frame", "table", legs, **BRASS, roughness=0.3)
    yield RoomPart("copper vase", "vase", vase, **COPPER, roughness=0.25)
    yield RoomPart("bowl", "vase", bowl, (0.62, 0.66, 0.62), 0.3)
    pile = joined(magazines).moved(x - 0.08, level, z + 0.22)
    yield RoomPart("magazines", "book", pile, covers, 0.6)
    yield RoomPart("steel drum", "table", drum, **STEEL, roughness=0.3)


def _desk(rng: np.random.Generator) -> Iterator[RoomPart]:
    xs, zs, level = (3.62, 4.82), (0.14, 0.60), 0.7505
    top = box((1.30, 0.035, 0.58), 0.008).moved(4.22, 0.715, 0.37).projected(0, 2)
    frame = [
        *upright_rods(xs, zs, 0.715, 0.018),
        *(rod((x, 0.70, zs[0]), (x, 0.70, zs[1]), 0.014, 8) for x in xs),
        rod((xs[0], 0.25, zs[0]), (xs[1], 0.25, zs[0]), 0.012, 8),
    ]
    books = [
        box((0.24, 0.035, 0.17), 0.004).turned(-10).tinted(0, 3),
        box((0.21, 0.045, 0.16), 0.004).turned(6).moved(0, 0.0355, 0).tinted(1, 3),
        box((0.19, 0.025, 0.13), 0.004).turned(-22).moved(0.01, 0.081, 0).tinted(2, 3),
    ]
    oak = textures.wood(rng, 120, 300, (0.55, 0.37, 0.20), (0.40, 0.24, 0.11))
    covers = palette((0.45, 0.09, 0.06), (0.60, 0.57, 0.50), (0.06, 0.12, 0.24))
    mug = lathed(OUTLINES["mug"], 24).moved(3.86, level, 0.42)
    yield RoomPart("desk", "table", top, oak, 0.5)
    yield RoomPart("desk frame", "table", joined(frame), (0.045, 0.045, 0.05), 0.5)
    yield RoomPart("desk books", "book", joined(books).moved(4.58, level, 0.30), covers, 0.7)
    yield RoomPart("desk mug", "vase", mug, (0.66, 0.30, 0.12), 0.25)


# --- storage ----------------------------------------------------------------------------------


def _sideboard() -> Iterator[RoomPart]:
    # Lacquered, at the east wall, with three doors.
    level = 0.7305
    body = [
        box((0.44, 0.60, 1.84), 0.012).moved(4.755, 0.13, 2.10),
        *(box((0.022, 0.55, 0.59), 0.008).moved(4.528, 0.155, z) for z in (1.485, 2.10, 2.715)),
    ]
    handles = []
    for z in (1.72, 2.335, 2.48):
        handles.append(rod((4.492, 0.32, z), (4.492, 0.54, z), 0.007, 8))
        handles += [rod((4.492, y, z), (4.52, y, z), 0.005, 6) for y in (0.34, 0.52)]
    legs = joined(upright_rods((4.60, 4.90), (1.28, 2.92), 0.13, 0.016))
    stand = lathed(OUTLINES["lamp stand"], 28).moved(_GLOBE[0], level, _GLOBE[2])
    vase = lathed(OUTLINES["ceramic vase"], 36).moved(4.76, level, 2.66)
    lacquer = ball(0.075, 28).moved(4.72, level + 0.075, 2.32)
    yield RoomPart("sideboard", "cupboard", joined(body), (0.028, 0.13, 0.15), 0.18)
    yield RoomPart("sideboard handles", "cupboard", joined(handles), **BRASS, roughness=0.25)
    yield RoomPart("sideboard legs", "cupboard", legs, **BRASS, roughness=0.3)
    yield RoomPart("table lamp stand", "lamp", stand, **BRASS, roughness=0.25)
    yield RoomPart("ceramic vase", "vase", vase, (0.70, 0.68, 0.64), 0.15)
    yield RoomPart("lacquer ball", "vase", lacquer, (0.45, 0.045, 0.03), 0.15)


def _bookcase(rng: np.random.Generator) -> Iterator[RoomPart]:
    # 1.55 m wide, two bays of four shelves, at the south wall.
    left, width, top, front, back = 0.95, 1.55, 1.85, 3.70, 3.985
    middle, z, depth = left + width / 2, (front + back) / 2, back - front
    boards = (0.06, 0.50, 0.94, 1.38, top - 0.03)
    uprights = (left + 0.015, middle, left + width - 0.015)
    case = [
        *(box((width, 0.028, depth), 0.004).moved(middle, y, z) for y in boards),
        *(box((0.03, top, depth), 0.004).moved(x, 0.001, z) for x in uprights),
        box((width, top, 0.012)).moved(middle, 0.001, back),
    ]
    colors = len(BOOK_COLORS)
    books, boxes = [], []
    for shelf, y in enumerate(boards[:-1]):
        for bay, start in enumerate((left + 0.035, middle + 0.02)):
            ground, end = y + 0.0285, start + width / 2 - 0.06
            if (shelf, bay) in ((0, 0), (0, 1), (2, 1)):
                crate = box((0.56, 0.27, 0.22), 0.012).moved((start + end) / 2, ground, z - 0.02)
                boxes.append(crate.tinted(len(boxes) % 2, 2))
                continue
            x = start + (0.26 if (shelf, bay) == (3, 0) else 0.0)  # the silver ball's place
            full = end if rng.random() < 0.4 else end - 0.16
            while x < full:
                w, h, d = rng.uniform((0.022, 0.22, 0.15), (0.052, 0.34, 0.21))
                book = box((w, h, d)).moved(x + w / 2, ground, back - 0.015 - d / 2)
                books.append(book.tinted(int(rng.integers(colors)), colors))
                x += w + 0.002
    crates = palette((0.46, 0.36, 0.24), (0.24, 0.32, 0.32))
    silver = ball(0.10, 32).moved(left + 0.17, 1.5085, z - 0.02)
    pot = lathed(OUTLINES["small pot"], 28).moved(left + 0.35, top - 0.0015, z)
    leaves = foliage(rng, 22, (0.16, 0.30), 0.055, (0.02, 0.16), 0.20, (-0.3, -0.12), (0.3, 0.12))
    trailing = leaves.moved(left + 0.35, 2.00, z - 0.01)
    yield RoomPart("bookcase", "shelf", joined(case), (0.68, 0.66, 0.61), 0.6)
    yield RoomPart("books", "book", joined(books), palette(*BOOK_COLORS), 0.8)
    yield RoomPart("storage boxes", "shelf", joined(boxes), crates, 0.95)
    yield RoomPart("silver ball", "vase", silver, **SILVER, roughness=0.25)
    yield RoomPart("bookcase pot", "vase", pot, (0.62, 0.60, 0.55), 0.4)
    yield RoomPart("trailing leaves", "plant", trailing, (0.09, 0.22, 0.05), 0.6)


# --- pictures and plants ----------------------------------------------------------------------


def _wall_art() -> Iterator[RoomPart]:
    hills, hills_frame = framed(0.96, 0.72, -90, (4.985, 1.72, 2.25))
    arches, arches_frame = framed(0.57, 0.76, 90, (0.015, 1.58, 2.05))
    frames = joined([hills_frame, arches_frame])
    yield RoomPart("landscape", "picture", hills, textures.landscape(), 0.9)
    yield RoomPart("print", "picture", arches, textures.shapes_print(), 0.9)
    yield RoomPart("picture frames", "picture", frames, (0.10, 0.055, 0.025), 0.4)


def _plant(rng: np.random.Generator) -> Iterator[RoomPart]:
    free = (-0.4, -0.44), (0.9, 0.9)
    leaves = [
        foliage(rng, 15, (0.42, 0.60), 0.14, (0.45, 0.95), 0.55, *free),
        foliage(rng, 9, (0.22, 0.36), 0.12, (0.75, 1.0), 0.30, *free),
    ]
    pot = lathed(OUTLINES["plant pot"], 36).moved(0.46, 0.001, 0.50)
    yield RoomPart("plant pot", "plant", pot, (0.58, 0.25, 0.13), 0.7)
    yield RoomPart("plant", "plant", joined(leaves).moved(0.46, 0.29, 0.50), (0.055, 0.17, 0.045), 0.5)


EXPOSURE = 2.5
"""Factor on all emitters, chosen once so that the median pixel of a view is about 0.25."""

DESIGN = RoomDesign(SIZE, EXPOSURE, furnish, SEMANTICS)
