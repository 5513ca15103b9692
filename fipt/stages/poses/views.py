"""The views whose poses are wanted: developed photographs, or HDR images of any folder with intrinsics."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.files import check_name, existing_file
from fipt.formats.text import MALFORMED
from fipt.scene.cameras import Camera
from fipt.strict_json import parse_json

FEWEST = 3
"""Views from which poses can be estimated."""

_KEYS = ("w", "h", "fl_x", "fl_y", "cx", "cy")


@dataclass(frozen=True)
class UnposedViews:
    """Views without poses.

    Attributes
    ----------
    cameras
        Intrinsics of the views; their ``world_from_camera`` is the identity and means nothing.
    images
        View -> its EXR file.
    rejected
        View that an earlier check has rejected -> why; not among the cameras.
    orientation
        View -> EXIF orientation, 1 to 8, where it is known: pixels stay in the sensor's frame whatever it says.
    """

    cameras: tuple[Camera, ...]
    images: Mapping[str, Path]
    rejected: Mapping[str, str]
    orientation: Mapping[str, int] = field(default_factory=dict)

    def radiance(self, view: str) -> np.ndarray:
        """(H, W, 3) float32 linear RGB of a view."""
        return self.image(view)[0]

    def image(self, view: str) -> tuple[np.ndarray, np.ndarray]:
        """Read a view: (H, W, 3) float32 linear RGB, and (H, W) bool, where it shows something that stands still.

        Raises
        ------
        FiptError
            If the image is missing, damaged or of another size than its camera.
        """
        path, camera = self.images[view], next(c for c in self.cameras if c.name == view)
        channels = read_exr(path, required=("R", "G", "B"))
        radiance = np.stack([channels[letter] for letter in "RGB"], axis=-1)
        if radiance.shape[:2] != (camera.height, camera.width):
            raise FiptError(
                f"{path} must be {camera.width}x{camera.height} like its intrinsics; it is "
                f"{radiance.shape[1]}x{radiance.shape[0]}",
                "correct the intrinsics' w and h, or the image",
            )
        shown = np.asarray(np.isfinite(radiance).all(axis=-1))
        if "flags.Y" in channels:
            shown &= channels["flags.Y"].astype(np.uint32) & (FLAG_OUTSIDE | FLAG_MOVED) == 0
        if "valid.Y" in channels:
            shown &= (channels["valid.Y"] > 0) | _near_clipped(channels)
        return np.where(shown[..., None], radiance, 0).astype(np.float32), shown


def _near_clipped(channels: Mapping[str, np.ndarray]) -> np.ndarray:
    """(H, W) bool: clipped pixels and their neighbours. They have no weight, but show the edges of lamps."""
    flags = channels.get("flags.Y", np.zeros(channels["valid.Y"].shape)).astype(np.uint32)
    return cv2.dilate((flags & FLAG_SATURATED > 0).view(np.uint8), np.ones((5, 5), np.uint8)) > 0


def read_capture(folder: str | Path, held_out: Collection[str]) -> UnposedViews:
    """Read the developed views of a capture: hdr/VIEW.exr, VIEW.json, qa.json.

    Parameters
    ----------
    folder
        What ``fipt develop`` and ``fipt qa`` wrote.
    held_out
        Views that become ``val``.

    Raises
    ------
    FiptError
        A file is missing or damaged, nothing is known of the camera, or there are fewer than three views.
    """
    folder = Path(folder)
    report = existing_file(folder / "qa.json", "the capture report")
    try:
        states = json.loads(report.read_text(encoding="utf-8"))["views"]
        rejected = {name: str(state["reason"]) for name, state in states.items() if not state["accepted"]}
        accepted = [name for name in states if name not in rejected]
        stated = {
            name: json.loads(existing_file(folder / f"{name}.json", "the facts of a view").read_text())
            for name in accepted
        }
        facts = {name: own["camera"] for name, own in stated.items()}
        orientation = {name: int(own.get("orientation", 1)) for name, own in stated.items()}
    except MALFORMED as error:
        raise FiptError(
            f"{report} or what stands beside it is damaged ({error!r})", "develop the views again"
        ) from error
    without = [name for name, keys in facts.items() if keys is None]
    if without:
        raise FiptError(
            f"the intrinsics of every view must be known; those of {', '.join(without[:3])} are not",
            "calibrate the camera (docs/stages/capture.md), or run fipt pose with --source and --intrinsics",
        )
    cameras = tuple(_camera(name, facts[name], held_out, report) for name in accepted)
    images = {name: folder / "hdr" / f"{name}.exr" for name in accepted}
    return _checked(UnposedViews(cameras, images, rejected, orientation), folder)


def read_folder(folder: str | Path, intrinsics: str | Path, held_out: Collection[str]) -> UnposedViews:
    """Read the EXR images of a folder, undistorted, with intrinsics in the form of a transforms.json without poses.

    Parameters
    ----------
    folder
        Holds VIEW.exr.
    intrinsics
        JSON with w, h, fl_x and perhaps fl_y, cx, cy, in pixels; the same for all views, or in ``frames`` by
        ``file_path``.
    held_out
        Views that become ``val``.
    """
    folder, path = Path(folder), existing_file(intrinsics, "the file of intrinsics")
    try:
        shared = parse_json(path.read_text(encoding="utf-8"))
        own = {Path(frame["file_path"]).stem: frame for frame in shared.get("frames", ())}
    except MALFORMED as error:
        raise FiptError(f"{path} must hold w, h and fl_x in JSON ({error!r})", "see docs/stages/poses.md") from error
    images = {check_name(file.stem, f"{folder}: view"): file for file in sorted(folder.glob("*.exr"))}
    cameras = tuple(_camera(name, {**shared, **own.get(name, {})}, held_out, path) for name in images)
    return _checked(UnposedViews(cameras, images, {}), folder)


def _camera(name: str, keys: Mapping[str, Any], held_out: Collection[str], path: Path) -> Camera:
    try:
        known = {key: float(keys[key]) for key in _KEYS if keys.get(key) is not None}
        width, height, fx = int(known["w"]), int(known["h"]), known["fl_x"]
    except MALFORMED as error:
        raise FiptError(
            f"{path}: the intrinsics of view {name} must hold w, h and fl_x ({error!r})",
            "add them, in pixels of the undistorted image",
        ) from error
    if min(width, height) < 1 or not fx > 0 or not known.get("fl_y", fx) > 0:
        raise FiptError(f"{path}, view {name}: image size and focal length must be positive", "correct the intrinsics")
    return Camera(
        name=name,
        split="val" if name in held_out else "train",
        width=width,
        height=height,
        fx=fx,
        fy=known.get("fl_y", fx),
        cx=known.get("cx", width / 2),
        cy=known.get("cy", height / 2),
        world_from_camera=np.eye(4),
    )


def _checked(views: UnposedViews, folder: Path) -> UnposedViews:
    if len(views.cameras) < FEWEST:
        names = ", ".join(camera.name for camera in views.cameras) or "none"
        refused = f"; {len(views.rejected)} are rejected by the capture report" if views.rejected else ""
        raise FiptError(
            f"poses need at least {FEWEST} views; {folder} has {len(views.cameras)} ({names}{refused})",
            "take more photographs, in steps of 15 degrees and half a metre",
        )
    for path in views.images.values():
        existing_file(path, "the image of a view")
    return views
