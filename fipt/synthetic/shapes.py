"""Triangle shapes to furnish a room with: boxes, turned bodies, rods, cloth.

Every shape winds its triangles so that normals point outward (panels: along ``u x v``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

Vector: TypeAlias = Sequence[float] | np.ndarray
"""Three numbers."""


@dataclass(frozen=True)
class Shape:
    """Triangles with texture coordinates.

    Attributes
    ----------
    vertices
        (V, 3) float64 positions, metres.
    triangles
        (T, 3) int64 vertex indices.
    uv
        (V, 2) float64 texture coordinates in [0, 1].
    """

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray

    def moved(self, x: float, y: float, z: float) -> Shape:
        """Return the shape shifted by (x, y, z) metres."""
        return replace(self, vertices=np.add(self.vertices, (x, y, z)))

    def turned(self, degrees: float, axis: str = "y") -> Shape:
        """Return the shape turned around a world axis through the origin, right-handed."""
        first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        vertices = self.vertices.copy()
        vertices[:, first] = c * self.vertices[:, first] - s * self.vertices[:, second]
        vertices[:, second] = s * self.vertices[:, first] + c * self.vertices[:, second]
        return replace(self, vertices=vertices)

    def projected(self, first: int, second: int) -> Shape:
        """Return the shape with texture coordinates from two of its position's axes."""
        plane = self.vertices[:, [first, second]]
        low, high = plane.min(axis=0), plane.max(axis=0)
        return replace(self, uv=(plane - low) / (high - low))

    def tinted(self, index: int, count: int) -> Shape:
        """Return the shape in the one colour ``index`` of a texture of 1 x ``count`` texels."""
        u = index / max(count - 1, 1)
        return replace(self, uv=np.tile((u, 0.5), (len(self.vertices), 1)))


def joined(shapes: Sequence[Shape]) -> Shape:
    """Return several shapes as one, in order."""
    offsets = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    return Shape(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([s.triangles + offset for s, offset in zip(shapes, offsets, strict=False)]),
        np.concatenate([shape.uv for shape in shapes]),
    )


def _grid(points: np.ndarray, uv: np.ndarray | None = None) -> Shape:
    """Triangulate (rows, columns, 3) points; normals along d/drow x d/dcolumn."""
    rows, columns = points.shape[:2]
    if uv is None:
        u, v = np.linspace(0, 1, rows), np.linspace(0, 1, columns)
        uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    return Shape(points.reshape(-1, 3), quads.reshape(-1, 3), uv.reshape(-1, 2))


def _without_slivers(shape: Shape) -> Shape:
    """Drop triangles without area, such as those at the poles of a turned body."""
    a, b, c = np.moveaxis(shape.vertices[shape.triangles], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return replace(shape, triangles=shape.triangles[area > 1e-10])


def panel(origin: Vector, u: Vector, v: Vector, cell: float = np.inf) -> Shape:
    """Parallelogram ``origin + a u + b v`` with normal u x v, in cells of about ``cell`` metres."""
    start, first, second = (np.asarray(vector, float) for vector in (origin, u, v))
    counts = [max(round(float(np.linalg.norm(side)) / cell), 1) + 1 for side in (first, second)]
    a, b = (np.linspace(0, 1, count) for count in counts)
    return _grid(start + a[:, None, None] * first + b[None, :, None] * second)


def box(size: Sequence[float], radius: float = 0.0, steps: int = 1) -> Shape:
    """Box on the ground (centred in x and z, bottom at y = 0), edges rounded where ``radius`` > 0.

    Parameters
    ----------
    size
        Lengths along x, y, z, metres.
    radius
        Of the rounded edges, metres.
    steps
        Facets across a rounded edge are ``2 * steps``.
    """
    half = np.asarray(size, float) / 2
    radius = min(radius, 0.999 * half.min())
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        lines = [_ticks(half[k], radius, steps) for k in (first, second)]
        for sign in (-1.0, 1.0):
            points = np.empty((len(lines[0]), len(lines[1]), 3))
            points[..., axis] = sign * half[axis]
            points[..., first] = lines[0][:, None]
            points[..., second] = lines[1][None, :]
            face = _grid(points)
            if sign < 0:
                face = replace(face, triangles=face.triangles[:, ::-1])
            faces.append(face)
    shape = joined(faces)
    if radius > 0:
        core = np.clip(shape.vertices, radius - half, half - radius)
        away = shape.vertices - core
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        shape = replace(shape, vertices=core + radius * away)
    return shape.moved(0, half[1], 0)


def _ticks(half: float, radius: float, steps: int) -> np.ndarray:
    """Coordinates along a box's side: fine across the rounded ends, none between."""
    if radius <= 0:
        return np.array([-half, half])
    # Tangents of even angles make even facets once the points are drawn onto the round edge.
    end = radius * np.tan(np.linspace(0, np.pi / 4, steps + 1))
    right = half - radius + end
    return np.concatenate([-right[::-1], right])


def turned_body(profile: Sequence[Sequence[float]], segments: int = 32) -> Shape:
    """Body of revolution around the y axis.

    Parameters
    ----------
    profile
        (radius, height) pairs, metres; outward normals need the outline to go from the bottom over
        the outside to the top.
    segments
        Facets around the axis.
    """
    outline = np.asarray(profile, float)
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    points = np.stack(
        [
            outline[:, 0, None] * np.cos(angle),
            np.broadcast_to(outline[:, 1, None], (len(outline), segments + 1)),
            outline[:, 0, None] * np.sin(angle),
        ],
        axis=-1,
    )
    # The seam's two columns are one place: give them the same bits, so that nothing leaks.
    points[:, -1] = points[:, 0]
    return _without_slivers(_grid(points))


def ball(radius: float, segments: int = 24) -> Shape:
    """Sphere around the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    ring = np.abs(radius * np.cos(angle))
    ring[[0, -1]] = 0.0
    return turned_body(list(zip(ring, radius * np.sin(angle), strict=True)), segments)


def rod(start: Vector, end: Vector, radius: float, segments: int = 10) -> Shape:
    """Closed cylinder between two points."""
    base = np.asarray(start, float)
    axis = np.asarray(end, float) - base
    length = float(np.linalg.norm(axis))
    body = turned_body([(0, 0), (radius, 0), (radius, length), (0, length)], segments)
    y = axis / length
    x = np.cross(y, (0, 0, 1) if abs(y[2]) < 0.9 else (1, 0, 0))
    x /= np.linalg.norm(x)
    frame = np.stack([x, y, np.cross(x, y)])
    return replace(body, vertices=body.vertices @ frame + base)


def ring(radius: float, thickness: float, segments: int = 48, facets: int = 8) -> Shape:
    """Torus around the y axis."""
    angle = np.linspace(0, 2 * np.pi, facets + 1)
    outline = np.stack([radius + thickness * np.sin(angle), -thickness * np.cos(angle)], axis=1)
    outline[-1] = outline[0]
    return turned_body(outline.tolist(), segments)


def curtain(width: float, height: float, depth: float, folds: int, taper: float = 0.0) -> Shape:
    """Cloth along x that hangs from y = 0, folded in z; ``taper`` narrows it half way down."""
    u = np.linspace(0, 1, 8 * folds + 1)
    v = np.linspace(0, 1, 13)
    wave = np.sin(2 * np.pi * folds * u)
    swing = 0.55 + 0.45 * v
    narrow = 1 - taper * np.sin(np.pi * v) ** 2
    points = np.empty((len(u), len(v), 3))
    points[..., 0] = width * (u[:, None] - 0.5) * narrow
    points[..., 1] = -height * v
    points[..., 2] = depth * wave[:, None] * swing
    return _grid(points)


def leaf(length: float, width: float, rise: float, droop: float) -> Shape:
    """Leaf from the origin along x that rises and bends down again; one layer of triangles."""
    t = np.linspace(0, 1, 7)
    s = np.array([-1.0, 0.0, 1.0])
    points = np.empty((len(t), len(s), 3))
    points[..., 0] = length * t[:, None]
    points[..., 1] = (rise * t - droop * t**2)[:, None] + 0.12 * width * np.abs(s)
    points[..., 2] = width * np.sin(np.pi * np.clip(t + 0.03, 0, 1))[:, None] ** 0.8 * s / 2
    return _without_slivers(_grid(points))


def disc(radius: float, segments: int = 48) -> Shape:
    """Disc around the origin in the xz plane, facing down."""
    angle = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    rim = np.stack([radius * np.cos(angle), 0 * angle, radius * np.sin(angle)], axis=1)
    index = np.arange(segments)
    triangles = np.stack([0 * index, 1 + index, 1 + (index + 1) % segments], axis=1)
    return Shape(np.concatenate([np.zeros((1, 3)), rim]), triangles, np.full((segments + 1, 2), 0.5))
