"""A studio under the roof: its only emitter, a skylight, stands in no view, since no camera looks up to it."""

from collections.abc import Iterator

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import BLACK, OUTLINES, STEEL, WHITE_PAINT, RoomPart, cushion, lathed, palette
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
from fipt.synthetic.shapes import Shape, ball, box, joined, panel, rod

SIZE = (4.6, 2.7, 4.2)
"""Interior along x, y, z, metres."""

_SKYLIGHT = Hole(1.7, 2.9, 1.4, 2.6, 0.35)
"""In the ceiling, at the end of a shaft."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, the skylight first; ``rng`` draws the grain of woods, books and leaves."""
    pane = sides(SIZE)["ceiling"].pane(_SKYLIGHT, 0.4)
    return [
        RoomPart("window pane skylight", "window", pane, BLACK, radiance=(8.0, 9.0, 10.4)),
        *_shell(rng),
        *_bed(rng),
        *_work(rng),
        *_storage(rng),
        *_easel(),
        *_details(rng),
    ]


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    room = sides(SIZE)
    width, _, depth = SIZE
    brick, _ = textures.grid(
        rng, (depth, SIZE[1]), (0.24, 0.08), 0.012, ((0.42, 0.20, 0.13), (0.46, 0.43, 0.39)), 0.14, 0.5
    )
    yield RoomPart("north wall", "wall", room["north"].surface(), (0.68, 0.66, 0.61))
    yield RoomPart("west wall", "wall", room["west"].surface(), brick, 0.9)
    yield RoomPart("east wall", "wall", room["east"].surface(), (0.68, 0.66, 0.61))
    yield RoomPart("south wall", "wall", room["south"].surface(), (0.30, 0.40, 0.50))
    yield RoomPart("floor", "floor", room["floor"].surface(), textures.planks(rng, (depth, width)), 0.4)
    yield RoomPart("ceiling", "ceiling", room["ceiling"].surface((_SKYLIGHT,)), (0.74, 0.73, 0.70))
    yield RoomPart("skirting", "wall", skirting(SIZE), WHITE_PAINT, 0.6)


def _bed(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = 3.75, 1.15
    frame = [
        box((1.45, 0.20, 2.02), 0.01).moved(x, 0.12, z),
        box((1.45, 0.80, 0.05), 0.012).moved(x, 0.12, z - 1.045),
        *(box((0.06, 0.118, 0.06)).moved(x + dx, GAP, z + dz) for dx in (-0.66, 0.66) for dz in (-0.94, 0.94)),
    ]
    mattress = cushion(1.38, 0.20, 1.94, 0.06).moved(x, 0.321, z + 0.01)
    cover = cushion(1.43, 0.09, 1.25, 0.04).moved(x, 0.522, z + 0.36)
    pillows = [cushion(0.58, 0.13, 0.38, 0.06).turned(-8, "x").moved(x + dx, 0.545, z - 0.68) for dx in (-0.34, 0.34)]
    pine = textures.wood(rng, 120, 200, (0.58, 0.40, 0.22), (0.44, 0.27, 0.13))
    yield RoomPart("bed", "bed", joined(frame).projected(2, 1), pine, 0.5)
    yield RoomPart("mattress", "bed", mattress, (0.66, 0.65, 0.62))
    yield RoomPart("bed cover", "bed", cover.projected(0, 2), textures.weave(rng, (0.42, 0.14, 0.10), 150, 160))
    yield RoomPart("bed pillows", "bed", joined(pillows), (0.68, 0.66, 0.60))


def _work(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = 0.55, 2.6
    top, legs = table((1.5, 0.74, 0.7), 0.03, 0.03)
    beech = textures.wood(rng, 100, 200, (0.56, 0.38, 0.22), (0.46, 0.29, 0.15))
    seat, chair_legs = (placed(shape, 255, (x + 0.72, 0, z + 0.1)) for shape in chair())
    yield RoomPart("table", "table", placed(top, 90, (x, 0, z)), beech, 0.4)
    yield RoomPart("table legs", "table", placed(legs, 90, (x, 0, z)), **STEEL, roughness=0.4)
    yield RoomPart("chair", "chair", seat, (0.58, 0.42, 0.08), 0.5)
    yield RoomPart("chair legs", "chair", chair_legs, (0.05, 0.05, 0.05), 0.4)
    level = 0.741
    jars = [
        lathed(OUTLINES["mug"], 24).moved(x - 0.1 + 0.09 * k, level, z - 0.5 + 0.07 * k).tinted(k, 3) for k in range(3)
    ]
    tints = palette((0.60, 0.14, 0.06), (0.10, 0.24, 0.42), (0.62, 0.60, 0.56))
    pile = [
        box((0.30, 0.03, 0.22), 0.003).turned(12).tinted(0, 2),
        box((0.26, 0.03, 0.19), 0.003).turned(-8).moved(0, 0.031, 0).tinted(1, 2),
    ]
    sheet = box((0.42, 0.002, 0.30)).turned(80).moved(x, level, z)
    yield RoomPart("jars", "vase", joined(jars), tints, 0.2)
    yield RoomPart("sketch", "book", sheet, (0.72, 0.70, 0.64), 0.9)
    yield RoomPart(
        "table books",
        "book",
        joined(pile).moved(x, level, z + 0.52),
        palette((0.08, 0.16, 0.14), (0.55, 0.50, 0.38)),
        0.7,
    )


def _storage(rng: np.random.Generator) -> Iterator[RoomPart]:
    size, place = (1.5, 0.86, 0.45), (1.1, 0.0, 0.26)
    yield RoomPart("chest", "cupboard", cupboard(size, (2, 3)).moved(*place), (0.10, 0.20, 0.22), 0.3)
    yield RoomPart("chest handles", "cupboard", handles(size, (2, 3), 0.1).moved(*place), **STEEL, roughness=0.25)
    row = books(rng, 0.0, 0.5, (0.28, 0.2)).moved(0.9, 0.862, 0.08)
    yield RoomPart("books", "book", row, palette(*BOOK_COLORS), 0.8)
    yield RoomPart("silver ball", "vase", ball(0.09, 28).moved(0.6, 0.952, 0.28), (0.78, 0.77, 0.74), 0.2, 1.0)
    yield RoomPart(
        "vase", "vase", lathed(OUTLINES["ceramic vase"], 32).moved(1.65, 0.862, 0.25), (0.62, 0.55, 0.40), 0.2
    )


def _easel() -> Iterator[RoomPart]:
    def stand(shapes: list[Shape]) -> Shape:
        return placed(joined(shapes), 205, (2.3, 0, 3.55))

    legs = [
        *(rod((1.6 * x, 0.006, 0.12), (0.4 * x, 1.75, -0.06), 0.016, 8) for x in (-0.25, 0.25)),
        rod((0, 0.008, -0.45), (0, 1.55, -0.08), 0.016, 8),
        box((0.62, 0.03, 0.06)).moved(0, 0.72, 0.10),
    ]
    canvas = panel((-0.35, 0, 0.012), (0.7, 0, 0), (0, 0.55, 0))
    behind = box((0.7, 0.55, 0.020)).moved(0, 0, 0.0)
    lean = [shape.turned(-6, "x").moved(0, 0.755, 0.115) for shape in (canvas.projected(0, 1), behind)]
    yield RoomPart("easel", "easel", stand(legs), (0.34, 0.20, 0.10), 0.5)
    yield RoomPart("painting", "picture", stand(lean[:1]), textures.landscape(), 0.6)
    yield RoomPart("canvas", "picture", stand(lean[1:]), (0.66, 0.62, 0.54), 0.9)


def _details(rng: np.random.Generator) -> Iterator[RoomPart]:
    canvas, frame = framed(0.57, 0.76, -90, (SIZE[0] - 0.002, 1.55, 2.9))
    rug = box((1.5, 0.012, 1.1), 0.005).turned(8).moved(2.1, GAP, 2.2)
    leaves = foliage(rng, 16, (0.36, 0.52), 0.13, (0.45, 0.95), 0.5, (-0.4, -0.4), (0.4, 0.3)).moved(4.05, 0.29, 3.75)
    yield RoomPart("print", "picture", canvas, textures.shapes_print(), 0.8)
    yield RoomPart("print frame", "picture", frame, (0.55, 0.50, 0.40), 0.4)
    yield RoomPart("rug", "rug", rug.projected(0, 2), textures.weave(rng, (0.50, 0.45, 0.34), 120, 160))
    yield RoomPart(
        "plant pot", "plant", lathed(OUTLINES["plant pot"], 32).moved(4.05, GAP, 3.75), (0.30, 0.32, 0.33), 0.4
    )
    yield RoomPart("plant", "plant", leaves, (0.07, 0.20, 0.05), 0.5)


DESIGN = RoomDesign(SIZE, 3.8, furnish, unseen=("window pane skylight",))
