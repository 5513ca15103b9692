"""The tables of views on the page: images of the results at one exposure, embedded."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.progress import progress
from fipt.scene import display
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset, read_layers
from fipt.scene.references import find_references, read_reference
from fipt.stages.report import images
from fipt.stages.report.export import ExportCheck
from fipt.stages.report.files import read_json
from fipt.stages.report.images import EmbeddedImage
from fipt.stages.report.settings import ReportSettings

COLUMNS = (
    ("photo", "Photo"),
    ("render", "Re-rendered"),
    ("difference", "Difference"),
    ("kd", "Diffuse kd"),
    ("reflectance", "Reflectance a'"),
    ("roughness", "Roughness"),
    ("metallic", "Metallic"),
    ("confidence", "Confidence"),
    ("emission", "Emission"),
)
"""Columns of the view table: key and heading."""

_LARGEST_VIDEO = 6_000_000
"""Bytes of a video that the page takes in."""
_FRAMES_SHOWN = 4


@dataclass(frozen=True)
class ViewRow:
    """A view: its images by column key, those of the truth, and its re-rendering's PSNR, dB."""

    name: str
    split: str
    psnr: float | None
    shown: Mapping[str, EmbeddedImage]
    truth: Mapping[str, EmbeddedImage]


@dataclass(frozen=True)
class RelitView:
    """A view under other light: the original, an image per setup; the truth and the photograph of each or None."""

    name: str
    original: EmbeddedImage
    relit: Sequence[EmbeddedImage]
    truth: Sequence[EmbeddedImage | None]
    photographed: Sequence[EmbeddedImage | None] = ()


@dataclass(frozen=True)
class CameraSetup:
    """What the cameras of a setup see, where it has its own.

    Attributes
    ----------
    setup
        Its name.
    shown
        Its images, up to the page's number of views; of a path a few frames.
    frames
        Images there are.
    video
        The MP4 as data URI; None where there is none, or it is too large for the page.
    file
        Where the video lies in the results folder; None where there is none.
    """

    setup: str
    shown: Sequence[EmbeddedImage]
    frames: int
    video: str | None
    file: str | None


class ViewReader:
    """Reads and embeds images of a scene at one exposure."""

    def __init__(
        self,
        results: Path,
        data: Dataset | None,
        metrics: Mapping[str, Any],
        settings: ReportSettings,
        scale: float,
    ) -> None:
        self.results, self.data, self.metrics = results, data, metrics
        self.settings, self.scale = settings, scale
        self.names = display.shown_views(data, settings.max_views) if data else []
        self.photos = {name: photo for name in self.names if (photo := self._photo(name)) is not None}
        self.exposure = display.common_exposure(self.photos.values())

    @property
    def dataset(self) -> Dataset:
        """The dataset; without one no method that asks for it has views to show."""
        if self.data is None:
            raise RuntimeError("the results hold no dataset")
        return self.data

    def _photo(self, name: str) -> np.ndarray | None:
        path = self.results / "dataset" / "images" / f"{name}.exr"
        return self.dataset.image(name)[0] if path.is_file() else None

    def embed(self, key: str, label: str, pixels: np.ndarray) -> EmbeddedImage:
        """Embed an image at the page's width."""
        return EmbeddedImage(key, label, *images.embedded(pixels, self.settings.width))

    def _toned(self, key: str, label: str, radiance: np.ndarray) -> EmbeddedImage:
        return self.embed(key, label, display.tone_mapped(radiance, self.exposure))

    def rows(self) -> list[ViewRow]:
        """The view table."""
        with progress("report", len(self.names), " views") as bar:
            rows = []
            for name in self.names:
                rows.append(self._row(name))
                bar.advance()
        return rows

    def _row(self, name: str) -> ViewRow:
        split = self.dataset.camera(name).split
        shown, labels = {}, dict(COLUMNS)
        photo, render = self.photos.get(name), self._computed(self.results / "render", name)
        if photo is not None:
            shown["photo"] = self._toned("photo", labels["photo"], photo)
        if render is not None:
            shown["render"] = self._toned("render", labels["render"], render)
        if photo is not None and render is not None:
            pixels = images.difference_map(render, photo, self.exposure)
            pixels = pixels * (self.dataset.image(name)[1] > 0)[..., None]  # masked: nothing to compare with
            shown["difference"] = self.embed("difference", labels["difference"], pixels)
        path = self.results / "materials" / f"{name}.exr"
        layers = read_layers(path) if path.is_file() else {}
        for layer in layers.values():
            self._check_size(path, layer, name)
        hit = layers.get("hit")
        shown |= self._maps(layers, hit, "{}")
        per_view = (self.metrics.get(split) or {}).get("render_psnr_views") or {}
        truth = self._maps(self.dataset.truth(name) or {}, hit, "{}, truth")
        return ViewRow(name, split, per_view.get(name), shown, truth)

    def _maps(self, layers: Mapping[str, np.ndarray], hit: np.ndarray | None, label: str) -> dict[str, EmbeddedImage]:
        """Embed the material columns that ``layers`` holds."""
        shown = {}
        for key, heading in COLUMNS[3:]:
            if key not in layers:
                continue
            if key == "emission":
                pixels = display.tone_mapped(layers[key], self.exposure)
            else:
                pixels = images.surface_map(layers[key], hit, encode=layers[key].ndim == 3)
            shown[key] = self.embed(key, label.format(heading), pixels)
        return shown

    def _computed(self, folder: Path, name: str) -> np.ndarray | None:
        """Image of a folder of the results, as large as its view; None where there is none."""
        path = folder / f"{name}.exr"
        image = self._radiance(path)
        if image is not None:
            self._check_size(path, image, name)
        return image

    def _radiance(self, path: Path) -> np.ndarray | None:
        """Image that was rendered, in the photographs' unit; None where there is none."""
        return read_rgb(path) * self.scale if path.is_file() else None

    def _check_size(self, path: Path, image: np.ndarray, name: str) -> None:
        known = {camera.name: camera for camera in self.data.cameras} if self.data else {}
        if name in known and image.shape[:2] != (known[name].height, known[name].width):
            raise FiptError(
                f"{path} must be {known[name].width}x{known[name].height} like its view; it is "
                f"{image.shape[1]}x{image.shape[0]}",
                "delete it and run its stage again",
            )

    def relit_views(self, setups: Sequence[str]) -> list[RelitView]:
        """Views that these light setups have rendered, beside their original."""
        if self.data is None:
            return []
        folder, rows = self.results / "relight", []
        for camera in self.data.cameras:
            relit, truth, photographed = [], [], []
            for setup in setups:
                image = self._computed(folder / setup, camera.name)
                if image is None:
                    continue
                relit.append(self._toned("relit", setup, image))
                path = self.results / "dataset" / "relight_truth" / setup / f"{camera.name}.exr"
                known = read_rgb(path) if path.is_file() else None
                truth.append(None if known is None else self._toned("relit", f"{setup}, truth", known))
                photographed.append(self._reference(setup, camera))
            if relit and len(rows) < self.settings.max_views:
                rows.append(RelitView(camera.name, self._original(camera.name, relit), relit, truth, photographed))
        return rows

    def _reference(self, setup: str, camera: Camera) -> EmbeddedImage | None:
        """The photograph under a setup's light, at the exposure that the metrics found."""
        figures = (self.metrics.get("relight") or {}).get(setup) or {}
        if camera.name not in (figures.get("relight_psnr_views") or {}) or figures.get("of") != "reference":
            return None
        path = find_references(figures["reference"], [camera.name]).get(camera.name)
        if path is None:
            return None
        photo = read_reference(path, camera)[0] * figures["exposure"] * self.scale
        return self._toned("relit", f"{setup}, photographed", photo)

    def camera_setups(self, setups: Sequence[str]) -> list[CameraSetup]:
        """What the own cameras of these setups see, as far as it was joined."""
        found = []
        for setup in setups:
            path = self.results / "relight" / f"{setup}.manifest.json"
            content = read_json(path)
            if content is None:
                continue
            names = [Path(file).stem for file in sorted(content["files"]) if file.endswith(".png")]
            video = path.with_name(f"{setup}.mp4")
            there = video.name in content["files"] and video.is_file()
            moving = bool(content["settings"]["cameras"].get("path"))
            most = min(len(names), _FRAMES_SHOWN if moving else self.settings.max_views)
            chosen = [names[pick] for pick in np.linspace(0, len(names) - 1, most).round().astype(int)]
            # of any size: a camera that is called like a view is another
            seen = [(name, self._radiance(path.with_name(setup) / f"{name}.exr")) for name in chosen]
            shown = [self._toned("relit", name, image) for name, image in seen if image is not None]
            embedded = images.data_uri(video, "video/mp4", _LARGEST_VIDEO) if there else None
            if shown:
                file = video.relative_to(self.results).as_posix() if there else None
                found.append(CameraSetup(setup, shown, len(names), embedded, file))
        return found

    def exported_views(self, export: ExportCheck) -> list[RelitView]:
        """Our image of every checked view, beside what each exported file shows."""
        rows = []
        for name in dict.fromkeys(view for file in export.files for view in file.views):
            shown = []
            for file in export.files:
                image = self._computed(self.results / "export" / "check" / file.kind, name)
                if image is not None:
                    shown.append(self._toned("relit", f"{file.label}, {file.views[name]:.1f} dB", image))
            if shown:
                rows.append(RelitView(name, self._original(name, shown), shown, ()))
        return rows

    def _original(self, name: str, relit: Sequence[EmbeddedImage]) -> EmbeddedImage:
        """The re-rendering under the scene's own light, else the photograph."""
        original = self._computed(self.results / "render", name)
        if original is not None:
            return self._toned("original", "As captured, re-rendered", original)
        photo = self.photos.get(name)
        if photo is None:
            photo = self._photo(name)
        return self._toned("original", "Photo", photo) if photo is not None else relit[0]
