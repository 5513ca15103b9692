"""A dataset with planted errors, beside the one that it is made of."""

from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import copy_file, link_folder
from fipt.formats.manifests import withdraw_manifest, write_manifest
from fipt.formats.text import read_json
from fipt.scene.cameras import read_radiance_scale, read_transforms, write_transforms
from fipt.scene.mesh import Mesh, read_mesh, write_ply
from fipt.settings import dumped
from fipt.stages.plant_errors import mesh as errors
from fipt.stages.plant_errors.settings import PlantErrorsSettings
from fipt.stages.plant_errors.views import exposures, scale_image, turned_cameras

_FOLDERS = ("images", "truth", "segments/part", "segments/semantic")
_ELSEWHERE = ("transforms.json", "views.json", "mesh.ply", "check_poses.json")
"""Files that the workflow knows by their names."""
_HOLDS = r"[\w.-]+\.(exr|png|json)"


def plant(source: Path, out: Path, settings: PlantErrorsSettings) -> dict[str, Any]:
    """Write a dataset like ``source`` with the errors of the settings; return what was done.

    Raises
    ------
    FiptError
        If the room is not known so well that a part can be named.
    """
    manifest = out / "images.manifest.json"
    withdraw_manifest(manifest)
    rng = np.random.default_rng(settings.seed)
    cameras = read_transforms(source / "transforms.json")
    mesh, figures = _worn(source, settings, np.mean([camera.center for camera in cameras], axis=0), rng)
    if settings.pose_angle:
        cameras = turned_cameras(cameras, settings.pose_angle, rng)
    _link(source, out)
    if settings.exposure_stops:
        train = [camera.name for camera in cameras if camera.split == "train"]
        factors = exposures(train, settings.exposure_stops, settings.exposure_share, rng)
        for view, factor in factors.items():
            scale_image(out / "images" / f"{view}.exr", factor)
        figures["exposures"] = factors
    for name in ("views.json", "prepare.json", "segments/part.json", "segments/semantic.json"):
        if (source / name).is_file():
            copy_file(source / name, out / name)
    if (source / "room.json").is_file() and not settings.removed_parts:
        copy_file(source / "room.json", out / "room.json")
    write_ply(out / "mesh.ply", mesh)
    scale = read_radiance_scale(source / "transforms.json")
    write_transforms(out / "transforms.json", cameras, radiance_scale=scale)
    listed = [path for path in out.rglob("*") if path.is_file() and path.name not in _ELSEWHERE and path != manifest]
    write_manifest(manifest, "plant_errors", listed, dumped(settings))
    return figures


def _worn(
    source: Path, settings: PlantErrorsSettings, viewers: np.ndarray, rng: np.random.Generator
) -> tuple[Mesh, dict[str, Any]]:
    """The mesh with its errors, and what they are."""
    mesh, figures = read_mesh(source / "mesh.ply"), {}
    if settings.moved_part or settings.removed_parts:
        if not (source / "room.json").is_file():
            raise FiptError(f"{source} has no room.json, which tells parts", errors.OTHERS)
        room = read_json(source / "room.json", "what is known of the room", "synthesize again")
        parts = errors.NamedParts.of(room, mesh)
        removed = parts.chosen(settings.removed_parts, "removed_parts")
        if settings.moved_part:
            part = parts.chosen([settings.moved_part], "moved_part")
            front, normal = errors.front_of(mesh, part, viewers)
            figures["moved"] = {"place": mesh.corners[front].mean(axis=(0, 1)).tolist(), "normal": normal.tolist()}
            mesh = errors.moved(mesh, front, settings.moved_by * normal)
        if removed.any():
            figures["removed"] = {"place": mesh.corners[removed].mean(axis=(0, 1)).tolist()}
            mesh = errors.without(mesh, removed)
    if settings.mesh_noise:
        mesh = errors.noisy(mesh, settings.mesh_noise, rng)
    return mesh, figures


def _link(source: Path, out: Path) -> None:
    """Link images, truth and ids; true images of relight setups, too."""
    setups = sorted(path.relative_to(source) for path in (source / "relight_truth").glob("*/"))
    for name in (*map(Path, _FOLDERS), *setups):
        if (source / name).is_dir():
            link_folder(source / name, out / name, _HOLDS)
