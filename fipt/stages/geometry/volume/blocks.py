"""Signed distances in blocks of voxels near a surface, and their zero as a mesh."""

from dataclasses import dataclass

import numpy as np

from fipt.child import run_in_child
from fipt.errors import FiptError
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.tsdf import BLOCK, meshed, within_block

_SECONDS = 1_200.0
"""Limit for meshing."""


@dataclass(frozen=True)
class BlockGrid:
    """Voxels near a surface.

    Attributes
    ----------
    blocks
        (B, 3) int32 numbers along the world's axes; a block has `BLOCK` voxels along a side.
    distance
        (B, K) float32 signed distances of their voxels, x first, metres; free space is positive.
    known
        (B, K) bool: whether the distance is known.
    voxel
        Side of a voxel, metres.
    """

    blocks: np.ndarray
    distance: np.ndarray
    known: np.ndarray
    voxel: float

    def places(self, part: slice) -> np.ndarray:
        """(N, 3) float64 world places of the voxels of some blocks."""
        return ((self.blocks[part, None] * float(BLOCK) + within_block()) * self.voxel).reshape(-1, 3)

    def surface(self) -> Mesh:
        """The zero of the distances, in a process of its own.

        Raises
        ------
        FiptError
            If there is none, or open3d is missing.
        """
        arguments = {"blocks": self.blocks, "distance": self.distance, "known": self.known, "voxel": self.voxel}
        found = run_in_child(meshed, arguments, _SECONDS)
        if len(found["triangles"]) == 0:
            raise FiptError("the signed distance must be zero somewhere; no surface was found", "check units and poses")
        return Mesh(found["vertices"], found["triangles"])
