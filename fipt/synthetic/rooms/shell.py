"""Floor, ceiling and walls of a room in code, with holes for its windows.

The interior is a box with one corner at the origin, y up; normals point inward. Walls are called by the compass: the
north wall is z = 0, the west wall x = 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fipt.synthetic.shapes import Shape, joined, panel

CELL = 0.25
"""Side of the cells that walls are split into: visibility is counted by triangle."""


@dataclass(frozen=True)
class Hole:
    """Opening in a surface, metres along its two sides; a pane closes its far end, ``depth`` behind the surface."""

    left: float
    right: float
    low: float
    high: float
    depth: float = 0.18


@dataclass(frozen=True)
class Side:
    """One side of the room: the points ``origin + a u + b v`` (a, b in metres) with normal u x v, inward.

    Attributes
    ----------
    origin, u, v
        (3,) corner, and unit vectors along the sides.
    width, height
        Metres along u and v.
    """

    origin: np.ndarray
    u: np.ndarray
    v: np.ndarray
    width: float
    height: float

    @property
    def normal(self) -> np.ndarray:
        """(3,) unit vector into the room."""
        return np.cross(self.u, self.v)

    def at(self, a: float, b: float, off: float = 0.0) -> np.ndarray:
        """(3,) point ``off`` metres into the room before (a, b)."""
        return self.origin + a * self.u + b * self.v + off * self.normal

    def surface(self, holes: Sequence[Hole] = (), cell: float = CELL) -> Shape:
        """Return the surface without its holes, and the holes' sides; texture coordinates run along u and v."""
        across = sorted({0.0, self.width, *(edge for hole in holes for edge in (hole.left, hole.right))})
        up = sorted({0.0, self.height, *(edge for hole in holes for edge in (hole.low, hole.high))})
        found = [
            panel(self.at(a0, b0), (a1 - a0) * self.u, (b1 - b0) * self.v, cell)
            for a0, a1 in pairwise(across)
            for b0, b1 in pairwise(up)
            if not any(h.left <= a0 < h.right and h.low <= b0 < h.high for h in holes)
        ]
        for hole in holes:
            inward = hole.depth * self.normal
            right, top = (hole.right - hole.left) * self.u, (hole.high - hole.low) * self.v
            corner = self.at(hole.left, hole.low, -hole.depth)
            found += [
                panel(corner, top, inward, cell),
                panel(corner + right, inward, top, cell),
                panel(corner, inward, right, cell),
                panel(corner + top, right, inward, cell),
            ]
        whole = joined(found)
        place = (whole.vertices - self.origin) @ np.stack([self.u, self.v], axis=1) / (self.width, self.height)
        return Shape(whole.vertices, whole.triangles, place)

    def pane(self, hole: Hole, cell: float = 0.7) -> Shape:
        """Return what closes the far end of a hole."""
        corner = self.at(hole.left, hole.low, -hole.depth)
        return panel(corner, (hole.right - hole.left) * self.u, (hole.high - hole.low) * self.v, cell)


def sides(size: Sequence[float]) -> dict[str, Side]:
    """Return ``north``, ``south``, ``west``, ``east``, ``floor`` and ``ceiling`` of a room of ``size`` (3,) metres.

    On walls, seen from inside, u runs to the right and v up. The floor's u runs along z, v along x; the ceiling's u
    along x, v along z.
    """
    x, y, z = np.eye(3)
    width, height, depth = size
    return {
        "north": Side(np.zeros(3), x, y, width, height),
        "south": Side(np.array([width, 0, depth]), -x, y, width, height),
        "west": Side(np.array([0, 0, depth]), -z, y, depth, height),
        "east": Side(np.array([width, 0, 0]), z, y, depth, height),
        "floor": Side(np.zeros(3), z, x, depth, width),
        "ceiling": Side(np.array([0, height, 0]), x, z, width, depth),
    }
