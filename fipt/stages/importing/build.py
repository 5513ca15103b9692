"""Other people's layouts into a dataset folder (see `fipt.formats.layouts` for the layouts)."""

import json
import re
import shutil
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.files import atomic_folder, existing_file, write_text
from fipt.formats.images import read_ids, to_display, write_png
from fipt.formats.layouts import SEGMENT_FOLDERS, SourceView, numbered_file
from fipt.formats.manifests import write_manifest
from fipt.progress import progress
from fipt.scene.cameras import Camera, check_cameras, write_transforms
from fipt.scene.dataset import check_image, write_views
from fipt.scene.mesh import Mesh, read_mesh, write_ply
from fipt.scene.sources import CAPTURE, ImageSource, read_developed, read_source
from fipt.settings import dumped
from fipt.stages.importing.settings import ImportSettings

TRUTH_FOLDERS = {
    "kd": "DiffCol",
    "base_color": "BaseColor",
    "reflectance": "albedo",
    "emission": "Emit",
    "roughness": "Roughness",
    "metallic": "Metallic",
}
"""Layer of truth/{view}.exr -> folder of the FIPT synthetic layout, where the source has it."""

_SCALARS = ("roughness", "metallic")
_KNOWN = re.compile(
    r"mesh\.ply|transforms\.json|views\.json|room\.json|overlay\.png|images|segments|truth"
    r"|relight_truth|[\w.-]+\.manifest\.json|\..*"
)
"""What may lie in a dataset folder that an import replaces."""


@dataclass(frozen=True)
class Imported:
    """The dataset's cameras, in the source's order, and the source as it was read."""

    cameras: list[Camera]
    source: ImageSource


def import_scene(
    source: str | Path,
    format: str,
    dataset: str | Path,
    settings: ImportSettings,
    mesh: str | Path | None = None,
    manifest: str | Path | None = None,
    poses: str | Path | None = None,
    segments: str | Path | None = None,
) -> Imported:
    """Write the dataset folder of a source: complete, with its manifest last, or not at all.

    Parameters
    ----------
    source, format
        Folder (or transforms.json) and layout, see `fipt.formats.layouts`.
    dataset
        Folder to write; an earlier dataset there is replaced.
    mesh
        PLY or OBJ file in the source's world; default: the one that the layout names.
    manifest
        Default: ``import.manifest.json`` in the dataset.
    poses
        Format ``capture``: poses of the views, see `fipt.scene.sources.read_poses`. A room.json beside them or the
        mesh comes along.
    segments
        Format ``capture``: folder with ``part/VIEW.png`` or ``semantic/VIEW.png`` of the developed views, and names in
        ``part.json``, ``semantic.json``.

    Raises
    ------
    FiptError
        The source is incomplete or inconsistent, or the folder must not be replaced.
    """
    parsed = _parsed(source, format, settings, poses)
    dataset = Path(dataset)
    manifest = dataset / "import.manifest.json" if manifest is None else Path(manifest)
    _check_target(dataset, manifest, parsed)
    _check_present(parsed.frames)
    if mesh is None and parsed.mesh is None:
        raise FiptError(f"{source} has no mesh.ply", "name the room's mesh with --mesh")
    room, names = read_mesh(mesh or parsed.mesh), _semantic_names(parsed)
    for leftover in dataset.parent.glob(f".{dataset.name}.*.tmp"):  # of an import that was killed
        shutil.rmtree(leftover)

    with atomic_folder(dataset) as folder:
        write_ply(folder / "mesh.ply", room)
        cameras, shown = _write_frames(folder, parsed)
        _warn_outside(cameras, room)
        write_transforms(folder / "transforms.json", cameras)
        write_views(folder / "views.json", [*(camera.name for camera in cameras), *parsed.rejected], parsed.rejected)
        if segments is not None:
            _copy_segments(folder / "segments", Path(segments), cameras)
        for beside in (poses, mesh) if poses is not None else ():
            if beside is not None and (Path(beside).parent / "room.json").is_file():
                shutil.copyfile(Path(beside).parent / "room.json", folder / "room.json")
        for kind in SEGMENT_FOLDERS:
            if (folder / "segments" / kind).is_dir() and not (folder / "segments" / f"{kind}.json").is_file():
                ids = {"ids": names if kind == "semantic" else {}}
                write_text(folder / "segments" / f"{kind}.json", json.dumps(ids, indent=1) + "\n")
        if settings.overlay:
            _write_overlay(folder / "overlay.png", room, *shown)
        # A manifest outside the folder must not vouch for a dataset that is being exchanged.
        manifest.unlink(missing_ok=True)
        (dataset / "import.manifest.json").unlink(missing_ok=True)
    files = [path for path in dataset.resolve().rglob("*") if path.is_file()]
    written = {"format": format, **dumped(settings), "scale": parsed.scale}
    write_manifest(manifest.resolve(), "import", files, written)
    return Imported(cameras, parsed)


def _write_overlay(path: Path, mesh: Mesh, camera: Camera, radiance: np.ndarray) -> None:
    """Draw the mesh's edges over a view. Rays are traced for it alone: without it an import needs no ray tracer."""
    from fipt.render.variant import set_variant

    set_variant()
    from fipt.stages.importing.overlay import overlay

    write_png(path, overlay(mesh, camera, radiance))


def _parsed(source: str | Path, format: str, settings: ImportSettings, poses: str | Path | None) -> ImageSource:
    if (format == CAPTURE) != (poses is not None):
        raise FiptError(f"--poses belongs to the format {CAPTURE}, and only to it", "give both or neither")
    if poses is None:
        return read_source(source, format, settings.val_every)
    found = read_developed(source, poses, settings.val_every)
    return found if settings.exposure is None else replace(found, scale=settings.exposure)


# --- checks before anything is written ------------------------------------------------------------


def _check_target(dataset: Path, manifest: Path, source: ImageSource) -> None:
    """Refuse to replace anything but an earlier dataset."""
    place, root = dataset.resolve(), source.root.resolve()
    if place == root or place in root.parents:
        raise FiptError(f"the dataset {dataset} must not hold its source {source.root}", "choose another folder")
    if manifest.resolve().parent not in (place, *place.parents):
        raise FiptError(
            f"the manifest {manifest} must lie in the dataset {dataset} or in a folder above it",
            "choose another path",
        )
    if not dataset.exists():
        return
    if not dataset.is_dir():
        raise FiptError(f"the dataset {dataset} is a file", "choose another folder")
    names = {path.name for path in dataset.iterdir()}
    foreign = sorted(name for name in names if not _KNOWN.fullmatch(name))
    if not foreign and "transforms.json" in names and "views.json" not in names:
        foreign = ["transforms.json"]  # someone's source: a dataset has both
    if foreign:
        raise FiptError(
            f"the folder {dataset} exists and is not a dataset (it holds {foreign[0]})",
            "choose another folder, or delete it",
        )


def _check_present(frames: Iterable[SourceView]) -> None:
    missing = [frame for frame in frames if not frame.image.is_file()]
    if missing:
        raise FiptError(
            f"every frame must have an image; {len(missing)} have none, the first is view "
            f"{missing[0].name}: {missing[0].image}",
            "add the images or remove the frames",
        )


def _warn_outside(cameras: list[Camera], mesh: Mesh) -> None:
    """Warn of cameras outside the mesh's bounds: wrong axes, units, or a mesh of something else."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    outside = [c.name for c in cameras if ((c.center < low) | (c.center > high)).any()]
    if outside:
        sys.stderr.write(
            f"fipt: warning: {len(outside)} of {len(cameras)} cameras stand outside the mesh's "
            f"bounds ({', '.join(outside[:5])}); check axes, units and overlay.png\n"
        )


# --- frames ---------------------------------------------------------------------------------------


def _write_frames(folder: Path, source: ImageSource) -> tuple[list[Camera], tuple[Camera, np.ndarray]]:
    """Write images, truth and ids of every frame.

    Returns the cameras, and camera and radiance of the train view that shows most detail.
    """
    cameras: list[Camera] = []
    most = -1.0
    with progress("import", len(source.frames), " views") as bar:
        for frame in source.frames:
            channels, valid = _read_image(frame)
            if source.photographs:
                valid = channels["valid.Y"] = with_bounds(valid, channels["flags.Y"].astype(np.uint32))
            radiance = channels[""] = _scaled(channels[""], valid, source)
            camera = _camera(frame, *radiance.shape[1::-1])
            check_cameras([camera], source.root)
            check_image(radiance, valid, camera, frame.image)
            channels[""] = radiance = np.where(valid[..., None] > 0, radiance, 0.0)
            write_exr(folder / "images" / f"{frame.name}.exr", channels)
            _write_truth(folder, frame, camera)
            _write_segments(folder, frame, camera)
            cameras.append(camera)
            detail = float(np.abs(np.diff(to_display(radiance).astype(np.int16), axis=1)).mean())
            if frame.split == "train" and detail > most:
                shown, most = (camera, radiance), detail
            bar.advance()
    return cameras, shown


def _read_image(frame: SourceView) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels to write for an image ('' = RGB, its valid and flags), and its (H, W) weights."""
    found = read_exr(frame.image, required=("R", "G", "B"))
    channels = {"": np.stack([found[letter] for letter in "RGB"], axis=-1)}
    channels |= {name: found[name] for name in ("valid.Y", "flags.Y") if name in found}
    if frame.mask is not None:
        channels["valid.Y"] = _read_mask(frame.mask, channels[""].shape[:2])
    valid = channels.get("valid.Y", np.ones(channels[""].shape[:2], np.float32))
    return channels, np.clip(valid, 0.0, 1.0)


def with_bounds(valid: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """(H, W) weights in which clipped pixels count, as the lower bounds that their flag says they are."""
    bound = (flags & FLAG_SATURATED > 0) & (flags & (FLAG_OUTSIDE | FLAG_MOVED) == 0)
    return np.where(bound, 1.0, valid).astype(np.float32)


def _scaled(radiance: np.ndarray, valid: np.ndarray, source: ImageSource) -> np.ndarray:
    """Radiance in the dataset's unit. Noise of photographs may be negative; light is not, and becomes 0."""
    if not source.photographs:
        return radiance
    return np.where(valid[..., None] > 0, np.maximum(radiance, 0.0) * np.float32(source.scale), 0.0).astype(np.float32)


def _read_mask(path: Path, shape: tuple[int, int]) -> np.ndarray:
    from PIL import Image

    existing_file(path, "the mask of a frame")
    with Image.open(path) as image:
        mask = (np.array(image.convert("L")) > 0).astype(np.float32)
    if mask.shape != shape:
        raise FiptError(
            f"{path} must be {shape[1]}x{shape[0]} like its image; it is {mask.shape[1]}x{mask.shape[0]}",
            "export the mask at the image's size",
        )
    return mask


def _camera(frame: SourceView, width: int, height: int) -> Camera:
    """Camera of a frame whose picture has this size (which its source need not state)."""
    k = frame.intrinsics
    width, height = int(k.get("w", width)), int(k.get("h", height))
    focal = [
        k[length] if length in k else 0.5 * size / np.tan(0.5 * k[angle]) if angle in k else None
        for length, angle, size in (
            ("fl_x", "camera_angle_x", width),
            ("fl_y", "camera_angle_y", height),
        )
    ]
    fx, fy = (focal[0] or focal[1], focal[1] or focal[0])  # square pixels where one is stated
    if fx is None or fy is None:
        raise FiptError(
            f"view {frame.name}: the focal length must be known; found neither fl_x nor camera_angle_x",
            "add it to the camera file",
        )
    return Camera(
        name=frame.name,
        split=frame.split,
        width=width,
        height=height,
        fx=float(fx),
        fy=float(fy),
        cx=float(k.get("cx", width / 2)),
        cy=float(k.get("cy", height / 2)),
        world_from_camera=np.array(frame.world_from_camera, np.float64),
    )


def _write_truth(folder: Path, frame: SourceView, camera: Camera) -> None:
    if frame.folder is None:
        return
    layers: dict[str, np.ndarray] = {}
    for layer, name in TRUTH_FOLDERS.items():
        if not (frame.folder / name).is_dir():
            continue
        path = numbered_file(frame.folder / name, frame.number)
        channels = read_exr(path)
        values = _scalar(channels, path) if layer in _SCALARS else _rgb(channels, path)
        _check_layer(values, camera, path)
        layers[f"{layer}.Y" if layer in _SCALARS else layer] = values
    if "emission" in layers:
        layers["emission_mask.Y"] = (layers["emission"] > 0).any(axis=-1)
    if layers:
        write_exr(folder / "truth" / f"{frame.name}.exr", layers)


def _write_segments(folder: Path, frame: SourceView, camera: Camera) -> None:
    if frame.folder is None:
        return
    for kind, name in SEGMENT_FOLDERS.items():
        if not (frame.folder / name).is_dir():
            continue
        path = numbered_file(frame.folder / name, frame.number)
        ids = _scalar(read_exr(path), path).astype(np.float64)
        _check_layer(ids, camera, path)
        whole = np.rint(ids)
        bad = (np.abs(whole - ids) > 1e-3) | (whole > 65535)
        if bad.any():
            raise FiptError(
                f"{path} must hold whole ids from 0 to 65535; {int(bad.sum())} pixels do not, such as {ids[bad][0]:g}",
                "export the ids without filtering",
            )
        write_png(folder / "segments" / kind / f"{frame.name}.png", whole.astype(np.uint16))


def _rgb(channels: Mapping[str, np.ndarray], path: Path) -> np.ndarray:
    missing = [letter for letter in "RGB" if letter not in channels]
    if missing:
        raise FiptError(
            f"{path} must have the channels R, G, B; {', '.join(missing)} not among {', '.join(sorted(channels))}",
            "export the image with these channel names",
        )
    return np.stack([channels[letter] for letter in "RGB"], axis=-1)


def _scalar(channels: Mapping[str, np.ndarray], path: Path) -> np.ndarray:
    """The one channel of a grey image, or R of a grey one that was written as RGB."""
    if len(channels) == 1:
        return next(iter(channels.values()))
    for name in ("R", "Y"):
        if name in channels:
            return channels[name]
    raise FiptError(
        f"{path} must have a channel R or Y; found {', '.join(sorted(channels))}",
        "export the image with these channel names",
    )


def _check_layer(values: np.ndarray, camera: Camera, path: Path) -> None:
    """Refuse truth or ids of another size, or with values that are NaN, infinite or negative."""
    if values.shape[:2] != (camera.height, camera.width):
        raise FiptError(
            f"{path} must be {camera.width}x{camera.height} like the image; it is {values.shape[1]}x{values.shape[0]}",
            "export it at the image's size",
        )
    bad = ~(np.isfinite(values) & (values >= 0))
    if bad.any():
        raise FiptError(f"{path} must hold finite values >= 0; {int(bad.sum())} are not", "repair the file")


def _copy_segments(out: Path, source: Path, cameras: list[Camera]) -> None:
    """Copy id maps of the views, and their names; every view must have one of the right size."""
    if not any((source / kind).is_dir() for kind in SEGMENT_FOLDERS):
        raise FiptError(f"{source} must hold part/ or semantic/ with an id map of every view", "check the path")
    for kind in SEGMENT_FOLDERS:
        if not (source / kind).is_dir():
            continue
        for camera in cameras:
            path = source / kind / f"{camera.name}.png"
            ids = read_ids(path)
            _check_layer(ids, camera, path)
            write_png(out / kind / f"{camera.name}.png", ids)
        if (source / f"{kind}.json").is_file():
            shutil.copyfile(source / f"{kind}.json", out / f"{kind}.json")


def _semantic_names(source: ImageSource) -> dict[str, str]:
    """Id -> name as far as meta.json of a FIPT folder tells: id i + 1 is its material i."""
    path = source.root / "meta.json"
    if not path.is_file() or source.frames[0].folder is None:
        return {}
    try:
        materials = json.loads(path.read_text(encoding="utf-8"))["materials"]
        return {str(index): str(entry["name"]) for index, entry in enumerate(materials, start=1)}
    except (ValueError, KeyError, TypeError) as error:
        raise FiptError(f"{path} must list materials with names ({error!r})", "correct or remove it") from error
