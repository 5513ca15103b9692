"""Images, truth and segment ids of a source's views, checked and written in the dataset's form."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import check_marks, read_exr, write_exr
from fipt.formats.images import read_ids, read_pixels, to_display, write_png
from fipt.formats.layouts import SEGMENT_FOLDERS, TRUTH_FOLDERS, SourceView, numbered_file
from fipt.formats.layouts.own import ids_file, truth_file
from fipt.progress import progress
from fipt.scene.blocks import is_bound
from fipt.scene.cameras import Camera, check_cameras
from fipt.scene.dataset import check_image, read_layers
from fipt.scene.sources import ImageSource
from fipt.stages.importing.defects import DefectCheck
from fipt.stages.importing.encoding import EncodingCheck

_SCALARS = ("roughness", "metallic")
_SAME_FOCAL = 0.01
"""Share by which a focal length may differ from that of an angle of view beside it."""


def write_frames(folder: Path, source: ImageSource) -> tuple[list[Camera], str, dict[str, Any]]:
    """Write images, truth and ids of every frame.

    Returns the cameras; the train view that shows most detail; what is strange about the images
    (`EncodingCheck.facts`, and `DefectCheck.facts` as ``defects``).
    """
    cameras: list[Camera] = []
    check, defects = EncodingCheck(), DefectCheck()
    judged = source.merged or not source.photographs
    most = -1.0
    with progress("import", len(source.frames), " views") as bar:
        for frame in source.frames:
            channels, valid = read_image(frame)
            if judged:
                check.add(frame.name, channels, valid)
                defects.add(frame.name, channels, valid)
            channels.pop("alpha.Y", None)
            if source.photographs:
                valid = channels["valid.Y"] = with_bounds(valid, channels["flags.Y"].astype(np.uint32))
            radiance = channels[""] = _scaled(channels[""], valid, source)
            camera = _camera(frame, *radiance.shape[1::-1])
            check_cameras([camera], source.root)
            check_image(radiance, valid, camera, frame.image)
            channels[""] = radiance = np.where(valid[..., None] > 0, radiance, 0.0)
            write_exr(folder / "images" / f"{frame.name}.exr", channels)
            _write_truth(folder, frame, camera, source.scale)
            _write_segments(folder, frame, camera)
            cameras.append(camera)
            detail = float(np.abs(np.diff(to_display(radiance).astype(np.int16), axis=1)).mean())
            if frame.split == "train" and detail > most:
                shown, most = camera.name, detail
            bar.advance()
    if not judged:
        return cameras, shown, {}
    found = defects.facts()
    return cameras, shown, check.facts() | ({"defects": found} if found else {})


def written_radiance(folder: Path, view: str) -> tuple[np.ndarray, np.ndarray]:
    """Read back the (H, W, 3) radiance and (H, W) weights of a view that `write_frames` wrote."""
    channels = read_exr(folder / "images" / f"{view}.exr", required=("R", "G", "B"))
    radiance = np.stack([channels[letter] for letter in "RGB"], axis=-1)
    return radiance, np.clip(channels.get("valid.Y", np.ones(radiance.shape[:2], np.float32)), 0.0, 1.0)


def read_image(frame: SourceView) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Channels of a frame's image ('' = RGB, its valid, flags and alpha), and its (H, W) weights."""
    found = read_exr(frame.image, required=("R", "G", "B"))
    channels = {"": np.stack([found[letter] for letter in "RGB"], axis=-1)}
    channels |= {name: found[name] for name in ("valid.Y", "flags.Y") if name in found}
    check_marks(frame.image, channels)
    if "A" in found:
        channels["alpha.Y"] = found["A"]
    if frame.mask is not None:
        mask = _read_mask(frame.mask, channels[""].shape[:2])
        channels["valid.Y"] = mask * channels.get("valid.Y", np.float32(1))
    valid = channels.get("valid.Y", np.ones(channels[""].shape[:2], np.float32))
    return channels, np.clip(valid, 0.0, 1.0)


def with_bounds(valid: np.ndarray, flags: np.ndarray) -> np.ndarray:
    """(H, W) weights in which clipped pixels count, as the lower bounds that their flag says they are."""
    return np.where(is_bound(flags), 1.0, valid).astype(np.float32)


def _scaled(radiance: np.ndarray, valid: np.ndarray, source: ImageSource) -> np.ndarray:
    """Radiance in the dataset's unit. Noise of photographs may be negative; light is not, and becomes 0."""
    if source.photographs:
        radiance = np.where(valid[..., None] > 0, np.maximum(radiance, 0.0), 0.0)
    with np.errstate(over="ignore"):  # what is infinite then is named
        return (radiance * np.float32(source.scale)).astype(np.float32)


def _read_mask(path: Path, shape: tuple[int, int]) -> np.ndarray:
    mask = (read_pixels(path, "the mask of a frame", "L") > 0).astype(np.float32)
    if mask.shape != shape:
        raise FiptError(
            f"{path} must be {shape[1]}x{shape[0]} like its image; it is {mask.shape[1]}x{mask.shape[0]}",
            "export the mask at the image's size",
        )
    return mask


def _camera(frame: SourceView, width: int, height: int) -> Camera:
    """Camera of a frame whose image has this size (which its source need not state)."""
    k = frame.intrinsics
    width, height = int(k.get("w", width)), int(k.get("h", height))
    focal = [_focal(frame, axis, size) for axis, size in (("x", width), ("y", height))]
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


def _focal(frame: SourceView, axis: str, size: int) -> float | None:
    """Focal length in pixels along an axis of an image of this size, from fl_x or camera_angle_x; None: neither is."""
    length, angle = frame.intrinsics.get(f"fl_{axis}"), frame.intrinsics.get(f"camera_angle_{axis}")
    if angle is None:
        return length
    meant = 0.5 * size / float(np.tan(0.5 * angle))
    if length is not None and abs(meant - length) > _SAME_FOCAL * length:
        raise FiptError(
            f"view {frame.name}: fl_{axis} and camera_angle_{axis} must mean one lens; {length:g} pixels are not the "
            f"{meant:.6g} that {angle:g} radians across {size} pixels make",
            f"remove the one that is wrong: where an image was cropped or resized, camera_angle_{axis} or fl_{axis} is "
            "that of before",
        )
    return meant if length is None else length


def _write_truth(folder: Path, frame: SourceView, camera: Camera, scale: float) -> None:
    if frame.dataset is not None and (path := truth_file(frame.dataset, frame.name)).is_file():
        known = read_layers(path)
        for values in known.values():
            check_layer(values, camera, path)
        if scale != 1.0 and "emission" in known:
            known["emission"] = known["emission"] * np.float32(scale)
            write_exr(folder / "truth" / path.name, {k if v.ndim == 3 else f"{k}.Y": v for k, v in known.items()})
        else:
            _copied(path, folder / "truth" / path.name)
    if frame.folder is None:
        return
    layers: dict[str, np.ndarray] = {}
    for layer, name in TRUTH_FOLDERS.items():
        if not (frame.folder / name).is_dir():
            continue
        path = numbered_file(frame.folder / name, frame.number)
        channels = read_exr(path)
        values = _scalar(channels, path) if layer in _SCALARS else _rgb(channels, path)
        check_layer(values, camera, path)
        layers[f"{layer}.Y" if layer in _SCALARS else layer] = values
    if "emission" in layers:
        layers["emission"] = layers["emission"] * np.float32(scale)
        layers["emission_mask.Y"] = np.asarray((layers["emission"] > 0).any(axis=-1))
    if layers:
        write_exr(folder / "truth" / f"{frame.name}.exr", layers)


def _copied(path: Path, out: Path) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(path, out)


def _write_segments(folder: Path, frame: SourceView, camera: Camera) -> None:
    if frame.dataset is not None:
        for kind in SEGMENT_FOLDERS:
            if (path := ids_file(frame.dataset, kind, frame.name)).is_file():
                check_layer(read_ids(path), camera, path)
                _copied(path, folder / "segments" / kind / path.name)
    if frame.folder is None:
        return
    for kind, name in SEGMENT_FOLDERS.items():
        if not (frame.folder / name).is_dir():
            continue
        path = numbered_file(frame.folder / name, frame.number)
        ids = _scalar(read_exr(path), path).astype(np.float64)
        check_layer(ids, camera, path)
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


def check_layer(values: np.ndarray, camera: Camera, path: Path) -> None:
    """Refuse truth or ids of another size, or with values that are NaN, infinite or negative."""
    if values.shape[:2] != (camera.height, camera.width):
        raise FiptError(
            f"{path} must be {camera.width}x{camera.height} like the image; it is {values.shape[1]}x{values.shape[0]}",
            "export it at the image's size",
        )
    bad = ~(np.isfinite(values) & (values >= 0))
    if bad.any():
        raise FiptError(f"{path} must hold finite values >= 0; {int(bad.sum())} are not", "repair the file")
