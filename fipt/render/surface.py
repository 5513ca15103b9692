"""What a ray finds on the surface: cached radiance and material by voxel, normal and emitter by triangle."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters, emits
from fipt.scene.mesh import Mesh


class Materials(Protocol):
    """Reflectance of K points, numpy float32."""

    @property
    def base_color(self) -> np.ndarray:
        """(K, 3)."""
        ...

    @property
    def roughness(self) -> np.ndarray:
        """(K,)."""
        ...

    @property
    def metallic(self) -> np.ndarray:
        """(K,)."""
        ...


@dataclass(frozen=True)
class EmitterSet:
    """Emitting triangles.

    Attributes
    ----------
    triangle
        (E,) int32 indices into the mesh.
    radiance
        (E, 3) float32.
    sides
        (E,) int8 which sides shine, as of `Emitters`. Left out: both.
    """

    triangle: np.ndarray
    radiance: np.ndarray
    sides: np.ndarray = field(default_factory=lambda: np.empty(0, np.int8))

    def __post_init__(self) -> None:
        count, given = len(self.triangle), len(self.sides)
        if given not in (0, count):
            raise ValueError(f"sides is of {given} triangles, not of {count}")
        if given != count:
            object.__setattr__(self, "sides", np.full(count, BOTH, np.int8))

    def chosen(self, rows: np.ndarray) -> "EmitterSet":
        """Those where ``rows`` (E,) is true."""
        return EmitterSet(self.triangle[rows], self.radiance[rows], self.sides[rows])

    def lit(self) -> "EmitterSet":
        """The triangles that emit at all."""
        return self.chosen(self.radiance.max(axis=1, initial=0) > 0)

    def emitted(self, triangle: np.ndarray, front: np.ndarray) -> np.ndarray:
        """(N, 3) float32 radiance that triangles (N,) emit from their front, where ``front`` (N,), or their back."""
        order = np.argsort(self.triangle)
        known = self.triangle[order]
        if len(known) == 0:
            return np.zeros((len(triangle), 3), np.float32)
        place = np.minimum(np.searchsorted(known, triangle), len(known) - 1)
        own = (known[place] == triangle) & emits(self.sides[order][place], front)
        return np.where(own[:, None], self.radiance[order][place], 0.0).astype(np.float32)


def emitter_set(emitters: Emitters) -> EmitterSet:
    """Found emitters as the tracer takes them."""
    return EmitterSet(emitters.triangle, emitters.radiance, emitters.sides)


class SurfaceCache:
    """Sparse voxel records over the surface, for lookups inside kernels.

    Parameters
    ----------
    voxels
        The arrays of cache.npz: ``center`` (3,), ``side`` (metres), ``resolution``, and ``key`` (K,), ``facing`` (K,)
        by which the records are sorted.
    radiance
        (K, 3) cached outgoing radiance.
    known
        (K,) bool: whether the radiance may end a path.
    materials
        ``base_color`` (K, 3), ``roughness`` (K,), ``metallic`` (K,); None in round 0, where no path goes on.
    objects
        Material of each of the O last triangles of the mesh, which have records of their own; None: of no triangle.
        Their radiance is not known.
    first_object
        Number of the first of these triangles.
    """

    def __init__(
        self,
        voxels: Mapping[str, np.ndarray],
        radiance: np.ndarray,
        known: np.ndarray,
        materials: Materials | None = None,
        objects: Materials | None = None,
        first_object: int = 0,
    ) -> None:
        side, key = float(voxels["side"]), voxels["key"]
        n, count = int(voxels["resolution"]), len(key)
        center = voxels["center"]
        self.low = [float(v) for v in center - side / 2]
        self.scale, self.resolution = n / side, n
        index, mask = np.full(n**3, count, np.uint32), np.zeros(n**3, np.uint32)
        cells, first = np.unique(key, return_index=True)
        index[cells] = first
        np.bitwise_or.at(mask, key, np.uint32(1) << voxels["facing"].astype(np.uint32))
        self.index, self.mask = mi.UInt32(index), mi.UInt32(mask)
        rough = np.ones(count, np.float32) if materials is None else materials.roughness
        # the sign of the roughness tells whether the radiance is known; the last record is "nothing here"
        light = np.concatenate([radiance, np.where(known, rough, -rough)[:, None]], axis=1)
        light = np.concatenate([light, [[0.0, 0.0, 0.0, -1.0]]])
        self.first_object = None if objects is None else first_object
        self.first_record = count + 1
        if objects is not None:
            light = np.concatenate([light, np.pad(-objects.roughness[:, None], ((0, 0), (3, 0)))])
        self.light = mi.Float(light.astype(np.float32).ravel())
        if materials is not None:
            material = np.concatenate([materials.base_color, materials.metallic[:, None]], axis=1)
            material = np.concatenate([material, [[0.5, 0.5, 0.5, 0.0]]])
            if objects is not None:
                material = np.concatenate([material, np.column_stack([objects.base_color, objects.metallic])])
            self.material = mi.Float(material.astype(np.float32).ravel())

    def find(
        self, p: "mi.Point3f", normal: "mi.Vector3f", active: "mi.Bool", triangle: "mi.UInt32 | None" = None
    ) -> "mi.UInt32":
        """Record number of the surface at p, on ``triangle``, that faces along ``normal``."""
        record = self._find(p, normal, active)
        if self.first_object is None or triangle is None:
            return record
        own = triangle >= self.first_object
        return dr.select(own, triangle - self.first_object + self.first_record, record)

    def _find(self, p: "mi.Point3f", normal: "mi.Vector3f", active: "mi.Bool") -> "mi.UInt32":
        """Record number of the room's surface, by voxel."""
        n = self.resolution
        cell = mi.Vector3i(dr.clip(dr.floor((p - mi.Point3f(*self.low)) * self.scale), 0, n - 1))
        cell = mi.UInt32(cell.x + n * (cell.y + n * cell.z))
        first, mask = dr.gather(mi.UInt32, self.index, cell, active), dr.gather(mi.UInt32, self.mask, cell, active)
        x, y, z = dr.abs(normal.x), dr.abs(normal.y), dr.abs(normal.z)
        along_x, along_y = (x >= y) & (x >= z), y >= z
        component = dr.select(along_x, normal.x, dr.select(along_y, normal.y, normal.z))
        facing = dr.select(along_x, mi.UInt32(0), dr.select(along_y, mi.UInt32(2), mi.UInt32(4)))
        bit = mi.UInt32(1) << (facing + dr.select(component > 0, mi.UInt32(1), mi.UInt32(0)))
        # records of a voxel stand in the order of their facings; another facing is better than none
        return first + dr.select((mask & bit) > 0, dr.popcnt(mask & (bit - 1)), 0)

    def lookup_radiance(self, record: "mi.UInt32", active: "mi.Bool") -> tuple["mi.Color3f", "mi.Float", "mi.Bool"]:
        """Cached radiance, roughness, and whether the radiance is known."""
        v = dr.gather(mi.Vector4f, self.light, record, active)
        return mi.Color3f(v.x, v.y, v.z), dr.abs(v.w), v.w > 0

    def lookup_material(self, record: "mi.UInt32", active: "mi.Bool") -> tuple["mi.Color3f", "mi.Float"]:
        """Base colour and metallic."""
        v = dr.gather(mi.Vector4f, self.material, record, active)
        return mi.Color3f(v.x, v.y, v.z), v.w


@dataclass
class EmitterPoint:
    """Points on emitters, one a lane.

    Attributes
    ----------
    p, n
        Place (metres), normal by winding order.
    emitter
        Its number.
    radiance
        What is emitted there.
    p_area
        Density of choosing the point, per square metre.
    """

    p: "mi.Point3f"
    n: "mi.Vector3f"
    emitter: "mi.UInt32"
    radiance: "mi.Color3f"
    p_area: "mi.Float"


class Triangles:
    """Normal and emitter of every triangle, and sampling of emitters by power.

    Emitters absorb what falls on them, also those that are off: light then adds up emitter by emitter.

    Parameters
    ----------
    mesh
        The room.
    emitters
        Emitting triangles, or None.

    Attributes
    ----------
    absorb
        Whether there are emitters, perhaps all of them off.
    has_emitters
        Whether some emit.
    """

    def __init__(self, mesh: Mesh, emitters: EmitterSet | None) -> None:
        known = EmitterSet(np.zeros(0, np.int32), np.zeros((0, 3), np.float32)) if emitters is None else emitters
        self.absorb = len(known.triangle) > 0
        emitters = known.lit()
        self.has_emitters = len(emitters.triangle) > 0
        number = np.zeros(len(mesh.triangles), np.float32)
        number[known.triangle] = 1 + len(emitters.triangle)  # the last row: emitters that are off, black
        number[emitters.triangle] = 1 + np.arange(len(emitters.triangle))
        self.face = mi.Float(np.concatenate([mesh.normals, number[:, None]], axis=1).astype(np.float32).ravel())
        if not self.absorb:
            return
        self.sides = mi.UInt32(np.append(emitters.sides, 0).astype(np.uint32))
        self.count = len(emitters.triangle)
        area = np.maximum(mesh.areas[emitters.triangle], 1e-20)
        power = area * emitters.radiance.astype(np.float64).mean(axis=1)
        chance = power / max(power.sum(), 1e-300)
        emitted = np.pad(np.concatenate([emitters.radiance, (chance / area)[:, None]], axis=1), ((0, 1), (0, 0)))
        self.emitted = mi.Float(emitted.astype(np.float32).ravel())
        if not self.has_emitters:
            return
        prob, alias = alias_table(chance)
        self.alias = mi.Float(np.stack([prob, alias.astype(np.float64)], 1).astype(np.float32).ravel())
        corner = mesh.corners[emitters.triangle]
        a, u, v = corner[:, 0], corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        self.corner, self.edge_u, self.edge_v = (
            mi.Float(np.pad(x, ((0, 0), (0, 1))).astype(np.float32).ravel()) for x in (a, u, v)
        )
        self.emitter_normal = mi.Float(
            np.pad(mesh.normals[emitters.triangle], ((0, 0), (0, 1))).astype(np.float32).ravel()
        )

    def lookup(self, triangle: "mi.UInt32", active: "mi.Bool") -> tuple["mi.Vector3f", "mi.UInt32"]:
        """Normal by winding order and emitter number + 1 (0: does not emit)."""
        v = dr.gather(mi.Vector4f, self.face, triangle, active)
        return mi.Vector3f(v.x, v.y, v.z), mi.UInt32(v.w)

    def radiance(self, emitter: "mi.UInt32", active: "mi.Bool") -> tuple["mi.Color3f", "mi.Float"]:
        """Emitted radiance and the density of choosing a point on it, per square metre."""
        v = dr.gather(mi.Vector4f, self.emitted, emitter, active)
        return mi.Color3f(v.x, v.y, v.z), v.w

    def emits(self, emitter: "mi.UInt32", cos: "mi.Float", active: "mi.Bool") -> "mi.Bool":
        """Whether an emitter emits to where the cosine with its normal by winding order is ``cos``."""
        sides = dr.gather(mi.UInt32, self.sides, emitter, active)
        return (sides & dr.select(cos > 0, mi.UInt32(FRONT), mi.UInt32(BACK))) > 0

    def sample(self, u: "mi.Float", u1: "mi.Float", u2: "mi.Float", active: "mi.Bool") -> EmitterPoint:
        """Choose a point on an emitter by power."""
        x = u * self.count
        slot = dr.minimum(mi.UInt32(x), self.count - 1)
        entry = dr.gather(mi.Vector2f, self.alias, slot, active)
        e = dr.select(x - mi.Float(slot) < entry.x, slot, mi.UInt32(entry.y))
        root = dr.sqrt(u1)
        corner = dr.gather(mi.Vector4f, self.corner, e, active)
        edge_u = dr.gather(mi.Vector4f, self.edge_u, e, active)
        edge_v = dr.gather(mi.Vector4f, self.edge_v, e, active)
        q = corner + edge_u * (root * (1 - u2)) + edge_v * (root * u2)
        n = dr.gather(mi.Vector4f, self.emitter_normal, e, active)
        radiance, pdf = self.radiance(e, active)
        return EmitterPoint(mi.Point3f(q.x, q.y, q.z), mi.Vector3f(n.x, n.y, n.z), e, radiance, pdf)


def alias_table(chance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Walker's alias table of (E,) probabilities: (E,) threshold of each slot and (E,) its other entry."""
    n = len(chance)
    scaled = np.asarray(chance, np.float64) * n
    threshold, alias = np.ones(n), np.arange(n)
    small = [i for i in range(n) if scaled[i] < 1]
    large = [i for i in range(n) if scaled[i] >= 1]
    while small and large:
        s, b = small.pop(), large.pop()
        threshold[s], alias[s] = scaled[s], b
        scaled[b] -= 1 - scaled[s]
        (small if scaled[b] < 1 else large).append(b)
    return threshold, alias
