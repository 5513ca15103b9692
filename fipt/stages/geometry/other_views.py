"""What the other views say of a place: whether they see it, or through it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.room_planes import WITHIN

THROUGH = 0.15
"""Share of what other views tell of a place that may see through it: more than outliers make."""


@dataclass(frozen=True)
class OtherViews:
    """Depth of all views at once: (V, 3, 4) image axes from world, (V, 4) intrinsics, (V, H, W) depth."""

    extrinsics: np.ndarray
    intrinsics: np.ndarray
    depth: np.ndarray

    @staticmethod
    def of(views: Sequence[DepthView]) -> "OtherViews":
        """What these views know."""
        rows, columns = max(v.camera.height for v in views), max(v.camera.width for v in views)
        depth = np.zeros((len(views), rows, columns), np.float32)
        extrinsics, intrinsics = np.zeros((len(views), 3, 4)), np.zeros((len(views), 4))
        for i, view in enumerate(views):
            camera = view.camera
            depth[i, : camera.height, : camera.width] = view.map.depth
            extrinsics[i] = camera.extrinsics
            intrinsics[i] = camera.fx, camera.fy, camera.cx, camera.cy
        return OtherViews(extrinsics, intrinsics, depth)

    def say(self, points: np.ndarray, own: int, noise: float) -> tuple[np.ndarray, np.ndarray]:
        """How many other views see through each of (N, 3) points, and how many see it there: (N,) int64 each."""
        local = np.einsum("vij,nj->vni", self.extrinsics[..., :3], points) + self.extrinsics[:, None, :, 3]
        x, y, z = np.moveaxis(local, -1, 0)
        ahead = z > 1e-3
        safe = np.where(ahead, z, 1.0)
        fx, fy, cx, cy = self.intrinsics.T[:, :, None]
        u, v = fx * x / safe + cx, fy * y / safe + cy
        rows, columns = self.depth.shape[1:]
        inside = ahead & (u >= 0) & (v >= 0) & (u < columns) & (v < rows)
        inside[own] = False
        i, n = np.nonzero(inside)
        there = self.depth[i, v[i, n].astype(np.int64), u[i, n].astype(np.int64)]
        depth = z[i, n]
        far = WITHIN * noise * np.hypot(there**2, depth**2) + depth / fx[i, 0]
        known = there > 0
        through, same = known & (there > depth + far), known & (np.abs(there - depth) <= far)
        return np.bincount(n[through], minlength=len(points)), np.bincount(n[same], minlength=len(points))
