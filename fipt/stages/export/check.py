"""Every exported format, loaded back, path traced by Mitsuba and compared with our own images."""

import json
import logging
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.files import existing_file, write_text
from fipt.formats.images import psnr_of_error, srgb_encode
from fipt.formats.manifests import Stats
from fipt.progress import progress
from fipt.registry import VERSIONS
from fipt.render.denoise import denoise
from fipt.render.exported import (
    emitted,
    guides,
    load_asset,
    load_scene_file,
    path_integrator,
    rays_of,
    rays_of_sensor,
    traced_image,
)
from fipt.scene.asset import Asset
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.environment import read_map
from fipt.settings import dumped
from fipt.stages.export.check_export_stage import CheckExportInputs
from fipt.stages.export.gltf import read_glb
from fipt.stages.export.settings import ExportSettings
from fipt.stages.export.usd import read_usd

log = logging.getLogger(__name__)

GOAL = 32.0
"""PSNR that every format should reach, dB."""

FORMATS = {"glb": "scene.glb", "usd": "scene.usdc", "mitsuba": "mitsuba/scene.xml", "exact": "mitsuba/scene_exact.xml"}
"""Format -> its file in the exported folder."""

Draw = Callable[[Camera, int], tuple[np.ndarray, np.ndarray]]
"""What a view shows of reflected light, and of the emitters and the outside themselves (no noise in it), by its
camera and number among the exported ones."""


def check_export(inputs: CheckExportInputs, settings: ExportSettings) -> Stats:
    """Write check.json and check/FORMAT/VIEW.exr beside it.

    Raises
    ------
    FiptError
        If a file is missing or cannot be read back, or no held-out view has been rendered.
    """
    export, render, out = inputs.export, inputs.render, inputs.out
    data = Dataset(inputs.dataset)
    names = [camera.name for camera in data.cameras]
    views = _judged_views(data, render, settings.check_views)
    grid = inputs.rays_per_side  # our images look through several points of each pixel, these through the same
    for file in FORMATS.values():
        existing_file(export / file, "an exported file")
    unit = np.float32(data.radiance_scale)  # our images are in the dataset's
    known = {view: read_rgb(render / f"{view}.exr") for view in views}
    photo = {view: _photograph(data, view) for view in views}
    asset = _with_outside(read_glb(export / FORMATS["glb"]), export)
    read_usd(export / FORMATS["usd"])  # a damaged file says so before anything is rendered
    scene = load_asset(asset)
    guide = {view: guides(scene, asset, asset.cameras[names.index(view)], grid) for view in views}
    figures: dict[str, dict[str, float]] = {}
    photos = {"ours": [psnr(known[view], *photo[view]) for view in views]}
    with progress("check-export", len(FORMATS) * len(views), " images") as bar:
        for kind, file in FORMATS.items():
            draw = _opened(kind, export, export / file, grid, settings)
            figures[kind], photos[kind] = {}, []
            for view in views:
                drawn = draw(asset.cameras[names.index(view)], names.index(view))
                reflected, shown = (part * unit for part in drawn)
                seen = denoise(reflected, *guide[view]) + shown  # emitters stay exact, as in our images
                write_exr(out.parent / "check" / kind / f"{view}.exr", {"": seen}, half=True)
                figures[kind][view] = round(psnr(seen, known[view]), 2)
                photos[kind].append(psnr(seen, *photo[view]))
                bar.advance()
    content = {
        "definition": "PSNR of the exported room, loaded back and path traced by Mitsuba, against our own image; "
        "both clipped to [0, 1] and sRGB encoded, dB; photo: the same against the photograph, where it is valid",
        "goal": GOAL,
        "ours_photo": _mean(photos["ours"]),
        "formats": {
            kind: {
                "file": FORMATS[kind],
                "psnr": _mean(of_view.values()),
                "photo": _mean(photos[kind]),
                "views": of_view,
            }
            for kind, of_view in figures.items()
        },
        "settings": dumped(settings),
        "version": VERSIONS["export"],
    }
    write_text(out, json.dumps(content, indent=1) + "\n")
    for entry in content["formats"].values():
        log.info("%.1f dB  %s", entry["psnr"], entry["file"])
    return {"psnr": {kind: entry["psnr"] for kind, entry in content["formats"].items()}}


def _judged_views(data: Dataset, render: Path, count: int) -> list[str]:
    """Held-out views, spread over those that were rendered and whose photograph has a valid pixel."""
    rendered = [name for name in data.views("val") if (render / f"{name}.exr").is_file()]
    views = [name for name in rendered if _photograph(data, name)[1].any()]
    if not views:
        raise FiptError(
            f"{render} holds no image of a held-out view whose photograph has a valid pixel", "run fipt render first"
        )
    picks = np.linspace(0, len(views) - 1, min(count, len(views))).round().astype(int)
    return [views[pick] for pick in picks]


def _opened(kind: str, export: Path, path: Path, grid: int, settings: ExportSettings) -> Draw:
    """Load a file; glTF and USD are seen by the cameras in them, a Mitsuba scene by its own sensors and integrator."""
    own: Asset | None = None
    if kind in ("glb", "usd"):
        own = _with_outside((read_glb if kind == "glb" else read_usd)(path), export)
    scene = load_asset(own) if own else load_scene_file(path)
    integrator = path_integrator(settings.max_depth) if own else scene.integrator()

    def draw(camera: Camera, number: int) -> tuple[np.ndarray, np.ndarray]:
        rays = rays_of(own.cameras[number]) if own else rays_of_sensor(scene, number)
        shape = camera.height, camera.width
        shown = emitted(scene, rays, shape, grid)
        whole = traced_image(scene, integrator, rays, shape, grid, settings.check_spp, settings.seed)
        return np.maximum(whole - shown, 0), shown

    return draw


def _with_outside(asset: Asset, export: Path) -> Asset:
    """The room with the exported map of the outside, where there is one."""
    path = export / "textures" / "environment.exr"
    return replace(asset, outside=read_map(path)) if path.is_file() else asset


def _photograph(data: Dataset, view: str) -> tuple[np.ndarray, np.ndarray]:
    """Radiance of a view, and (H, W) bool where it is known."""
    radiance, valid = data.image(view)
    return radiance, (valid > 0) & ~data.clipped(view)


def _mean(values: Iterable[float]) -> float:
    return round(float(np.mean(list(values))), 2)


def psnr(seen: np.ndarray, known: np.ndarray, where: np.ndarray | None = None) -> float:
    """PSNR of two (H, W, 3) radiance images, both clipped to [0, 1] and sRGB encoded, dB; at most 100.

    ``where`` (H, W) bool restricts it to some pixels, at least one.
    """
    a, b = (srgb_encode(np.clip(np.asarray(p, np.float64), 0, 1)) for p in (seen, known))
    return psnr_of_error(((a - b) ** 2)[... if where is None else where].mean())
