"""Every exported format, loaded back, path traced by Mitsuba and compared with our own pictures."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.io.asset import Asset
from fipt.io.background import read_map
from fipt.io.dataset import Dataset
from fipt.io.exr import read_rgb, write_exr
from fipt.io.files import existing_file, write_text
from fipt.io.gltf import read_glb
from fipt.io.images import srgb_encode
from fipt.io.usd import read_usd
from fipt.progress import progress
from fipt.render.denoise import denoise
from fipt.render.exported import guides, load_asset, load_scene_file, render_sensor
from fipt.render.reference import PathTracer
from fipt.settings import Export, dumped
from fipt.versions import VERSIONS

GOAL = 32.0
"""PSNR that every format should reach, dB."""

FORMATS = {"glb": "scene.glb", "usd": "scene.usdc", "mitsuba": "mitsuba/scene.xml", "exact": "mitsuba/scene_exact.xml"}
"""Format -> its file in the exported folder."""

Draw = Callable[[int], np.ndarray]
"""Picture of a view by its number among the exported cameras."""


def check_export(dataset: Path, export: Path, render: Path, out: Path, settings: Export) -> None:
    """Write check.json and check/FORMAT/VIEW.exr beside it.

    Raises
    ------
    FiptError
        If a file is missing or cannot be read back, or no held-out view has been rendered.
    """
    data = Dataset(dataset)
    names = [camera.name for camera in data.cameras]
    views = _chosen([name for name in data.views("val") if (render / f"{name}.exr").is_file()], settings.check_views)
    if not views:
        raise FiptError(f"{render} holds no picture of a held-out view", "run fipt render first")
    for file in FORMATS.values():
        existing_file(export / file, "an exported file")
    known = {view: read_rgb(render / f"{view}.exr") for view in views}
    asset = _with_outside(read_glb(export / FORMATS["glb"]), export)
    scene = load_asset(asset)
    guide = {view: guides(scene, asset, asset.cameras[names.index(view)]) for view in views}
    figures: dict[str, dict[str, float]] = {}
    with progress("check-export", len(FORMATS) * len(views), " pictures") as bar:
        for kind, file in FORMATS.items():
            draw = _opened(kind, export, export / file, settings)
            figures[kind] = {}
            for view in views:
                picture = denoise(draw(names.index(view)), *guide[view])
                write_exr(out.parent / "check" / kind / f"{view}.exr", {"": picture}, half=True)
                figures[kind][view] = round(psnr(picture, known[view]), 2)
                bar.advance()
    content = {
        "definition": "PSNR of the exported room, loaded back and path traced by Mitsuba, against our own picture; "
        "both clipped to [0, 1] and sRGB encoded, dB",
        "goal": GOAL,
        "formats": {
            kind: {"file": FORMATS[kind], "psnr": round(float(np.mean(list(of_view.values()))), 2), "views": of_view}
            for kind, of_view in figures.items()
        },
        "settings": dumped(settings),
        "version": VERSIONS["export"],
    }
    write_text(out, json.dumps(content, indent=1) + "\n")
    for kind, entry in content["formats"].items():
        print(f"{kind:8} {entry['psnr']:.1f} dB  {entry['file']}")


def _chosen(views: Sequence[str], count: int) -> list[str]:
    """Views spread over the list."""
    picks = np.linspace(0, len(views) - 1, min(count, len(views))).round().astype(int)
    return [views[pick] for pick in picks]


def _opened(kind: str, export: Path, path: Path, settings: Export) -> Draw:
    """Load a file; glTF and USD cameras are ours to trace, a Mitsuba scene renders by its own sensors."""
    if kind in ("glb", "usd"):
        asset = _with_outside((read_glb if kind == "glb" else read_usd)(path), export)
        tracer = PathTracer(load_asset(asset), settings.max_depth - 1)
        return lambda number: tracer.render(asset.cameras[number], settings.check_spp, settings.seed)
    scene = load_scene_file(path)
    return lambda number: render_sensor(scene, number, settings.check_spp, settings.seed)


def _with_outside(asset: Asset, export: Path) -> Asset:
    """The room with the exported map of the outside, where there is one."""
    path = export / "textures" / "environment.exr"
    return replace(asset, outside=read_map(path)) if path.is_file() else asset


def psnr(picture: np.ndarray, known: np.ndarray) -> float:
    """PSNR of two (H, W, 3) radiance pictures, both clipped to [0, 1] and sRGB encoded, dB; at most 100."""
    a, b = (srgb_encode(np.clip(np.asarray(p, np.float64), 0, 1)) for p in (picture, known))
    return float(-10 * np.log10(max(((a - b) ** 2).mean(), 1e-10)))
