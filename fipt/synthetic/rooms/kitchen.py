"""A kitchen in the evening: brushed metal, glossy tiles, and many small emitters of a few pixels each."""

from collections.abc import Iterator

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import BLACK, COPPER, OUTLINES, STEEL, WHITE_PAINT, RoomPart, lathed, palette
from fipt.synthetic.rooms.design import RoomDesign
from fipt.synthetic.rooms.pieces import (
    GAP,
    basin,
    cupboard,
    door,
    foliage,
    framed,
    handles,
    placed,
    skirting,
    table,
    tap,
)
from fipt.synthetic.rooms.shell import Hole, sides
from fipt.synthetic.shapes import Shape, ball, box, disc, joined, panel, ring, rod, turned_body

SIZE = (4.0, 2.6, 4.5)
"""Interior along x, y, z, metres."""

_WINDOW = Hole(0.75, 1.45, 1.2, 2.0, 0.16)
_SPOTS = [(x, z) for x in (0.8, 2.0, 3.2) for z in (0.95, 2.2, 3.45)]
"""Ceiling spots, x and z."""
_PENDANTS = (1.85, 2.3, 2.75)
"""x of the globes over the island."""
_ISLAND = (2.3, 2.65)
"""Its middle, x and z."""
_LEVEL = 0.90
"""Height of the worktops."""
_WALL_UNITS = ((0.37, 0.70), (1.80, 0.60), (3.03, 0.36))
"""Middle and width along x of what hangs on the north wall; the hood is between the last two."""
_HOB = 2.48
_STRIP = 0.012
"""Width of the light strips, metres."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, emitters first; ``rng`` draws tones of tiles, stone and steel, and leaves."""
    return [
        *_emitters(),
        *_shell(rng),
        *_lights(),
        *_north_run(rng),
        *_appliances(rng),
        *_west_run(rng),
        *_island(rng),
        *_small_things(rng),
    ]


# --- emitters ---------------------------------------------------------------------------------


def _emitters() -> Iterator[RoomPart]:
    pane = sides(SIZE)["north"].pane(_WINDOW, 0.4)
    yield RoomPart("window pane", "window", pane, BLACK, radiance=(0.42, 0.62, 1.0))
    for index, (x, z) in enumerate(_SPOTS):
        light = disc(0.045, 24).moved(x, SIZE[1] - 0.006, z)
        yield RoomPart(f"spot {index + 1}", "lamp", light, BLACK, radiance=(46.0, 37.0, 26.0))
    for index, (x, width) in enumerate(_WALL_UNITS):
        yield RoomPart(f"light strip {index + 1}", "lamp", _strip(x, width - 0.08), BLACK, radiance=(26.0, 22.5, 17.0))
    west = panel((0.20, 1.512, 1.0), (_STRIP, 0, 0), (0, 0, 1.4), 0.35)
    yield RoomPart("light strip 4", "lamp", west, BLACK, radiance=(26.0, 22.5, 17.0))
    for index, dx in enumerate((-0.16, 0.16)):
        light = disc(0.026, 16).moved(_HOB + dx, 1.596, 0.26)
        yield RoomPart(f"hood spot {index + 1}", "lamp", light, BLACK, radiance=(58.0, 54.0, 48.0))
    for index, x in enumerate(_PENDANTS):
        globe = ball(0.055, 20).moved(x, 1.72, _ISLAND[1])
        yield RoomPart(f"pendant globe {index + 1}", "lamp", globe, BLACK, radiance=(4.5, 3.3, 2.0))
    clock = panel((-0.055, 0, 0), (0.11, 0, 0), (0, 0.03, 0)).moved(_HOB, 0.80, 0.627)
    yield RoomPart("oven clock", "screen", clock, BLACK, radiance=(0.07, 0.21, 0.26))
    display = placed(panel((-0.05, 0, 0), (0.10, 0, 0), (0, 0.07, 0)), -90, (3.298, 1.42, 2.0))
    yield RoomPart("fridge display", "screen", display, BLACK, radiance=(0.18, 0.22, 0.26))


def _strip(x: float, length: float) -> Shape:
    """Light strip under a wall unit, facing down."""
    return panel((x - length / 2, 1.442, 0.28), (length, 0, 0), (0, 0, _STRIP), 0.3)


# --- shell ------------------------------------------------------------------------------------


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    room = sides(SIZE)
    width, _, depth = SIZE
    floor, joint = textures.grid(
        rng, (depth, width), (0.45, 0.45), 0.006, ((0.40, 0.37, 0.33), (0.22, 0.21, 0.20)), 0.05
    )
    floor = np.clip(floor * (1 + 0.05 * rng.standard_normal(joint.shape)[..., None]), 0.01, 0.8).astype(np.float32)
    yield RoomPart("north wall", "wall", room["north"].surface((_WINDOW,)), (0.64, 0.66, 0.60))
    yield RoomPart("west wall", "wall", room["west"].surface(), (0.64, 0.66, 0.60))
    yield RoomPart("east wall", "wall", room["east"].surface(), (0.58, 0.38, 0.26))
    yield RoomPart("south wall", "wall", room["south"].surface(), (0.64, 0.66, 0.60))
    yield RoomPart("floor", "floor", room["floor"].surface(), floor, np.where(joint, 0.85, 0.3))
    yield RoomPart("ceiling", "ceiling", room["ceiling"].surface(), (0.75, 0.75, 0.73))
    yield RoomPart("skirting", "wall", skirting(SIZE), WHITE_PAINT, 0.6)
    x, y, bar = (_WINDOW.left + _WINDOW.right) / 2, _WINDOW.low + GAP, 0.05
    w, h = _WINDOW.right - _WINDOW.left - 2 * GAP, _WINDOW.high - _WINDOW.low - 2 * GAP
    bars = [
        *(box((w, bar, 0.04)).moved(x, low, -0.12) for low in (y, y + h - bar)),
        *(
            box((bar, h - 2 * bar - 2 * GAP, 0.04)).moved(x + dx, y + bar + GAP, -0.12)
            for dx in (-(w - bar) / 2, 0, (w - bar) / 2)
        ),
    ]
    yield RoomPart("window frame", "window", joined(bars), WHITE_PAINT, 0.4)
    leaf, jamb, handle = (placed(shape, 180, (0.85, 0, depth)) for shape in door())
    yield RoomPart("door", "door", leaf, (0.16, 0.24, 0.26), 0.4)
    yield RoomPart("door frame", "door", jamb, WHITE_PAINT, 0.5)
    yield RoomPart("door handle", "door", handle, **STEEL, roughness=0.25)


def _lights() -> Iterator[RoomPart]:
    top = SIZE[1] - GAP
    ring_of = turned_body([(0.046, -0.008), (0.060, -0.008), (0.060, 0.0), (0.046, 0.0)], 24)
    rings = [ring_of.moved(x, top, z) for x, z in _SPOTS]
    strips = [box((width - 0.06, 0.006, 0.03)).moved(x, 1.443, 0.286) for x, width in _WALL_UNITS]
    strips.append(box((0.03, 0.006, 1.44)).moved(0.206, 1.513, 1.7))
    cords, caps = [], []
    for x in _PENDANTS:
        cords.append(rod((x, 1.80, _ISLAND[1]), (x, top, _ISLAND[1]), 0.004, 6))
        caps.append(
            lathed("0.012 0.052, 0.034 0.048, 0.036 0.056, 0.012 0.085, 0 0.085", 20).moved(x, 1.72, _ISLAND[1])
        )
        caps.append(rod((x, top - 0.02, _ISLAND[1]), (x, top, _ISLAND[1]), 0.04, 20))
    yield RoomPart("spot rings", "lamp", joined(rings), **STEEL, roughness=0.35)
    yield RoomPart("light strip rails", "lamp", joined(strips), (0.60, 0.60, 0.60), 0.4)
    yield RoomPart("pendant cords", "lamp", joined(cords), (0.03, 0.03, 0.03), 0.7)
    yield RoomPart("pendant caps", "lamp", joined(caps), (0.83, 0.62, 0.30), 0.3, 1.0)


# --- what stands along the walls --------------------------------------------------------------


def _north_run(rng: np.random.Generator) -> Iterator[RoomPart]:
    # Base units with a sink under the window and an oven under the hob; units and a hood on the wall.
    z, green = 0.31, (0.10, 0.19, 0.15)
    bases = [
        ((0.74, 0.859, 0.60), (1, 1), 0.38),
        ((0.70, 0.65, 0.60), (2, 1), 1.105),
        ((0.70, 0.859, 0.60), (2, 1), 1.81),
    ]
    bases.append(((0.40, 0.859, 0.60), (1, 3), 3.0))
    body = [cupboard(size, fronts).moved(x, 0, z) for size, fronts, x in bases]
    units = [cupboard((width, 0.72, 0.32), (1, 1), 0.0).moved(x, 1.45, 0.17) for x, width in _WALL_UNITS]
    grips = [handles(size, fronts, 0.14).moved(x, 0, z) for size, fronts, x in bases]
    grips += [handles((width, 0.72, 0.32), (1, 1), 0.14, 0.0).moved(x, 1.30, 0.17) for x, width in _WALL_UNITS[:2]]
    tops = [box((w, 0.04, 0.64), 0.003).moved(x, 0.86, 0.322) for x, w in ((0.375, 0.745), (2.3275, 1.745))]
    tiles, joint = textures.grid(
        rng, (3.2, 0.30), (0.15, 0.075), 0.006, ((0.70, 0.70, 0.66), (0.50, 0.49, 0.46)), 0.06, 0.5, 0.003
    )
    splash = box((3.2, 0.298, 0.008)).moved(1.602, 0.901, 0.006).projected(0, 1)
    tub = basin((0.68, 0.25, 0.60), 0.03, 0.20).moved(1.105, 0.652, 0.322)
    stone = textures.weave(rng, (0.10, 0.10, 0.105), 160, 400)
    body.append(cupboard((0.72, 2.17, 0.60), (1, 2)).moved(3.59, 0, z))
    grips.append(handles((0.72, 2.17, 0.60), (1, 2), 0.3).moved(3.59, 0, z))
    yield RoomPart("base units", "cupboard", joined(body), green, 0.35)
    yield RoomPart("wall units", "cupboard", joined(units), (0.62, 0.60, 0.54), 0.35)
    yield RoomPart("unit handles", "cupboard", joined(grips), (0.83, 0.62, 0.30), 0.3, 1.0)
    yield RoomPart("worktops", "table", joined(tops).projected(0, 2), stone, 0.2)
    yield RoomPart("splashback", "wall", splash, tiles, np.where(joint, 0.85, 0.15))
    yield RoomPart("sink", "sink", tub, **STEEL, roughness=0.35)
    yield RoomPart("tap", "tap", tap(0.30, 0.20).moved(1.105, 0.903, 0.041), **STEEL, roughness=0.15)


def _brushed(rng: np.random.Generator, height: int, width: int, around: float) -> np.ndarray:
    """(h, w) roughness of steel brushed along u."""
    from scipy.ndimage import gaussian_filter

    grain = gaussian_filter(rng.standard_normal((height, width)), (0.7, 24), mode="wrap")
    return np.clip(around + 0.05 * grain / grain.std(), 0.15, 1).astype(np.float32)


def _appliances(rng: np.random.Generator) -> Iterator[RoomPart]:
    steel = np.broadcast_to(np.float32(STEEL["color"]), (96, 96, 3))
    brushed = _brushed(rng, 96, 96, 0.35)
    oven = [
        box((0.598, 0.775, 0.56)).moved(_HOB, 0.08, 0.29),
        box((0.594, 0.09, 0.022), 0.003).moved(_HOB, 0.765, 0.615),
    ]
    glass = box((0.594, 0.66, 0.022), 0.003).moved(_HOB, 0.095, 0.615)
    grip = [rod((_HOB - 0.24, 0.70, 0.672), (_HOB + 0.24, 0.70, 0.672), 0.010, 10)]
    grip += [rod((_HOB + dx, 0.70, 0.6275), (_HOB + dx, 0.70, 0.672), 0.007, 8) for dx in (-0.2, 0.2)]
    hob = box((0.58, 0.006, 0.50), 0.002).moved(_HOB, 0.901, 0.33)
    hood = [
        box((0.60, 0.05, 0.48), 0.003).moved(_HOB, 1.60, 0.245),
        box((0.26, SIZE[1] - 1.652, 0.24)).moved(_HOB, 1.651, 0.125),
    ]
    # The fridge stands at the east wall.
    fridge = [
        box((0.68, 1.86, 0.62)).moved(0, 0.02, 0.31),
        box((0.676, 1.20, 0.05), 0.012).moved(0, 0.68, 0.648),
        box((0.676, 0.62, 0.05), 0.012).moved(0, 0.04, 0.648),
    ]
    bars = [rod((-0.28, y0, 0.71), (-0.28, y1, 0.71), 0.011, 10) for y0, y1 in ((0.80, 1.30), (0.40, 0.62))]
    bars += [rod((-0.28, y, 0.6745), (-0.28, y, 0.71), 0.007, 8) for y in (0.84, 1.26, 0.43, 0.59)]
    place = (SIZE[0] - 0.026, 0, 2.0)
    frame = box((0.14, 0.11, 0.002)).moved(0, 1.40, 0.6745)
    yield RoomPart("oven", "appliance", joined(oven).projected(0, 1), steel, brushed, 1.0)
    yield RoomPart("oven glass", "appliance", glass, (0.014, 0.014, 0.015), 0.08)
    yield RoomPart("oven handle", "appliance", joined(grip), **STEEL, roughness=0.25)
    yield RoomPart("hob", "appliance", hob, (0.012, 0.012, 0.012), 0.1)
    yield RoomPart("hood", "appliance", joined(hood).projected(0, 1), steel, brushed, 1.0)
    yield RoomPart("fridge", "appliance", placed(joined(fridge).projected(0, 1), -90, place), steel, brushed, 1.0)
    yield RoomPart("fridge handles", "appliance", placed(joined(bars), -90, place), **STEEL, roughness=0.2)
    yield RoomPart("fridge display frame", "appliance", placed(frame, -90, place), (0.02, 0.02, 0.02), 0.3)


def _west_run(rng: np.random.Generator) -> Iterator[RoomPart]:
    size, place = (1.5, 0.859, 0.55), (0.286, 0, 1.7)
    body = placed(cupboard(size, (3, 1)), 90, place)
    top = box((0.59, 0.04, 1.52), 0.003).moved(0.302, 0.86, 1.7).projected(2, 0)
    oak = textures.wood(rng, 90, 220, (0.48, 0.31, 0.17), (0.36, 0.21, 0.10))
    shelves = box((0.24, 0.03, 1.5), 0.003).moved(0.125, 1.52, 1.7)
    cans = [
        lathed("0 0, 0.045 0, 0.05 0.01, 0.05 0.13, 0.042 0.14, 0.042 0.16, 0 0.16", 24)
        .moved(0.12, 1.551, z)
        .tinted(k % 3, 3)
        for k, z in enumerate((1.10, 1.24, 1.38, 1.52))
    ]
    plates = [
        lathed("0 0, 0.07 0, 0.12 0.014, 0.118 0.018, 0 0.008", 28).moved(0.13, 1.551 + 0.019 * k, 2.05)
        for k in range(5)
    ]
    box_shape = box((0.26, 0.24, 0.36), 0.02).moved(0.24, 0.901, 1.28)
    kettle = lathed("0 0, 0.08 0, 0.085 0.02, 0.065 0.19, 0.03 0.21, 0.012 0.215, 0.012 0.235, 0 0.235", 32).moved(
        0.26, 0.901, 2.1
    )
    yield RoomPart("west units", "cupboard", body, (0.10, 0.19, 0.15), 0.35)
    grips = placed(handles(size, (3, 1), 0.14), 90, place)
    yield RoomPart("west handles", "cupboard", grips, (0.83, 0.62, 0.30), 0.3, 1.0)
    yield RoomPart("west worktop", "table", top, oak, 0.35)
    yield RoomPart("west shelf", "shelf", shelves, (0.42, 0.27, 0.14), 0.5)
    colors = palette((0.52, 0.12, 0.06), (0.60, 0.44, 0.14), (0.14, 0.26, 0.30))
    yield RoomPart("cans", "vase", joined(cans), colors, 0.25)
    yield RoomPart("plates", "vase", joined(plates), (0.72, 0.71, 0.68), 0.2)
    yield RoomPart("bread box", "vase", box_shape, (0.62, 0.55, 0.40), 0.4)
    yield RoomPart("kettle", "vase", kettle, **STEEL, roughness=0.15)


# --- island and the rest ----------------------------------------------------------------------


def _island(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = _ISLAND
    top, frame = table((1.5, 0.92, 0.80), 0.045, 0.06)
    walnut = textures.wood(rng, 110, 220, (0.30, 0.165, 0.085), (0.17, 0.08, 0.036))
    low = box((1.34, 0.03, 0.64)).moved(x, 0.28, z)
    pots = [
        lathed("0 0, 0.12 0, 0.125 0.01, 0.125 0.16, 0.118 0.16, 0.115 0.012, 0 0.012", 32).moved(x - 0.3, 0.311, z),
        lathed("0 0, 0.10 0, 0.105 0.01, 0.105 0.12, 0.098 0.12, 0.095 0.012, 0 0.012", 32).moved(
            x + 0.05, 0.311, z + 0.05
        ),
    ]
    seats, legs = [], []
    for dx, turn in ((-0.42, 10), (0.05, -14), (0.48, 24)):
        seats.append(
            lathed("0 0, 0.15 0, 0.17 0.012, 0.17 0.03, 0.155 0.04, 0 0.034", 32).moved(x + dx, 0.642, z + 0.52)
        )
        for k in range(4):
            leg = rod((0.19, 0.004, 0), (0.11, 0.640, 0), 0.010, 8)
            legs.append(leg.turned(90 * k + 45 + turn).moved(x + dx, 0, z + 0.52))
        legs.append(ring(0.165, 0.007, 28, 6).moved(x + dx, 0.22, z + 0.52))
    bowl = lathed(OUTLINES["bowl"]).moved(x + 0.35, 0.921, z)
    fruit = [
        ball(0.038, 16).moved(x + 0.35 + dx, 0.921 + dy, z + dz).tinted(k % 2, 2)
        for k, (dx, dy, dz) in enumerate(((0.035, 0.062, 0.02), (-0.045, 0.066, 0.012), (0.005, 0.064, -0.055)))
    ]
    board = box((0.42, 0.022, 0.28), 0.006).turned(14).moved(x - 0.28, 0.921, z + 0.05)
    yield RoomPart("island top", "table", top.moved(x, 0, z), walnut, 0.3)
    yield RoomPart("island frame", "table", frame.moved(x, 0, z), (0.62, 0.60, 0.54), 0.4)
    yield RoomPart("island shelf", "table", low, (0.42, 0.27, 0.14), 0.5)
    yield RoomPart("pots", "vase", joined(pots), **STEEL, roughness=0.2)
    yield RoomPart("stool seats", "chair", joined(seats), (0.44, 0.28, 0.15), 0.45)
    yield RoomPart("stool legs", "chair", joined(legs), (0.05, 0.05, 0.055), 0.4)
    yield RoomPart("fruit bowl", "vase", bowl, (0.66, 0.64, 0.58), 0.2)
    yield RoomPart("fruit", "vase", joined(fruit), palette((0.56, 0.30, 0.03), (0.30, 0.42, 0.06)), 0.4)
    yield RoomPart("chopping board", "table", board, (0.52, 0.36, 0.20), 0.6)


def _small_things(rng: np.random.Generator) -> Iterator[RoomPart]:
    rail = [rod((SIZE[0] - 0.05, 1.75, 2.85), (SIZE[0] - 0.05, 1.75, 3.85), 0.009, 10)]
    rail += [rod((SIZE[0] - 0.05, 1.75, z), (SIZE[0] - GAP, 1.75, z), 0.007, 8) for z in (2.95, 3.75)]
    pans = []
    for z, radius in ((3.05, 0.15), (3.40, 0.12), (3.68, 0.095)):
        pan = turned_body(
            [(0, 0), (0.8 * radius, 0), (radius, 0.045), (0.97 * radius, 0.045), (0.78 * radius, 0.005), (0, 0.005)], 32
        )
        hung = pan.turned(90, "z").moved(SIZE[0] - 0.035, 1.45 - radius, z)
        pans += [hung, rod((SIZE[0] - 0.045, 1.45, z), (SIZE[0] - 0.045, 1.72, z), 0.007, 8)]
    canvas, frame = framed(0.6, 0.8, 180, (2.7, 1.55, SIZE[2] - 0.002))
    size, place = (1.6, 0.78, 0.40), (2.7, 0, SIZE[2] - 0.235)
    leaves = foliage(rng, 14, (0.14, 0.22), 0.05, (0.15, 0.5), 0.22, (-0.2, -0.05), (0.2, 0.3)).moved(1.42, 1.02, 0.16)
    pot = lathed("0 0, 0.05 0, 0.06 0.1, 0.053 0.1, 0.045 0.02, 0 0.02", 24).moved(1.55, 0.901, 0.16)
    vase = lathed(OUTLINES["ceramic vase"], 32).moved(3.2, 0.782, SIZE[2] - 0.24)
    yield RoomPart("pan rail", "shelf", joined(rail), **STEEL, roughness=0.25)
    yield RoomPart("copper pans", "vase", joined(pans), **COPPER, roughness=0.3)
    yield RoomPart("print", "picture", canvas, textures.shapes_print(), 0.7)
    yield RoomPart("print frame", "picture", frame, (0.05, 0.05, 0.055), 0.4)
    yield RoomPart("sideboard", "cupboard", placed(cupboard(size, (4, 1)), 180, place), (0.62, 0.60, 0.54), 0.3)
    grips = placed(handles(size, (4, 1), 0.12), 180, place)
    yield RoomPart("sideboard handles", "cupboard", grips, (0.83, 0.62, 0.30), 0.3, 1.0)
    yield RoomPart("vase", "vase", vase, (0.06, 0.14, 0.30), 0.15)
    yield RoomPart("herb pot", "plant", pot, (0.56, 0.28, 0.16), 0.7)
    yield RoomPart("herbs", "plant", leaves.moved(0.13, -0.03, 0), (0.08, 0.24, 0.05), 0.5)


DESIGN = RoomDesign(SIZE, 6.6, furnish)
