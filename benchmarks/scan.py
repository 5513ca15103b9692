"""A scan-like mesh of a room whose true mesh is known: what a depth sensor gives, instead of a modeller's mesh.

    python -m benchmarks.scan results/office/dataset office_2cm.ply --voxel 0.02 --noise 0.003
    python -m benchmarks.scan results/office/dataset office_3cm.ply --voxel 0.03 --noise 0.010

Depth of the true mesh from the dataset's training cameras and from ``--views`` more at random in free space, with
noise whose standard deviation is ``--noise`` metres at 2 m and grows with the square of the depth. The depths are
fused as a truncated signed distance field (Curless and Levoy 1996) over voxels near the surface, weights equal; its
zero is meshed by surface nets (Gibson 1998: a vertex in each cell that the surface crosses, at the mean of the
crossings). Edges are rounded, thin things get lost, and there are holes where nothing looked.
"""

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.groups import connected_groups
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh, write_ply

log = logging.getLogger(__name__)

BLOCK = 8
"""Voxels along a side of the blocks that the field is stored in."""
TRUNCATION = 4.0
"""Largest distance that the field holds, voxels."""
SIZE, FOV = (320, 240), 75.0
"""Pixels of a depth image, and its horizontal field of view, degrees."""
REACH = 10.0
"""Farthest surface that has a depth, metres: views through windows would ask for voxels of the whole world."""
CLEARANCE = 0.3
"""Nearest surface to a camera at random, metres."""
PIECE = 50
"""Least triangles of a connected piece."""


@dataclass(frozen=True)
class ScanSettings:
    """How a room is scanned.

    Attributes
    ----------
    voxel
        Side of a voxel, metres.
    noise
        Standard deviation of a depth of 2 m, metres.
    views
        Cameras at random, beside the dataset's for training.
    seed
        Of cameras and noise.
    """

    voxel: float = 0.02
    noise: float = 0.003
    views: int = 120
    seed: int = 0


def scanned(mesh: Mesh, cameras: list[Camera], settings: ScanSettings) -> Mesh:
    """Return the scan-like mesh of a true one.

    Raises
    ------
    FiptError
        If no place for a camera is found.
    """
    from fipt.render.scene import RayScene

    rng = np.random.default_rng(settings.seed)
    scene = RayScene(mesh)
    # Walls in the plane of voxels would be an accident that no scan has.
    field = DistanceField(settings.voxel, rng.uniform(0, settings.voxel, 3))
    poses = [depth_camera(camera.world_from_camera) for camera in cameras]
    poses += random_cameras(scene, np.array([camera.center for camera in cameras]), settings.views, rng)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    for camera in poses:
        directions = camera.directions(columns.ravel(), rows.ravel())
        distance, _ = scene.intersect(camera.center.astype(np.float32), directions)
        forward = -camera.world_from_camera[:3, 2]
        depth = (distance * (directions @ forward)).astype(np.float64)
        depth[~(depth < REACH)] = 0
        depth += np.where(depth > 0, settings.noise * (depth / 2) ** 2 * rng.standard_normal(depth.shape), 0)
        field.integrate(camera, np.maximum(depth, 0).reshape(rows.shape))
    return without_crumbs(field.mesh())


def depth_camera(pose: np.ndarray) -> Camera:
    """A camera of depth images at a (4, 4) pose."""
    focal = SIZE[0] / 2 / np.tan(np.radians(FOV) / 2)
    return Camera("depth", "train", *SIZE, focal, focal, SIZE[0] / 2, SIZE[1] / 2, np.asarray(pose, float))


def random_cameras(scene, centers: np.ndarray, count: int, rng: np.random.Generator) -> list[Camera]:
    """Cameras at random in free space around (N, 3) known centres, turned anywhere but steeply up or down."""
    low, high = centers.min(axis=0), centers.max(axis=0)
    pad = 0.35 * (high - low + 0.5) * (1, 0, 1)
    found: list[Camera] = []
    for _ in range(200 * max(count, 1)):
        if len(found) == count:
            return found
        center, back = rng.uniform(low - pad, high + pad), rng.standard_normal(3)
        back /= np.linalg.norm(back)
        if abs(back[1]) > 0.8 or not _free(scene, center, rng):
            continue
        right = np.cross((0, 1, 0), back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(back, right), back, center], axis=1)
        found.append(depth_camera(pose))
    if len(found) < count:
        raise FiptError(f"free space for {count} cameras was sought; found {len(found)}", "ask for fewer --views")
    return found


def _free(scene, center: np.ndarray, rng: np.random.Generator) -> bool:
    """Whether a place has clearance, and surface all around that faces it (so it is not within furniture)."""
    directions = rng.standard_normal((64, 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    distance, triangle = scene.intersect(center.astype(np.float32), directions)
    met = triangle >= 0
    facing = (scene.normals[triangle] * directions).sum(axis=1) < 0
    return bool(distance.min() >= CLEARANCE and met.mean() > 0.95 and facing[met].mean() > 0.8)


class DistanceField:
    """Truncated signed distances in blocks of voxels near the surface.

    Parameters
    ----------
    voxel
        Side of a voxel, metres.
    origin
        (3,) centre of voxel (0, 0, 0), metres.
    """

    def __init__(self, voxel: float, origin: np.ndarray) -> None:
        self.voxel, self.origin = voxel, origin
        self._blocks: dict[tuple[int, int, int], int] = {}
        self._sum = np.zeros((0, BLOCK**3), np.float32)
        self._weight = np.zeros((0, BLOCK**3), np.float32)
        self._within = np.stack(np.meshgrid(*[np.arange(BLOCK)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)

    def integrate(self, camera: Camera, depth: np.ndarray) -> None:
        """Add a depth image (H, W), metres along the optical axis; 0 is unknown."""
        blocks = self._near(camera, depth)
        slots = self._slots(blocks)
        places = self.origin + (blocks[:, None] * BLOCK + self._within).reshape(-1, 3) * self.voxel
        image, z = camera.project(places)
        pixel = np.floor(image).astype(int)
        inside = (z > 0) & (pixel >= 0).all(axis=1) & (pixel < (camera.width, camera.height)).all(axis=1)
        measured = np.zeros(len(places))
        measured[inside] = depth[pixel[inside, 1], pixel[inside, 0]]
        distance = (measured - z) / (TRUNCATION * self.voxel)
        counted = inside & (measured > 0) & (distance > -1)
        shape = (len(blocks), BLOCK**3)
        self._sum[slots] += np.where(counted, np.minimum(distance, 1), 0).reshape(shape)
        self._weight[slots] += counted.reshape(shape)

    def _near(self, camera: Camera, depth: np.ndarray) -> np.ndarray:
        """(B, 3) blocks within the truncation of what a depth image shows."""
        rows, columns = np.nonzero(depth)
        directions = camera.directions(columns + 0.5, rows + 0.5).astype(np.float64)
        directions /= (directions @ -camera.world_from_camera[:3, 2])[:, None]
        reach, side, start = TRUNCATION * self.voxel, BLOCK * self.voxel, camera.center - self.origin
        found = [
            np.unique(np.floor((start + directions * (depth[rows, columns] + step)[:, None]) / side), axis=0)
            for step in np.arange(-reach, reach + 1e-9, side / 2)
        ]
        return np.unique(np.concatenate(found), axis=0).astype(int)

    def _slots(self, blocks: np.ndarray) -> np.ndarray:
        slots = [self._blocks.setdefault(tuple(block), len(self._blocks)) for block in blocks.tolist()]
        if (more := len(self._blocks) - len(self._sum)) > 0:
            more = max(more, len(self._sum) // 2)  # seldom, in large steps
            self._sum, self._weight = (
                np.concatenate([held, np.zeros((more, BLOCK**3), np.float32)]) for held in (self._sum, self._weight)
            )
        return np.array(slots)

    def mesh(self) -> Mesh:
        """Return the zero of the field: surface nets, normals towards free space."""
        count = len(self._blocks)
        corner = np.array(list(self._blocks), int) * BLOCK
        index = (corner[:, None] + self._within).reshape(-1, 3)
        weight = self._weight[:count].ravel()
        known = weight > 0
        index, value = index[known], (self._sum[:count].ravel()[known] / weight[known]).astype(np.float64)
        low = index.min(axis=0) - 1
        grid = np.full(index.max(axis=0) - low + 2, np.nan, np.float32)
        grid[tuple((index - low).T)] = value
        return surface_nets(grid, self.origin + low * self.voxel, self.voxel)


def surface_nets(grid: np.ndarray, origin: np.ndarray, voxel: float) -> Mesh:
    """Mesh the zero of a field on a dense grid (X, Y, Z); NaN is unknown, positive is free space.

    A quad for each grid edge that the surface crosses, joining the cells around it; none where a corner of one of
    them is unknown.
    """
    shape = np.array(grid.shape) - 1
    corners = [
        grid[i : i + shape[0], j : j + shape[1], k : k + shape[2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)
    ]
    crossed, known = np.zeros(shape, bool), np.ones(shape, bool)
    for values in corners:  # one at a time: the grid of a large room has hundreds of millions of corners
        crossed |= np.signbit(values) != np.signbit(corners[0])
        known &= np.isfinite(values)
    crossed &= known
    cells = np.argwhere(crossed)
    values = np.stack([values[crossed] for values in corners], axis=1).astype(np.float64)
    offsets = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
    total, count = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a in range(8):
        for b in range(a + 1, 8):
            if np.abs(offsets[a] - offsets[b]).sum() == 1:
                cut = np.signbit(values[:, a]) != np.signbit(values[:, b])
                share = values[cut, a] / (values[cut, a] - values[cut, b])
                total[cut] += offsets[a] + share[:, None] * (offsets[b] - offsets[a])
                count[cut] += 1
    vertices = origin + (cells + total / count[:, None]) * voxel
    number = np.full(shape, -1, np.int32)
    number[crossed] = np.arange(len(cells))
    quads = [_quads(grid, number, axis) for axis in range(3)]
    quad = np.concatenate(quads)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return Mesh(vertices.astype(np.float32), triangles.astype(np.int32))


def _quads(grid: np.ndarray, number: np.ndarray, axis: int) -> np.ndarray:
    """(Q, 4) vertices around the crossed grid edges along an axis."""
    field, cell = np.moveaxis(grid, axis, 0), np.moveaxis(number, axis, 0)
    if axis == 1:  # (y, x, z) is left-handed: the others in the order (z, x)
        field, cell = field.swapaxes(1, 2), cell.swapaxes(1, 2)
    first, second = field[:-1, 1:-1, 1:-1], field[1:, 1:-1, 1:-1]
    behind = np.signbit(first)
    cut = np.isfinite(first) & np.isfinite(second) & (behind != np.signbit(second))
    around = np.stack([cell[:, :-1, :-1], cell[:, 1:, :-1], cell[:, 1:, 1:], cell[:, :-1, 1:]], axis=-1)[cut]
    around, behind = around[(around >= 0).all(axis=1)], behind[cut][(around >= 0).all(axis=1)]
    around[~behind] = around[~behind][:, ::-1]
    return around


def without_crumbs(mesh: Mesh) -> Mesh:
    """Return a mesh without connected pieces of fewer than `PIECE` triangles, and without unused vertices."""
    a, b, c = mesh.triangles.T
    ends = (np.concatenate([a, b]), np.concatenate([b, c]))
    piece = connected_groups(ends, len(mesh.vertices))[a]
    kept = mesh.triangles[np.bincount(piece)[piece] >= PIECE]
    used, triangles = np.unique(kept, return_inverse=True)
    return Mesh(mesh.vertices[used], triangles.reshape(-1, 3).astype(np.int32))


def main() -> int:
    """Scan the room of a dataset."""
    parser = argparse.ArgumentParser("python -m benchmarks.scan", description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, help="dataset folder of a room with a true mesh")
    parser.add_argument("out", type=Path, help="PLY file to write")
    defaults = ScanSettings()
    parser.add_argument("--voxel", type=float, default=defaults.voxel, help="side of a voxel, metres")
    parser.add_argument("--noise", type=float, default=defaults.noise, help="standard deviation at 2 m, metres")
    parser.add_argument("--views", type=int, default=defaults.views, help="cameras at random")
    parser.add_argument("--seed", type=int, default=defaults.seed)
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    set_variant()
    dataset = Dataset(args.dataset)
    cameras = [camera for camera in dataset.cameras if camera.split == "train"]
    mesh = scanned(dataset.mesh(), cameras, ScanSettings(args.voxel, args.noise, args.views, args.seed))
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_ply(args.out, mesh)
    log.info("%s: %d triangles from %d views", args.out, len(mesh.triangles), len(cameras) + args.views)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
