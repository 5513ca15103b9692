"""The views of other people's layouts, read with the standard library alone.

The workflow asks `read_source` when it plans, so nothing heavy may be imported here; the import reads the same frames,
so that both agree on names and splits.

Layouts, and the axes of their cameras (inside, every camera has OpenGL axes, see `conventions`):

========================  ==================================================  =====================
format                    files                                               axes
========================  ==================================================  =====================
``nerfstudio``            transforms.json, or Blender's                       x right, y up,
                          transforms_{train,val}.json; EXR images             looking along -z
``fipt-synthetic``        {train,val}/transforms.json, {train,val}/Image/     x left, y up,
                          NNN_0001.exr and truth beside it, scene.obj         looking along +z
``fipt-real``             cam.txt, K_list.txt, Image/NNN_0001.exr,            x right, y down,
                          segmentation/NNN.exr, scene.obj                     looking along +z
``capture``               developed photographs: hdr/VIEW.exr, VIEW.json,     as ``nerfstudio``
                          qa.json; poses in a transforms.json elsewhere
========================  ==================================================  =====================
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from fipt.errors import FiptError
from fipt.formats.files import check_name, existing_file
from fipt.formats.pose_files import is_pose_file, read_pose_file
from fipt.formats.views import read_rejected

FORMATS = ("nerfstudio", "fipt-synthetic", "fipt-real")

CAPTURE = "capture"
"""The one more layout, of developed photographs: see `read_developed`."""

SEGMENT_FOLDERS = {"part": "IndexMA", "semantic": "segmentation"}
"""Kind of segment ids -> folder of the FIPT layouts, where the source has it."""

Matrix = tuple[tuple[float, ...], ...]

_INTRINSICS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
_DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Camera models that are pinholes once their distortion is zero."""
_MESHES = ("mesh.ply", "mesh.obj", "scene.ply", "scene.obj")
_MALFORMED = (KeyError, TypeError, ValueError, AttributeError, IndexError)


@dataclass(frozen=True)
class Frame:
    """One view of a source, nothing of it opened yet.

    Attributes
    ----------
    name, split
        View name in the dataset, and ``train`` or ``val`` (empty until `read_source` decides).
    image
        The picture.
    world_from_camera
        4x4 rows, OpenGL axes, the source's units (metres).
    intrinsics
        What the source says of w, h, fl_x, fl_y, cx, cy (pixels) and camera_angle_x, _y (radians).
    mask
        An 8-bit picture, 0 where pixels are not to be used.
    folder, number
        FIPT layouts: where folders like ``Image`` and ``DiffCol`` lie, and the view's number there.
    """

    name: str
    split: str
    image: Path
    world_from_camera: Matrix
    intrinsics: Mapping[str, float]
    mask: Path | None = None
    folder: Path | None = None
    number: str = ""


@dataclass(frozen=True)
class Source:
    """All views of a source, and its mesh where it is known (None: the user names it).

    Attributes
    ----------
    photographs
        Whether the pictures are developed photographs, whose noise may be negative.
    scale
        Factor on all radiance of photographs.
    rejected
        View that a check has rejected -> why; not among the frames.
    unposed
        Views without a pose, left out.
    """

    frames: tuple[Frame, ...]
    mesh: Path | None
    root: Path
    photographs: bool = False
    scale: float = 1.0
    rejected: Mapping[str, str] = field(default_factory=dict)
    unposed: tuple[str, ...] = ()


def read_source(path: str | Path, format: str, val_every: int = 8) -> Source:
    """Read all frames of a source, without any picture.

    Parameters
    ----------
    path
        Folder of the source (``nerfstudio``: or its transforms.json).
    format
        One of `FORMATS`; the layouts share file names but not axes, so it is never guessed.
    val_every
        Every n-th view, beginning with the first, becomes ``val`` where the source has no split.

    Raises
    ------
    FiptError
        A file is missing or malformed, a name is unusable or occurs twice, no view is for training.
    """
    readers = dict(zip(FORMATS, (_nerfstudio, _fipt_synthetic, _fipt_real), strict=True))
    if format not in readers:
        raise FiptError(f"unknown format {format!r}", f"choose one of {', '.join(FORMATS)}")
    path = Path(path)
    if not path.exists():
        raise FiptError(f"the source {path} does not exist", "check the path")
    source = readers[format](path)
    return replace(source, frames=_checked(path, source.frames, val_every))


def has_segments(source: Source) -> bool:
    """Whether every training view of a source has segment ids of some kind."""
    folders = {frame.folder for frame in source.frames if frame.split == "train"}
    return None not in folders and any(
        all((folder / name).is_dir() for folder in folders) for name in SEGMENT_FOLDERS.values()
    )


def read_poses(path: str | Path, val_every: int = 8) -> tuple[Frame, ...]:
    """Read poses by view name: a nerfstudio or Blender transforms.json, or what `fipt.formats.pose_files` reads.

    A view is called as its picture, without folder and ending; the pictures may be of any kind. ``image`` of the
    frames means nothing.
    """
    path = Path(path)
    if is_pose_file(path):
        frames = [Frame(p.name, "", path, p.world_from_camera, p.intrinsics) for p in read_pose_file(path)]
    else:
        frames = _nerfstudio_frames(path, developed=False)
    return _checked(path, tuple(frames), val_every)


def read_developed(folder: str | Path, poses: str | Path, val_every: int = 8) -> Source:
    """Read the frames of developed photographs: those that the capture report accepts and that have a pose.

    Parameters
    ----------
    folder
        What ``fipt develop`` and ``fipt qa`` wrote: hdr/VIEW.exr, VIEW.json, qa.json.
    poses
        What `read_poses` reads; its intrinsics count only where calibration found none. Those of ``fipt pose`` (with a
        poses.json beside them) are of the developed views, and count; views that it rejected stay rejected.

    Raises
    ------
    FiptError
        A file is missing or malformed, or no accepted view has a pose.
    """
    folder = Path(folder)
    report = existing_file(folder / "qa.json", "the capture report")
    posed, estimated = read_poses(poses, val_every), (Path(poses).parent / "poses.json").is_file()
    judged = read_rejected(Path(poses).with_name("views.json")) if estimated else {}
    try:
        content = json.loads(report.read_text(encoding="utf-8"))
        states = {name: None if state["accepted"] else str(state["reason"]) for name, state in content["views"].items()}
        scale = float(content["exposure"]["scale"])
        frames = []
        for frame in posed:
            if frame.name in states and states[frame.name] is None:
                image = folder / "hdr" / f"{frame.name}.exr"
                camera = json.loads(existing_file(folder / f"{frame.name}.json", "the facts of a view").read_text())
                known = frame.intrinsics if estimated else camera["camera"] or frame.intrinsics
                frames.append(replace(frame, image=image, intrinsics=known, mask=None))
    except _MALFORMED as error:
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
            "name the poses' pictures as the views of the capture, and see the findings of qa.json",
        )
    return Source(
        tuple(frames),
        None,
        folder,
        photographs=True,
        scale=scale,
        rejected={name: why for name, why in refused.items() if name in names},
        unposed=tuple(name for name in states if name not in names),
    )


def _checked(path: Path, frames: tuple[Frame, ...], val_every: int) -> tuple[Frame, ...]:
    """Frames with usable, different names and with splits."""
    if not frames:
        raise FiptError(f"{path} must list at least one frame; it lists none", "check the source")
    seen: set[str] = set()
    for frame in frames:
        check_name(frame.name, f"{path}: view")
        if frame.name in seen:
            raise FiptError(
                f"{path}: view names must be unique; {frame.name} occurs twice",
                "rename one of the images",
            )
        seen.add(frame.name)
    if not any(frame.split for frame in frames):
        frames = tuple(
            replace(frame, split="train" if index % val_every else "val") for index, frame in enumerate(frames)
        )
    if not any(frame.split == "train" for frame in frames):
        raise FiptError(
            f"{path} must have at least one train view; all {len(frames)} are val",
            "raise import.val_every or give the source a split",
        )
    return frames


def numbered_file(folder: Path, number: str) -> Path:
    """File of a numbered view in a FIPT folder: NNN_0001.exr, or NNN.exr where only that exists."""
    short, long = folder / f"{number}.exr", folder / f"{number}_0001.exr"
    return short if short.is_file() and not long.is_file() else long


# --- nerfstudio and Blender ---------------------------------------------------------------------


def _nerfstudio(path: Path) -> Source:
    root = path.parent if path.is_file() else path
    single = path if path.is_file() else root / "transforms.json"
    by_split = {split: root / f"transforms_{split}.json" for split in ("train", "val", "test")}
    if single.is_file():
        frames = _nerfstudio_frames(single)
    elif by_split["train"].is_file():
        only_test = by_split["test"].is_file() and not by_split["val"].is_file()
        held_out = by_split["test" if only_test else "val"]
        frames = [
            replace(frame, name=f"{split}_{frame.name}", split=split)
            for split, file in (("train", by_split["train"]), ("val", held_out))
            for frame in _nerfstudio_frames(file)
        ]
    else:
        raise FiptError(
            f"{root} must hold transforms.json, or transforms_train.json and transforms_val.json",
            "check the source's path and format",
        )
    meshes = [root / name for name in _MESHES if (root / name).is_file()]
    return Source(tuple(frames), meshes[0] if meshes else None, root)


def _nerfstudio_frames(path: Path, developed: bool = True) -> list[Frame]:
    """Frames of a transforms.json; not ``developed``: their pictures may be photographs, distorted as they are."""
    shared, entries = _read_transforms(path)
    entries = _listed_splits(path, shared, entries)
    frames = []
    for index, entry in enumerate(entries):
        where = f"{path}, frame {index}"
        try:
            file_path = str(entry["file_path"])
            matrix = _matrix(entry["transform_matrix"])
            intrinsics = _intrinsics(where, {**shared, **entry}) if developed else _stated({**shared, **entry})
            mask = path.parent / entry["mask_path"] if entry.get("mask_path") else None
        except _MALFORMED as error:
            raise FiptError(f"{where} is malformed ({error!r})", "correct the file") from error
        name = _view_name(where, file_path) if developed else PurePosixPath(file_path).stem
        complete = file_path.lower().endswith(".exr")
        image = path.parent / (file_path if complete else f"{file_path}.exr")
        split = _split(where, entry, entries)
        frames.append(Frame(name, split, image, matrix, intrinsics, mask=mask))
    return frames


def _listed_splits(path: Path, shared: Mapping[str, Any], entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Frames with the split that nerfstudio's lists give them; those in no list are left out."""
    lists = {split: shared.get(f"{split}_filenames") for split in ("train", "val", "test")}
    if all(names is None for names in lists.values()):
        return entries
    splits = dict.fromkeys(lists["val"] or lists["test"] or (), "val")
    splits |= dict.fromkeys(lists["train"] or (), "train")
    unknown = splits.keys() - {str(entry.get("file_path")) for entry in entries}
    if unknown:
        raise FiptError(
            f"{path}: a split lists {min(unknown)}, which no frame has",
            "correct train_filenames and val_filenames",
        )
    return [{**entry, "split": splits[entry["file_path"]]} for entry in entries if entry.get("file_path") in splits]


def _read_transforms(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Shared keys and frames of a transforms.json."""
    existing_file(path, "the camera file")
    try:
        shared = json.loads(path.read_text(encoding="utf-8"))
        return shared, [dict(entry) for entry in shared.pop("frames")]
    except _MALFORMED as error:
        raise FiptError(
            f"{path} is not a transforms.json with frames ({error!r})", "check the source's format"
        ) from error


def _view_name(where: str, file_path: str) -> str:
    """Name of the picture without folder and .exr; names may hold other dots."""
    name = PurePosixPath(file_path).name
    suffix = PurePosixPath(name).suffix.lower()
    if suffix in (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".hdr"):
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


def _intrinsics(where: str, keys: Mapping[str, Any]) -> dict[str, float]:
    """Intrinsics among ``keys``, once they describe a pinhole without distortion."""
    model = keys.get("camera_model", "PINHOLE")
    if keys.get("is_fisheye"):
        model = "FISHEYE"
    if model not in _PINHOLES:
        raise FiptError(
            f"{where}: cameras must be pinholes; found {model}",
            "undistort the images first",
        )
    for key in _DISTORTION:
        if float(keys.get(key) or 0.0) != 0.0:
            raise FiptError(
                f"{where}: lens distortion must be zero; found {key} = {keys[key]}",
                "undistort the images first, then set the coefficients to 0",
            )
    return _stated(keys)


def _stated(keys: Mapping[str, Any]) -> dict[str, float]:
    return {key: float(keys[key]) for key in _INTRINSICS if keys.get(key) is not None}


def _matrix(rows: Sequence[Sequence[float]], flip: Sequence[int] = (1, 1, 1)) -> Matrix:
    """A 3x4 or 4x4 camera-to-world matrix as 4x4, camera axes multiplied by ``flip``."""
    if len(rows) not in (3, 4) or any(len(row) != 4 for row in rows):
        raise ValueError("transform_matrix must be 3x4 or 4x4")
    signs = (*flip, 1)
    top = [tuple(float(x) * sign for x, sign in zip(row, signs, strict=True)) for row in rows[:3]]
    return (*top, (0.0, 0.0, 0.0, 1.0))


# --- the published FIPT layouts -----------------------------------------------------------------


def _fipt_synthetic(root: Path) -> Source:
    frames = []
    for split in ("train", "val"):
        folder = root / split
        path = folder / "transforms.json"
        shared, entries = _read_transforms(path)
        for index, entry in enumerate(entries):
            where = f"{path}, frame {index}"
            try:
                file_path = str(entry.get("file_path", ""))
                matrix = _matrix(entry["transform_matrix"], flip=(-1, 1, -1))
                intrinsics = _intrinsics(where, {**shared, **entry})
            except _MALFORMED as error:
                raise FiptError(f"{where} is malformed ({error!r})", "correct the file") from error
            # Published scenes number pictures by position; a number in file_path says the same.
            match = re.fullmatch(r"(\d+)(?:_0001)?(?:\.exr)?", PurePosixPath(file_path).name)
            number = match[1] if match else f"{index:03d}"
            image = numbered_file(folder / "Image", number)
            frames.append(
                Frame(
                    f"{split}_{number}",
                    split,
                    image,
                    matrix,
                    intrinsics,
                    folder=folder,
                    number=number,
                )
            )
    return Source(tuple(frames), root / "scene.obj", root)


def _fipt_real(root: Path) -> Source:
    poses, calibrations = _triples(root / "cam.txt"), _triples(root / "K_list.txt")
    if len(poses) != len(calibrations):
        raise FiptError(
            f"{root}: cam.txt and K_list.txt must hold as many cameras; found {len(poses)} and {len(calibrations)}",
            "correct the lists",
        )
    frames = []
    for index, (pose, k) in enumerate(zip(poses, calibrations, strict=True)):
        number = f"{index:03d}"
        if abs(k[0][1]) > 1e-6 * abs(k[0][0]):
            raise FiptError(
                f"{root / 'K_list.txt'}, camera {index}: skew must be zero; found {k[0][1]}",
                "undistort the images first",
            )
        intrinsics = {"fl_x": k[0][0], "fl_y": k[1][1], "cx": k[0][2], "cy": k[1][2]}
        image = numbered_file(root / "Image", number)
        matrix = _look_at(f"{root / 'cam.txt'}, camera {index}", *pose)
        frames.append(Frame(number, "", image, matrix, intrinsics, folder=root, number=number))
    return Source(tuple(frames), root / "scene.obj", root)


def _triples(path: Path) -> list[Matrix]:
    """Read a count, then three lines of three numbers for each camera."""
    existing_file(path, "the camera list")
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    try:
        (count,) = (int(float(text)) for text in lines[0])
        rows = [tuple(map(float, line)) for line in lines[1:]]
    except (ValueError, IndexError) as error:
        raise FiptError(
            f"{path} must hold a count, then lines of three numbers ({error})", "correct the list"
        ) from error
    if len(rows) != 3 * count or any(len(row) != 3 for row in rows):
        raise FiptError(
            f"{path} must hold 3 lines of three numbers for each of {count} cameras; it holds {len(rows)} lines",
            "correct the list",
        )
    return [tuple(rows[start : start + 3]) for start in range(0, len(rows), 3)]


def _look_at(where: str, origin: Sequence[float], at: Sequence[float], up: Sequence[float]) -> Matrix:
    """World from an OpenGL camera at ``origin`` that looks at ``at``; ``up`` need not be square."""
    forward = _unit(where, [a - o for a, o in zip(at, origin, strict=True)])
    right = _unit(where, _cross(forward, up))
    above = _cross(right, forward)
    rows = zip(right, above, forward, origin, strict=True)
    return (*((r, u, -f, float(o)) for r, u, f, o in rows), (0.0, 0.0, 0.0, 1.0))


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _unit(where: str, vector: Sequence[float]) -> list[float]:
    length = math.hypot(*vector)
    if not (math.isfinite(length) and length > 1e-9):
        raise FiptError(f"{where}: origin, look-at point and up must span a camera", "correct the pose")
    return [x / length for x in vector]
