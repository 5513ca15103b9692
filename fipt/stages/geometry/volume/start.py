"""What a field starts from: a sphere, or distances that were fused."""

import numpy as np
import torch
from torch import nn

from fipt.model.networks import SceneBox
from fipt.stages.geometry.tsdf import BLOCK
from fipt.stages.geometry.volume.blocks import BlockGrid


class Sphere(nn.Module):
    """Distance to a sphere that is seen from inside: what nothing is known of."""

    def __init__(self, radius: float = 0.9) -> None:
        super().__init__()
        self.radius = radius

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(N,) distances of (N, 3) places, positive inside."""
        return self.radius - points.norm(dim=1)


class BlockDistance(nn.Module):
    """Trilinear distances of a grid of blocks, as the start of a field: half sides of the scene box.

    Places outside its blocks, and voxels that are unknown, count as matter.
    """

    index: torch.Tensor
    values: torch.Tensor
    origin: torch.Tensor
    shift: torch.Tensor

    def __init__(self, grid: BlockGrid, box: SceneBox) -> None:
        super().__init__()
        first = grid.blocks.min(axis=0)
        sides = grid.blocks.max(axis=0) - first + 1
        index = np.full(sides, len(grid.blocks), np.int64)
        index[tuple((grid.blocks - first).T)] = np.arange(len(grid.blocks))
        # world place of a voxel, in voxels: where the cube's corner lies, and half sides
        self.scale = box.side / 2 / grid.voxel
        self.register_buffer("shift", torch.tensor(np.array(box.center) / grid.voxel, dtype=torch.float32))
        self.register_buffer("origin", torch.from_numpy(first.astype(np.int64)))
        self.register_buffer("index", torch.from_numpy(index))
        self.register_buffer("values", torch.from_numpy(_with_rim(grid, index) / np.float32(box.side / 2)))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(N,) distances of (N, 3) places in [-1, 1]."""
        place = points * self.scale + self.shift
        block = torch.floor(place / BLOCK).long()
        local = (place - block * BLOCK).clamp(0, BLOCK - 1e-3)
        corner = local.long()
        t = local - corner
        block = block - self.origin
        sides = torch.tensor(self.index.shape, device=points.device)
        inside = ((block >= 0) & (block < sides)).all(dim=1)
        x, y, z = torch.minimum(block.clamp_min(0), sides - 1).unbind(1)
        number = torch.where(inside, self.index[x, y, z], len(self.values) - 1)
        side = BLOCK + 1
        first = ((number * side + corner[:, 2]) * side + corner[:, 1]) * side + corner[:, 0]
        flat, total = self.values.view(-1), torch.zeros_like(t[:, 0])
        for k in range(8):
            i, j, h = k & 1, k >> 1 & 1, k >> 2
            weight = (t[:, 0] if i else 1 - t[:, 0]) * (t[:, 1] if j else 1 - t[:, 1])
            weight = weight * (t[:, 2] if h else 1 - t[:, 2])
            total = total + weight * flat[first + i + side * j + side * side * h]
        return total


def _with_rim(grid: BlockGrid, index: np.ndarray) -> np.ndarray:
    """(B + 1, 9, 9, 9) float32 metres, z first: blocks with the first voxels of those behind; the last is matter."""
    solid = np.float32(grid.distance.min())
    own = np.where(grid.known, grid.distance, solid).reshape(-1, BLOCK, BLOCK, BLOCK)
    own = np.concatenate([own, np.full((1, BLOCK, BLOCK, BLOCK), solid, np.float32)])
    result = np.pad(own, [(0, 0), (0, 1), (0, 1), (0, 1)], mode="edge")
    at = grid.blocks - grid.blocks.min(axis=0)
    wide = np.pad(index, (0, 1), constant_values=len(grid.blocks))
    for k in range(1, 8):
        i, j, h = k & 1, k >> 1 & 1, k >> 2
        beside = wide[at[:, 0] + i, at[:, 1] + j, at[:, 2] + h]
        there = beside < len(grid.blocks)
        rim = tuple(slice(BLOCK, None) if way else slice(0, BLOCK) for way in (h, j, i))
        its = tuple(slice(0, 1) if way else slice(None) for way in (h, j, i))
        result[(np.flatnonzero(there), *rim)] = own[(beside[there], *its)]
    return result
