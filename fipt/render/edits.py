"""Where a setup changes the room: segments and boxes, what vanishes there, and other materials."""

import logging
from dataclasses import dataclass, replace

import numpy as np

from fipt.errors import FiptError
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.setup import BrushBox, MaterialEdit, RelightSetup, Removal

log = logging.getLogger(__name__)

_FAR = 0.5
"""Metres from a point to the surface that it means, from which that is told."""
_LISTED = 12
"""Segments that an error lists with their places."""


@dataclass(frozen=True)
class Box:
    """A box: (3,) center and half its sides, metres; (3, 3) rotation from its axes to the world's."""

    center: np.ndarray
    half: np.ndarray
    turn: np.ndarray

    def holds(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of (N, 3) points."""
        return np.all(np.abs((points - self.center) @ self.turn) <= self.half, axis=1)


@dataclass(frozen=True)
class Edit:
    """Another material somewhere.

    Attributes
    ----------
    change
        What it becomes.
    where
        (T,) bool triangles, or a box.
    """

    change: MaterialEdit
    where: np.ndarray | Box

    def holds(self, points: np.ndarray, triangle: np.ndarray) -> np.ndarray:
        """(N,) bool: whether it changes the surface at points (N, 3) on triangles (N,), -1 = unknown."""
        if isinstance(self.where, Box):
            return self.where.holds(points)
        return (triangle >= 0) & np.append(self.where, False)[np.clip(triangle, -1, len(self.where))]

    def of_triangles(self, chosen: np.ndarray) -> "Edit":
        """Return the edit for a mesh that has only the ``chosen`` triangles (K,)."""
        return self if isinstance(self.where, Box) else replace(self, where=self.where[chosen])

    def extended(self, count: int) -> "Edit":
        """Return the edit for a mesh of ``count`` triangles whose first ones are those it knows."""
        if isinstance(self.where, Box):
            return self
        return replace(self, where=np.pad(self.where, (0, count - len(self.where))))

    def color(self, found: np.ndarray) -> np.ndarray:
        """Base colour (N, 3) after the change."""
        if self.change.tint is not None:
            return np.minimum(found * np.array(self.change.tint, np.float32), 1)
        return found if self.change.base_color is None else np.broadcast_to(self.change.base_color, found.shape)


class Segments:
    """The segments of a mesh, by number or by a point.

    Parameters
    ----------
    mesh
        T triangles.
    ids
        (T,) fused segment of each, 0 = unknown; None: connected parts, from 0.
    up
        Axis that points up.
    """

    def __init__(self, mesh: Mesh, ids: np.ndarray | None, up: str) -> None:
        self._mesh, self._fused, self._up = mesh, ids is not None, up
        self._ids = ids

    def edits(self, setup: RelightSetup) -> list[Edit]:
        """The changed materials of a setup, in order."""
        return [Edit(edit, self._where(edit, f"materials.{number}")) for number, edit in enumerate(setup.materials)]

    def removed(self, setup: RelightSetup) -> np.ndarray:
        """(T,) bool: what a setup takes out of the room."""
        gone = np.zeros(len(self._mesh.triangles), bool)
        for number, entry in enumerate(setup.remove):
            where = self._where(entry, f"remove.{number}")
            if isinstance(where, Box):
                where = where.holds(self._mesh.corners.mean(axis=1))
                log.info("remove.%d: %d triangles have their centre in the box", number, where.sum())
            gone |= where
        return gone

    @property
    def ids(self) -> np.ndarray:
        """(T,) number of each triangle's segment."""
        if self._ids is None:
            self._ids = connected_parts(self._mesh)
        return self._ids

    def described(self, triangle: int) -> str:
        """Say of which segment a triangle is, for people."""
        number = int(self.ids[triangle])
        return "of no segment" if self._fused and number == 0 else self._described(number)

    def _described(self, number: int) -> str:
        own = self.ids == number
        place = ", ".join(f"{value:.2f}" for value in self._mesh.corners[own].mean(axis=(0, 1)))
        return f"segment {number}, {int(own.sum())} triangles, {self._mesh.areas[own].sum():.3g} m2, around ({place})"

    def _where(self, entry: Removal, name: str) -> np.ndarray | Box:
        if entry.box is not None:
            return self._box(entry.box, name)
        chosen = entry.segment
        if chosen is None:
            assert entry.at is not None  # one of the three is given
            chosen = self._at(entry.at, name)
        own = self.ids == chosen
        if not own.any() or (self._fused and chosen == 0):
            raise FiptError(f"{name} names segment {chosen}, which does not exist", self._listing())
        log.info("%s: %s", name, self._described(chosen))
        return own

    def _at(self, point: tuple[float, float, float], name: str) -> int:
        """Segment of the surface nearest to a point."""
        import trimesh

        corners = self._mesh.corners.astype(np.float64)
        nearest = trimesh.triangles.closest_point(corners, np.tile(point, (len(corners), 1)))
        away = np.linalg.norm(nearest - point, axis=1)
        if away.min() > _FAR:
            log.warning("%s: the surface nearest to %s is %.2g m away from it", name, point, away.min())
        chosen = int(self.ids[away.argmin()])
        if self._fused and chosen == 0:
            raise FiptError(f"{name}: the surface nearest to {point} belongs to no segment", "choose a box instead")
        return chosen

    def _box(self, box: BrushBox, name: str) -> Box:
        c, s = np.cos(np.radians(box.rotation)), np.sin(np.radians(box.rotation))
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]] if self._up == "y" else [[c, -s, 0], [s, c, 0], [0, 0, 1]])
        made = Box(np.array(box.center, float), np.array(box.size, float) / 2, turn)
        local = (self._mesh.corners - made.center) @ made.turn
        if not ((local.min(axis=1) <= made.half) & (local.max(axis=1) >= -made.half)).all(axis=1).any():
            log.warning("%s: the box touches no surface; nothing is changed", name)
        return made

    def _listing(self) -> str:
        """Which segments there are: all numbers, and where the largest are."""
        numbers = np.unique(self.ids)
        numbers = numbers[numbers > 0] if self._fused else numbers
        if not len(numbers):
            return "there is none; choose a box instead"
        ends = np.flatnonzero(np.diff(numbers) > 1)
        starts, stops = numbers[np.append(0, ends + 1)], numbers[np.append(ends, len(numbers) - 1)]
        ranges = ", ".join(f"{a}" if a == b else f"{a} to {b}" for a, b in zip(starts, stops, strict=True))
        areas = np.bincount(self.ids, self._mesh.areas)
        largest = []
        for number in numbers[np.argsort(-areas[numbers], kind="stable")][:_LISTED]:
            x, y, z = self._mesh.corners[self.ids == number].mean(axis=(0, 1))
            largest.append(f"{number} around ({x:.1f}, {y:.1f}, {z:.1f})")
        return f"there are {ranges}; the largest: {'; '.join(largest)}; or give a point: at: [x, y, z]"


def without(mesh: Mesh, gone: np.ndarray) -> Mesh:
    """Return a mesh whose triangles (T,) ``gone`` are points that no ray meets; numbers stay as they are."""
    return replace(mesh, triangles=np.where(gone[:, None], mesh.triangles[:, :1], mesh.triangles))
