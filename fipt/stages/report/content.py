"""What the page shows, gathered from whatever files a results folder holds."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median_low
from typing import Any

from fipt.errors import FiptError
from fipt.formats.images import read_pixels
from fipt.scene.dataset import Dataset
from fipt.stages.report import images
from fipt.stages.report.calibration import calibration_plot
from fipt.stages.report.capture import CaptureReport, read_capture
from fipt.stages.report.emitters import read_emitter_entries
from fipt.stages.report.export import ExportCheck, read_check
from fipt.stages.report.files import of_form, read_figures, read_json, round_folders
from fipt.stages.report.findings import FindingsReport, read_room_findings
from fipt.stages.report.geometry import GeometryReport, read_geometry
from fipt.stages.report.images import EmbeddedImage
from fipt.stages.report.mixer import Mixer, read_mixer
from fipt.stages.report.poses import PosesReport, read_poses
from fipt.stages.report.room import RoomModel, read_room
from fipt.stages.report.runs import (
    StageRun,
    StageTime,
    pretty,
    read_runs,
    stage_settings,
    stage_times,
    versions_used,
    warnings_of,
)
from fipt.stages.report.segments import SegmentsReport, read_segments
from fipt.stages.report.selection import EVERYTHING, Selection
from fipt.stages.report.settings import ReportSettings
from fipt.stages.report.views import CameraSetup, RelitView, ViewReader, ViewRow

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


@dataclass(frozen=True)
class Content:
    """Everything the page shows; lists are empty and figures absent where a file does not exist.

    ``median`` is that of the held-out views' PSNR, dB, and ``typical`` the shown one that is nearest to it.
    """

    scene: str
    facts: Sequence[str]
    exposure: float
    render_scale: float
    metrics: Mapping[str, Any]
    typical: ViewRow | None
    median: float | None
    views: Sequence[ViewRow]
    hidden_views: int
    emitters: Sequence[Mapping[str, Any]] | None
    relit: Sequence[RelitView]
    camera_setups: Sequence[CameraSetup]
    setups: Mapping[str, str]
    export: ExportCheck | None
    exported: Sequence[RelitView]
    findings: FindingsReport | None
    calibration: EmbeddedImage | None
    times: Sequence[StageTime]
    settings: Mapping[str, str]
    versions: Mapping[str, str]
    warnings: Sequence[str]
    overlay: EmbeddedImage | None
    capture: CaptureReport | None
    poses: PosesReport | None
    geometry: GeometryReport | None
    segments: SegmentsReport | None
    mixer: Mixer | None
    room: RoomModel | None


def gather(results: Path, settings: ReportSettings, selection: Selection = EVERYTHING) -> Content:
    """Read a results folder.

    Raises
    ------
    FiptError
        If the folder does not exist or one of its files is damaged. A missing file is no error.
    """
    if not results.is_dir():
        raise FiptError(f"the results folder {results} does not exist", "run the scene first")
    root = results / "dataset"
    data = Dataset(root) if (root / "transforms.json").is_file() else None
    metrics, scale = read_figures(results / "metrics.json")
    runs, times, used, warnings = _recorded(results)
    emitters = read_emitter_entries(results)
    setups, camera_setups = _shown_setups(results / "relight", selection.setups, selection.camera_setups)
    reader = ViewReader(results, data, metrics, settings, scale)
    views = reader.rows()
    export = read_check(results / "export" / "check.json") if selection.has("export") else None
    report = results / "capture" / "qa.json"
    typical, median = _typical(views, metrics)
    return Content(
        scene=results.resolve().name,
        facts=_facts(data, results),
        exposure=reader.exposure,
        render_scale=scale,
        metrics=metrics,
        typical=typical,
        median=median,
        views=views,
        hidden_views=len(data.cameras) - len(views) if data else 0,
        emitters=emitters,
        relit=reader.relit_views(setups),
        camera_setups=reader.camera_setups(camera_setups),
        setups=_setups(results / "relight", setups, camera_setups),
        export=export,
        exported=reader.exported_views(export) if export else [],
        findings=read_room_findings(results),
        calibration=calibration_plot(metrics),
        times=times,
        settings=used,
        versions=versions_used(runs),
        warnings=warnings,
        overlay=_overlay(root / "overlay.png", settings.width),
        capture=read_capture(report, data, reader.exposure) if selection.has("capture") else None,
        poses=read_poses(results / "poses") if selection.has("poses") else None,
        geometry=read_geometry(results / "geometry") if selection.has("geometry") else None,
        segments=_segments(results / "segments", runs, reader),
        mixer=read_mixer(results, emitters, reader.exposure * scale, selection.olat_shards),
        room=read_room(results, data, emitters, selection.has("export")),
    )


def _recorded(results: Path) -> tuple[list[StageRun], list[StageTime], dict[str, str], list[str]]:
    """Runs of stages, with their times, settings and warnings."""
    runs = read_runs(results / "stats")
    with of_form(results / "stats"):
        return runs, stage_times(runs), stage_settings(runs), warnings_of(results / "dataset", runs)


def _segments(folder: Path, runs: Sequence[StageRun], reader: ViewReader) -> SegmentsReport | None:
    """The fused segments; None where the fit took others, or none."""
    fits = [run.figures for run in runs if run.stage == "fit"]
    if fits and not fits[-1].get("fused_segments"):
        return None
    mode = next((run.figures.get("settings") for run in runs if run.stage == "segment"), None) or {}
    return read_segments(folder, reader.data, mode, reader.exposure, lambda *shown: reader.embed("segments", *shown))


def _typical(rows: Sequence[ViewRow], metrics: Mapping[str, Any]) -> tuple[ViewRow | None, float | None]:
    """The held-out view nearest to the median PSNR of all, shown or not, and this; else the first view with a photo."""
    every = (metrics.get("val") or {}).get("render_psnr_views") or {}
    judged = {row.psnr: row for row in rows if row.split == "val" and row.psnr is not None}
    if judged:
        median = median_low(value for value in every.values() if value is not None)
        return judged[min(judged, key=lambda psnr: abs(psnr - median))], median
    return next((row for row in rows if "photo" in row.shown), None), None


def _facts(data: Dataset | None, results: Path) -> list[str]:
    """Short facts for the page's head."""
    facts = []
    if data is not None:
        train, val = len(data.views("train")), len(data.views("val"))
        facts += [f"{train} training views", f"{val} held-out views"]
        sizes = sorted({(camera.width, camera.height) for camera in data.cameras})
        if len(sizes) == 1:
            facts.append(f"{sizes[0][0]} by {sizes[0][1]} pixels")
    done = sum((folder / "model.safetensors").is_file() for folder in round_folders(results))
    if done:
        facts.append(f"{done} fitting round{'s' if done > 1 else ''}")
    return facts


def _shown_setups(
    relight: Path, setups: Sequence[str] | None, camera_setups: Sequence[str] | None
) -> tuple[list[str], list[str]]:
    """Setups seen by views of the dataset, and those seen by cameras of their own, each sorted."""
    if camera_setups is None:
        camera_setups = [name for name in _setups_with_cameras(relight) if name not in (setups or ())]
    if setups is None:
        setups = [path.name for path in relight.glob("*/") if path.name not in camera_setups]
    return sorted(setups), sorted(camera_setups)


def _setups_with_cameras(relight: Path) -> list[str]:
    """Light setups that have a manifest of the stage video."""
    paths = relight.glob("*.manifest.json")
    return [path.name.removesuffix(".manifest.json") for path in paths if read_json(path).get("stage") == "video"]


def _setups(relight: Path, setups: Sequence[str], camera_setups: Sequence[str]) -> dict[str, str]:
    """What each light setup changes, as the manifest of its first shard records it."""
    changes, manifests = {}, sorted(relight.glob("*.manifest.json"))
    for setup in sorted(path.name for path in relight.glob("*/") if path.name in {*setups, *camera_setups}):
        shard = re.compile(re.escape(setup) + (r"\.camera" if setup in camera_setups else r"\.(train|val)") + r"-\d+")
        first = next((path for path in manifests if shard.fullmatch(path.name.removesuffix(".manifest.json"))), None)
        with of_form(first or relight):
            content = read_json(first) if first else {}
            changes[setup] = pretty(content.get("settings", {}).get("setup", {}))
    return changes


def _overlay(path: Path, width: int) -> EmbeddedImage | None:
    """The import's image of mesh edges over a photo, twice as wide as the others."""
    if not path.is_file():
        return None
    pixels = read_pixels(path, "the overlay", "RGB")
    return EmbeddedImage("overlay", "Mesh edges over a photo", *images.embedded(pixels, 2 * width))
