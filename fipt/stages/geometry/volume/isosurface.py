"""A field asked for its distances near the surface, in blocks of voxels that are then meshed."""

from collections.abc import Callable

import numpy as np
import torch

from fipt.model.networks import SceneBox
from fipt.stages.geometry.tsdf import BLOCK
from fipt.stages.geometry.volume.blocks import BlockGrid
from fipt.stages.geometry.volume.field import VolumeField

_AT_ONCE = 64
"""Blocks whose voxels the field is asked at once."""
_REACH = 2.0
"""Half diagonals of a block within which a surface is looked for: learned distances are not exact."""


def of_field(field: VolumeField, box: SceneBox, voxel: float, step: float) -> BlockGrid:
    """Ask a field for the distances near its surface, in the whole scene box."""
    size = BLOCK * voxel
    low, high = (np.floor((np.array(box.center) + sign * box.side / 2) / size).astype(int) for sign in (-1, 1))
    axes = [np.arange(one, other + 1, dtype=np.int32) for one, other in zip(low, high, strict=True)]
    blocks = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    middle = _asked(field.distance, box, (blocks + 0.5) * size, step, field.device)
    blocks = blocks[np.abs(middle) < _REACH * np.sqrt(0.75) * size]
    empty = np.zeros((len(blocks), BLOCK**3), np.float32)
    grid = BlockGrid(blocks, empty, np.ones(empty.shape, bool), voxel)
    for start in range(0, len(blocks), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        empty[part] = _asked(field.distance, box, grid.places(part), step, field.device).reshape(-1, BLOCK**3)
    return grid


@torch.no_grad()
def _asked(
    what: Callable[[torch.Tensor, float], torch.Tensor],
    box: SceneBox,
    places: np.ndarray,
    step: float,
    device: torch.device,
) -> np.ndarray:
    """(N,) float32 metres that a field says at (N, 3) world places."""
    signed, found = box.to_signed(places).astype(np.float32), np.empty(len(places), np.float32)
    chunk = _AT_ONCE * BLOCK**3
    for start in range(0, len(places), chunk):
        part = torch.from_numpy(signed[start : start + chunk]).to(device)
        found[start : start + chunk] = what(part, step).cpu().numpy()
    return found * np.float32(box.side / 2)


def changed_by(field: VolumeField, grid: BlockGrid, box: SceneBox, step: float) -> BlockGrid:
    """The grid that a field started from, with what was learned since."""
    distance = grid.distance.copy()
    for start in range(0, len(grid.blocks), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        distance[part] += _asked(field.learned, box, grid.places(part), step, field.device).reshape(-1, BLOCK**3)
    return BlockGrid(grid.blocks, distance, grid.known, grid.voxel)
