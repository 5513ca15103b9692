"""The views of a source: read by its layout's reader, named, split, and judged by what earlier checks wrote.

The workflow asks `read_source` when it plans, so nothing heavy may be imported here; the import reads the same views,
so that both agree on names and splits. One more source than `fipt.formats.layouts` has is that of developed photographs
(hdr/VIEW.exr, VIEW.json, qa.json, poses elsewhere): see `read_developed`.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.files import check_distinct, check_name, existing_file, natural
from fipt.formats.layouts import DISTORTION, READERS, SEGMENT_FOLDERS, TRUTH_FOLDERS, SourceView, nerfstudio_views
from fipt.formats.layouts.own import ids_file, truth_file
from fipt.formats.pose_files import is_pose_file, read_pose_file
from fipt.formats.text import MALFORMED
from fipt.formats.views import read_rejected

CAPTURE = "capture"
"""The format of developed photographs."""

EXIF_LENS = "EXIF focal length"
"""Said in VIEW.json of a lens of which nothing else is known: whole millimetres, often, and no distortion."""

_STRAIGHT = 1e-3
"""Largest distortion coefficient of images that are taken to be undistorted: their corners are off by about a pixel."""


@dataclass(frozen=True)
class ImageSource:
    """All views of a source, and its mesh where it is known (None: the user names it).

    Attributes
    ----------
    photographs
        Whether the images are developed photographs, whose noise may be negative.
    merged
        Whether somebody else has merged these: nobody has looked for clipped pixels, say.
    scale
        Factor on all radiance.
    rejected
        View that a check has rejected -> why; not among the frames.
    unposed
        Views without a pose, left out.
    masked
        Views whose pose names a mask, of the photograph: it is not used.
    """

    frames: tuple[SourceView, ...]
    mesh: Path | None
    root: Path
    photographs: bool = False
    merged: bool = False
    scale: float = 1.0
    rejected: Mapping[str, str] = field(default_factory=dict)
    unposed: tuple[str, ...] = ()
    masked: tuple[str, ...] = ()


def read_source(path: str | Path, format: str, val_every: int = 8) -> ImageSource:
    """Read all frames of a source, without any image.

    Parameters
    ----------
    path
        Folder of the source (``nerfstudio``: or its transforms.json).
    format
        A key of `READERS`; the layouts share file names but not axes, so it is never guessed.
    val_every
        Every n-th view by name, beginning with the first, becomes ``val`` where the source has no split.

    Raises
    ------
    FiptError
        A file is missing or malformed, a name is unusable or occurs twice, no view is for training.
    """
    if format not in READERS:
        raise FiptError(f"unknown format {format!r}", f"choose one of {', '.join(READERS)}")
    path = Path(path)
    if not path.exists():
        raise FiptError(f"the source {path} does not exist", "check the path")
    layout = READERS[format](path)
    return ImageSource(_split(path, _named(path, layout.views), val_every), layout.mesh, layout.root)


def has_segments(source: ImageSource) -> bool:
    """Whether every training view of a source has segment ids of some kind."""
    training = [frame for frame in source.frames if frame.split == "train"]
    if training[0].dataset is not None:
        own = training[0].dataset
        return any(all(ids_file(own, kind, frame.name).is_file() for frame in training) for kind in SEGMENT_FOLDERS)
    folders = {frame.folder for frame in source.frames if frame.split == "train"}
    return any(
        all(folder is not None and (folder / name).is_dir() for folder in folders) for name in SEGMENT_FOLDERS.values()
    )


def has_materials(source: ImageSource) -> bool:
    """Whether every training view of a source has true base colour, roughness, metallic and emission."""
    training = [frame for frame in source.frames if frame.split == "train"]
    own, folders = training[0].dataset, {frame.folder for frame in training}
    if own is not None:
        return all(truth_file(own, frame.name).is_file() for frame in training)
    needed = [TRUTH_FOLDERS[layer] for layer in ("base_color", "roughness", "metallic", "emission")]
    return all(folder is not None and (folder / name).is_dir() for folder in folders for name in needed)


def depth_files(source: ImageSource) -> dict[str, Path]:
    """Training view -> its depth map that exists, of a source that names one for each; else nothing.

    Raises
    ------
    FiptError
        If only some training views have one.
    """
    training = [frame for frame in source.frames if frame.split == "train"]
    files = {frame.name: frame.depth for frame in training if frame.depth is not None}
    if files and len(files) < len(training):
        missing = next(frame.name for frame in training if frame.depth is None)
        raise FiptError(
            f"{source.root}: all training views must have a depth_file_path, or none; {len(files)} of {len(training)} "
            f"do, {missing} does not",
            "add the others, or set depth.given: none",
        )
    return files


def read_poses(path: str | Path, val_every: int = 8, views: Collection[str] | None = None) -> tuple[SourceView, ...]:
    """Read poses by view name: a nerfstudio or Blender transforms.json, or what `fipt.formats.pose_files` reads.

    A view is called as its image, without folder and ending; the images may be of any kind. ``image`` of the
    frames means nothing.

    Parameters
    ----------
    path
        File or folder.
    val_every
        As in `read_source`.
    views
        Those that are photographed: others are left out before the split. None: all are.

    Raises
    ------
    FiptError
        As in `read_source`, or if no pose is of any of ``views``.
    """
    path = Path(path)
    if is_pose_file(path):
        posed = [SourceView(p.name, "", path, p.world_from_camera, p.intrinsics) for p in read_pose_file(path)]
    else:
        posed = nerfstudio_views(path, developed=False)
    found = _named(path, tuple(posed))
    known = tuple(frame for frame in found if views is None or frame.name in views)
    if views is not None and not known:
        raise FiptError(
            f"{path} must have poses of the photographed views, {', '.join(list(views)[:3])}; it has "
            f"{', '.join(frame.name for frame in found[:3])}",
            "name the poses' images as the views",
        )
    return _split(path, known, val_every)


def read_developed(folder: str | Path, poses: str | Path, val_every: int = 8) -> ImageSource:
    """Read the frames of developed photographs: those that the capture report accepts and that have a pose.

    Parameters
    ----------
    folder
        What ``fipt develop`` and ``fipt qa`` wrote: hdr/VIEW.exr, VIEW.json, qa.json.
    poses
        What `read_poses` reads; `_intrinsics` says when its intrinsics count. Those of ``fipt pose`` (with a poses.json
        beside them) are of the developed views, and count; views that it rejected stay rejected.

    Raises
    ------
    FiptError
        A file is missing or malformed, no accepted view has a pose, or nothing has undistorted a view.
    """
    folder = Path(folder)
    report = existing_file(folder / "qa.json", "the capture report")
    estimated = (Path(poses).parent / "poses.json").is_file()
    judged = read_rejected(Path(poses).with_name("views.json")) if estimated else {}
    try:
        content = json.loads(report.read_text(encoding="utf-8"))
        states = {name: None if state["accepted"] else str(state["reason"]) for name, state in content["views"].items()}
        scale, merged = float(content["exposure"]["scale"]), content.get("kind") == "merged"
        posed, frames = read_poses(poses, val_every, states), []
        for frame in posed:
            if frame.name in states and states[frame.name] is None:
                image = folder / "hdr" / f"{frame.name}.exr"
                facts = json.loads(existing_file(folder / f"{frame.name}.json", "the facts of a view").read_text())
                known = frame.intrinsics if estimated else _intrinsics(poses, frame, facts)
                frames.append(replace(frame, image=image, intrinsics=known, mask=None))
    except MALFORMED as error:
        raise FiptError(
            f"{report} or what stands beside it is damaged ({error!r})", "develop the views again"
        ) from error
    names = {frame.name for frame in posed} | judged.keys()
    refused = judged | {name: why for name, why in states.items() if why is not None}
    accepted = [name for name, why in states.items() if why is None]
    if not any(frame.split == "train" for frame in frames):
        raise FiptError(
            f"{poses} must have the pose of an accepted training view of {folder}; it has "
            f"{', '.join(sorted(names)[:3])}, accepted are {', '.join(accepted[:3]) or 'none'}",
            "name the poses' images as the views of the capture, and see the findings of qa.json",
        )
    return ImageSource(
        tuple(frames),
        None,
        folder,
        photographs=True,
        merged=merged,
        scale=scale,
        rejected={name: why for name, why in refused.items() if name in names},
        unposed=tuple(name for name in states if name not in names),
        masked=tuple(frame.name for frame in posed if frame.mask is not None),
    )


def _intrinsics(poses: str | Path, frame: SourceView, facts: Mapping[str, Any]) -> Mapping[str, float]:
    """Intrinsics of a developed view: its own, but those of its pose where EXIF alone tells its own, or nothing."""
    own, given = facts["camera"], frame.intrinsics
    if own is not None and facts.get("sources", {}).get("lens") != EXIF_LENS:
        return own
    for key in DISTORTION:
        if abs(given.get(key, 0.0)) > _STRAIGHT:
            raise FiptError(
                f"{poses}, view {frame.name}: lens distortion must be zero, since nothing has undistorted this view; "
                f"found {key} = {given[key]:g}",
                "undistort the photographs first and give the poses of those, or calibrate the lens",
            )
    if own is None:
        return given
    stated = not {"fl_x", "camera_angle_x"}.isdisjoint(given)
    if not stated or given.get("w", 0) * own["h"] != given.get("h", 0) * own["w"]:
        return own
    # poses are of the photographs, and views may have been averaged down since
    scale = {key: 1.0 if key.startswith("camera_angle") else own["w"] / given["w"] for key in given}
    return {key: value * scale[key] for key, value in given.items() if key not in DISTORTION}


def _named(path: Path, frames: tuple[SourceView, ...]) -> tuple[SourceView, ...]:
    """Frames with usable, different names, in the order of these: lists have one of chance."""
    if not frames:
        raise FiptError(f"{path} must list at least one frame; it lists none", "check the source")
    seen: set[str] = set()
    for frame in frames:
        check_name(frame.name, f"{path}: view")
        if frame.name in seen:
            raise FiptError(
                f"{path}: view names must be unique; {frame.name} occurs twice",
                "rename one of the images, or remove a frame that is listed twice",
            )
        seen.add(frame.name)
    check_distinct([frame.name for frame in frames], f"{path}, views")
    return tuple(sorted(frames, key=lambda frame: (natural(frame.name), frame.name)))


def _split(path: Path, frames: tuple[SourceView, ...], val_every: int) -> tuple[SourceView, ...]:
    """Frames with splits: their own, or every n-th is held out."""
    split = any(frame.split for frame in frames)
    if not split:
        frames = tuple(
            replace(frame, split="train" if index % val_every else "val") for index, frame in enumerate(frames)
        )
    if not any(frame.split == "train" for frame in frames):
        raise FiptError(
            f"{path} must have at least one train view; all {len(frames)} are val",
            _remedy_without_training(split, len(frames)),
        )
    return frames


def _remedy_without_training(split: bool, views: int) -> str:
    """What to do where no view is trained, of views that the source splits or not."""
    if split:
        return "make some of them train in the source's split"
    return "raise import.val_every or give the source a split" if views > 1 else "give it more views, or a split"
