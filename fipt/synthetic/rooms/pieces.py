"""Furniture that several rooms share. Pieces stand at the origin on the ground and face +z, where they have a front."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fipt.synthetic.parts import cushion
from fipt.synthetic.shapes import Shape, Vector, box, joined, leaf, panel, rod
from fipt.synthetic.textures import Rgb

GAP = 0.001
"""Between pieces, metres: no two surfaces coincide."""

BOOK_COLORS = (
    (0.42, 0.09, 0.05), (0.06, 0.14, 0.28), (0.62, 0.55, 0.40), (0.10, 0.26, 0.20),
    (0.60, 0.36, 0.08), (0.25, 0.10, 0.17), (0.55, 0.60, 0.62), (0.08, 0.08, 0.09),
)  # fmt: skip


def placed(shape: Shape, degrees: float, place: Vector) -> Shape:
    """Turn a piece from facing +z around the y axis (90: it faces +x), and stand it at a place (3,)."""
    return shape.turned(degrees).moved(*place)


def framed(width: float, height: float, degrees: float, place: Rgb) -> tuple[Shape, Shape]:
    """Canvas and frame, turned from facing z and hung at ``place``."""
    canvas = panel((-width / 2, -height / 2, 0.012), (width, 0, 0), (0, height, 0))
    t = 0.025
    sides = [
        *(box((width + 2 * t, t, 0.03)).moved(0, y, 0.015) for y in (-height / 2 - t, height / 2)),
        *(box((t, height, 0.03)).moved(x, -height / 2, 0.015) for x in (-(width + t) / 2, (width + t) / 2)),
    ]
    canvas, frame = canvas.projected(0, 1), joined(sides)
    return canvas.turned(degrees).moved(*place), frame.turned(degrees).moved(*place)


def foliage(
    rng: np.random.Generator,
    count: int,
    length: tuple[float, float],
    width: float,
    rise: tuple[float, float],
    droop: float,
    low: tuple[float, float],
    high: tuple[float, float],
) -> Shape:
    """Leaves all around the origin, shortened to stay within ``low`` and ``high`` in x and z."""
    leaves = []
    for index in range(count):
        shape = leaf(
            rng.uniform(*length),
            width * rng.uniform(0.8, 1.2),
            rng.uniform(*rise),
            droop * rng.uniform(0.6, 1.2),
        ).turned(137.5 * index + rng.uniform(-15, 15))
        flat = shape.vertices[:, [0, 2]]
        excess = max((flat / high).max(), (flat / low).max(), 1.0)
        leaves.append(replace(shape, vertices=shape.vertices / (excess, 1, excess)))
    return joined(leaves)


def screen(width: float, height: float, columns: int = 1, rows: int = 1) -> tuple[Shape, Shape]:
    """Display and housing of a screen whose lower edge is at y = 0, the housing's back at z = 0.

    The display stands 4 mm behind the housing's rim; its cells are ordered by column, then by row from below, two
    triangles each.
    """
    depth, rim = 0.04, 0.012
    low = (-width / 2, rim, depth - 0.004)
    corners = [
        panel(
            (low[0] + i * width / columns, rim + j * height / rows, low[2]),
            (width / columns, 0, 0),
            (0, height / rows, 0),
        )
        for i in range(columns)
        for j in range(rows)
    ]
    behind = depth - 0.005
    housing = [
        box((width + 2 * rim, height + 2 * rim, behind)).moved(0, 0, behind / 2),
        *(box((width + 2 * rim, rim, 0.006)).moved(0, y, depth - 0.003) for y in (0, height + rim)),
        *(box((rim, height, 0.006)).moved(x, rim, depth - 0.003) for x in (-(width + rim) / 2, (width + rim) / 2)),
    ]
    return joined(corners), joined(housing)


def chair(seat: float = 0.45, width: float = 0.42) -> tuple[Shape, Shape]:
    """Shell and thin legs of a plain chair."""
    half = width / 2 - 0.03
    shell = [
        box((width, 0.02, width), 0.008).moved(0, seat, 0),
        box((width - 0.02, 0.30, 0.018), 0.008).turned(-8, "x").moved(0, seat + 0.12, -width / 2 - 0.02),
    ]
    legs = [
        *(rod((1.12 * x, 0.004, half), (x, seat - 0.012, half), 0.009, 8) for x in (-half, half)),
        *(rod((1.12 * x, 0.004, -1.2 * half), (x, seat - 0.012, -half), 0.009, 8) for x in (-half, half)),
        *(rod((x, seat - 0.014, -half), (x, seat - 0.014, half), 0.009, 8) for x in (-half, half)),
        *(rod((x, seat - 0.014, -half), (x, seat + 0.30, -width / 2 - 0.045), 0.009, 8) for x in (-half, half)),
    ]
    return joined(shell), joined(legs)


def office_chair(turn: float) -> tuple[Shape, Shape, Shape]:
    """Cushions, metal and castors of a swivel chair whose star is turned by ``turn`` degrees."""
    cushions = [
        cushion(0.48, 0.08, 0.46, 0.03).moved(0, 0.45, 0),
        cushion(0.44, 0.52, 0.06, 0.028).turned(-9, "x").moved(0, 0.62, -0.24),
    ]
    metal = [
        rod((0, 0.10, 0), (0, 0.445, 0), 0.022, 12),
        rod((0, 0.43, -0.02), (0, 0.43, -0.30), 0.016, 8),
        rod((0, 0.42, -0.30), (0, 0.80, -0.315), 0.014, 8),
    ]
    castors = []
    for k in range(5):
        metal.append(rod((0, 0.11, 0), (0.27, 0.072, 0), 0.013, 8).turned(72 * k + turn))
        castors.append(rod((0.265, 0.029, -0.02), (0.265, 0.029, 0.02), 0.028, 12).turned(72 * k + turn))
    return joined(cushions), joined(metal), joined(castors)


def table(size: Sequence[float], thickness: float, leg: float) -> tuple[Shape, Shape]:
    """Top and square legs of a table of ``size`` (x, height, z), metres; legs are ``leg`` metres wide."""
    width, height, depth = size
    top = box((width, thickness, depth), 0.004).moved(0, height - thickness, 0).projected(0, 2)
    under = height - thickness - GAP
    x, z = width / 2 - 0.05, depth / 2 - 0.05
    frame = [
        *(box((leg, under - GAP, leg)).moved(dx, GAP, dz) for dx in (-x, x) for dz in (-z, z)),
        *(box((2 * x - leg, leg, leg)).moved(0, under - leg, dz) for dz in (-z, z)),
        *(box((leg, leg, 2 * z - leg)).moved(dx, under - leg, 0) for dx in (-x, x)),
    ]
    return top, joined(frame)


def books(rng: np.random.Generator, start: float, end: float, largest: tuple[float, float] = (0.32, 0.21)) -> Shape:
    """Row of upright books along x, backs in the plane z = 0, of the colours `BOOK_COLORS`."""
    found, x, count = [], start, len(BOOK_COLORS)
    while x < end - 0.06:
        w, h, d = rng.uniform((0.022, 0.6 * largest[0], 0.7 * largest[1]), (0.055, *largest))
        found.append(box((w, h, d)).moved(x + w / 2, 0, d / 2).tinted(int(rng.integers(count)), count))
        x += w + 2 * GAP
    return joined(found)


def cupboard(size: Sequence[float], fronts: tuple[int, int], plinth: float = 0.08) -> Shape:
    """Body with fronts (columns, rows) and a plinth set back; ``size`` is (x, height, z), the front faces +z."""
    width, height, depth = size
    columns, rows = fronts
    w, h = width / columns, (height - plinth) / rows
    doors = [
        box((w - 0.004, h - 0.004, 0.018), 0.002).moved(
            -width / 2 + (i + 0.5) * w, plinth + j * h + 0.002, depth / 2 - 0.008
        )
        for i in range(columns)
        for j in range(rows)
    ]
    body = box((width, height - plinth, depth - 0.02)).moved(0, plinth, -0.01)
    foot = [box((width - 0.02, plinth, depth - 0.08)).moved(0, GAP, -0.03)] if plinth else []
    return joined([body, *foot, *doors])


def handles(size: Sequence[float], fronts: tuple[int, int], length: float, plinth: float = 0.08) -> Shape:
    """Upright handles of `cupboard`, a millimetre off its fronts, in pairs of neighbouring doors."""
    width, height, depth = size
    columns, rows = fronts
    w, h = width / columns, (height - plinth) / rows
    found = []
    for i in range(columns):
        for j in range(rows):
            side = 0.5 * w - 0.04 if i % 2 == 0 else -0.5 * w + 0.04
            x, y = -width / 2 + (i + 0.5) * w + side, plinth + (j + 0.5) * h
            front = depth / 2 + 0.010 + GAP
            found.append(rod((x, y - length / 2, front + 0.028), (x, y + length / 2, front + 0.028), 0.006, 8))
            found += [
                rod((x, y + dy, front), (x, y + dy, front + 0.028), 0.004, 6) for dy in (-0.4 * length, 0.4 * length)
            ]
    return joined(found)


def basin(outer: Sequence[float], wall: float, depth: float) -> Shape:
    """Closed tub on the ground, centred in x and z, open at the top.

    Parameters
    ----------
    outer
        Lengths along x, y, z, metres.
    wall, depth
        Thickness of its walls and depth of its inside, metres.
    """
    width, height, length = outer
    x, z = width / 2, length / 2
    inner_x, inner_z, low = x - wall, z - wall, height - depth

    def ground(half_x: float, half_z: float, y: float) -> Shape:
        return panel((-half_x, y, -half_z), (0, 0, 2 * half_z), (2 * half_x, 0, 0))

    def around(half_x: float, half_z: float, y0: float, y1: float, inward: bool) -> list[Shape]:
        up, found = np.array([0, y1 - y0, 0]), []
        corners = [np.array([a * half_x, y0, b * half_z]) for a, b in ((-1, 1), (1, 1), (1, -1), (-1, -1))]
        for first, second in zip(corners, corners[1:] + corners[:1], strict=True):
            sides = (up, second - first) if inward else (second - first, up)
            found.append(panel(first, *sides))
        return found

    rim = [
        panel((-x, height, -z), (0, 0, 2 * z), (wall, 0, 0)),
        panel((inner_x, height, -z), (0, 0, 2 * z), (wall, 0, 0)),
        panel((-inner_x, height, -z), (0, 0, wall), (2 * inner_x, 0, 0)),
        panel((-inner_x, height, inner_z), (0, 0, wall), (2 * inner_x, 0, 0)),
    ]
    below = panel((-x, 0, -z), (2 * x, 0, 0), (0, 0, 2 * z))
    sides = [*around(x, z, 0, height, False), *around(inner_x, inner_z, low, height, True)]
    return joined([ground(inner_x, inner_z, low), below, *rim, *sides])


def skirting(size: Sequence[float], height: float = 0.07, thickness: float = 0.014) -> Shape:
    """Strips along the walls of a room of ``size`` (3,), a millimetre off floor and walls."""
    width, _, depth = size
    off = GAP + thickness / 2
    return joined(
        [
            *(box((width, height, thickness)).moved(width / 2, GAP, z) for z in (off, depth - off)),
            *(box((thickness, height, depth - 0.05)).moved(x, GAP, depth / 2) for x in (off, width - off)),
        ]
    )


def door(width: float = 0.86, height: float = 2.05) -> tuple[Shape, Shape, Shape]:
    """Leaf, jamb and handle of a closed door whose back lies a millimetre before z = 0."""
    leaf_shape = box((width, height, 0.03), 0.004).moved(0, GAP, 0.018)
    jamb = [
        *(
            box((0.06, height + 0.06, 0.045), 0.005).moved(x, GAP, 0.025)
            for x in (-width / 2 - 0.031, width / 2 + 0.031)
        ),
        box((width, 0.058, 0.045), 0.005).moved(0, height + 2 * GAP, 0.025),
    ]
    x = width / 2 - 0.07
    handle = [
        rod((x, 1.0, 0.034), (x, 1.0, 0.085), 0.010, 10),
        rod((x + 0.008, 1.0, 0.085), (x - 0.12, 1.0, 0.085), 0.010, 10),
        rod((x, 1.0, 0.034), (x, 1.0, 0.040), 0.024, 12),
    ]
    return leaf_shape, joined(jamb), joined(handle)


def tap(height: float, reach: float) -> Shape:
    """Upright pipe with a spout towards +z and a lever."""
    return joined(
        [
            rod((0, 0, 0), (0, 0.012, 0), 0.028, 16),
            rod((0, 0.012, 0), (0, height, 0), 0.014, 12),
            rod((0, height - 0.014, 0), (0, height - 0.014, reach), 0.012, 12),
            rod((0, height - 0.014, reach - 0.012), (0, height - 0.05, reach - 0.012), 0.011, 12),
            rod((0.012, 0.06, 0), (0.075, 0.09, 0), 0.007, 8),
        ]
    )
