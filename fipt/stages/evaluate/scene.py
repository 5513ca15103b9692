"""The figures of a scene, from the files of its dataset and results."""

import json
import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz
from fipt.formats.exr import read_rgb
from fipt.formats.text import MALFORMED
from fipt.progress import progress
from fipt.scene.dataset import Dataset, read_layers
from fipt.scene.emitters import BACK, BOTH, FRONT
from fipt.scene.references import read_reference, reference_files
from fipt.scene.samples import read_samples
from fipt.stages.evaluate.emission import emitted_ratios, emitting_triangles, triangle_figures
from fipt.stages.evaluate.metrics import (
    Layers,
    MaterialFigures,
    PhotographedExposure,
    RenderExposure,
    emits,
    finite,
    image_psnr,
)

log = logging.getLogger(__name__)

_GRAZING = 0.1
"""Least cosine of a view that counts: an area seen at less is uncertain by more than half."""


def material_figures(data: Dataset, folder: Path, split: str, partial: bool = False) -> dict[str, Any]:
    """Figures of the material maps of a split; all None where the dataset has no truth.

    ``partial``: maps of another program, which may lack layers and views.
    """
    figures, views = MaterialFigures(), data.views(split)
    if partial:
        views = [view for view in views if (folder / f"{view}.exr").is_file()]
    with progress(f"metrics {split}", len(views), " views") as bar:
        for view in views:
            truth = data.truth(view)
            if truth is not None:
                path = folder / f"{view}.exr"
                estimate = finite(read_layers(path), str(path))
                truth = finite(truth, str(data.root / "truth" / f"{view}.exr"))
                _check_layers(path, estimate, truth, partial)
                figures.add(estimate, truth, data.image(view)[1] > 0)
            bar.advance()
    return figures.figures()


def _check_layers(path: Path, estimate: Layers, truth: Layers, partial: bool) -> None:
    compared = ("kd", "reflectance", "base_color", "roughness", "metallic", "emission", "hit")
    missing = [name for name in compared if name not in estimate and (name in truth or name == "hit")]
    if missing and not partial:
        raise FiptError(f"{path} lacks the layers {', '.join(missing)}", "run fipt materials again")
    if "emission" not in truth and "emission_mask" not in truth:
        raise FiptError(
            f"the truth of {path.stem} must say what emits; it lacks emission and emission_mask",
            "write one of these layers",
        )
    for name, values in truth.items():
        if name in estimate and values.shape != estimate[name].shape:
            raise FiptError(
                f"{path}: layer {name} must have shape {values.shape} like its truth; it has {estimate[name].shape}",
                "run fipt materials again",
            )


def _rendered_views(folder: Path, views: list[str], what: str, partial: bool) -> list[str]:
    """Views whose image exists: all or none, or some stage did not finish; if ``partial`` any."""
    present = [view for view in views if (folder / f"{view}.exr").is_file()]
    missing = [view for view in views if view not in present]
    if present and missing and not partial:
        raise FiptError(
            f"{folder} must hold an image of every view; {', '.join(missing[:8])} missing",
            f"run {what} for these views",
        )
    return present


def _rendered(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """Read a finite (H, W, 3) image of the expected shape."""
    image = read_rgb(path)
    if image.shape != shape:
        raise FiptError(f"{path} must have shape {shape}; it has {image.shape}", "render it again")
    return finite({"RGB": image}, str(path))["RGB"]


def render_figures(
    data: Dataset, folder: Path, counted: list[str], fit_exposure: bool, partial: bool = False
) -> dict[str, Any]:
    """PSNR of re-rendered views; None where none of the ``counted`` is there. ``partial``: some views may lack."""

    def pairs() -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
        for view in views:
            photo, valid = data.image(view)
            valid = valid * ~data.clipped(view)  # a lower bound is nothing to compare with
            yield view, _rendered(folder / f"{view}.exr", photo.shape), photo, valid

    views = _rendered_views(folder, counted, "fipt render", partial)
    exposure = RenderExposure()
    if fit_exposure:
        for _, image, photo, valid in pairs():
            exposure.add(image, photo, valid)
    per_view = {view: image_psnr(image, photo, valid, exposure.scale) for view, image, photo, valid in pairs()}
    return {
        "render_psnr": _mean(per_view),
        "render_psnr_views": per_view,
        "render_exposure_scale": exposure.scale if per_view else None,
        "render_exposure_fitted": fit_exposure,
    }


def _mean(per_view: dict[str, float | None]) -> float | None:
    values = [value for value in per_view.values() if value is not None]
    return sum(values) / len(values) if values else None


def relight_figures(
    data: Dataset, folder: Path, counted: Collection[str], setups: Sequence[str] | None = None
) -> dict[str, Any]:
    """PSNR of the ``counted`` views under the light setups that the dataset has truth for, or under those named.

    Raises
    ------
    FiptError
        If there is no truth, or no relit view, of a setup that is named.
    """
    known = {truth.name: truth for truth in sorted((data.root / "relight_truth").glob("*/"))}
    for name in setups or ():
        for place in (data.root / "relight_truth" / name, folder / name):
            if not any(place.glob("*.exr")):
                raise FiptError(
                    f"--setups names {name}, but {place} has no image; there is truth of {', '.join(known) or 'none'}",
                    "correct the name, or leave --setups out",
                )
    result = {}
    for truth in known.values():
        if setups is not None and truth.name not in setups:
            continue  # of a setup that is no more, or has cameras of its own now
        shown = [each for each in data.cameras if each.name in counted and (truth / f"{each.name}.exr").is_file()]
        _tell_missing(data, folder / truth.name, [camera.name for camera in shown])
        per_view = {}
        for camera in shown:
            path = folder / truth.name / f"{camera.name}.exr"
            if path.is_file():
                shape = (camera.height, camera.width, 3)
                reference = _rendered(truth / path.name, shape)
                per_view[camera.name] = image_psnr(_rendered(path, shape), reference)
        if per_view:
            figures = {"relight_psnr": _mean(per_view), "relight_psnr_views": per_view}
            result[truth.name] = {**figures, "of": "truth", "exposure": 1.0}
    return result


def _tell_missing(data: Dataset, folder: Path, known: Sequence[str]) -> None:
    """Warn of relit views that are missing where others of their split are there: the mean leaves them out."""
    for split in ("train", "val"):
        views = [view for view in data.views(split) if view in known]
        missing = [view for view in views if not (folder / f"{view}.exr").is_file()]
        if 0 < len(missing) < len(views):
            log.warning(
                "%s lacks %d of %d views of which there is truth (%s); its mean leaves them out",
                folder, len(missing), len(views), ", ".join(missing[:8]),
            )  # fmt: skip


def reference_figures(data: Dataset, folder: Path, reference: Path, counted: Collection[str]) -> dict[str, Any]:
    """PSNR of a light setup's views against photographs of the room under that light.

    Parameters
    ----------
    folder
        The relit views.
    reference
        Photographs named as these, all of one unknown exposure; views without one are left out.
    counted
        Views that count.
    """
    relit = [each.name for each in data.cameras if each.name in counted and (folder / f"{each.name}.exr").is_file()]
    if not relit:
        raise FiptError(f"{folder} has no relit view to compare with {reference}", "run fipt relight first")
    photographs = reference_files(reference, relit)

    def pairs() -> Iterator[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
        for view, path in photographs.items():
            photo, valid = read_reference(path, data.camera(view))
            weight = valid * (data.image(view)[1] > 0)
            yield view, _rendered(folder / f"{view}.exr", photo.shape), photo, weight

    exposure = PhotographedExposure()
    for _, image, photo, valid in pairs():
        exposure.add(image, photo, valid)
    scale = exposure.scale
    if scale is None:
        raise FiptError(
            f"{reference} and {folder} must have pixels in common that are valid and not black; there are none",
            "check the photographs, their masks and the light setup",
        )
    per_view = {view: image_psnr(image, scale * photo, valid) for view, image, photo, valid in pairs()}
    log.info(
        "%s: %d of %d views are photographed; their radiance times %.4g",
        reference,
        len(photographs),
        len(relit),
        scale,
    )
    return {
        "relight_psnr": _mean(per_view),
        "relight_psnr_views": per_view,
        "of": "reference",
        "exposure": scale,
        "reference": str(reference),
    }


def emitter_figures(data: Dataset, path: Path, samples: list[Path]) -> dict[str, Any]:
    """Found, false and missed emitting triangles; emitting area and flux over the true ones."""
    found, areas = load_npz(path), data.mesh().areas
    seen = truth = unknown = None
    shown = {"emitted_area": None, "emitted_flux": None}
    if samples:
        majority, seen, judged = emitting_triangles(len(areas), _centre_triangles(data, samples))
        if judged.any():
            truth, unknown = majority, seen & ~judged
        shown = emitted_ratios(_seen_emission(data, samples, found))
    source = "pixel centres that see them" if truth is not None else None
    room = data.root / "room.json"
    if room.is_file():
        ids = _room_triangles(room, areas)
        if ids is None:
            log.warning("%s is of another mesh than mesh.ply: emitting triangles are judged by pixels", room)
        else:
            truth = np.zeros(len(areas), bool)
            truth[ids], unknown = True, None
            source = "room.json"
    return {
        "emitters": len(np.unique(found["emitter"])),
        **triangle_figures(found["triangle"], truth, areas, seen, unknown),
        "truth_from": source,
        **shown,
    }


def _seen_emission(
    data: Dataset, folders: list[Path], found: Mapping[str, np.ndarray]
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """For every view with truth: area (n,) that each pixel centre stands for, true and found radiance (n, 3) there."""
    mesh = data.mesh()
    radiance, sides = np.zeros((len(mesh.triangles), 3)), np.full(len(mesh.triangles), BOTH, np.int8)
    radiance[found["triangle"]], sides[found["triangle"]] = found["radiance"], found.get("sides", BOTH)
    for folder in folders:
        shard = read_samples(folder)
        for index, view in enumerate(shard.views):
            truth = data.truth(view)
            if truth is None or "emission" not in truth or view in data.rejected:
                continue
            pixels = shard.pixels(index)
            hit = shard.center[pixels] > 0
            first = shard.offsets[pixels][hit]
            toward = data.camera(view).center - shard.position[first]
            cosine = np.abs((toward * shard.normal[first]).sum(axis=1)) / np.linalg.norm(toward, axis=1).clip(1e-9)
            area = shard.footprint[first].astype(np.float64) ** 2 / np.maximum(cosine, _GRAZING)
            true = truth["emission"].reshape(-1, 3)[hit] * emits(truth).ravel()[hit, None]
            triangle = np.asarray(shard.triangle)[first]
            side = np.where(mesh.front(triangle, shard.normal[first]), FRONT, BACK)
            yield area, true, radiance[triangle] * ((sides[triangle] & side) > 0)[:, None]


def _room_triangles(path: Path, areas: np.ndarray) -> np.ndarray | None:
    """Ids of the emitting triangles that room.json lists; None where it is of another mesh than these (T,) areas."""
    try:
        room = json.loads(path.read_text(encoding="utf-8"))
        lists = [np.asarray(emitter["triangles"], np.int64) for emitter in room["emitters"]]
        said = [emitter.get("area") for emitter in room["emitters"]]
        count = int(room.get("triangles", len(areas)))
    except MALFORMED as error:
        raise FiptError(
            f"{path} does not list the triangles of its emitters ({error!r})", "synthesize again"
        ) from error
    if count != len(areas):
        return None
    ids = np.concatenate([np.zeros(0, np.int64), *lists])
    if ids.size and (ids.min() < 0 or ids.max() >= len(areas)):
        raise FiptError(f"{path} lists triangles that mesh.ply does not have", "synthesize again")
    # a scan may have as many triangles by chance, but not the emitters' areas
    alike = [
        area is None or np.isclose(areas[rows].sum(), area, rtol=0.01) for rows, area in zip(lists, said, strict=True)
    ]
    return ids if all(alike) else None


def _centre_triangles(data: Dataset, folders: list[Path]) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
    """For every view: triangles at pixel centres that hit, and whether these pixels truly emit, if there is truth."""
    for folder in folders:
        shard = read_samples(folder)
        for index, view in enumerate(shard.views):
            if view in data.rejected:
                continue
            pixels = shard.pixels(index)
            hit = shard.center[pixels] > 0
            # The first hit of such a pixel is the surface at its centre.
            ids = shard.triangle[shard.offsets[pixels][hit]].astype(np.int64)
            truth = data.truth(view)
            yield ids, None if truth is None else emits(truth).ravel()[hit]


def rounded(value: Any) -> Any:
    """Round every float to six decimals: more is noise, and diffs stay readable."""
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [rounded(entry) for entry in value]
    return round(value, 6) if isinstance(value, float) else value
