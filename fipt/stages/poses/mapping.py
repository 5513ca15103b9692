"""Matches to cameras and points: incremental and global mapping, independently of each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap

from fipt.formats.files import atomic_folder
from fipt.scene.cameras import Camera
from fipt.stages.poses.matching import colmap_log, key, view_of
from fipt.stages.poses.model import Reconstruction, Tracks
from fipt.stages.poses.settings import PosesSettings

_LOSS = 0.5
"""Reprojection error from which on matches count less in the last adjustment, pixels."""

_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between COLMAP's camera axes (y down, looking along +z) and ours."""


def mapped(
    matches: Path, cameras: Sequence[Camera], mapper: str, min_matches: int, work: Path, settings: PosesSettings
) -> list[Reconstruction]:
    """Run one mapper on a database, or find its models made; largest model first, perhaps none.

    Parameters
    ----------
    matches
        Database of `fipt.stages.poses.matching`.
    cameras
        The views; models name them.
    mapper
        ``incremental`` or ``global``.
    min_matches
        Pairs of views with fewer matches do not count.
    """
    made_of = key(matches.name, mapper, min_matches, settings.intrinsics, settings.seed)
    out = work / f"{mapper}-{min_matches}-{made_of}"
    if not out.is_dir():
        with atomic_folder(out, r"\d+") as folder, colmap_log(work):
            run = _incremental if mapper == "incremental" else _global
            run(matches, folder, min_matches, settings)
            for model in folder.iterdir():
                _refine(model, settings)
    models = [_read(folder, cameras) for folder in sorted(out.iterdir()) if folder.is_dir()]
    return sorted(models, key=lambda model: (-len(model.cameras), -len(model.points)))


def _incremental(matches: Path, out: Path, min_matches: int, settings: PosesSettings) -> None:
    options = pycolmap.IncrementalPipelineOptions()
    options.min_num_matches = min_matches
    options.min_model_size = 3
    options.extract_colors = False
    options.random_seed = options.mapper.random_seed = settings.seed
    options.num_threads = options.mapper.num_threads = 1  # sums in one order: a seed gives one result
    refined = settings.intrinsics == "refined"
    # Few matches may place a camera here: whether it is right, other evidence tells.
    options.mapper.abs_pose_min_num_inliers = min(options.mapper.abs_pose_min_num_inliers, min_matches)
    options.triangulation.ignore_two_view_tracks = False
    options.ba_refine_focal_length = options.mapper.abs_pose_refine_focal_length = refined
    options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = False
    pycolmap.incremental_mapping(matches, matches.parent, out, options)


def _global(matches: Path, out: Path, min_matches: int, settings: PosesSettings) -> None:
    options = pycolmap.GlobalPipelineOptions()
    options.min_num_matches = min_matches
    options.random_seed = options.mapper.random_seed = settings.seed
    options.mapper.global_positioning.random_seed = options.mapper.rotation_averaging.random_seed = settings.seed
    options.num_threads = options.mapper.num_threads = 1
    options.mapper.bundle_adjustment.refine_focal_length = settings.intrinsics == "refined"
    options.mapper.bundle_adjustment.refine_extra_params = False
    pycolmap.global_mapping(matches, matches.parent, out, options)


def _refine(folder: Path, settings: PosesSettings) -> None:
    """Adjust a model once more with a loss that wrong matches hardly move (COLMAP's own least squares follows them)."""
    model, options = pycolmap.Reconstruction(folder), pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = settings.intrinsics == "refined"
    options.refine_extra_params = False
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = _LOSS
    options.ceres.solver_options.num_threads = 1
    pycolmap.bundle_adjustment(model, options)
    model.update_point_3d_errors()
    model.write(folder)


def _read(folder: Path, cameras: Sequence[Camera]) -> Reconstruction:
    """A COLMAP model in our axes."""
    model = pycolmap.Reconstruction(folder)
    known = {camera.name: camera for camera in cameras}
    images = sorted((model.image(image) for image in model.reg_image_ids()), key=lambda image: image.name)
    index = {image.image_id: i for i, image in enumerate(images)}
    points = [model.point3D(point) for point in sorted(model.point3D_ids())]
    pixels = {image.image_id: np.array([p.xy for p in image.points2D]).reshape(-1, 2) for image in images}
    seen = [
        (index[e.image_id], number, *pixels[e.image_id][e.point2D_idx])
        for number, point in enumerate(points)
        for e in point.track.elements
    ]
    table = np.array(seen, np.float64).reshape(-1, 4)
    return Reconstruction(
        cameras=tuple(_camera(image, known[view_of(image.name)]) for image in images),
        points=np.array([point.xyz for point in points], np.float64).reshape(-1, 3),
        errors=np.array([point.error for point in points], np.float32),
        tracks=Tracks(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2:].astype(np.float32)),
    )


def _camera(image: pycolmap.Image, view: Camera) -> Camera:
    pose = np.eye(4)
    pose[:3] = image.cam_from_world().inverse().matrix()
    assert image.camera is not None
    fx, fy, cx, cy = image.camera.params
    return Camera(view.name, view.split, view.width, view.height, fx, fy, cx, cy, pose @ _OPENGL)
