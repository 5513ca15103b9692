"""Depth maps fused into one surface, for a process of its own: this module imports little."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from fipt.stages.geometry.library import import_open3d

BLOCK = 8
"""Voxels along a side of a block: at four voxels of truncation, larger blocks hold mostly free space."""
TRUNCATION = 4.0
"""Largest distance that the field holds, voxels: some deviations of the depth where a voxel is as large as a pixel."""
_CHUNK = 2_000
"""Blocks that a view is added to at once: a million voxels."""
_PROJECTED = 142
"""Bytes of memory that a voxel takes while a view is added to it: places, pixels and distances, 130 as measured; and
the vote that it is full."""
_VOXEL_BYTES = 64
"""Bytes that any voxel takes: sum and weights, field and weight of the grid, and what its isosurface needs."""
_PIXEL_BYTES = 220
"""Bytes that a pixel takes: depth, normals and radiance of its view, measured and completed, with its rays and places,
and the arrays of the fusion, here and in its process."""


def fused(
    depth: np.ndarray,
    normal: np.ndarray,
    confidence: np.ndarray,
    carves: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    voxel: float,
    noise: float,
) -> dict[str, np.ndarray]:
    """Fuse depth maps as a truncated signed distance field (Curless and Levoy 1996) and mesh its zero.

    A voxel's distance is that to the tangent plane of the pixel that it falls into: so a slanted surface is as sharp as
    one that faces the camera. Where views that see through a voxel outweigh those that see surface in it, it is free;
    elsewhere they do not move the surface. Behind its surface a view sees nothing: there its word counts less,
    down to nothing at the truncation.

    Parameters
    ----------
    depth
        (N, H, W) float32 along the viewing axis, metres, 0 where unknown.
    normal
        (N, H, W, 3) float32 world normals that face the camera; 0 where unknown.
    confidence
        (N, H, W) float32, at least 0: factor on the weight that noise gives a pixel.
    carves
        (N, H, W) bool: pixels that say that nothing lies before their surface.
    intrinsics
        (N, 4) fx, fy, cx, cy; the centre of the first pixel is (0.5, 0.5).
    extrinsics
        (N, 3, 4) image axes (x right, y down, z forward) from world axes, metres.
    voxel
        Side of a voxel, metres.
    noise
        Deviation of depth at one metre, metres.

    Returns
    -------
    dict
        ``vertices`` (V, 3) float32 and ``triangles`` (T, 3) int32, in an order that the same input gives again.
    """
    blocks = summed(depth, normal, confidence, carves, intrinsics, extrinsics, voxel, noise)
    return meshed(**blocks, voxel=voxel)


def summed(
    depth: np.ndarray,
    normal: np.ndarray,
    confidence: np.ndarray,
    carves: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    voxel: float,
    noise: float,
) -> dict[str, np.ndarray]:
    """The distances that `fused` meshes.

    Returns
    -------
    dict
        ``blocks`` (B, 3) int32 numbers of blocks along the axes; ``distance`` (B, K) float32 of their voxels, x first,
        in truncations; ``known`` (B, K) bool whether any view tells it.
    """
    o3d = import_open3d()
    cameras = [_Camera(*parts) for parts in zip(intrinsics, extrinsics, strict=True)]
    grid = _grid(o3d, cameras, depth, voxel)
    slot = grid.hashmap().active_buf_indices()
    blocks = grid.hashmap().key_tensor().numpy()[slot.numpy()]
    base = blocks.astype(np.float64) * BLOCK * voxel
    maps = zip(cameras, depth, normal, confidence, carves, strict=True)
    distance, known = _voted(maps, base, within_block() * voxel, voxel, noise)
    return {"blocks": blocks.copy(), "distance": distance, "known": known}


def meshed(blocks: np.ndarray, distance: np.ndarray, known: np.ndarray, voxel: float) -> dict[str, np.ndarray]:
    """Mesh the zero of distances that `summed` returns, or others like them; in any unit."""
    o3d = import_open3d()
    grid = _empty_grid(o3d, voxel, len(blocks))
    slot = grid.hashmap().activate(o3d.core.Tensor(blocks))[0].to(o3d.core.int64)
    field, certain = (grid.attribute(name).reshape((-1, BLOCK**3)) for name in ("tsdf", "weight"))
    field[slot], certain[slot] = o3d.core.Tensor(distance), o3d.core.Tensor(known.astype(np.float32))
    mesh = grid.extract_triangle_mesh(0.5)
    return _ordered(mesh.vertex.positions.numpy(), mesh.triangle.indices.numpy())


def within_block() -> np.ndarray:
    """(K, 3) float64 places of a block's voxels, in voxels, x first."""
    z, y, x = np.mgrid[:BLOCK, :BLOCK, :BLOCK]
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(np.float64)


def _voted(
    maps: Iterable[tuple["_Camera", np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
    base: np.ndarray,
    within: np.ndarray,
    voxel: float,
    noise: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (B, K) float32 of the voxels of blocks, in truncations, and whether any view tells them.

    ``maps`` holds the camera, depth, normals, confidence and what carves, of each view.
    """
    total = np.zeros((len(base), len(within)), np.float32)
    heavy, full, free = np.zeros_like(total), np.zeros_like(total), np.zeros_like(total)
    for camera, depth, normal, confidence, carves in maps:
        images = depth, camera.inner(normal), confidence, carves
        seen = camera.blocks(base + 0.5 * BLOCK * voxel, BLOCK * voxel, depth.shape, float(depth.max()))
        for part in np.array_split(seen, -(-len(seen) // _CHUNK) or 1):
            add = camera.distances(base[part], within, *images, voxel, noise)
            total[part] += add[0]
            heavy[part] += add[1]
            full[part] += add[2]
            free[part] += add[3]
    empty = free > full
    total[empty] = heavy[empty] = 1.0
    known = heavy > 0
    return np.divide(total, heavy, out=total, where=known), known


def _empty_grid(o3d: Any, voxel: float, blocks: int) -> Any:
    """A grid with room for so many blocks."""
    kinds = o3d.core.float32, o3d.core.float32
    return o3d.t.geometry.VoxelBlockGrid(("tsdf", "weight"), kinds, ((1,), (1,)), float(voxel), BLOCK, blocks)


def _grid(o3d: Any, cameras: list["_Camera"], depth: np.ndarray, voxel: float) -> Any:
    """Blocks of voxels near what the views show; their values are not set."""
    grid = _empty_grid(o3d, voxel, 20_000)
    for camera, image in zip(cameras, depth, strict=True):
        if (image > 0).any():
            near = grid.compute_unique_block_coordinates(
                o3d.t.geometry.Image(o3d.core.Tensor(np.ascontiguousarray(image[..., None]))),
                o3d.core.Tensor(camera.matrix()),
                o3d.core.Tensor(camera.extrinsics),
                1.0,  # depth in metres, as far as there is any: the defaults are millimetres and 3 m
                float(image.max()) + 1.0,
                TRUNCATION,
            )
            grid.hashmap().activate(near)
    return grid


class _Camera:
    """Projection of one view."""

    def __init__(self, intrinsics: np.ndarray, extrinsics: np.ndarray) -> None:
        self.fx, self.fy, self.cx, self.cy = (float(value) for value in intrinsics)
        self.rotation = extrinsics[:, :3].T
        self.center = -self.rotation @ extrinsics[:, 3]
        self.extrinsics = np.vstack([extrinsics, [0.0, 0.0, 0.0, 1.0]])

    def matrix(self) -> np.ndarray:
        """(3, 3) intrinsics of pixels counted from their centres."""
        return np.array([[self.fx, 0, self.cx - 0.5], [0, self.fy, self.cy - 0.5], [0, 0, 1]])

    def inner(self, directions: np.ndarray) -> np.ndarray:
        """(..., 3) float32 in image axes, of directions in world axes."""
        return (directions @ self.rotation).astype(np.float32)

    def blocks(self, middle: np.ndarray, side: float, shape: tuple[int, ...], deepest: float) -> np.ndarray:
        """Numbers of the blocks, by their (B, 3) middles, that may lie in the image before its deepest pixel."""
        local = (middle - self.center) @ self.rotation
        reach, z = side, np.maximum(local[:, 2], side)
        u, v = self.fx * local[:, 0] / z + self.cx, self.fy * local[:, 1] / z + self.cy
        rim = self.fx * reach / z
        inside = (local[:, 2] > -reach) & (local[:, 2] < deepest + 2 * side)
        inside &= (u > -rim) & (u < shape[1] + rim) & (v > -rim) & (v < shape[0] + rim)
        return np.flatnonzero(inside)

    def distances(
        self,
        base: np.ndarray,
        within: np.ndarray,
        depth: np.ndarray,
        normal: np.ndarray,
        confidence: np.ndarray,
        carves: np.ndarray,
        voxel: float,
        noise: float,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Weighted distances in truncations, their weights, and those of what says that voxels are full, and empty.

        (B, K) float32 each, of the voxels of blocks. The (H, W, 3) normals are in image axes. Noise is that of depth at
        the voxel: how far behind it a ray ends says nothing of whether it passed.
        """
        most = TRUNCATION * voxel
        local = ((base - self.center) @ self.rotation)[:, None] + (within @ self.rotation)[None]
        local = local.astype(np.float32)
        x, y, z = np.moveaxis(local, -1, 0)
        ahead = z > 1e-3
        safe = np.where(ahead, z, 1.0)
        u, v = self.fx * x / safe + self.cx, self.fy * y / safe + self.cy
        rows, columns = depth.shape
        ahead &= (u >= 0) & (v >= 0) & (u < columns) & (v < rows)
        pixel = (np.where(ahead, v, 0).astype(np.int64), np.where(ahead, u, 0).astype(np.int64))
        found, certain = depth[pixel], confidence[pixel]
        ahead &= (found > 0) & (certain > 0)
        # point of the pixel's centre on its surface, and the tangent plane there
        tangent = normal[pixel]
        point = np.stack([
            (pixel[1] + 0.5 - self.cx) / self.fx * found, (pixel[0] + 0.5 - self.cy) / self.fy * found, found
        ], axis=-1)  # fmt: skip
        straight = found - z
        leaning = ((local - point) * tangent).sum(axis=-1)
        flat = (tangent**2).sum(axis=-1) > 0.5
        # before an outline's pixel the tangent plane of a grazing surface tells nothing
        signed = np.where(flat & (np.abs(straight) < 4 * most), leaning, straight) / np.float32(most)
        near = ahead & (np.abs(signed) < 1) & (straight > -4 * most)
        through = ahead & (signed >= 1) & carves[pixel]
        # a voxel rounds what falls into it; the rest is the noise of the depth
        weight = certain * voxel**2 / ((noise * z * z) ** 2 + np.float32(voxel / 4) ** 2)
        seen = np.where(near, weight, 0)
        full = seen * np.clip(1 + straight / np.float32(most), 0, 1)  # what lies behind its surface a view does not see
        return seen * np.where(near, signed, 0), seen, full, np.where(through, weight, 0)


def _ordered(vertices: np.ndarray, triangles: np.ndarray) -> dict[str, Any]:
    """Vertices and triangles in an order of their places: the grid's hash map leaves another at each run.

    Vertices of one place are one, or their order would stay open; triangles that this leaves without area go.
    """
    vertices = vertices.astype(np.float32) + np.float32(0)  # one zero, not two
    order = np.lexsort(vertices.T)
    first = np.append(True, (np.diff(vertices[order], axis=0) != 0).any(axis=1))[: len(order)]
    number = np.empty(len(order), np.int64)
    number[order] = np.cumsum(first) - 1
    corner = number[triangles.astype(np.int64)]
    corner = corner[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    begin = corner.argmin(axis=1)
    corner = corner[np.arange(len(corner))[:, None], (begin[:, None] + np.arange(3)) % 3]
    return {
        "vertices": vertices[order][first],
        "triangles": corner[np.lexsort(corner.T[::-1])].astype(np.int32),
    }


def memory(blocks: int, pixels: int) -> int:
    """Bytes that the fusion of so many pixels to so many blocks takes, at most."""
    return BLOCK**3 * (blocks * _VOXEL_BYTES + min(blocks, _CHUNK) * _PROJECTED) + pixels * _PIXEL_BYTES
