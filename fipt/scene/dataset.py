"""The dataset folder: the one form every source is brought to."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr
from fipt.formats.files import write_text
from fipt.formats.images import read_ids
from fipt.formats.manifests import ListedFiles
from fipt.formats.views import read_gains, read_names, read_rejected
from fipt.scene.cameras import Camera, read_radiance_scale, read_transforms
from fipt.scene.mesh import Mesh, read_mesh
from fipt.scene.metals import METALS, JudgedMetals, read_metals

CHECKED = "check_poses.json"
"""File of a dataset with the verdicts of ``fipt check-poses``, beside views.json and read like it."""

_VIEWPOINTS = 16
"""Cameras that tell how far a room reaches; others stand between them."""

_MOST = 1e10
"""Radiance that no pixel has, in a unit in which rooms have about 0.25: the sun in a room lit by a candle has less.
Squares and sums of what is below stay far from the end of float32."""


class Dataset:
    """Read access to a dataset folder; only accepted views are listed.

    Attributes
    ----------
    root
        The folder.
    segments_root
        Folder with ``part/`` and ``semantic/`` ids: of the dataset, or others made of its images.
    cameras
        Accepted cameras in the order of transforms.json.
    rejected
        View that a check rejected -> why: what the import knew (views.json) and what the mesh told (`CHECKED`).

    Parameters
    ----------
    unchecked
        Leave out what the mesh told: for the check itself.
    mesh
        Another mesh of its images; None: its own.
    """

    def __init__(
        self,
        root: str | Path,
        segments: str | Path | None = None,
        unchecked: bool = False,
        mesh: str | Path | None = None,
    ) -> None:
        self.root = Path(root)
        self.segments_root = Path(segments) if segments else self.root / "segments"
        self._mesh = Path(mesh) if mesh else self.root / "mesh.ply"
        self.rejected = rejected_views(self.root)
        self._gains = read_gains(self.root / CHECKED)
        if unchecked:
            self.rejected, self._gains = read_rejected(self.root / "views.json"), {}
        cameras = read_transforms(self.root / "transforms.json")
        if not unchecked:
            _check_of_these(self.root / CHECKED, cameras)
        self.cameras = [c for c in cameras if c.name not in self.rejected]
        self._by_name = {camera.name: camera for camera in self.cameras}
        self._listed = ListedFiles(self.root)
        self._listed_ids = self._listed if segments is None else ListedFiles(self.segments_root)
        # Of the view that was read last: callers ask for them after its image, which is in the same file.
        self._flags: dict[str, np.ndarray | None] = {}

    @cached_property
    def radiance_scale(self) -> float:
        """Factor from the source's radiance to that of the images: people see the source's unit alone."""
        return read_radiance_scale(self.root / "transforms.json")

    def camera(self, view: str) -> Camera:
        """Return the camera of an accepted view."""
        if view not in self._by_name:
            raise FiptError(
                f"view {view} is not among the accepted views of {self.root}",
                "choose one of " + ", ".join(list(self._by_name)[:8]),
            )
        return self._by_name[view]

    def views(self, split: str) -> list[str]:
        """Names of the accepted views of a split (``train`` or ``val``)."""
        return [camera.name for camera in self.cameras if camera.split == split]

    def accepted(self, views: Iterable[str]) -> list[str]:
        """Return ``views`` without those that a check rejected: a plan is made before the checks."""
        return [view for view in views if view not in self.rejected]

    def mesh(self) -> Mesh:
        """The room's mesh, metres, with the places where its cameras stand."""
        step = max(1, -(-len(self.cameras) // _VIEWPOINTS))
        centers = np.array([camera.center for camera in self.cameras[::step]]).reshape(-1, 3)
        return replace(read_mesh(self._listed.check(self._mesh)), seen_from=centers)

    def image(self, view: str) -> tuple[np.ndarray, np.ndarray]:
        """Read an image and its weights; one of another exposure is brought to that of the others (`CHECKED`).

        Returns
        -------
        radiance
            (H, W, 3) float32 linear RGB, finite and >= 0 where the weight is positive.
        valid
            (H, W) float32 weights in [0, 1]; 1 where the file has no ``valid.Y``.

        Raises
        ------
        FiptError
            If the size differs from the camera's or pixels with weight are NaN, infinite or negative.
        """
        camera = self.camera(view)
        path = self.root / "images" / f"{view}.exr"
        channels = self._channels(view)
        radiance = np.stack([channels[letter] for letter in "RGB"], axis=-1)
        valid = np.clip(channels.get("valid.Y", np.ones(radiance.shape[:2], np.float32)), 0.0, 1.0)
        check_image(radiance, valid, camera, path)
        radiance = radiance * np.float32(self._gains.get(view, 1.0))
        return np.where(valid[..., None] > 0, radiance, 0.0).astype(np.float32), valid

    def flags(self, view: str) -> np.ndarray | None:
        """(H, W) uint32 bits of conventions.FLAG_*, or None where the source gave none."""
        if view not in self._flags:
            self._channels(view)
        return self._flags[view]

    def clipped(self, view: str) -> np.ndarray:
        """(H, W) bool: pixels whose radiance is only a lower bound; none where the source gave no flags."""
        flags, camera = self.flags(view), self.camera(view)
        if flags is None:
            return np.zeros((camera.height, camera.width), bool)
        return (flags & FLAG_SATURATED) > 0

    def shown(self, view: str) -> np.ndarray:
        """(H, W) bool: pixels that show the room: of a weight, within the frame, and nothing moved there."""
        shown, flags = self.image(view)[1] > 0, self.flags(view)
        return shown if flags is None else shown & (flags & (FLAG_OUTSIDE | FLAG_MOVED) == 0)

    def _channels(self, view: str) -> dict[str, np.ndarray]:
        path = self._listed.check(self.root / "images" / f"{view}.exr")
        channels = read_exr(path, required=("R", "G", "B"))
        flags = channels.get("flags.Y")
        self._flags = {view: None if flags is None else flags.astype(np.uint32)}
        return channels

    def segment_kind(self, wanted: str = "auto") -> str | None:
        """Return the kind of segments to use: ``wanted`` itself, or for ``auto`` part, else semantic, else None."""
        kinds = ("part", "semantic") if wanted == "auto" else () if wanted == "none" else (wanted,)
        for kind in kinds:
            if self.has_segments(kind):
                return kind
        if wanted not in ("auto", "none"):
            raise FiptError(f"{self.segments_root} has no {wanted} segments", "set segments: auto, or import them")
        return None

    def has_segments(self, kind: str) -> bool:
        """Whether there are segments of a kind, part or semantic."""
        return (self.segments_root / kind).is_dir()

    def segments(self, view: str, kind: str) -> np.ndarray:
        """(H, W) uint16 segment ids of a view, 0 = unknown."""
        path = self._listed_ids.check(self.segments_root / kind / f"{view}.png")
        ids, camera = read_ids(path), self.camera(view)
        if ids.shape != (camera.height, camera.width):
            raise FiptError(
                f"{path} must be {camera.width}x{camera.height} like its camera; it is {ids.shape[1]}x{ids.shape[0]}",
                "export the ids at the image's size",
            )
        return ids

    def metals(self) -> JudgedMetals:
        """Which parts are metal, as the join of segments found; nothing is known where none made them.

        Raises
        ------
        FiptError
            If the file of a join is damaged or missing.
        """
        path = self._listed_ids.check(self.segments_root / METALS)
        return read_metals(path) if path.is_file() or self._listed_ids.lists(path) else JudgedMetals()

    def truth(self, view: str) -> dict[str, np.ndarray] | None:
        """Ground truth of a view, or None: layer name -> (H, W, 3) or (H, W) float32."""
        path = self._listed.check(self.root / "truth" / f"{view}.exr")
        return read_layers(path) if path.is_file() else None


def check_image(radiance: np.ndarray, valid: np.ndarray, camera: Camera, path: Path) -> None:
    """Raise FiptError if an (H, W, 3) image does not fit its camera or holds what no radiance can be."""
    if radiance.shape[:2] != (camera.height, camera.width):
        raise FiptError(
            f"{path} must be {camera.width}x{camera.height} like its camera; it is "
            f"{radiance.shape[1]}x{radiance.shape[0]}",
            "correct the camera's size or the image",
        )
    for what, bad in (
        ("NaN", np.isnan(radiance)),
        ("infinite", np.isinf(radiance)),
        ("negative", radiance < 0),
        (f"{_MOST:.0e} times as bright as a room, more than the sun", radiance > _MOST),
    ):
        pixels = bad.any(axis=-1) & (valid > 0)
        if pixels.any():
            row, column = np.argwhere(pixels)[0]
            raise FiptError(
                f"{path} must hold finite radiance >= 0; {int(pixels.sum())} pixels are {what}, the first at row "
                f"{row}, column {column}",
                "repair the image, or set valid.Y to 0 there",
            )


def read_layers(path: str | Path) -> dict[str, np.ndarray]:
    """Read an EXR of layers: ``name.R/.G/.B`` become (H, W, 3) under ``name``, ``name.Y`` (H, W)."""
    channels = read_exr(path)
    layers: dict[str, np.ndarray] = {}
    for name in sorted({channel.rpartition(".")[0] for channel in channels}):
        if f"{name}.Y" in channels:
            layers[name] = channels[f"{name}.Y"]
        else:
            letters = [f"{name}.{letter}" if name else letter for letter in "RGB"]
            missing = [letter for letter in letters if letter not in channels]
            if missing:
                raise FiptError(f"{path}: layer {name!r} lacks {', '.join(missing)}", "write all three channels")
            layers[name] = np.stack([channels[letter] for letter in letters], axis=-1)
    return layers


def rejected_views(root: Path) -> dict[str, str]:
    """View of a dataset that some check rejected -> why."""
    return read_rejected(root / "views.json") | read_rejected(root / CHECKED)


def _check_of_these(path: Path, cameras: Sequence[Camera]) -> None:
    """Refuse verdicts about views that the dataset does not have: they are of another one."""
    unknown = sorted(set(read_names(path)) - {camera.name for camera in cameras})
    if unknown:
        raise FiptError(
            f"{path} must be about views of this dataset; {', '.join(unknown[:8])} is not one: it was made of another",
            "delete it, and run fipt check-poses --reject again",
        )


def write_views(path: str | Path, names: Sequence[str], rejected: Mapping[str, str] | None = None) -> None:
    """Write views.json: every view accepted, or rejected with its reason."""
    rejected = rejected or {}
    views = {
        name: {"accepted": False, "reason": rejected[name]} if name in rejected else {"accepted": True}
        for name in names
    }
    write_text(path, json.dumps({"views": views}, indent=1) + "\n")
