"""An office: dim screens and light panels beside bright windows, thin steel legs, a wall of glass.

Glass is not in the material model. The wall's panes are glossy dark dielectrics instead, as glass looks before a dark
room, and one of its three bays is open.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import BLACK, OUTLINES, STEEL, WHITE_PAINT, RoomPart, lathed, palette
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
    office_chair,
    placed,
    screen,
    skirting,
    table,
)
from fipt.synthetic.rooms.shell import Hole, sides
from fipt.synthetic.shapes import Shape, box, disc, joined, panel, rod
from fipt.synthetic.textures import Rgb

SIZE = (6.0, 2.8, 8.0)
"""Interior along x, y, z, metres."""

_GRAPHITE: Rgb = (0.045, 0.045, 0.05)
_WINDOWS = (Hole(0.6, 2.5, 0.9, 2.3, 0.2), Hole(3.4, 5.3, 0.9, 2.3, 0.2))
_FACADE = Hole(5.1, 6.6, 0.9, 2.3, 0.2)
"""The west wall's window, counted from its southern end."""
_LIT, _DARK = ((1.2, 1.6), (3.6, 1.6), (1.2, 4.2), (3.6, 4.2), (3.9, 6.7)), ((1.2, 6.7),)
"""Centres of light panels in the ceiling, x and z: on, and switched off."""
_PANEL = 0.6
_DESKS = ((1.55, 1.35, 0.0), (1.55, 2.75, 180.0), (4.35, 1.45, 0.0), (4.35, 2.85, 180.0))
"""x, z and turn: people face the desk's +z side."""
_SCREENS = (((0.55, 0.68, 0.85), 0.62), ((0.80, 0.78, 0.72), 0.50), ((0.30, 0.42, 0.34), 0.55), (None, 0.62))
"""Colour of what each desk's screen shows (None: it is off) and the screen's width, metres."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, emitters first; ``rng`` draws tones of carpet and ceiling, books and leaves."""
    return [
        *_emitters(),
        *_shell(rng),
        *_windows(),
        *_ceiling_panels(),
        *_desks(rng),
        *_glass_wall(),
        *_meeting(rng),
        *_walls_things(),
        *_storage(rng),
        *_plant(rng),
    ]


# --- emitters ---------------------------------------------------------------------------------


def _emitters() -> Iterator[RoomPart]:
    room = sides(SIZE)
    for index, hole in enumerate(_WINDOWS):
        yield RoomPart(f"window pane {index + 1}", "window", room["north"].pane(hole), BLACK, radiance=(7.8, 8.6, 9.8))
    yield RoomPart("window pane west", "window", room["west"].pane(_FACADE), BLACK, radiance=(6.2, 7.4, 9.0))
    for index, (x, z) in enumerate(_LIT):
        light = panel((x - 0.28, SIZE[1] - 0.012, z - 0.28), (0.56, 0, 0), (0, 0, 0.56), 0.28)
        yield RoomPart(f"light panel {index + 1}", "lamp", light, BLACK, radiance=(1.25, 1.28, 1.2))
    for index, (display, _, radiance) in enumerate(_desk_screens()):
        if radiance is not None:
            yield RoomPart(f"desk screen {index + 1}", "screen", display, BLACK, radiance=radiance)
    yield RoomPart("wall screen", "screen", _wall_screen()[0], BLACK, radiance=(0.50, 0.58, 0.72))
    slide, _, radiance = _presentation()
    yield RoomPart("presentation", "screen", slide, BLACK, radiance=radiance)
    sign = panel((-0.15, 0, 0.022), (0.3, 0, 0), (0, 0.14, 0))
    yield RoomPart("exit sign", "sign", placed(sign, 90, (0.001, 2.30, 7.3)), BLACK, radiance=(0.06, 0.46, 0.14))
    bulb = disc(0.045, 24).moved(4.98, 1.075, 1.30)
    yield RoomPart("desk light", "lamp", bulb, BLACK, radiance=(14.0, 10.0, 6.0))


def _desk_screens() -> list[tuple[Shape, Shape, Rgb | None]]:
    """Display, housing and radiance of the screen on each desk."""
    found = []
    for (x, z, turn), (radiance, width) in zip(_DESKS, _SCREENS, strict=True):
        aside = 0.12 if turn else -0.12
        place = (x + aside, 0.74 + 0.14, z + (0.22 if turn else -0.22))
        shapes = [placed(shape, turn + 4, place) for shape in screen(width, 0.57 * width)]
        found.append((shapes[0], shapes[1], radiance))
    return found


def _wall_screen() -> list[Shape]:
    """Display and housing of the screen on the east wall."""
    return [placed(shape, -90, (SIZE[0] - GAP, 1.25, 3.9)) for shape in screen(1.4, 0.8)]


def _presentation() -> tuple[Shape, Shape, np.ndarray]:
    """Slide on a screen at the south wall: its display, the housing, and the (T, 3) radiance of the slide's blocks."""
    columns, rows = 12, 8
    image = np.empty((columns, rows, 3))
    image[:] = (0.62, 0.63, 0.66)
    image[:, rows - 1] = (0.10, 0.20, 0.52)
    image[:, 0] = (0.16, 0.17, 0.19)
    for left, height, color in ((1, 2, (0.62, 0.24, 0.08)), (3, 4, (0.12, 0.42, 0.22)), (5, 3, (0.66, 0.52, 0.10))):
        image[left : left + 1, 1 : 1 + height] = color
    image[8:11, 2:5] = (0.20, 0.34, 0.60)
    shapes = [placed(shape, 180, (4.35, 1.0, SIZE[2] - GAP)) for shape in screen(1.62, 0.91, columns, rows)]
    radiance = np.repeat(image.reshape(-1, 3), 2, axis=0)
    # Cells of one colour follow one another: they are one emitter.
    order = np.argsort(np.unique(radiance, axis=0, return_inverse=True)[1].ravel(), kind="stable")
    return replace(shapes[0], triangles=shapes[0].triangles[order]), shapes[1], radiance[order]


# --- shell ------------------------------------------------------------------------------------


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    room = sides(SIZE)
    width, _, depth = SIZE
    carpet, seam = textures.grid(
        rng, (depth, width), (0.5, 0.5), 0.012, ((0.16, 0.17, 0.19), (0.12, 0.13, 0.145)), 0.10
    )
    carpet = carpet * (1 + 0.06 * rng.standard_normal(seam.shape)[..., None])
    tiles, _ = textures.grid(rng, (width, depth), (0.6, 0.6), 0.024, ((0.74, 0.74, 0.72), (0.60, 0.60, 0.60)), 0.01)
    yield RoomPart("north wall", "wall", room["north"].surface(_WINDOWS), (0.70, 0.70, 0.68))
    yield RoomPart("west wall", "wall", room["west"].surface((_FACADE,)), (0.70, 0.70, 0.68))
    yield RoomPart("east wall", "wall", room["east"].surface(), (0.30, 0.40, 0.45))
    yield RoomPart("south wall", "wall", room["south"].surface(), (0.64, 0.58, 0.48))
    yield RoomPart("floor", "floor", room["floor"].surface(), np.clip(carpet, 0.01, 0.8).astype(np.float32))
    yield RoomPart("ceiling", "ceiling", room["ceiling"].surface(), tiles)
    yield RoomPart("skirting", "wall", skirting(SIZE), _GRAPHITE, 0.5)


def _windows() -> Iterator[RoomPart]:
    room, bars = sides(SIZE), []
    for side, hole in ((room["north"], _WINDOWS[0]), (room["north"], _WINDOWS[1]), (room["west"], _FACADE)):
        a0, a1, b0, b1 = hole.left + GAP, hole.right - GAP, hole.low + GAP, hole.high - GAP
        for left, right, low, high in (
            (a0, a1, b0, b0 + 0.06),
            (a0, a1, b1 - 0.06, b1),
            (a0, a0 + 0.06, b0 + 0.061, b1 - 0.061),
            (a1 - 0.06, a1, b0 + 0.061, b1 - 0.061),
            ((a0 + a1) / 2 - 0.03, (a0 + a1) / 2 + 0.03, b0 + 0.061, b1 - 0.061),
        ):
            size = np.abs((right - left) * side.u + (high - low) * side.v + 0.05 * side.normal)
            center = side.at((left + right) / 2, low, -0.15)
            bars.append(box(size.tolist()).moved(*center))
    yield RoomPart("window frames", "window", joined(bars), _GRAPHITE, 0.4)
    sills = [
        box((2.0, 0.025, 0.16), 0.006).moved((hole.left + hole.right) / 2, 0.9 - 0.028, 0.083) for hole in _WINDOWS
    ]
    sills.append(box((0.16, 0.025, 1.6), 0.006).moved(0.083, 0.9 - 0.028, SIZE[2] - 5.85))
    yield RoomPart("window sills", "window", joined(sills), WHITE_PAINT, 0.4)


def _ceiling_panels() -> Iterator[RoomPart]:
    frames, top = [], SIZE[1] - GAP
    for x, z in (*_LIT, *_DARK):
        frames += [
            *(box((_PANEL, 0.024, 0.018)).moved(x, top - 0.024, z + dz) for dz in (-0.291, 0.291)),
            *(box((0.018, 0.024, _PANEL - 0.036)).moved(x + dx, top - 0.024, z) for dx in (-0.291, 0.291)),
        ]
    off = [panel((x - 0.28, SIZE[1] - 0.012, z - 0.28), (0.56, 0, 0), (0, 0, 0.56), 0.28) for x, z in _DARK]
    yield RoomPart("light panel frames", "lamp", joined(frames), WHITE_PAINT, 0.5)
    yield RoomPart("light panel that is off", "lamp", joined(off), (0.66, 0.66, 0.63), 0.35)


# --- desks ------------------------------------------------------------------------------------


def _desks(rng: np.random.Generator) -> Iterator[RoomPart]:
    top, frame = table((1.5, 0.74, 0.75), 0.025, 0.028)
    tops = [placed(top, turn, (x, 0, z)) for x, z, turn in _DESKS]
    frames = [placed(frame, turn, (x, 0, z)) for x, z, turn in _DESKS]
    birch = textures.wood(rng, 100, 220, (0.62, 0.48, 0.32), (0.54, 0.39, 0.24))
    yield RoomPart("desk tops", "table", joined(tops), birch, 0.35)
    yield RoomPart("desk frames", "table", joined(frames), **STEEL, roughness=0.35)
    housings, stands = [], []
    for (_, housing, _), (x, z, turn) in zip(_desk_screens(), _DESKS, strict=True):
        housings.append(housing)
        aside, back = (0.12 if turn else -0.12), (0.225 if turn else -0.225)
        stand = [
            box((0.24, 0.010, 0.18), 0.003),
            rod((0, 0.011, -0.03), (0, 0.24, -0.03), 0.014, 8),
        ]
        stands.append(placed(joined(stand), turn, (x + aside, 0.741, z + back)))
    yield RoomPart("desk screen housings", "screen", joined(housings), (0.035, 0.035, 0.038), 0.35)
    yield RoomPart("desk screen stands", "screen", joined(stands), (0.08, 0.08, 0.085), 0.4)
    dark = [display for display, _, radiance in _desk_screens() if radiance is None]
    yield RoomPart("desk screen that is off", "screen", joined(dark), (0.012, 0.012, 0.014), 0.15)
    yield from _on_desks()
    chairs = [
        (x + dx, z + (0.72 if not turn else -0.72), 180 - turn + spin, k)
        for k, ((x, z, turn), dx, spin) in enumerate(
            zip(_DESKS, (0.1, -0.15, 0.05, 0.2), (15, -25, 40, -10), strict=True)
        )
    ]
    shapes = [[placed(shape, turn, (x, 0, z)) for shape in office_chair(20 * k)] for x, z, turn, k in chairs]
    blue = textures.weave(rng, (0.06, 0.12, 0.26), 128, 128)
    yield RoomPart("chair cushions", "chair", joined([shape[0] for shape in shapes]), blue)
    yield RoomPart("chair metal", "chair", joined([shape[1] for shape in shapes]), **STEEL, roughness=0.3)
    yield RoomPart("chair castors", "chair", joined([shape[2] for shape in shapes]), (0.03, 0.03, 0.03), 0.6)


def _on_desks() -> Iterator[RoomPart]:
    keys = [
        placed(box((0.42, 0.018, 0.13), 0.004), turn, (x, 0.741, z + (-0.12 if turn else 0.12)))
        for x, z, turn in _DESKS
    ]
    paper = [
        box((0.21, 0.012, 0.297)).turned(18 * k + 7).moved(x + 0.5, 0.741, z) for k, (x, z, _) in enumerate(_DESKS)
    ]
    mugs = [lathed(OUTLINES["mug"], 24).moved(x - 0.52, 0.741, z + 0.1) for x, z, _ in _DESKS[1:3]]
    light = [
        rod((4.98, 0.7415, 1.16), (4.98, 0.752, 1.16), 0.08, 24),
        rod((4.98, 0.752, 1.16), (4.98, 1.10, 1.16), 0.008, 8),
        rod((4.98, 1.10, 1.16), (4.98, 1.10, 1.30), 0.008, 8),
        lathed("0.048 0, 0.052 -0.01, 0.07 -0.028, 0.074 -0.028, 0.056 0.02, 0.03 0.04, 0 0.04", 24).moved(
            4.98, 1.09, 1.30
        ),
        lathed("0.001 -0.013, 0.048 -0.013, 0.048 0", 24).moved(4.98, 1.09, 1.30),
    ]
    yield RoomPart("keyboards", "screen", joined(keys), (0.06, 0.06, 0.065), 0.6)
    yield RoomPart("papers", "book", joined(paper), (0.74, 0.73, 0.70), 0.9)
    yield RoomPart("mugs", "vase", joined(mugs), (0.55, 0.09, 0.06), 0.2)
    yield RoomPart("desk light body", "lamp", joined(light[:3]), (0.60, 0.30, 0.05), 0.35)
    yield RoomPart("desk light shade", "lamp", joined(light[3:]), (0.60, 0.30, 0.05), 0.5)


# --- glass wall and meeting corner ------------------------------------------------------------


def _glass_wall() -> Iterator[RoomPart]:
    z, top, start, end = 5.35, SIZE[1] - 2 * GAP, 2.4, SIZE[0] - 0.02
    posts = np.linspace(start, end, 4)
    bars = [box((0.05, top - GAP, 0.06)).moved(np.clip(x, start + 0.025, end - 0.025), GAP, z) for x in posts]
    panes = []
    for bay, (left, right) in enumerate(pairwise(posts)):
        left, right = left + 0.052, right - 0.052
        middle, width = (left + right) / 2, right - left
        bars.append(box((width, 0.05, 0.06)).moved(middle, top - 0.052, z))
        if bay == 0:  # the way in
            continue
        bars.append(box((width, 0.05, 0.06)).moved(middle, GAP, z))
        panes.append(box((width - 2 * GAP, top - 0.106, 0.012)).moved(middle, 0.052, z))
    yield RoomPart("glass wall frame", "door", joined(bars), _GRAPHITE, 0.35)
    yield RoomPart("glass wall panes", "door", joined(panes), (0.02, 0.028, 0.028), 0.06)


def _meeting(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = 4.1, 6.7
    top, frame = table((1.9, 0.73, 0.95), 0.03, 0.035)
    walnut = textures.wood(rng, 100, 220, (0.28, 0.15, 0.075), (0.15, 0.07, 0.032))
    yield RoomPart("meeting table", "table", top.moved(x, 0, z), walnut, 0.25)
    yield RoomPart("meeting table frame", "table", frame.moved(x, 0, z), _GRAPHITE, 0.4)
    shapes = [
        [placed(shape, turn, (x + dx, 0, z + dz)) for shape in chair()]
        for dx, dz, turn in ((-0.45, -0.62, 4), (0.48, -0.60, -8), (-0.5, 0.64, 174), (0.42, 0.62, 186))
    ]
    yield RoomPart("meeting chairs", "chair", joined([shape[0] for shape in shapes]), (0.58, 0.50, 0.10), 0.5)
    yield RoomPart("meeting chair legs", "chair", joined([shape[1] for shape in shapes]), **STEEL, roughness=0.25)
    pads = [
        box((0.20, 0.015, 0.28)).turned(10).moved(x - 0.4, 0.731, z - 0.25).tinted(0, 2),
        box((0.20, 0.015, 0.28)).turned(-14).moved(x + 0.4, 0.731, z + 0.22).tinted(1, 2),
    ]
    bowl = lathed(OUTLINES["bowl"]).moved(x + 0.05, 0.731, z)
    yield RoomPart("notebooks", "book", joined(pads), palette((0.10, 0.10, 0.11), (0.50, 0.10, 0.08)), 0.6)
    yield RoomPart("bowl", "vase", bowl, (0.10, 0.30, 0.28), 0.2)


# --- along the walls --------------------------------------------------------------------------


def _walls_things() -> Iterator[RoomPart]:
    yield RoomPart("wall screen housing", "screen", _wall_screen()[1], (0.03, 0.03, 0.033), 0.3)
    yield RoomPart("presentation housing", "screen", _presentation()[1], (0.03, 0.03, 0.033), 0.3)
    sign = box((0.34, 0.18, 0.020)).moved(0, -0.02, 0.0105)
    yield RoomPart("exit sign housing", "sign", placed(sign, 90, (0.0, 2.30, 7.3)), (0.05, 0.22, 0.10), 0.5)
    board = box((1.5, 1.0, 0.012)).moved(0, 0, 0.008)
    rim = [
        *(box((1.54, 0.02, 0.022)).moved(0, y, 0.012) for y in (-0.021, 1.001)),
        *(box((0.02, 1.0, 0.022)).moved(x, 0, 0.012) for x in (-0.761, 0.761)),
        box((0.5, 0.012, 0.06)).moved(0, -0.036, 0.035),
    ]
    place = (1.2, 1.0, SIZE[2])
    yield RoomPart("whiteboard", "picture", placed(board, 180, place), (0.76, 0.77, 0.77), 0.18)
    yield RoomPart("whiteboard rim", "picture", placed(joined(rim), 180, place), **STEEL, roughness=0.3)
    canvas, frame = framed(0.6, 0.8, -90, (SIZE[0] - 0.002, 1.65, 1.7))
    yield RoomPart("print", "picture", canvas, textures.shapes_print(), 0.6)
    yield RoomPart("print frame", "picture", frame, (0.05, 0.05, 0.055), 0.4)


def _storage(rng: np.random.Generator) -> Iterator[RoomPart]:
    size, place = (2.0, 1.1, 0.42), (SIZE[0] - 0.24, 0.0, 3.9)
    yield RoomPart("cabinet", "cupboard", placed(cupboard(size, (4, 1)), -90, place), (0.62, 0.63, 0.63), 0.35)
    grips = placed(handles(size, (4, 1), 0.16), -90, place)
    yield RoomPart("cabinet handles", "cupboard", grips, **STEEL, roughness=0.25)
    x, depth, width, top = 0.002, 0.32, 1.7, 1.9
    boards = [box((width, 0.022, depth)).moved(0, y, depth / 2) for y in (0.06, 0.52, 0.98, 1.44, top - 0.022)]
    uprights = [box((0.022, top, depth)).moved(dx, GAP, depth / 2) for dx in (-width / 2, 0, width / 2)]
    back = box((width, top, 0.01)).moved(0, GAP, 0.006)
    place = (x, 0, 6.1)
    rows = [
        books(rng, left, left + reach).moved(0, y + 0.023, 0.02)
        for y, left, reach in (
            (0.06, -0.82, 0.7), (0.06, 0.03, 0.5), (0.52, -0.82, 0.5), (0.52, 0.03, 0.78),
            (0.98, -0.82, 0.78), (0.98, 0.2, 0.5), (1.44, -0.6, 0.5), (1.44, 0.03, 0.6),
        )
    ]  # fmt: skip
    yield RoomPart("shelf", "shelf", placed(joined([*boards, *uprights, back]), 90, place), (0.60, 0.60, 0.58), 0.5)
    yield RoomPart("binders", "book", placed(joined(rows), 90, place), palette(*BOOK_COLORS), 0.6)
    bins = [
        lathed("0 0, 0.12 0, 0.15 0.32, 0.142 0.32, 0.112 0.01, 0 0.01", 28).moved(bx, GAP, bz)
        for bx, bz in ((2.75, 3.1), (5.6, 1.0))
    ]
    yield RoomPart("paper bins", "vase", joined(bins), **STEEL, roughness=0.45)


def _plant(rng: np.random.Generator) -> Iterator[RoomPart]:
    leaves = [
        foliage(rng, 16, (0.45, 0.62), 0.13, (0.5, 1.1), 0.5, (-0.42, -0.42), (0.42, 0.42)),
        foliage(rng, 10, (0.22, 0.36), 0.12, (0.8, 1.1), 0.30, (-0.4, -0.4), (0.4, 0.4)),
    ]
    pot = lathed(OUTLINES["plant pot"], 32).moved(0.5, GAP, 0.5)
    yield RoomPart("plant pot", "plant", pot, (0.64, 0.63, 0.60), 0.3)
    yield RoomPart("plant", "plant", joined(leaves).moved(0.5, 0.29, 0.5), (0.06, 0.18, 0.05), 0.5)


DESIGN = RoomDesign(SIZE, 2.5, furnish)
