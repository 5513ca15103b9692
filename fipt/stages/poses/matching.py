"""Features and matches of images, in COLMAP databases that are kept and used again."""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import cv2  # before pycolmap: the other way round, cv2's PNG writer aborts the process
import numpy as np
import pycolmap

from fipt.formats.files import atomic, atomic_folder, check_disk, check_memory, make_folder
from fipt.formats.images import write_png
from fipt.progress import progress
from fipt.registry import VERSIONS
from fipt.scene.cameras import Camera
from fipt.stages.poses.readable import local_contrast, mask
from fipt.stages.poses.settings import PosesSettings
from fipt.stages.poses.views import UnposedViews

assert cv2  # imported for its place above

FEWEST_MATCHES = 15
"""Matches below which a pair of images is not taken for one of the same thing."""

_ENDING = ".png"

_BYTES_A_PIXEL, _BYTES_OF_FEATURES = 80, 310
"""Of memory, for each pixel of the largest view, and of the image that a thread looks at (measured 61; 299)."""
_BYTES_ON_DISK, _BYTES_A_FEATURE = 2, 600
"""For each pixel of a view, and for each feature in both databases (measured 415)."""


@dataclass(frozen=True)
class Link:
    """Two views with verified matches.

    Attributes
    ----------
    views
        Indices of the two views, ascending.
    matches
        Number of matches that fit one geometry.
    turn
        (M,) distance of the matches from what a mere turn of the camera explains, pixels.
    """

    views: tuple[int, int]
    matches: int
    turn: np.ndarray


def database(views: UnposedViews, work: Path, settings: PosesSettings) -> Path:
    """Make images, features and matches of views, or find them made; return the database.

    Parameters
    ----------
    views
        With intrinsics.
    work
        Folder for images and databases; their names tell what they were made of.
    """
    _check_room(views, work, settings)
    images = _images(views, work)
    features = _features(views, images, work, settings)
    return _matches(features, len(views.cameras), work, settings)


def _check_room(views: UnposedViews, work: Path, settings: PosesSettings) -> None:
    """Refuse views that memory is too small for, or their images and features the disk."""
    sizes = [camera.width * camera.height for camera in views.cameras]
    scaled = [
        size * min(1.0, settings.max_size / max(camera.width, camera.height)) ** 2
        for size, camera in zip(sizes, views.cameras, strict=True)
    ]
    threads = min(settings.threads or os.cpu_count() or 1, len(sizes))
    needed = max(_BYTES_A_PIXEL * max(sizes), _BYTES_OF_FEATURES * int(max(scaled)) * threads)
    check_memory(needed, "the estimate of poses", "use a smaller poses.max_size or fewer poses.threads")
    kept = _BYTES_ON_DISK * sum(sizes) + _BYTES_A_FEATURE * settings.max_features * len(sizes)
    check_disk(work.parent, kept, "the estimate of poses")


@contextmanager
def colmap_log(work: Path) -> Iterator[None]:
    """Send the pages that COLMAP writes about its work to a file; the file descriptor, since C++ writes there."""
    sys.stderr.flush()
    kept = os.dup(2)
    make_folder(work)
    try:
        with open(work / "colmap.log", "ab") as file:
            os.dup2(file.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def view_of(image: str) -> str:
    """Name of the view of an image in a database."""
    return image.removesuffix(_ENDING)


def key(*parts: object) -> str:
    """Short hash of what something is made of."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:12]


def _images(views: UnposedViews, work: Path) -> Path:
    """Write 8-bit images and masks of all views to a folder named after their content, and after how they are made."""
    state = [(name, path.stat().st_size, path.stat().st_mtime_ns) for name, path in views.images.items()]
    out = work / f"images-{key(VERSIONS['poses'], state)}"
    if out.is_dir():
        return out
    with atomic_folder(out, "grey|mask") as folder, progress("images", len(views.cameras), " views") as bar:
        for camera in views.cameras:
            radiance, shown = views.image(camera.name)
            write_png(folder / "grey" / f"{camera.name}{_ENDING}", local_contrast(radiance, shown))
            # COLMAP looks for the image's name with one more ending.
            write_png(folder / "mask" / f"{camera.name}{_ENDING}.png", mask(shown))
            bar.advance()
    return out


def _features(views: UnposedViews, images: Path, work: Path, settings: PosesSettings) -> Path:
    """Find the features of all images; views of the same intrinsics share a camera."""
    kind = (settings.max_size, settings.max_features, settings.peak)
    grouped = [(k, [c.name for c in group]) for k, group in groupby(sorted(views.cameras, key=_k), key=_k)]
    out = work / f"features-{key(images.name, kind, grouped)}.db"
    if out.is_file():
        return out
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = settings.threads or -1
    options.max_image_size = settings.max_size
    options.sift.max_num_features = settings.max_features
    options.sift.peak_threshold = settings.peak
    with atomic(out) as temporary, progress("features", len(views.cameras), " views") as bar:
        pycolmap.Database.open(temporary).close()
        for (_, _, *intrinsics), names in grouped:
            reader = pycolmap.ImageReaderOptions()
            reader.camera_model = "PINHOLE"
            reader.camera_params = ",".join(f"{value:.17g}" for value in intrinsics)
            reader.mask_path = str(images / "mask")
            listed = [f"{name}{_ENDING}" for name in names]
            single, grey = pycolmap.CameraMode.SINGLE, images / "grey"
            with colmap_log(work):
                # First the list: threads finish in any order, and numbers by that order would change the result.
                pycolmap.import_images(temporary, grey, single, listed, reader)
                pycolmap.extract_features(
                    temporary,
                    grey,
                    image_names=listed,
                    camera_mode=single,
                    reader_options=reader,
                    extraction_options=options,
                    device=pycolmap.Device.cpu,
                )
            bar.advance(len(names))
    return out


def _k(camera: Camera) -> tuple[float, ...]:
    return camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy


def _matches(features: Path, count: int, work: Path, settings: PosesSettings) -> Path:
    exhaustive = count < settings.exhaustive_below
    kind = (settings.match_ratio, "exhaustive" if exhaustive else settings.overlap, settings.seed)
    out = work / f"matches-{key(features.name, kind)}.db"
    if out.is_file():
        return out
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads = settings.threads or -1
    options.sift.max_ratio = settings.match_ratio
    verification = pycolmap.TwoViewGeometryOptions()
    verification.min_num_inliers = FEWEST_MATCHES
    verification.ransac.random_seed = settings.seed
    pycolmap.set_random_seed(settings.seed)
    pairs = count * (count - 1) // 2 if exhaustive else count * settings.overlap
    with atomic(out) as temporary, progress("matching", pairs, " pairs") as bar:
        shutil.copyfile(features, temporary)
        near = pycolmap.SequentialPairingOptions()
        near.overlap, near.quadratic_overlap = settings.overlap, True
        every, device = pycolmap.ExhaustivePairingOptions(), pycolmap.Device.cpu
        with colmap_log(work):
            if exhaustive:
                pycolmap.match_exhaustive(temporary, options, every, verification, device)
            else:
                pycolmap.match_sequential(temporary, options, near, verification, device)
        bar.advance(pairs)
    return out


def counts(path: Path, cameras: Sequence[Camera]) -> np.ndarray:
    """(V,) int number of features of each view."""
    with pycolmap.Database.open(path) as data:
        found = {view_of(image.name): data.num_keypoints_for_image(image.image_id) for image in data.read_all_images()}
    return np.array([found.get(camera.name, 0) for camera in cameras])


def links(path: Path, cameras: Sequence[Camera]) -> list[Link]:
    """Pairs of views with verified matches, strongest first."""
    index = {camera.name: i for i, camera in enumerate(cameras)}
    found = []
    with pycolmap.Database.open(path) as data:
        names = {image.image_id: index[view_of(image.name)] for image in data.read_all_images()}
        rays = {number: _rays(data.read_keypoints(image)[:, :2], cameras[number]) for image, number in names.items()}
        pairs, geometries = data.read_two_view_geometries()
        for pair, geometry in zip(pairs, geometries, strict=True):
            matches = np.asarray(geometry.inlier_matches, np.int64)
            if len(matches) < FEWEST_MATCHES:
                continue
            a, b = (names[image] for image in pycolmap.pair_id_to_image_pair(pair))
            turn = _off_a_turn(rays[a][matches[:, 0]], rays[b][matches[:, 1]]) * cameras[b].fx
            found.append(Link((min(a, b), max(a, b)), len(matches), turn))
    return sorted(found, key=lambda link: (-link.matches, link.views))


def _rays(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """(N, 3) unit directions in the camera, x right, y down, z ahead."""
    x = (pixels[:, 0] - camera.cx) / camera.fx
    y = (pixels[:, 1] - camera.cy) / camera.fy
    rays = np.stack([x, y, np.ones_like(x)], axis=1).astype(np.float64)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _off_a_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(M,) angles between directions b and directions a after the turn that fits most of them best, radians."""
    good, away = np.ones(len(a), bool), np.zeros(len(a))
    for _ in range(5):
        u, _, vt = np.linalg.svd(b[good].T @ a[good])
        rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        away = np.linalg.norm(a @ rotation.T - b, axis=1)
        good = away <= max(np.median(away), 1e-9)
    return away
