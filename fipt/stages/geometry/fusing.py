"""One mesh from the depth maps of all views."""

from collections.abc import Sequence

import numpy as np

from fipt.child import run_in_child
from fipt.errors import FiptError
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.tsdf import BLOCK, TRUNCATION, fused, memory, summed
from fipt.stages.geometry.volume.blocks import BlockGrid

_SECONDS_A_VIEW = 60.0
"""Of the time limit: some twenty times what a view takes."""
_LAYERS = 3.0
"""Blocks that lie over each other along a surface, of those that its truncation touches."""


def voxel_size(views: Sequence[DepthView], finest: float) -> float:
    """Side of a voxel, metres: the median pixel's width where it falls, at least ``finest``."""
    widths = [view.map.depth[view.map.known] / view.camera.fx for view in views]
    if not sum(map(len, widths)):
        raise FiptError("the depth maps must hold depth; all pixels are unknown", "look at the photographs of fipt qa")
    return max(float(np.median(np.concatenate(widths))), finest)


def check_memory(views: Sequence[DepthView], voxel: float, most: float) -> None:
    """Refuse what would need more than ``most`` gigabytes, before it starts.

    ``views`` are completed ones: bare surface takes blocks too.
    """
    blocks = np.zeros(0, np.int64)
    for view in views:
        place = np.floor(view.points[view.map.known] / (BLOCK * voxel)).astype(np.int64)
        number = ((place[:, 0] << 42) + (place[:, 1] << 21)) + place[:, 2]
        blocks = np.union1d(blocks, number)
    needed = memory(int(_LAYERS * len(blocks)), sum(view.map.depth.size for view in views)) / 1e9
    if needed > most:
        raise FiptError(
            f"fusing the depth maps at voxels of {1e3 * voxel:.0f} mm needs about {needed:.1f} GB; "
            f"geometry.memory_gb is {most:g}",
            "raise geometry.voxel or geometry.memory_gb",
        )


def fuse(views: Sequence[DepthView], carves: Sequence[np.ndarray], noise: float, voxel: float) -> Mesh:
    """Fuse depth maps in a process of its own.

    Parameters
    ----------
    carves
        (H, W) bool of each view: pixels that say that nothing lies before their surface.
    noise
        Deviation of depth at one metre, metres.
    voxel
        Side of a voxel, metres.

    Raises
    ------
    FiptError
        If open3d is missing, or nothing was fused.
    """
    found = run_in_child(fused, _arguments(views, carves, noise, voxel), _limit(views))
    if len(found["triangles"]) == 0:
        raise FiptError("the depth maps must agree on a surface; fusing them gave none", "check units and poses")
    return Mesh(found["vertices"], found["triangles"])


def fuse_blocks(views: Sequence[DepthView], carves: Sequence[np.ndarray], noise: float, voxel: float) -> BlockGrid:
    """Fuse depth maps as `fuse` does, but return the distances that it would mesh."""
    found = run_in_child(summed, _arguments(views, carves, noise, voxel), _limit(views))
    order = np.lexsort(found["blocks"].T)  # the hash map of blocks leaves another at each run
    blocks, distance, known = (found[name][order] for name in ("blocks", "distance", "known"))
    return BlockGrid(blocks, distance * np.float32(TRUNCATION * voxel), known, voxel)


def _limit(views: Sequence[DepthView]) -> float:
    return 120 + _SECONDS_A_VIEW * len(views)


def _arguments(
    views: Sequence[DepthView], carves: Sequence[np.ndarray], noise: float, voxel: float
) -> dict[str, np.ndarray | float]:
    """What `fipt.stages.geometry.tsdf.fused` takes, of views of any sizes."""
    rows, columns = max(v.camera.height for v in views), max(v.camera.width for v in views)
    shape = len(views), rows, columns
    depth, confidence = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    normal, free = np.zeros((*shape, 3), np.float32), np.zeros(shape, bool)
    for number, view in enumerate(views):
        inside = np.s_[number, : view.camera.height, : view.camera.width]
        depth[inside], normal[inside], free[inside] = view.map.depth, view.map.normal, carves[number]
        confidence[inside] = view.map.confidence
    return {
        "depth": depth,
        "normal": normal,
        "confidence": confidence,
        "carves": free,
        "intrinsics": np.array([(v.camera.fx, v.camera.fy, v.camera.cx, v.camera.cy) for v in views]),
        "extrinsics": np.array([v.camera.extrinsics for v in views]),
        "voxel": voxel,
        "noise": noise,
    }
