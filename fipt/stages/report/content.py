"""What the page shows, gathered from whatever files a results folder holds."""

import json
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from fipt import __version__
from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.formats.files import existing_file
from fipt.progress import human, progress
from fipt.scene import display
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset, read_layers, rejected_views
from fipt.scene.emitters import default_name
from fipt.scene.references import find_references, read_reference
from fipt.stages.report import pictures
from fipt.stages.report.capture import CaptureReport, read_capture
from fipt.stages.report.export import ExportCheck, read_check
from fipt.stages.report.mixer import Mixer, read_mixer
from fipt.stages.report.poses import PosesReport, read_poses
from fipt.stages.report.room import Room, read_room
from fipt.stages.report.segments import SegmentsReport, read_segments
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

TILES = (
    "kd_psnr",
    "reflectance_psnr",
    "base_color_psnr",
    "roughness_l1",
    "metallic_l1",
    "emission_iou",
    "log_radiance_error",
    "render_psnr",
)
"""Figures of a split that have a tile, in order."""

_FIRST = (
    "synthesize",
    "photograph",
    "calibrate",
    "develop",
    "qa",
    "pose",
    "import",
    "truth",
    "check_poses",
    "samples",
    "segment",
    "fuse",
    "environment",
    "cache",
)
_ROUND = ("bake", "refine", "fit", "emitters")
_LAST = ("review", "materials", "render", "relight", "video", "olat", "export", "check-export", "metrics", "report")

_LARGEST_VIDEO = 6_000_000
"""Bytes of a video that the page takes in."""
_FRAMES_SHOWN = 4

_PACKAGES = ("numpy", "torch", "mitsuba", "drjit", "pyoidn", "OpenEXR")


@dataclass(frozen=True)
class Picture:
    """One embedded picture.

    Attributes
    ----------
    key
        Column it belongs to.
    label
        Short heading.
    src
        Data URI.
    width, height
        Pixels of the embedded picture.
    """

    key: str
    label: str
    src: str
    width: int
    height: int


@dataclass(frozen=True)
class ViewRow:
    """A view: its pictures by column key, those of the truth, and its re-rendering's PSNR, dB."""

    name: str
    split: str
    psnr: float | None
    shown: Mapping[str, Picture]
    truth: Mapping[str, Picture]


@dataclass(frozen=True)
class RelitView:
    """A view under other light: the original, a picture per setup; the truth and the photograph of each or None."""

    name: str
    original: Picture
    relit: Sequence[Picture]
    truth: Sequence[Picture | None]
    photographed: Sequence[Picture | None] = ()


@dataclass(frozen=True)
class Film:
    """What a setup's own cameras see.

    Attributes
    ----------
    setup
        Its name.
    shown
        Its pictures, up to the page's number of views; of a path a few frames.
    frames
        Pictures there are.
    video
        The MP4 as data URI; None where there is none, or it is too large for the page.
    file
        Where the video lies in the results folder; None where there is none.
    """

    setup: str
    shown: Sequence[Picture]
    frames: int
    video: str | None
    file: str | None


@dataclass(frozen=True)
class StageTime:
    """Time of a stage (of one round), summed over its shards.

    Attributes
    ----------
    label
        Stage and round.
    seconds
        Wall time, summed over shards.
    shards
        Number of runs.
    memory
        Largest peak memory, bytes; 0 where unknown.
    rate
        Mean rate in words, or empty.
    """

    label: str
    seconds: float
    shards: int
    memory: int
    rate: str


@dataclass(frozen=True)
class Content:
    """Everything the page shows; lists are empty and figures absent where a file does not exist."""

    scene: str
    facts: Sequence[str]
    exposure: float
    render_scale: float
    metrics: Mapping[str, Any]
    typical: ViewRow | None
    views: Sequence[ViewRow]
    hidden_views: int
    emitters: Sequence[Mapping[str, Any]] | None
    relit: Sequence[RelitView]
    films: Sequence[Film]
    setups: Mapping[str, str]
    export: ExportCheck | None
    exported: Sequence[RelitView]
    times: Sequence[StageTime]
    settings: Mapping[str, str]
    versions: Mapping[str, str]
    warnings: Sequence[str]
    overlay: Picture | None
    capture: CaptureReport | None
    poses: PosesReport | None
    segments: SegmentsReport | None
    mixer: Mixer | None
    room: Room | None


def gather(
    results: Path, settings: ReportSettings, setups: Sequence[str] | None = None, films: Sequence[str] | None = None
) -> Content:
    """Read a results folder.

    Parameters
    ----------
    setups, films
        Light setups that are shown: those seen by views of the dataset, and those with cameras of their own. The
        folder may hold others, or what a setup was before; None: all that it holds, of each what was filmed if it was.

    Raises
    ------
    FiptError
        If the folder does not exist or one of its files is damaged. A missing file is no error.
    """
    if not results.is_dir():
        raise FiptError(f"the results folder {results} does not exist", "run the scene first")
    root = results / "dataset"
    data = Dataset(root) if (root / "transforms.json").is_file() else None
    metrics = _json(results / "metrics.json") or {}
    stats = _stats(results / "stats")
    emitters = _emitters(results)
    scale = float((metrics.get("val") or {}).get("render_exposure_scale") or 1.0)
    if films is None:
        films = [name for name in _filmed(results / "relight") if name not in (setups or ())]
    if setups is None:
        setups = [path.name for path in (results / "relight").glob("*/") if path.name not in films]
    reader = _Reader(results, data, metrics, settings, scale)
    views = reader.rows()
    relit = reader.relit_views(sorted(setups))
    export = read_check(results / "export" / "check.json")
    return Content(
        scene=results.resolve().name,
        facts=_facts(data, results),
        exposure=reader.exposure,
        render_scale=scale,
        metrics=metrics,
        typical=_typical(views),
        views=views,
        hidden_views=len(data.cameras) - len(views) if data else 0,
        emitters=emitters,
        relit=relit,
        films=reader.films(sorted(films)),
        setups=_setups(results / "relight", setups, films),
        export=export,
        exported=reader.exported_views(export) if export else [],
        times=_times(stats),
        settings=_settings(stats),
        versions=_versions(stats),
        warnings=_warnings(root, stats),
        overlay=_overlay(root / "overlay.png", settings.width),
        capture=read_capture(results / "capture" / "qa.json", data, reader.exposure),
        poses=read_poses(results / "poses"),
        segments=_segments(results / "segments", stats, reader),
        mixer=read_mixer(results, emitters, reader.exposure * scale),
        room=read_room(results, data, emitters),
    )


class _Reader:
    """Reads and embeds pictures of a scene at one exposure."""

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

    def _photo(self, name: str) -> np.ndarray | None:
        path = self.results / "dataset" / "images" / f"{name}.exr"
        return self.data.image(name)[0] if path.is_file() else None

    def embed(self, key: str, label: str, pixels: np.ndarray) -> Picture:
        """Embed a picture at the page's width."""
        return Picture(key, label, *pictures.embedded(pixels, self.settings.width))

    def _toned(self, key: str, label: str, radiance: np.ndarray) -> Picture:
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
        split = self.data.camera(name).split
        shown, labels = {}, dict(COLUMNS)
        photo, render = self.photos.get(name), self._computed(self.results / "render", name)
        if photo is not None:
            shown["photo"] = self._toned("photo", labels["photo"], photo)
        if render is not None:
            shown["render"] = self._toned("render", labels["render"], render)
        if photo is not None and render is not None:
            pixels = pictures.difference_map(render, photo, self.exposure)
            pixels = pixels * (self.data.image(name)[1] > 0)[..., None]  # masked: nothing to compare with
            shown["difference"] = self.embed("difference", labels["difference"], pixels)
        path = self.results / "materials" / f"{name}.exr"
        layers = read_layers(path) if path.is_file() else {}
        hit = layers.get("hit")
        shown |= self._maps(layers, hit, "{}")
        per_view = (self.metrics.get(split) or {}).get("render_psnr_views") or {}
        truth = self._maps(self.data.truth(name) or {}, hit, "{}, truth")
        return ViewRow(name, split, per_view.get(name), shown, truth)

    def _maps(self, layers: Mapping[str, np.ndarray], hit: np.ndarray | None, label: str) -> dict[str, Picture]:
        """Embed the material columns that ``layers`` holds."""
        shown = {}
        for key, heading in COLUMNS[3:]:
            if key not in layers:
                continue
            if key == "emission":
                pixels = display.tone_mapped(layers[key], self.exposure)
            else:
                pixels = pictures.surface_map(layers[key], hit, encode=layers[key].ndim == 3)
            shown[key] = self.embed(key, label.format(heading), pixels)
        return shown

    def _computed(self, folder: Path, name: str) -> np.ndarray | None:
        path = folder / f"{name}.exr"
        return read_rgb(path) * self.scale if path.is_file() else None

    def relit_views(self, setups: Sequence[str]) -> list[RelitView]:
        """Views that these light setups have rendered, beside their original."""
        if self.data is None:
            return []
        folder, rows = self.results / "relight", []
        for camera in self.data.cameras:
            relit, truth, photographed = [], [], []
            for setup in setups:
                picture = self._computed(folder / setup, camera.name)
                if picture is None:
                    continue
                relit.append(self._toned("relit", setup, picture))
                path = self.results / "dataset" / "relight_truth" / setup / f"{camera.name}.exr"
                known = read_rgb(path) if path.is_file() else None
                truth.append(None if known is None else self._toned("relit", f"{setup}, truth", known))
                photographed.append(self._reference(setup, camera))
            if relit and len(rows) < self.settings.max_views:
                rows.append(RelitView(camera.name, self._original(camera.name, relit), relit, truth, photographed))
        return rows

    def _reference(self, setup: str, camera: Camera) -> Picture | None:
        """The photograph under a setup's light, at the exposure that the metrics found."""
        figures = (self.metrics.get("relight") or {}).get(setup) or {}
        if camera.name not in (figures.get("relight_psnr_views") or {}) or figures.get("of") != "reference":
            return None
        path = find_references(figures["reference"], [camera.name]).get(camera.name)
        if path is None:
            return None
        photo = read_reference(path, camera)[0] * figures["exposure"] * self.scale
        return self._toned("relit", f"{setup}, photographed", photo)

    def films(self, setups: Sequence[str]) -> list[Film]:
        """What the own cameras of these setups see, as far as it was joined."""
        films = []
        for setup in setups:
            path = self.results / "relight" / f"{setup}.manifest.json"
            content = _json(path)
            if content is None:
                continue
            names = [Path(file).stem for file in sorted(content["files"]) if file.endswith(".png")]
            video = path.with_name(f"{setup}.mp4")
            there = video.name in content["files"] and video.is_file()
            moving = bool(content["settings"]["cameras"].get("path"))
            most = min(len(names), _FRAMES_SHOWN if moving else self.settings.max_views)
            chosen = [names[pick] for pick in np.linspace(0, len(names) - 1, most).round().astype(int)]
            seen = [(name, self._computed(path.with_name(setup), name)) for name in chosen]
            shown = [self._toned("relit", name, picture) for name, picture in seen if picture is not None]
            embedded = pictures.data_uri(video, "video/mp4", _LARGEST_VIDEO) if there else None
            if shown:
                file = video.relative_to(self.results).as_posix() if there else None
                films.append(Film(setup, shown, len(names), embedded, file))
        return films

    def exported_views(self, export: ExportCheck) -> list[RelitView]:
        """Our picture of every checked view, beside what each exported file shows."""
        rows = []
        for name in dict.fromkeys(view for file in export.files for view in file.views):
            shown = []
            for file in export.files:
                picture = self._computed(self.results / "export" / "check" / file.kind, name)
                if picture is not None:
                    shown.append(self._toned("relit", f"{file.label}, {file.views[name]:.1f} dB", picture))
            if shown:
                rows.append(RelitView(name, self._original(name, shown), shown, ()))
        return rows

    def _original(self, name: str, relit: Sequence[Picture]) -> Picture:
        """The re-rendering under the scene's own light, else the photograph."""
        original = self._computed(self.results / "render", name)
        if original is not None:
            return self._toned("original", "As captured, re-rendered", original)
        photo = self.photos.get(name)
        if photo is None:
            photo = self._photo(name)
        return self._toned("original", "Photo", photo) if photo is not None else relit[0]


def _segments(
    folder: Path, stats: Sequence[tuple[str, int | None, Mapping[str, Any]]], reader: _Reader
) -> SegmentsReport | None:
    """The fused segments; None where the fit took others, or none."""
    fits = [figures for stage, _, figures in stats if stage == "fit"]
    if fits and not fits[-1].get("fused_segments"):
        return None
    mode = next((figures.get("settings") for stage, _, figures in stats if stage == "segment"), None) or {}
    return read_segments(folder, reader.data, mode, reader.exposure, lambda *shown: reader.embed("segments", *shown))


def _json(path: Path) -> Any:
    """Content of a JSON file; None where it is missing."""
    if not path.is_file():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise FiptError(f"{path} is not JSON ({error})", "delete it and run its stage again") from error


def _typical(rows: Sequence[ViewRow]) -> ViewRow | None:
    """The held-out view whose PSNR is the median; else the first view with a photo."""
    judged = sorted((row for row in rows if row.psnr is not None), key=lambda row: row.psnr)
    if judged:
        return judged[(len(judged) - 1) // 2]
    return next((row for row in rows if "photo" in row.shown), None)


def _rounds(results: Path) -> list[Path]:
    """Folders round-0, round-1, ... in order."""
    folders = [path for path in results.glob("round-*/") if path.name[6:].isdigit()]
    return sorted(folders, key=lambda path: int(path.name[6:]))


def _emitters(results: Path) -> list[Mapping[str, Any]] | None:
    """Lamps with names and pictures, else those of the last round with an extraction, by power; None without any."""
    for path in (results / "emitters" / "emitters.json", *(f / "emitters.json" for f in reversed(_rounds(results)))):
        content = _json(path)
        if content is None:
            continue
        try:
            found = [_lamp(entry, path.parent) for entry in content["emitters"]]
        except (KeyError, TypeError, ValueError) as error:
            raise FiptError(f"{path} is not a list of emitters ({error!r})", "run fipt emitters again") from error
        return sorted(found, key=lambda entry: -entry["power"])
    return None


def _lamp(entry: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What the page shows of a lamp."""
    return {
        "index": int(entry["index"]),
        "name": _lamp_name(entry),
        "triangles": int(entry["triangles"]),
        "area": float(entry["area"]),
        "radiance": [float(value) for value in entry["radiance"]],
        "center": [float(value) for value in entry["center"]],
        "color": pictures.swatch(entry["radiance"]),
        "power": float(np.mean(entry["power"])),
        "views": int(entry["views"]),
        "confidence": float(entry["confidence"]),
        "lower_bound": bool(entry.get("lower_bound")),
        "thumbnail": _thumbnail(entry, folder),
    }


def _lamp_name(entry: Mapping[str, Any]) -> str:
    """The lamp's name; extractions of older versions wrote none."""
    return str(entry.get("name") or default_name(int(entry["index"])))


def _thumbnail(entry: Mapping[str, Any], folder: Path) -> Picture | None:
    """Picture of a lamp; None where no view shows it, or there are none yet."""
    from PIL import Image

    if not entry.get("thumbnail"):
        return None
    with Image.open(existing_file(folder / entry["thumbnail"], "the picture of a lamp")) as image:
        pixels = np.asarray(image.convert("RGB"))
    return Picture("lamp", _lamp_name(entry), *pictures.embedded(pixels, pixels.shape[1]))


def _facts(data: Dataset | None, results: Path) -> list[str]:
    """Short facts for the page's head."""
    facts = []
    if data is not None:
        train, val = len(data.views("train")), len(data.views("val"))
        facts += [f"{train} training views", f"{val} held-out views"]
        sizes = sorted({(camera.width, camera.height) for camera in data.cameras})
        if len(sizes) == 1:
            facts.append(f"{sizes[0][0]} by {sizes[0][1]} pixels")
    done = sum((folder / "model.safetensors").is_file() for folder in _rounds(results))
    if done:
        facts.append(f"{done} fitting round{'s' if done > 1 else ''}")
    return facts


def _filmed(relight: Path) -> list[str]:
    """Light setups that have a manifest of the stage video."""
    paths = relight.glob("*.manifest.json")
    return [path.name.removesuffix(".manifest.json") for path in paths if _json(path).get("stage") == "video"]


def _setups(relight: Path, setups: Sequence[str], films: Sequence[str]) -> dict[str, str]:
    """What each light setup changes, as the manifest of its first shard records it."""
    changes, manifests = {}, sorted(relight.glob("*.manifest.json"))
    for setup in sorted(path.name for path in relight.glob("*/") if path.name in {*setups, *films}):
        shard = re.compile(re.escape(setup) + (r"\.camera" if setup in films else r"\.(train|val)") + r"-\d+")
        first = next((path for path in manifests if shard.fullmatch(path.name.removesuffix(".manifest.json"))), None)
        content = _json(first) if first else {}
        changes[setup] = _pretty(content.get("settings", {}).get("setup", {}))
    return changes


def _stats(folder: Path) -> list[tuple[str, int | None, Mapping[str, Any]]]:
    """(stage, round, figures) of every file of stats/."""
    found = []
    for path in sorted(folder.glob("*.json")):
        stage, *rest = path.stem.split(".")
        rounds = [part[6:] for part in rest if part.startswith("round-") and part[6:].isdigit()]
        content = _json(path)
        if not isinstance(content, Mapping):
            raise FiptError(f"{path} holds no figures", "delete it and run its stage again")
        found.append((stage, int(rounds[0]) if rounds else None, content))
    return found


def _order(stage: str, number: int | None) -> tuple[int, int, int]:
    """Place of a stage in the pipeline: before the rounds, in round k, after them."""
    for place, stages in enumerate((_FIRST, _ROUND, _LAST)):
        if stage in stages:
            return place, number or 0, stages.index(stage)
    return len(_LAST), number or 0, 0


def _times(stats: Sequence[tuple[str, int | None, Mapping[str, Any]]]) -> list[StageTime]:
    grouped: dict[tuple[str, int | None], list[Mapping[str, Any]]] = {}
    for stage, number, figures in stats:
        if stage != "report":  # its own time is not known before the page is written
            grouped.setdefault((stage, number), []).append(figures)
    return [
        StageTime(
            label=stage if number is None else f"{stage} · round {number}",
            seconds=sum(float(run.get("wall_s", 0.0)) for run in runs),
            shards=len(runs),
            memory=max(int(run.get("peak_memory_bytes", 0)) for run in runs),
            rate=_rate(runs),
        )
        for (stage, number), runs in sorted(grouped.items(), key=lambda item: _order(*item[0]))
    ]


def _rate(runs: Sequence[Mapping[str, Any]]) -> str:
    """Mean of the first figure called ``..._per_s``, in words."""
    for key in runs[0]:
        if key.endswith("_per_s"):
            values = [float(run[key]) for run in runs if run.get(key) is not None]
            unit = key.removesuffix("_per_s").replace("_", " ")
            return f"{human(float(np.mean(values)))} {unit}/s" if values else ""
    return ""


def _settings(stats: Sequence[tuple[str, int | None, Mapping[str, Any]]]) -> dict[str, str]:
    """Settings of each stage, as its first run recorded them."""
    found: dict[str, str] = {}
    for stage, _, figures in sorted(stats, key=lambda entry: _order(entry[0], entry[1])):
        if figures.get("settings"):
            found.setdefault(stage, _pretty(figures["settings"]))
    return found


def _pretty(values: Any) -> str:
    return json.dumps(values, indent=2, ensure_ascii=False)


def _versions(stats: Sequence[tuple[str, int | None, Mapping[str, Any]]]) -> dict[str, str]:
    """Version of fipt that wrote the results, and of Python and the packages that matter."""
    wrote = sorted({str(figures["fipt"]) for *_, figures in stats if "fipt" in figures})
    versions = {"fipt": ", ".join(wrote) or __version__}
    versions["Python"] = platform.python_version()
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _warnings(root: Path, stats: Sequence[tuple[str, int | None, Mapping[str, Any]]]) -> list[str]:
    """What the stages noticed and a reader should know."""
    sparse = [view for *_, figures in stats for view in figures.get("views_mostly_off_mesh", ())]
    warnings = []
    if sparse:
        warnings.append(f"More than half of the pixels miss the mesh in {', '.join(sorted(sparse))}.")
    warnings += [f"View {name} was rejected: {reason}." for name, reason in rejected_views(root).items()]
    for stage, _, figures in stats:
        warnings += [f"{stage}: {text}" for text in figures.get("warnings", ())]
    if any(stage == "fit" and figures.get("segments") == "none" for stage, _, figures in stats):
        warnings.append(
            "The fit ran without segments: roughness and metallic are unsure wherever no view sees a highlight."
        )
    return warnings


def _overlay(path: Path, width: int) -> Picture | None:
    """The import's picture of mesh edges over a photo, twice as wide as the others."""
    if not path.is_file():
        return None
    from PIL import Image

    with Image.open(path) as image:
        pixels = np.array(image.convert("RGB"))
    return Picture("overlay", "Mesh edges over a photo", *pictures.embedded(pixels, 2 * width))
