"""A small bathroom: glossy tiles with rough joints, a mirror, chrome, a frosted globe and a dim lampshade."""

from collections.abc import Iterator

import numpy as np

from fipt.synthetic import textures
from fipt.synthetic.parts import BLACK, WHITE_PAINT, RoomPart, cushion, lathed, palette
from fipt.synthetic.rooms.design import RoomDesign
from fipt.synthetic.rooms.pieces import GAP, basin, cupboard, door, foliage, placed, tap
from fipt.synthetic.rooms.shell import Hole, sides
from fipt.synthetic.shapes import Shape, ball, box, curtain, joined, panel, ring, rod, turned_body

SIZE = (2.4, 2.5, 3.0)
"""Interior along x, y, z, metres."""

_WINDOW = Hole(1.15, 1.75, 1.35, 2.1, 0.14)
_CHROME = {"color": (0.72, 0.73, 0.75), "metallic": 1.0}
_PORCELAIN = (0.76, 0.76, 0.74)
_BASIN_Z = 1.05
"""Middle of washbasin and mirror, on the east wall."""


def furnish(rng: np.random.Generator) -> list[RoomPart]:
    """Return all parts, emitters first; ``rng`` draws tones of tiles and cloth, and leaves."""
    return [
        *_emitters(),
        *_shell(rng),
        *_lights(),
        *_bath(rng),
        *_washbasin(rng),
        *_toilet(),
        *_textiles(rng),
        *_details(rng),
    ]


def _emitters() -> Iterator[RoomPart]:
    pane = sides(SIZE)["north"].pane(_WINDOW, 0.4)
    shade = turned_body([(0.085, 0), (0.095, 0.0), (0.075, 0.16), (0.065, 0.16)], 32)
    yield RoomPart("window pane", "window", pane, BLACK, radiance=(3.6, 4.1, 4.8))
    yield RoomPart(
        "ceiling globe", "lamp", ball(0.14, 28).moved(1.45, SIZE[1] - 0.20, 1.6), BLACK, radiance=(5.2, 4.7, 3.9)
    )
    yield RoomPart(
        "lampshade", "lamp", _without_ends(shade).moved(2.18, 1.02, 0.35), BLACK, radiance=(0.42, 0.31, 0.18)
    )


def _without_ends(shape: Shape) -> Shape:
    """Leave a shade's outer side only."""
    corners = shape.vertices[shape.triangles]
    flat = np.ptp(corners[:, :, 1], axis=1) < 1e-6
    return Shape(shape.vertices, shape.triangles[~flat], shape.uv)


def _shell(rng: np.random.Generator) -> Iterator[RoomPart]:
    room = sides(SIZE)
    width, height, depth = SIZE
    white, grout = (0.72, 0.73, 0.71), (0.34, 0.33, 0.31)
    for name, length, color in (
        ("north", width, white), ("west", depth, (0.12, 0.30, 0.32)), ("east", depth, white), ("south", width, white)
    ):  # fmt: skip
        image, joint = textures.grid(rng, (length, height), (0.2, 0.1), 0.008, (color, grout), 0.05, 0.5, 0.004)
        holes = (_WINDOW,) if name == "north" else ()
        yield RoomPart(f"{name} wall", "wall", room[name].surface(holes), image, np.where(joint, 0.9, 0.2))
    image, joint = textures.grid(
        rng, (depth, width), (0.1, 0.1), 0.008, ((0.15, 0.16, 0.18), (0.42, 0.41, 0.39)), 0.10, 0.0, 0.004
    )
    yield RoomPart("floor", "floor", room["floor"].surface(), image, np.where(joint, 0.9, 0.35))
    yield RoomPart("ceiling", "ceiling", room["ceiling"].surface(), (0.76, 0.76, 0.75))
    x, y, bar = (_WINDOW.left + _WINDOW.right) / 2, _WINDOW.low + GAP, 0.05
    w, h = _WINDOW.right - _WINDOW.left - 2 * GAP, _WINDOW.high - _WINDOW.low - 2 * GAP
    bars = [
        *(box((w, bar, 0.04)).moved(x, low, -0.10) for low in (y, y + h - bar)),
        *(
            box((bar, h - 2 * bar - 2 * GAP, 0.04)).moved(x + dx, y + bar + GAP, -0.10)
            for dx in (-(w - bar) / 2, (w - bar) / 2)
        ),
    ]
    yield RoomPart("window frame", "window", joined(bars), WHITE_PAINT, 0.4)
    leaf, jamb, handle = (placed(shape, 180, (1.75, 0, depth)) for shape in door(0.8, 2.02))
    yield RoomPart("door", "door", leaf, (0.62, 0.60, 0.54), 0.45)
    yield RoomPart("door frame", "door", jamb, WHITE_PAINT, 0.5)
    yield RoomPart("door handle", "door", handle, **_CHROME, roughness=0.15)


def _lights() -> Iterator[RoomPart]:
    fitting = [
        rod((1.45, SIZE[1] - 0.03, 1.6), (1.45, SIZE[1] - GAP, 1.6), 0.07, 24),
        rod((1.45, SIZE[1] - 0.062, 1.6), (1.45, SIZE[1] - 0.031, 1.6), 0.05, 24),
    ]
    foot = lathed("0 0, 0.05 0, 0.05 0.01, 0.012 0.02, 0.012 0.15, 0 0.15").moved(2.18, 0.861, 0.35)
    closing = [
        turned_body([(0, -0.001), (0.094, -0.001), (0.094, 0.0), (0, 0.0)], 32).moved(2.18, 1.018, 0.35),
        turned_body([(0, 0.1605), (0.074, 0.1605), (0.074, 0.1615), (0, 0.1615)], 32).moved(2.18, 1.02, 0.35),
    ]
    yield RoomPart("globe fitting", "lamp", joined(fitting), **_CHROME, roughness=0.2)
    yield RoomPart("lampshade foot", "lamp", foot, **_CHROME, roughness=0.2)
    yield RoomPart("lampshade lids", "lamp", joined(closing), (0.60, 0.56, 0.48), 0.9)


def _bath(rng: np.random.Generator) -> Iterator[RoomPart]:
    tub = basin((0.74, 0.56, 1.7), 0.06, 0.40).moved(0.372, GAP, 0.853)
    rail = [
        rod((0.04, 1.05, 0.10), (0.04, 2.10, 0.10), 0.010, 10),
        *(rod((0.002, y, 0.10), (0.04, y, 0.10), 0.008, 8) for y in (1.10, 2.05)),
        rod((0.04, 2.0, 0.10), (0.14, 1.93, 0.16), 0.010, 8),
        rod((0.14, 1.935, 0.16), (0.15, 1.90, 0.166), 0.05, 20),
    ]
    mixer = [
        rod((0.30, 0.78, GAP), (0.30, 0.78, 0.07), 0.024, 16),
        rod((0.20, 0.78, 0.07), (0.44, 0.78, 0.07), 0.020, 16),
        rod((0.32, 0.78, 0.07), (0.32, 0.74, 0.19), 0.013, 12),
    ]
    yellow = textures.weave(rng, (0.56, 0.46, 0.20), 120, 120)
    cloth = curtain(0.42, 1.55, 0.035, 5).turned(90).moved(0.78, 2.04, 1.47)
    pole = [
        rod((0.78, 2.06, GAP), (0.78, 2.06, 1.75), 0.012, 10),
        rod((0.002, 2.06, 1.74), (0.77, 2.06, 1.74), 0.012, 10),
    ]
    yield RoomPart("bath", "bath", tub, _PORCELAIN, 0.15)
    yield RoomPart("shower", "tap", joined([*rail, *mixer]), **_CHROME, roughness=0.15)
    yield RoomPart("shower curtain", "curtain", cloth, yellow, 0.7)
    yield RoomPart("shower pole", "curtain", joined(pole), **_CHROME, roughness=0.2)


def _washbasin(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z, size = SIZE[0] - 0.225, _BASIN_Z, (1.2, 0.68, 0.44)
    oak = textures.wood(rng, 90, 200, (0.50, 0.33, 0.18), (0.38, 0.23, 0.11))
    body = placed(cupboard(size, (2, 1)).projected(0, 1), -90, (x, 0, z))
    slab = box((0.446, 0.03, 1.22), 0.004).moved(x, 0.683, z)
    bowl = lathed("0 0, 0.14 0, 0.19 0.06, 0.205 0.13, 0.195 0.132, 0.175 0.07, 0.13 0.02, 0 0.014", 40).moved(
        x + 0.02, 0.714, z
    )
    faucet = placed(tap(0.26, 0.15), -90, (SIZE[0] - 0.045, 0.714, z + 0.16))
    mirror = panel((0, 0, 0.014), (0.8, 0, 0), (0, 0.95, 0), 0.4).moved(-0.4, 0, 0)
    behind = box((0.82, 0.97, 0.012)).moved(0, -0.01, 0.007)
    hung = (SIZE[0], 1.12, z)
    things = [
        lathed("0 0, 0.03 0, 0.03 0.12, 0.012 0.135, 0.012 0.16, 0 0.16", 20)
        .moved(x + 0.08, 0.714, z + 0.36)
        .tinted(0, 3),
        lathed("0 0, 0.025 0, 0.028 0.09, 0 0.09", 20).moved(x + 0.02, 0.714, z + 0.46).tinted(1, 3),
        lathed("0 0, 0.036 0, 0.038 0.1, 0.034 0.1, 0.033 0.01, 0 0.01", 20).moved(x, 0.714, z - 0.32).tinted(2, 3),
    ]
    yield RoomPart("vanity", "cupboard", body, oak, 0.45)
    yield RoomPart("vanity top", "cupboard", slab, (0.12, 0.12, 0.125), 0.2)
    yield RoomPart("washbasin", "sink", bowl, _PORCELAIN, 0.15)
    yield RoomPart("tap", "tap", faucet, **_CHROME, roughness=0.15)
    yield RoomPart("mirror", "mirror", placed(mirror, -90, hung), (0.85, 0.86, 0.86), 0.05, 1.0)
    yield RoomPart("mirror back", "mirror", placed(behind, -90, hung), (0.05, 0.05, 0.05), 0.5)
    colors = palette((0.58, 0.20, 0.10), (0.66, 0.64, 0.58), (0.10, 0.28, 0.36))
    yield RoomPart("bottles", "vase", joined(things), colors, 0.25)


def _toilet() -> Iterator[RoomPart]:
    outline = "0 0, 0.11 0, 0.10 0.10, 0.13 0.26, 0.185 0.38, 0.185 0.40, 0.15 0.40, 0.12 0.30, 0.05 0.22, 0 0.22"
    bowl = lathed(outline, 36)
    bowl = Shape(bowl.vertices * (1.3, 1, 1), bowl.triangles, bowl.uv).moved(0.42, GAP, 2.35)
    cistern = box((0.17, 0.38, 0.40), 0.02).moved(0.09, 0.42, 2.35)
    seat = ring(0.160, 0.016, 36, 8)
    seat = Shape(seat.vertices * (1.3, 0.7, 1), seat.triangles, seat.uv).moved(0.42, 0.418, 2.35)
    button = rod((0.09, 0.8015, 2.35), (0.09, 0.808, 2.35), 0.022, 16)
    yield RoomPart("toilet", "toilet", joined([bowl, cistern]), _PORCELAIN, 0.15)
    yield RoomPart("toilet seat", "toilet", seat, (0.05, 0.05, 0.055), 0.3)
    yield RoomPart("toilet button", "toilet", button, **_CHROME, roughness=0.2)


def _textiles(rng: np.random.Generator) -> Iterator[RoomPart]:
    x, z = SIZE[0] - 0.07, 2.25
    rungs = [rod((x, y, z - 0.25), (x, y, z + 0.25), 0.010, 10) for y in np.arange(0.55, 1.66, 0.11)]
    posts = [rod((x, 0.50, z + dz), (x, 1.70, z + dz), 0.014, 10) for dz in (-0.25, 0.25)]
    feet = [rod((x, y, z + dz), (SIZE[0] - GAP, y, z + dz), 0.008, 8) for y in (0.6, 1.6) for dz in (-0.25, 0.25)]
    towel = cushion(0.05, 0.46, 0.34, 0.02).moved(x - 0.042, 1.12, z)
    low = cushion(0.05, 0.34, 0.34, 0.02).moved(x - 0.042, 0.62, z + 0.02)
    mat = cushion(0.55, 0.022, 0.85, 0.01).moved(1.18, GAP, 0.95)
    basket = lathed("0 0, 0.17 0, 0.19 0.46, 0.182 0.46, 0.165 0.01, 0 0.01", 32).moved(0.95, GAP, 2.74)
    towels = joined([towel.tinted(0, 2), low.tinted(1, 2)])
    yield RoomPart("towel radiator", "radiator", joined([*rungs, *posts, *feet]), **_CHROME, roughness=0.2)
    yield RoomPart("towels", "towel", towels, palette((0.60, 0.16, 0.14), (0.66, 0.60, 0.48)))
    yield RoomPart("bath mat", "rug", mat.projected(0, 2), textures.weave(rng, (0.30, 0.36, 0.42), 100, 70))
    yield RoomPart("laundry basket", "basket", basket, textures.weave(rng, (0.46, 0.33, 0.18), 64, 160), 0.8)


def _details(rng: np.random.Generator) -> Iterator[RoomPart]:
    shelf = box((0.12, 0.02, 0.60), 0.003).moved(0.062, 1.35, 2.35)
    rolls = [rod((0.075, 1.415, 2.18 + dz), (0.075, 1.415, 2.28 + dz), 0.044, 20) for dz in (0.0, 0.115)]
    pot = lathed("0 0, 0.05 0, 0.06 0.1, 0.053 0.1, 0.045 0.02, 0 0.02", 24).moved(0.065, 1.371, 2.53)
    leaves = foliage(rng, 16, (0.12, 0.2), 0.05, (0.05, 0.2), 0.22, (-0.055, -0.25), (0.3, 0.25)).moved(
        0.065, 1.46, 2.53
    )
    yield RoomPart("shelf", "shelf", shelf, (0.48, 0.32, 0.17), 0.5)
    yield RoomPart("paper rolls", "towel", joined(rolls), (0.74, 0.74, 0.72))
    yield RoomPart("pot", "plant", pot, (0.62, 0.40, 0.26), 0.5)
    yield RoomPart("leaves", "plant", leaves, (0.08, 0.22, 0.06), 0.5)


DESIGN = RoomDesign(SIZE, 3.7, furnish)
