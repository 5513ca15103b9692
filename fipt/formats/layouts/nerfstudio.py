"""nerfstudio's transforms.json, and Blender's transforms_{train,val}.json: OpenGL axes, EXR images."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from fipt.errors import FiptError
from fipt.formats.layouts.common import Matrix, PosedViews, SourceView, number, pose_matrix
from fipt.formats.text import MALFORMED, read_json

_INTRINSICS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
"""Coefficients of a lens, of whatever model."""
_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Camera models that are pinholes once their distortion is zero."""
_OTHER_IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".hdr", ".dng", ".gif", ".webp", ".bmp", ".heic", ".avif")
_IDENTITY = tuple(tuple(float(row == column) for column in range(4)) for row in range(4))
_MESHES = ("mesh.ply", "mesh.obj", "scene.ply", "scene.obj")


def read_nerfstudio(path: Path) -> PosedViews:
    """Read transforms.json, or Blender's transforms_{train,val}.json; ``path`` is the file or its folder."""
    root = path.parent if path.is_file() else path
    if path.is_file() and path.suffix != ".json":
        raise FiptError(
            f"the source must be a folder or its transforms.json; {path} is another file",
            "name the folder of the views",
        )
    single = path if path.is_file() else root / "transforms.json"
    by_split = {split: root / f"transforms_{split}.json" for split in ("train", "val", "test")}
    if single.is_file():
        frames = nerfstudio_views(single)
    elif by_split["train"].is_file():
        only_test = by_split["test"].is_file() and not by_split["val"].is_file()
        held_out = by_split["test" if only_test else "val"]
        frames = [
            replace(frame, name=f"{split}_{frame.name}", split=split)
            for split, file in (("train", by_split["train"]), ("val", held_out))
            for frame in nerfstudio_views(file)
        ]
    else:
        raise FiptError(
            f"{root} must hold transforms.json, or transforms_train.json and transforms_val.json",
            "check the source's path and format",
        )
    meshes = [root / name for name in _MESHES if (root / name).is_file()]
    return PosedViews(tuple(frames), meshes[0] if meshes else None, root)


def nerfstudio_views(path: Path, developed: bool = True) -> list[SourceView]:
    """Read the views of a transforms.json; not ``developed``: they may be photographs, distorted as they are."""
    shared, entries = read_entries(path)
    entries = _listed_splits(path, shared, entries)
    frames, applied = [], _applied(path, shared)
    for index, entry in enumerate(entries):
        where = f"{path}, frame {index}"
        try:
            file_path = str(entry["file_path"])
            matrix = pose_matrix(entry["transform_matrix"])
            keys = {**shared, **entry}
            intrinsics = pinhole_intrinsics(where, keys) if developed else _stated(keys, _INTRINSICS + DISTORTION)
            mask, depth = (
                path.parent / entry[key] if entry.get(key) else None for key in ("mask_path", "depth_file_path")
            )
        except MALFORMED as error:
            raise FiptError(f"{where} is malformed ({error!r})", "correct the file") from error
        name = _view_name(where, file_path) if developed else PurePosixPath(file_path).stem
        complete = file_path.lower().endswith(".exr")
        image = path.parent / (file_path if complete else f"{file_path}.exr")
        split = _split(where, entry, entries)
        frames.append(SourceView(name, split, image, matrix, intrinsics, mask=mask, depth=depth, applied=applied))
    return frames


def _applied(path: Path, shared: Mapping[str, Any]) -> Matrix | None:
    """What nerfstudio says was done to the original world: applied_transform, then applied_scale; None: nothing."""
    try:
        rows = pose_matrix(shared.get("applied_transform") or _IDENTITY)
        scale = number(shared.get("applied_scale") or 1.0)
        if not all(map(math.isfinite, (scale, *(x for row in rows for x in row)))) or scale <= 0:
            raise ValueError("numbers must be finite, and the scale above 0")
    except MALFORMED as error:
        raise FiptError(
            f"{path}: applied_transform must be a 3x4 matrix and applied_scale a number ({error!r})", "correct the file"
        ) from error
    found = (*(tuple(scale * x for x in row) for row in rows[:3]), rows[3])
    return None if found == _IDENTITY else found


def _listed_splits(path: Path, shared: Mapping[str, Any], entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Frames with the split that nerfstudio's lists give them; those in no list are left out."""
    lists = {split: shared.get(f"{split}_filenames") for split in ("train", "val", "test")}
    if all(names is None for names in lists.values()):
        return entries
    splits = dict.fromkeys(lists["val"] or lists["test"] or (), "val")
    splits |= dict.fromkeys(lists["train"] or (), "train")
    both = set(lists["train"] or ()) & set(lists["val"] or lists["test"] or ())
    if both:
        raise FiptError(
            f"{path}: {min(map(str, both))} is listed for training, and as held out",
            "list it once: what a fit has seen judges nothing",
        )
    unknown = splits.keys() - {str(entry.get("file_path")) for entry in entries}
    if unknown:
        raise FiptError(
            f"{path}: a split lists {min(unknown)}, which no frame has",
            "correct train_filenames and val_filenames",
        )
    return [{**entry, "split": splits[entry["file_path"]]} for entry in entries if entry.get("file_path") in splits]


def read_entries(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Read the shared keys and the frames of a transforms.json."""
    shared = read_json(path, "the camera file", "check the source's format")
    try:
        return shared, [dict(entry) for entry in shared.pop("frames")]
    except MALFORMED as error:
        raise FiptError(
            f"{path} is not a transforms.json with frames ({error!r})", "check the source's format"
        ) from error


def _view_name(where: str, file_path: str) -> str:
    """Name of the image without folder and .exr; names may hold other dots."""
    name = PurePosixPath(file_path).name
    suffix = PurePosixPath(name).suffix.lower()
    if suffix in _OTHER_IMAGES:
        raise FiptError(
            f"{where}: images must be EXR files with linear radiance; found {file_path}",
            "convert the images and correct file_path",
        )
    return name[: -len(suffix)] if suffix == ".exr" else name


def _split(where: str, entry: Mapping[str, Any], entries: Sequence[Mapping[str, Any]]) -> str:
    if not any("split" in other for other in entries):
        return ""
    if entry.get("split") not in ("train", "val"):
        raise FiptError(
            f"{where}: split must be train or val; found {entry.get('split')!r}",
            "give every frame a split, or none",
        )
    return entry["split"]


def pinhole_intrinsics(where: str, keys: Mapping[str, Any]) -> dict[str, float]:
    """Intrinsics among ``keys``, once they describe a pinhole without distortion."""
    model = keys.get("camera_model", "PINHOLE")
    if keys.get("is_fisheye"):
        model = "FISHEYE"
    if model not in _PINHOLES:
        raise FiptError(
            f"{where}: cameras must be pinholes; found {model}",
            "undistort the images first",
        )
    for key in DISTORTION:
        if number(keys.get(key) or 0.0) != 0.0:
            raise FiptError(
                f"{where}: lens distortion must be zero; found {key} = {keys[key]}",
                "undistort the images first, then set the coefficients to 0",
            )
    return _stated(keys, _INTRINSICS)


def _stated(keys: Mapping[str, Any], names: Sequence[str]) -> dict[str, float]:
    found = {key: number(keys[key]) for key in names if keys.get(key) is not None}
    for key, value in found.items():
        above = "" if key in ("cx", "cy", *DISTORTION) else " above 0"
        if not math.isfinite(value) or (above and value <= 0):
            raise ValueError(f"{key} must be a finite number{above}; found {value:g}")
        if key in ("w", "h") and value != int(value):
            raise ValueError(f"{key} must be a whole number of pixels; found {value:g}")
        if key.startswith("camera_angle") and value >= math.pi:
            raise ValueError(f"{key} must be in radians, below pi; found {value:g}: is it in degrees?")
    return found
