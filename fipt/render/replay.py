"""Gradients of paths with respect to materials and emission, by Mitsuba's path replay backpropagation (``prb``).

The room is a set of groups of triangles. Each has one emitted radiance, and one row of materials or one for each of its
texels. Every group may emit: emitters are sampled by power, and which ones there are follows from the values.
"""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations  # Mitsuba has no classes before its variant is set

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.render import bsdf
from fipt.render.reference import emitting_shape
from fipt.render.scene import vectors
from fipt.scene.mesh import Mesh

LAYERS = {"base_color": 3, "roughness": 1, "metallic": 1}
"""Parameter of a group's material -> its channels."""

_LEAST_WEIGHT = 1e-3
"""Weight of a dark group among emitters, over the mean: its gradient must reach it."""


@dataclass(frozen=True)
class PathBatch:
    """N rays through pixels.

    Attributes
    ----------
    origin, direction
        (N, 3) float32 metres; unit directions.
    """

    origin: np.ndarray
    direction: np.ndarray


@dataclass(frozen=True)
class TexelRows:
    """Which row of materials each place of the surface has, by texture coordinates.

    Attributes
    ----------
    uv
        (T, 3, 2) float32 of the corners of triangles, in [0, 1].
    row
        (H, W) int32 of each texel, 0 to R - 1.
    """

    uv: np.ndarray
    row: np.ndarray


class _Rows:
    """Values by row, with the two methods of a Mitsuba texture that a BSDF calls."""

    def __init__(self, values: Mapping[str, Any], name: str, row: Callable[[Any, Any], Any]) -> None:
        self._values, self._name, self._row = values, name, row

    def eval(self, si: Any, active: Any = True) -> Any:
        return dr.gather(mi.Color3f, self._values[self._name], self._row(si, active), active)

    def eval_1(self, si: Any, active: Any = True) -> Any:
        return dr.gather(mi.Float, self._values[self._name], self._row(si, active), active)


class _RowSurface:
    """What `fipt.render.bsdf.textured` takes; ``row`` tells that of a surface interaction."""

    def __init__(self, values: Mapping[str, Any], row: Callable[[Any, Any], Any]) -> None:
        self.base_color, self.roughness, self.metallic = (_Rows(values, name, row) for name in LAYERS)


class ReplayScene:
    """A room whose radiance is differentiated by its materials and emission.

    Parameters
    ----------
    mesh
        The room; triangles emit to the side that their winding faces.
    group
        (T,) group of each triangle, 0 to G - 1; every group has triangles.
    max_depth
        Longest path, bounces.
    texels
        Where rows of materials lie; None: a row for each group.
    """

    def __init__(self, mesh: Mesh, group: np.ndarray, max_depth: int, texels: TexelRows | None = None) -> None:
        self.count = int(group.max()) + 1
        self.rows = self.count if texels is None else int(texels.row.max()) + 1
        self._areas = np.bincount(group, mesh.areas, self.count)
        self._values: dict[str, Any] = {
            name: mi.Float(np.full(size * self.rows, 0.5, np.float32)) for name, size in LAYERS.items()
        }
        self._table = None if texels is None else mi.UInt32(texels.row.astype(np.uint32).ravel())
        self._size = (1, self.count) if texels is None else texels.row.shape
        surface = bsdf.textured(_RowSurface(self._values, self._row))
        shapes = {}
        for k in range(self.count):
            own, uv = _own(mesh, group == k, (k + 0.5) / self.count, texels)
            shapes[f"group{k}"] = emitting_shape(f"group{k}", own, uv, surface)
        self._scene = mi.load_dict({"type": "scene", **shapes})
        self._parameters = mi.traverse(self._scene)
        # Mitsuba counts a path's edges, one more than its bounces
        self._integrator = mi.load_dict({"type": "prb", "max_depth": max_depth + 1, "rr_depth": 5})

    def assign(self, values: Mapping[str, np.ndarray]) -> None:
        """Set ``base_color`` (R, 3), ``roughness`` (R,), ``metallic`` (R,) by row and ``emission`` (G, 3) by group."""
        for name in LAYERS:
            self._values[name] = mi.Float(np.ascontiguousarray(values[name], np.float32).ravel())
            dr.enable_grad(self._values[name])
        power = values["emission"].mean(axis=1) * self._areas
        weight = np.maximum(power, _LEAST_WEIGHT * max(float(power.mean()), 1e-9))
        for k in range(self.count):
            radiance = mi.Color3f(*map(float, values["emission"][k]))
            dr.make_opaque(radiance)
            dr.enable_grad(radiance)
            self._parameters[f"group{k}.emitter.radiance.value"] = radiance
            self._parameters[f"group{k}.emitter.sampling_weight"] = float(weight[k])
        self._parameters.update()

    def _row(self, si: Any, active: Any) -> Any:
        """Row of materials of a surface interaction."""
        rows, columns = self._size
        x, y = (mi.UInt32(dr.clip(at, 0, 1 - 1e-6) * size) for at, size in ((si.uv.x, columns), (si.uv.y, rows)))
        return x if self._table is None else dr.gather(mi.UInt32, self._table, y * columns + x, active)

    def _differentiated(self) -> list[Any]:
        return [*self._values.values(), *self._emission()]

    def _emission(self) -> list[Any]:
        return [self._parameters[f"group{k}.emitter.radiance.value"] for k in range(self.count)]

    def radiance(self, batch: PathBatch, seed: int) -> np.ndarray:
        """(N, 3) float32 radiance that comes back along rays, one path each."""
        with dr.suspend_grad():
            color = self._trace(batch, seed)[0]
            return np.array(mi.Color3f(color)).T

    def gradient(self, batch: PathBatch, seed: int, adjoint: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of the sum of ``adjoint`` (N, 3) times the radiance of the rays, in the form of `assign`.

        Use another seed than the radiance had from which ``adjoint`` was made: else both err together.
        """
        for values in self._differentiated():
            dr.clear_grad(values)
        with dr.suspend_grad():  # the integrator resumes it where it means to
            state = self._trace(batch, seed)[3]
            self._trace(batch, seed, vectors(adjoint, mi.Color3f), state)
        found = {name: np.array(dr.grad(self._values[name])).reshape(self.rows, size) for name, size in LAYERS.items()}
        emission = [np.array(dr.grad(radiance)).ravel() for radiance in self._emission()]
        return {name: values[:, 0] if LAYERS[name] == 1 else values for name, values in found.items()} | {
            "emission": np.array(emission, np.float32).reshape(self.count, 3)
        }

    def _trace(self, batch: PathBatch, seed: int, adjoint: Any = None, state: Any = None) -> Any:
        """Call the integrator: primal, or backwards where an adjoint is given."""
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(dr.opaque(mi.UInt32, seed), len(batch.origin))
        ray = mi.RayDifferential3f(vectors(batch.origin, mi.Point3f), vectors(batch.direction, mi.Vector3f))
        mode = dr.ADMode.Primal if adjoint is None else dr.ADMode.Backward
        result = self._integrator.sample(
            mode=mode, scene=self._scene, sampler=sampler, ray=ray, δL=adjoint, state_in=state, active=mi.Bool(True)
        )
        dr.eval(result[0], result[3])
        return result


def _own(mesh: Mesh, chosen: np.ndarray, u: float, texels: TexelRows | None) -> tuple[Mesh, np.ndarray]:
    """Some triangles (T,) bool as a mesh, and texture coordinates (V, 2): those of texels, else ``u`` everywhere."""
    if texels is not None:
        corners = mesh.corners[chosen].reshape(-1, 3)
        return Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3)), texels.uv[chosen].reshape(-1, 2)
    used, triangles = np.unique(mesh.triangles[chosen], return_inverse=True)
    own = Mesh(mesh.vertices[used], triangles.reshape(-1, 3).astype(np.int32))
    return own, np.tile(np.float32([u, 0.5]), (len(used), 1))
