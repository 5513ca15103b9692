"""How far cameras are off, and the mesh: the small motions that bring what views show onto each other.

Pixel p of view i shows x, where its ray meets the mesh; view j shows x at q. Where both cameras and the mesh are right,
the two log luminances agree but for gloss and noise. A small motion of one of the three moves q by J dx:

    a_i(p) - a_j(q) = grad a_j(q) . J dx

    camera i    dx = (1 - d n^T / n.d) (v + w x (x - c_i))
    camera j    dx = -(v + w x (x - c_j))
    mesh        dx = d n^T / n.d (v + w x (x - o) + s (x - o))

d     direction of the ray, n the surface's normal, c a camera's centre, o the mean of all, J = dq / dx
v, w  translation and rotation vector of a motion, s the growth of the mesh

Least squares over pixels at edges, in a few steps that look at finer and finer structure, as direct alignment does
(Lucas and Kanade). First the mesh alone moves. Then each camera does too, under a prior that few are off: what all
cameras have in common is the mesh's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.sparse import coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.stages.check_poses.surface import ReducedView, surface_shown, visible

_STEPS = (
    *((3.0, False), (3.0, False), (2.0, False), (2.0, False), (2.0, False)),
    *((4.0, True), (2.5, True), (1.5, True), (1.5, True), (1.5, True)),
)
"""Blur of the images in each step, pixels, and whether cameras move by themselves in it.

A step brings a displacement of about as much as the blur."""

_PARTNERS = 6
"""Views that each is brought onto, those that share most with it."""

_MESH_VIEWS = 40
"""Views that tell the motion of the mesh, at most."""

_EDGES = 0.12
"""Share of a view's pixels that are looked at: those of the strongest slopes."""

_GRAZING = 0.2
"""Cosine between surface and ray, at least: below, an error of the mesh moves what is seen too far."""

_STRONG = 0.5
"""Difference from what is around, in log luminance, that counts at most: a lamp must not outweigh all else."""

_NOISE, _OUTLIER, _ALIKE = 0.1, 0.15, 50.0
"""Errors of log luminance: of a pixel, where one begins to count less, and how many pixels err as one."""

_MESH_PRIOR = np.array([0.1] * 3 + [0.1] * 3 + [0.1])
"""Deviations of v (over the distance of what views show), w (radians), s: so wide that only what no view
tells stays at rest."""

_FIXED = 1e12
"""Inverse variance that keeps a camera at rest."""

_CAMERA_PRIOR = np.array([0.0045] * 3 + [np.radians(0.3)] * 3)
"""Deviations of v (over that distance) and w of a sound camera, as far as this check tells them."""

_SPARSE = 3.0
"""Deviations from which on a camera's prior gives way: it is off, not inaccurate."""


@dataclass(frozen=True)
class MeshMotion:
    """What brings the mesh to where the views show it: metres along x, y, z, degrees, and its growth as a factor.

    ``distance`` is the median distance of what views show, metres.
    """

    moved: np.ndarray
    turned: float
    scale: float
    distance: float


@dataclass(frozen=True)
class CameraMotion:
    """What brings a camera to where its image shows it: metres, degrees, and how far its pixels move, by the median.

    The displacement is in pixels of the reduced view, without what all cameras share.
    """

    moved: float
    turned: float
    displacement: float


def align(
    scene: RayScene, views: Sequence[ReducedView], partners: Sequence[Sequence[int]]
) -> tuple[MeshMotion, list[CameraMotion]]:
    """Find the motions of the mesh and of each view's camera.

    Parameters
    ----------
    views
        V views.
    partners
        Of each view the numbers of those it is compared with, those that share most first; may be empty.
    """
    center = np.mean([view.camera.center for view in views], axis=0)
    distance = float(np.median(np.concatenate([_distances(view) for view in views])))
    pairs = [(i, j) for i, others in enumerate(partners) for j in others[:_PARTNERS]]
    every = -(-len(views) // _MESH_VIEWS)
    now, start = list(views), [view.camera for view in views]
    mesh, cameras = np.zeros(7), np.zeros((len(views), 6))
    with progress("align views", len(_STEPS), " steps") as bar:
        for blur, free in _STEPS:
            used = pairs if free else [pair for pair in pairs if pair[0] % every == 0]
            own, common = _step(_equations(scene, now, used, blur, center), cameras, distance, free)
            mesh, cameras = mesh + common, cameras + own
            start = [_mesh_fixed(camera, common, center) for camera in start]
            moved = [_moved(view.camera, step) for view, step in zip(now, own, strict=True)]
            now = [
                _seen_from(scene, v, _mesh_fixed(camera, common, center)) for v, camera in zip(now, moved, strict=True)
            ]
            bar.advance()
    return (
        MeshMotion(mesh[:3], float(np.degrees(np.linalg.norm(mesh[3:6]))), 1 + float(mesh[6]), distance),
        [
            CameraMotion(
                float(np.linalg.norm(own[:3])), float(np.degrees(np.linalg.norm(own[3:]))), _displacement(before, view)
            )
            for own, before, view in zip(cameras, start, now, strict=True)
        ],
    )


def _equations(
    scene: RayScene, views: Sequence[ReducedView], pairs: Sequence[tuple[int, int]], blur: float, center: np.ndarray
) -> tuple[csc_matrix, np.ndarray]:
    """Normal equations of the motions of V cameras and, in the last seven rows, of the mesh about ``center``."""
    images = [_image(view, blur) for view in views]
    edges = [_edges(view, image) for view, image in zip(views, images, strict=True)]
    size = 6 * len(views) + 7
    right = np.zeros(size)
    blocks = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for i, j in pairs:
        seen = _carried(scene, views[i], views[j], edges[i], (images[i], images[j]))
        along = (seen.slope * seen.direction).sum(axis=1)[:, None] * seen.normal_over_cosine
        here = _rows(seen.slope - along, seen.points - views[i].camera.center)
        there = -_rows(seen.slope, seen.points - views[j].camera.center)
        place = seen.points - center
        rows = np.column_stack([here, there, _rows(along, place), (along * place).sum(axis=1)])
        index = np.concatenate([np.arange(6 * i, 6 * i + 6), np.arange(6 * j, 6 * j + 6), np.arange(size - 7, size)])
        square = rows.T @ (rows * seen.weight[:, None])
        blocks.append((np.repeat(index, len(index)), np.tile(index, len(index)), square.reshape(-1)))
        right[index] += rows.T @ (seen.weight * seen.difference)
    row, column, value = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return coo_matrix((value, (row, column)), shape=(size, size)).tocsc(), right


def _step(
    equations: tuple[csc_matrix, np.ndarray], before: np.ndarray, distance: float, free: bool
) -> tuple[np.ndarray, np.ndarray]:
    """(V, 6) motions of the cameras, of which ``before`` (V, 6) were made already, and (7,) of the mesh.

    ``distance`` is that of what views show, metres. The cameras stay where they are unless they are ``free``.
    """
    matrix, right = equations
    length = np.array([distance] * 3 + [1.0] * 4)
    camera, mesh = _CAMERA_PRIOR * length[:6], _MESH_PRIOR * length
    off = ((before / camera) ** 2).sum(axis=1, keepdims=True)
    trust = camera**-2 / (1 + off / _SPARSE**2) if free else np.full(before.shape, _FIXED)
    prior = np.concatenate([trust.reshape(-1), mesh**-2])
    back = np.concatenate([(trust * before).reshape(-1), np.zeros(7)])
    found = spsolve(matrix + diags(prior, format="csc"), right - back)
    return found[:-7].reshape(-1, 6), found[-7:]


@dataclass(frozen=True)
class _Carried:
    """N pixels of a view beside what another one shows of the same surface.

    ``difference`` (N,) of the images; ``slope`` (N, 3) derivative of the other's by the surface point; ``points``,
    ``direction`` of the ray, ``normal_over_cosine`` n / n.d (N, 3); ``weight`` (N,).
    """

    difference: np.ndarray
    slope: np.ndarray
    points: np.ndarray
    direction: np.ndarray
    normal_over_cosine: np.ndarray
    weight: np.ndarray


def _carried(
    scene: RayScene, here: ReducedView, there: ReducedView, index: np.ndarray, images: tuple[np.ndarray, np.ndarray]
) -> _Carried:
    """Compare two views, by an image (3, H, W) of each, at flat pixels ``index`` of the first."""
    image_here, image_there = images
    pixels, front, _ = visible(scene, here, there, index)
    where = [pixels[front, 1] - 0.5, pixels[front, 0] - 0.5]
    known = map_coordinates(there.valid.astype(np.float32), where, order=1, mode="nearest") > 0.99
    level, down, across = (map_coordinates(layer, where, order=1, mode="nearest") for layer in image_there)
    points = here.points.reshape(-1, 3)[front].astype(np.float64)
    normal = here.normals.reshape(-1, 3)[front].astype(np.float64)
    direction = points - here.camera.center
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    cosine = (normal * direction).sum(axis=1)
    difference = image_here[0].reshape(-1)[front] - level
    weight = known * (cosine < -_GRAZING) / (1 + (difference / _OUTLIER) ** 2) / _NOISE**2 / _ALIKE
    slope = _by_point(there.camera, points, pixels[front], np.stack([across, down], axis=1))
    return _Carried(difference, slope, points, direction, normal / np.minimum(cosine, -1e-6)[:, None], weight)


def _by_point(camera: Camera, points: np.ndarray, pixels: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(N, 3) derivative by world points (N, 3), seen at pixels (N, 2), of an image with a slope (N, 2) there."""
    right, up, back = camera.world_from_camera[:3, :3].T
    depth = -(points - camera.center) @ back
    across, down = (slope * (camera.fx, camera.fy)).T
    off = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    return (across[:, None] * (right + off[:, :1] * back) + down[:, None] * (off[:, 1:] * back - up)) / depth[:, None]


def _rows(slope: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """(N, 6) derivatives by v and w where dx = v + w x arm, of what has the derivative (N, 3) by x."""
    return np.column_stack([slope, np.cross(arm, slope)])


def _image(view: ReducedView, blur: float) -> np.ndarray:
    """(3, H, W) log luminance in a band of sizes, and its slopes down and across."""
    middle = np.median(view.light[view.valid]) if view.valid.any() else 0.0
    light = np.clip(np.where(view.valid, view.light, middle).astype(np.float64), middle - 3, middle + 3)
    band = np.clip(gaussian_filter(light, blur) - gaussian_filter(light, 4 * blur), -_STRONG, _STRONG)
    return np.stack([band, *np.gradient(band)]).astype(np.float32)


def _edges(view: ReducedView, image: np.ndarray) -> np.ndarray:
    """Flat pixels of a view that have the strongest slopes of an image (3, H, W) of it."""
    steep = np.hypot(image[1], image[2]).reshape(-1) * (view.hit & view.valid).reshape(-1)
    strongest = np.argsort(-steep, kind="stable")[: int(_EDGES * steep.size)]
    return np.sort(strongest[steep[strongest] > 0])


def _seen_from(scene: RayScene, view: ReducedView, camera: Camera) -> ReducedView:
    return surface_shown(scene, camera, view.light, view.valid, view.color)


def _moved(camera: Camera, motion: np.ndarray) -> Camera:
    """The camera moved by v and turned by w about its centre."""
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = Rotation.from_rotvec(motion[3:]).as_matrix() @ pose[:3, :3]
    pose[:3, 3] += motion[:3]
    return replace(camera, world_from_camera=pose)


def _mesh_fixed(camera: Camera, motion: np.ndarray, center: np.ndarray) -> Camera:
    """The camera as it stands to the mesh once that has moved by (v, w, s), while the mesh stays where it is."""
    back = Rotation.from_rotvec(-motion[3:6]).as_matrix()
    pose = camera.world_from_camera.copy()
    pose[:3, :3] = back @ pose[:3, :3]
    pose[:3, 3] = center + back @ (pose[:3, 3] - center - motion[:3]) / (1 + motion[6])
    return replace(camera, world_from_camera=pose)


def _distances(view: ReducedView) -> np.ndarray:
    return np.linalg.norm(view.points[view.hit] - view.camera.center, axis=1)


def _displacement(before: Camera, now: ReducedView) -> float:
    """Median distance in pixels between where two poses of a camera see what one of them shows."""
    if not now.hit.any():
        return 0.0
    (old, _), (new, _) = (camera.project(now.points[now.hit]) for camera in (before, now.camera))
    return float(np.median(np.linalg.norm(new - old, axis=1)))
