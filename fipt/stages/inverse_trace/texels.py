"""Materials as textures over an atlas of the mesh: a material a texel, of a part's mean and what differs from it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.linalg import splu
from scipy.special import expit

from fipt.conventions import ROUGHNESS_MIN
from fipt.meshing.atlas import filled, texels, unwrap
from fipt.model.parts import PartLabels, PartMaterials
from fipt.model.reflectance import Brdf
from fipt.render.replay import LAYERS, TexelRows
from fipt.scene.mesh import Mesh
from fipt.stages.inverse_trace.optimise import PartOptimiser

_MOST = 4096
"""Longest side of the atlas, texels."""
_BESIDE = 1.5
"""Texels of one part that are so near are neighbours, in texels."""
_OFFSET = "{}.offset"
_SPREAD = 10.0
"""What one texel's gradient says, its surroundings take over: about the square root of this, in texels."""


@dataclass(frozen=True)
class SurfaceTexels:
    """N texels of the surface.

    Attributes
    ----------
    rows
        Where they lie in the atlas.
    place
        (N, 3) float32 metres.
    group
        (N,) group of the triangle that each shows.
    roughen
        (N, N) Laplacian of neighbours: how much each texel differs from them, added up.
    """

    rows: TexelRows
    place: np.ndarray
    group: np.ndarray
    roughen: csr_array

    @classmethod
    def of(cls, mesh: Mesh, group: np.ndarray, density: float) -> "SurfaceTexels":
        """Lay out a mesh whose triangles have groups (T,), with ``density`` texels along a metre."""
        from scipy.spatial import cKDTree

        atlas = unwrap(mesh, group.astype(np.int32), density, 1, _MOST)
        known = texels(atlas)
        place = np.einsum("nk,nkc->nc", known.weights, mesh.corners[known.triangle]).astype(np.float32)
        own = group[known.triangle]
        pairs = cKDTree(place).query_pairs(_BESIDE / atlas.density, output_type="ndarray")
        row = filled(np.arange(len(place), dtype=np.int32), known, atlas.height, atlas.width)
        return cls(TexelRows(atlas.uv[atlas.triangles], row), place, own, _laplacian(pairs, own))

    def materials(self, triangles: int, values: Mapping[str, np.ndarray]) -> PartMaterials:
        """A model that has at every place of a mesh of so many triangles the values (N, ...) of the nearest texel."""
        of_texel = np.arange(1, len(self.place) + 1, dtype=np.int32)
        labels = PartLabels(np.zeros(triangles, np.int32), self.place, of_texel)
        rows = (np.concatenate([values[name].mean(axis=0, keepdims=True), values[name]]) for name in LAYERS)
        return PartMaterials(labels, Brdf(*(row.astype(np.float32) for row in rows)))


def _laplacian(pairs: np.ndarray, group: np.ndarray) -> csr_array:
    """Of a graph with edges (K, 2), those within one group (N,)."""
    first, second = pairs[group[pairs[:, 0]] == group[pairs[:, 1]]].T
    ends, others = np.concatenate([first, second]), np.concatenate([second, first])
    count = np.bincount(ends, minlength=len(group)).astype(np.float64)
    every = np.arange(len(group))
    ends, others = np.concatenate([ends, every]), np.concatenate([others, every])
    weights = np.concatenate([np.full(2 * len(first), -1.0), count])
    return coo_array((weights, (ends, others)), (len(group), len(group))).tocsr()


class TextureOptimiser(PartOptimiser):
    """Values of N texels: logistic functions of a group's value and an offset; offsets of neighbours are alike.

    Offsets are smoothed variables: a path says little of a texel, and Adam would take steps of noise (Nicolet et al.
    2021, Large Steps in Inverse Rendering).

    The prior is a part of the loss: ``smoothness`` times the median radiance, times the mean over texels of the squared
    differences of their offsets to those of neighbours.
    """

    def __init__(self, texels: SurfaceTexels, count: int, level: float, smoothness: float) -> None:
        self._texels, self._weight = texels, smoothness * level / len(texels.place)
        matrix = (eye_array(len(texels.place)) + _SPREAD * texels.roughen).tocsc()
        # symmetric and positive definite: pivots stay on the diagonal, which leaves half as many other numbers
        symmetric = {"SymmetricMode": True}
        self._smoothed = splu(matrix, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric).solve
        self._offsets: dict[str, np.ndarray] = {}
        super().__init__(count, level)

    def _start(self, count: int, level: float) -> dict[str, np.ndarray]:
        start = super()._start(count, level)
        number = len(self._texels.place)
        return start | {_OFFSET.format(name): np.zeros((number, *start[name].shape[1:])) for name in LAYERS}

    def _materials(self) -> dict[str, np.ndarray]:
        group, held = self._texels.group, self._adam.values
        self._offsets = self._offsets or {name: self._smoothed(held[_OFFSET.format(name)]) for name in LAYERS}
        found = {name: expit(held[name][group] + self._offsets[name]) for name in LAYERS}
        found["roughness"] = np.maximum(found["roughness"], ROUGHNESS_MIN)
        return found

    def _slopes(self, slopes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        found, before = {}, self._offsets
        self._offsets = {}  # those of the step that comes
        for name in LAYERS:
            found[name] = np.zeros_like(self._adam.values[name])
            np.add.at(found[name], self._texels.group, slopes[name])
            rough = slopes[name] + 2 * self._weight * (self._texels.roughen @ before[name])
            found[_OFFSET.format(name)] = self._smoothed(rough)
        return found
