"""Small scenes as code, which every test of the stages shares.

* `box`: a closed room, its triangles facing inwards; with all walls shining it is a white furnace.
* `two_planes`: a floor and a rectangular emitter above it, whose light on the floor has a closed form.
* `cornell`: a room with a block and two emitters. Its materials depend on the side of x = 0 alone, where its triangles
  and the voxels of `grid` are cut, so that our tracer and Mitsuba see the same materials everywhere.
* `write_dataset`: a box room with an emitter in its ceiling and three views, as a dataset folder.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.conventions import SUB_POSITIONS
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import FootprintSamples

# --- meshes ---------------------------------------------------------------------------------------

QUAD = np.array([[0, 1, 2], [0, 2, 3]], np.int32)


def joined(*meshes: Mesh) -> Mesh:
    """All meshes as one, in their order."""
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]).astype(np.int32),
    )


def quad(corner, u, v) -> Mesh:
    """A parallelogram of two triangles that faces u x v."""
    corner, u, v = (np.asarray(x, np.float32) for x in (corner, u, v))
    return Mesh(np.stack([corner, corner + u, corner + u + v, corner + v]), QUAD)


def sheet(corner, u, v, count: int) -> Mesh:
    """A parallelogram of 2 * count^2 triangles."""
    corner, u, v = (np.asarray(x, np.float64) for x in (corner, u, v))
    row, column = np.mgrid[: count + 1, : count + 1]
    places = corner + (row / count)[..., None] * u + (column / count)[..., None] * v
    at = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    one = np.stack([at, at + count + 1, at + 1], 1)
    other = np.stack([at + 1, at + count + 1, at + count + 2], 1)
    return Mesh(places.reshape(-1, 3).astype(np.float32), np.concatenate([one, other]).astype(np.int32))


def box(low, high) -> Mesh:
    """A closed box of 12 triangles that face inwards: -x, +x, -y, +y, -z, +z, two each."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    walls = []
    for axis in range(3):
        u, v = np.zeros(3), np.zeros(3)
        u[(axis + 1) % 3], v[(axis + 2) % 3] = (high - low)[[(axis + 1) % 3, (axis + 2) % 3]]
        opposite = low.copy()
        opposite[axis] = high[axis]
        walls += [quad(low, u, v), quad(opposite, v, u)]
    return joined(*walls)


def turned(mesh: Mesh) -> Mesh:
    """The mesh with all triangles facing the other way."""
    return Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy())


def emitter_quad(x, y, z) -> Mesh:
    """A rectangle at height y that faces down; ``x`` and ``z`` are its ranges."""
    return quad((x[0], y, z[0]), (x[1] - x[0], 0, 0), (0, 0, z[1] - z[0]))


@dataclass(frozen=True)
class Lit:
    """A mesh and what emits: (E,) triangles and their (E, 3) radiance."""

    mesh: Mesh
    triangle: np.ndarray
    radiance: np.ndarray


def lit(dark: Mesh, *emitters: tuple[Mesh, tuple[float, float, float]]) -> Lit:
    """``dark`` with emitters appended, each a mesh and its radiance."""
    first = len(dark.triangles)
    radiance = np.concatenate([np.tile(np.float32(color), (len(mesh.triangles), 1)) for mesh, color in emitters])
    mesh = joined(dark, *(mesh for mesh, _ in emitters))
    return Lit(mesh, np.arange(first, first + len(radiance), dtype=np.int32), radiance)


# --- a floor below rectangular emitters -----------------------------------------------------------


def floor(half: float = 4.0) -> Mesh:
    """A square in y = 0 that faces up."""
    return quad((-half, 0, -half), (0, 0, 2 * half), (2 * half, 0, 0))


def two_planes(*emitters: tuple[Mesh, tuple[float, float, float]]) -> Lit:
    """A floor and emitters above it."""
    return lit(floor(), *emitters)


def form_factor(x, y, z) -> float:
    """Share of the cosine-weighted hemisphere that a rectangle at height ``y`` covers, seen from the origin."""

    def corner(a: float, b: float) -> float:
        a, b = a / y, b / y
        p, q = np.sqrt(1 + a * a), np.sqrt(1 + b * b)
        return (a / p * np.arctan(b / p) + b / q * np.arctan(a / q)) / (2 * np.pi)

    return corner(x[1], z[1]) - corner(x[0], z[1]) - corner(x[1], z[0]) + corner(x[0], z[0])


# --- a room with a block --------------------------------------------------------------------------


def cornell() -> Lit:
    """A room [-1, 1]^3 cut at x = 0, a turned block on its left half, an emitter below the ceiling and a small one."""
    halves = []
    for x in ((-1, 0), (0, 1)):
        walls = box((x[0], -1, -1), (x[1], 1, 1))
        inner = 1 if x[1] == 0 else 0  # the wall at x = 0 is no wall
        keep = np.arange(12) // 2 != inner
        halves.append(Mesh(walls.vertices, walls.triangles[keep]))
    block = turned(box((-0.25, -0.35, -0.25), (0.25, 0.35, 0.25)))
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    block = Mesh((block.vertices @ turn.T + (-0.45, -0.62, -0.2)).astype(np.float32), block.triangles)
    large = (emitter_quad((-0.4, 0.3), 0.97, (-0.3, 0.4)), (6.0, 5.0, 4.0))
    small = (emitter_quad((0.6, 0.7), 0.5, (0.55, 0.65)), (30.0, 60.0, 90.0))
    return lit(joined(*halves, block), large, small)


@dataclass(frozen=True)
class Surface:
    """A material: base colour, roughness, metallic."""

    base_color: tuple[float, float, float]
    roughness: float
    metallic: float


DIFFUSE = Surface((0.7, 0.6, 0.5), 1.0, 0.0)
GLOSSY = Surface((0.3, 0.5, 0.6), 0.3, 0.0)
METAL = Surface((0.9, 0.7, 0.4), 0.4, 1.0)


@dataclass(frozen=True)
class Records:
    """Materials of the K voxels of `grid`."""

    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray


def grid(radiance=1.0, resolution: int = 2, side: float = 2.1, center=(0.0, 0.0, 0.0)) -> dict[str, np.ndarray]:
    """A radiance cache of one record a voxel, whichever way the surface faces there.

    ``radiance`` is a number, a colour or (K, 3).
    """
    count = resolution**3
    key = np.arange(count, dtype=np.int64)
    cell = np.stack([key % resolution, key // resolution % resolution, key // resolution**2], axis=1)
    return {
        "center": np.asarray(center, np.float64),
        "side": np.float64(side),
        "resolution": np.int64(resolution),
        "key": key,
        "facing": np.zeros(count, np.uint8),
        "point": ((cell + 0.5) / resolution * side - side / 2 + center).astype(np.float32),
        "radiance": np.broadcast_to(np.float32(radiance), (count, 3)).copy(),
        "count": np.ones(count, np.float32),
        "source": np.arange(count, dtype=np.int32),
        "part": np.zeros(count, np.int32),
    }


def sides(voxels: dict[str, np.ndarray], left: Surface, right: Surface) -> Records:
    """Materials of voxels by the sign of x."""
    is_left = voxels["point"][:, 0] < 0
    return Records(
        np.where(is_left[:, None], np.float32(left.base_color), np.float32(right.base_color)),
        np.where(is_left, left.roughness, right.roughness).astype(np.float32),
        np.where(is_left, left.metallic, right.metallic).astype(np.float32),
    )


# --- samples by hand ---------------------------------------------------------------------------------


def samples_of(position, triangle=0, weight=1.0, counts=None, views=("a",), shapes=None, **arrays) -> FootprintSamples:
    """Hits at positions (H, 3), one a pixel unless ``counts`` (P,) says otherwise; all else may be given too."""
    position = np.float32(position).reshape(-1, 3)
    n = len(position)
    counts = np.ones(n, int) if counts is None else np.asarray(counts)
    content = {
        "center": np.asarray(counts > 0, np.uint8),
        "position": position,
        "normal": np.tile(np.float32([0, 1, 0]), (n, 1)),
        "triangle": np.broadcast_to(np.int32(triangle), n).copy(),
        "footprint": np.full(n, 0.01, np.float32),
        "weight": np.broadcast_to(np.float32(weight), n).copy(),
        "sub": np.zeros((n, SUB_POSITIONS, 3), np.float16),
    }
    content["sub_triangle"] = np.repeat(
        np.int32(arrays.get("triangle", content["triangle"]))[:, None], SUB_POSITIONS, axis=1
    )
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return FootprintSamples(tuple(views), tuple(shapes or ((1, len(counts)),)), offsets, **(content | arrays))


def observed(samples, shading, images, clipped=None) -> list[ObservedShard]:
    """Shards with what is seen there: images are pairs of radiance (P, 3) and weight (P,)."""
    clipped = clipped or [np.zeros(len(weight), bool) for _, weight in images]
    rows = zip(samples, shading, images, clipped, strict=True)
    return [ObservedShard(shard, baked, *image, above) for shard, baked, image, above in rows]


def training_pixels(samples, shading, images, segments=None, clipped=None, **others):
    """Training pixels of the fit, as `observed` shards."""
    from fipt.stages.fit.batches import Pixels

    return Pixels(observed(samples, shading, images, clipped), segments, **others)


# --- a dataset ------------------------------------------------------------------------------------

WIDTH, HEIGHT, FOCAL = 16, 12, 8.0
SIZE = np.array([4.0, 3.0, 5.0])
EMITTER = ((1.0, 3.0), (1.5, 3.5))
"""x and z ranges of the emitter, metres."""
EMITTER_RADIANCE = (9.0, 8.0, 7.0)
COLORS = np.array(
    [[0.5, 0.1, 0.1], [0.1, 0.5, 0.1], [0.3, 0.3, 0.3], [0.2, 0.2, 0.2], [0.2, 0.2, 0.5], [0.4, 0.4, 0.2]]
)
"""Radiance of the walls -x, +x, -y, +y, -z, +z; so even that none is taken for an emitter."""
VIEWS = {"a": "train", "b": "train", "c": "val"}
_EYES = {
    "a": ((0.6, 1.4, 4.5), (2.2, 2.2, 1.5)),
    "b": ((3.5, 1.0, 0.6), (1.8, 2.3, 3.0)),
    "c": ((1.0, 1.2, 1.0), (2.4, 2.4, 3.4)),
}


def look_at(name: str, eye, at, split: str = "train", width=WIDTH, height=HEIGHT, focal=FOCAL) -> Camera:
    """A level camera at ``eye`` that looks at a point; y is up in the world."""
    back = np.subtract(eye, at) / np.linalg.norm(np.subtract(eye, at))
    right = np.cross([0.0, 1.0, 0.0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, np.asarray(eye, float)], axis=1)
    return Camera(name, split, width, height, focal, focal, width / 2, height / 2, pose)


def cameras() -> list[Camera]:
    """The three cameras of the box room."""
    return [look_at(name, *_EYES[name], split) for name, split in VIEWS.items()]


def room() -> Lit:
    """The box room; its emitter is a rectangle of the ceiling, cut out of it."""
    walls = box((0, 0, 0), SIZE)
    (x0, x1), (z0, z1) = EMITTER
    y, (w, _, d) = SIZE[1], SIZE
    around = [((0, w), (0, z0)), ((0, w), (z1, d)), ((0, x0), (z0, z1)), ((x1, w), (z0, z1))]
    dark = Mesh(walls.vertices, np.delete(walls.triangles, [6, 7], axis=0))
    return lit(
        joined(dark, *(emitter_quad(x, y, z) for x, z in around)),
        (emitter_quad(*EMITTER[:1], y, *EMITTER[1:]), EMITTER_RADIANCE),
    )


def image(camera: Camera, samples: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) radiance of a view of the box room, by pixel area; (H, W) wall at the pixel's centre + 1, emitter 7."""
    rows, columns = np.divmod(np.arange(camera.width * camera.height), camera.width)

    def seen(dx: float, dy: float) -> tuple[np.ndarray, np.ndarray]:
        d = camera.directions(columns + dx, rows + dy).astype(np.float64)
        with np.errstate(divide="ignore"):
            t = np.where(d > 0, (SIZE - camera.center) / d, np.where(d < 0, -camera.center / d, np.inf))
        axis = t.argmin(axis=1)
        wall = 2 * axis + (d[np.arange(len(d)), axis] > 0)
        p = camera.center + t.min(axis=1)[:, None] * d
        emitter = (wall == 3) & np.all(
            [(p[:, k] > low) & (p[:, k] < high) for k, (low, high) in zip((0, 2), EMITTER, strict=True)], axis=0
        )
        return np.where(emitter[:, None], EMITTER_RADIANCE, COLORS[wall]), np.where(emitter, 7, wall + 1)

    steps = (np.arange(samples) + 0.5) / samples
    mean = np.mean([seen(dx, dy)[0] for dx in steps for dy in steps], axis=0)
    shape = (camera.height, camera.width)
    return mean.reshape(*shape, 3).astype(np.float32), seen(0.5, 0.5)[1].reshape(shape).astype(np.uint16)


def write_dataset(root: Path) -> Path:
    """Write the box room and its views as a dataset folder; return it."""
    write_ply(root / "mesh.ply", room().mesh)
    write_transforms(root / "transforms.json", cameras())
    write_views(root / "views.json", list(VIEWS))
    for camera in cameras():
        radiance, part = image(camera)
        write_exr(root / "images" / f"{camera.name}.exr", {"": radiance})
        write_png(root / "segments" / "part" / f"{camera.name}.png", part)
    return root
