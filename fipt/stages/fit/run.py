"""The fit of a round: its files read, its parts searched, its networks fitted, the model written."""

import hashlib
import logging
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fipt.formats.arrays import on_disk
from fipt.formats.files import check_disk, check_memory
from fipt.formats.manifests import Stats
from fipt.model.networks import Field, SceneBox
from fipt.model.store import load_field, save_field
from fipt.scene.confidence import Confidence, write_confidence
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import read_emitters
from fipt.scene.environment import beyond, read_environment
from fipt.scene.observed import check_as_many, read_observed, without_triangles
from fipt.scene.samples import median_footprint, scene_box, segments_of
from fipt.scene.shading import read_shading
from fipt.scene.voxels import read_cache
from fipt.stages.fit.batches import Pixels
from fipt.stages.fit.evidence import confident_pixels, measure
from fipt.stages.fit.hidden import find_hidden
from fipt.stages.fit.inner_pixels import stride
from fipt.stages.fit.inputs import FitInputs
from fipt.stages.fit.loop import fit
from fipt.stages.fit.material_posterior import no_parts, posterior
from fipt.stages.fit.objective import Objective
from fipt.stages.fit.part_search import (
    BYTES_A_SEARCHED,
    ROUGHNESS,
    PartEstimates,
    estimate_parts,
    part_classes,
    search_threads,
)
from fipt.stages.fit.reached import metallic_missed, said_of
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.settling import judge_round
from fipt.stages.fit.targets import part_targets
from fipt.stages.fit.uncertainty import predict

log = logging.getLogger(__name__)

_BYTES_A_WEIGHT, _BYTES_A_DRAWN = 28, 13_000
"""Of memory: for a weight of the hash encoding (with its gradient and two moments 15.5 were measured; a checkpoint has
12 more), and for a pixel of a step (measured 12,600)."""
_BYTES_A_PIXEL, _BYTES_OF_A_VIEW = 4, 300
"""Of memory: for each training pixel, whose weight changes where emitters are left out; for each pixel of the largest
view (measured 265)."""
_WEIGHT_ON_DISK, _PIXEL_ON_DISK = 16, 71
"""Bytes of the model and of its checkpoint for a weight; of nameless files for a pixel, 40 of them in later rounds."""


def fit_model(inputs: FitInputs, settings: FitSettings) -> Stats:
    """Fit a round's model and write it to ``out``, confidence.npz beside it; the checkpoint goes away then."""
    torch.set_num_threads(settings.threads or torch.get_num_threads())
    if inputs.first_shading:
        check_as_many("--first-shading", inputs.first_shading, inputs.samples)
    data = Dataset(inputs.dataset, inputs.segments)
    kind = data.segment_kind(settings.segments)
    if kind is None:
        log.warning(
            "no segments; roughness and metallic are fitted point by point, without search or propagation: "
            "they are uncertain wherever no view sees a highlight (docs/stages/segment.md has figures)"
        )
    _check_room(data, settings, inputs.out)
    pixels = _training_pixels(data, kind, inputs, settings)
    center, side = scene_box(pixels.shards)
    # where it is known what emits, no mask has to tell
    box, mask = SceneBox((center[0], center[1], center[2]), side), inputs.emitters is None
    field = Field(settings, box, mask=mask, inset=pixels.inset)
    before = None if inputs.previous is None else load_field(inputs.previous)
    if before is not None and settings.warm_start:
        field.start_from(before)
    _learn_finest(field, pixels)
    figures: Stats = {"segments": kind or "none", "fused_segments": inputs.segments is not None}
    targets = hidden = found = classes = None
    if kind is not None and settings.part_search:
        classes = _classes(data, pixels) if kind == "part" and data.has_segments("semantic") else None
        metals = data.metals() if kind == "part" else None
        slow = settings.light_errors and kind == "part"
        found = estimate_parts(pixels, center, side, settings.emitter_gain, classes, metals, slow)
        figures["parts"] = _described(found)
        pixels.light = found.light
        figures["light_error"] = None if found.light is None else round(found.light.size, 4)
        targets = part_targets(found, settings).to(field.device)
        if inputs.cache is not None and settings.hidden > 0:
            hidden = find_hidden(pixels, read_cache(inputs.cache), found.pixels > 0)
    checkpoint = _checkpoint(inputs, settings)
    figures |= fit(field, pixels, Objective(settings, kind, targets), checkpoint, hidden if hidden else None)
    if found is not None:
        figures["metallic_missed"] = metallic_missed(field, pixels, found.metallic, settings.footprint)
        figures["warnings"] = said_of(figures["metallic_missed"])
        for warning in figures["warnings"]:
            log.warning("%s", warning)
    write_confidence(
        inputs.out.with_name("confidence.npz"), _confidence(field, pixels, found, classes, inputs, settings)
    )
    save_field(inputs.out, field, settings)
    figures |= judge_round(inputs, field, before, settings.settled)
    checkpoint.unlink(missing_ok=True)
    return figures


def _check_room(data: Dataset, settings: FitSettings, out: Path) -> None:
    """Refuse a fit that memory or the disk of ``out`` are too small for."""
    views = [camera.width * camera.height for camera in data.cameras if camera.split == "train"]
    pixels = sum(views)
    weights = 2 * settings.levels * 2**settings.table_log2 if settings.encoding == "hash" else 0
    needed = _BYTES_A_WEIGHT * weights + _BYTES_A_DRAWN * min(settings.batch, pixels)
    needed += _BYTES_A_PIXEL * pixels + _BYTES_OF_A_VIEW * max(views, default=0)
    if settings.part_search:
        needed += BYTES_A_SEARCHED * search_threads() * (pixels // stride(pixels))
    check_memory(needed, "the fit", "use a smaller fit.batch or fit.table_log2")
    check_disk(out.parent, _WEIGHT_ON_DISK * weights + _PIXEL_ON_DISK * pixels, "the fit")


def _training_pixels(data: Dataset, kind: str | None, inputs: FitInputs, settings: FitSettings) -> Pixels:
    """All pixels that teach anything."""
    empty = on_disk(inputs.out.parent)  # what there is for every pixel stays out of memory
    shards = read_observed(data, inputs.samples, inputs.shading, empty)
    if inputs.emitters is not None:
        shards = without_triangles(shards, read_emitters(inputs.emitters).possible)
    cameras = [[data.camera(view) for view in shard.samples.views] for shard in shards]
    evidence = None
    if settings.confidence_weights or settings.min_confidence > 0:
        eyes = {camera.name: camera.center for own in cameras for camera in own}
        evidence = measure(shards, eyes, settings.emitter_gain)
    if evidence is not None and settings.min_confidence > 0:
        shards = confident_pixels(shards, evidence, settings.min_confidence, settings.emitter_gain)
    outside = read_environment(inputs.environment)
    edges = [beyond(shard.samples, own, outside) for shard, own in zip(shards, cameras, strict=True)]
    ids = None if kind is None else [segments_of(data, shard.samples, kind, empty) for shard in shards]
    # as far below the surface as a query of the median sample is wide; a mask is asked on the surface
    inset = settings.footprint * median_footprint([shard.samples for shard in shards]) if inputs.emitters else 0.0
    return Pixels(shards, ids, evidence if settings.confidence_weights else None, edges, empty, inset)


def _learn_finest(field: Field, pixels: Pixels) -> None:
    """Tell the field how fine the pixels are that teach it; one view is in memory at a time."""
    field.finest.zero_()  # a field before this one may have been taught by others
    for samples, valid in zip(pixels.shards, pixels.valid, strict=True):
        for view in range(len(samples.views)):
            teaches = np.asarray(valid[samples.pixels(view)])[samples.pixel_of_sample(view)] > 0
            own = samples.of_view(view).start + np.flatnonzero(teaches)
            field.learn_finest(samples.position[own], field.settings.footprint * np.asarray(samples.footprint[own]))


def _confidence(
    field: Field,
    pixels: Pixels,
    found: PartEstimates | None,
    classes: np.ndarray | None,
    inputs: FitInputs,
    settings: FitSettings,
) -> Confidence:
    """Predicted errors of what was fitted."""
    if found is None:
        uniform = np.zeros(int(pixels.largest_segment) + 1)
        materials = no_parts(np.array(ROUGHNESS), len(uniform))
    else:
        materials = posterior(np.array(ROUGHNESS), found.residual, found.free, classes)
        uniform = found.uniform if settings.base_weight > 0 else np.zeros_like(found.uniform)
    earlier = [read_shading(folder, own) for folder, own in zip(inputs.first_shading, pixels.shards, strict=False)]
    return predict(field, pixels, materials, uniform, settings.emitter_gain, earlier)


def _classes(data: Dataset, pixels: Pixels) -> np.ndarray:
    """(S,) semantic class of every part."""
    views = [view for samples in pixels.shards for view in samples.views]
    pairs = ((data.segments(view, "part"), data.segments(view, "semantic")) for view in views)
    return part_classes(pairs, pixels.largest_segment + 1)


def _described(found: PartEstimates) -> list[dict[str, Any]]:
    """What the search found, for the figures of the fit."""
    return [
        {"segment": int(k), "roughness": float(found.roughness[k]), "metallic": float(found.metallic[k])}
        | {"gain": round(float(found.gain[k]), 4), "pixels": int(found.pixels[k])}
        | {"base_color": found.base_color[k].tolist(), "uniform": round(float(found.uniform[k]), 3)}
        for k in np.flatnonzero(found.pixels)
    ]


def _files_that_a_fit_reads(dataset: Path) -> list[Path]:
    """Files of a dataset but its truth and held-out views, which may be made while a fit runs."""
    others = {camera.name for camera in Dataset(dataset).cameras if camera.split != "train"}
    found = [path for path in sorted(dataset.rglob("*")) if path.stem not in others]
    unread = ("truth", "relight_truth")
    return [path for path in found if path.relative_to(dataset).parts[0] not in unread and ".manifest" not in path.name]


def _checkpoint(inputs: FitInputs, settings: FitSettings) -> Path:
    """Checkpoint file of exactly this fit; those of other inputs or settings are stale and removed.

    Files are told by size and time: a checkpoint never leaves its machine.
    """
    key, out = hashlib.sha256(settings.model_dump_json().encode()), inputs.out
    segments = [] if inputs.segments is None else [inputs.segments]
    files = [inputs.previous, inputs.emitters, inputs.cache, inputs.environment, inputs.settled]
    for folder in (*inputs.samples, *inputs.shading, *inputs.first_shading, *segments):
        files += sorted(folder.rglob("*"))
    files += _files_that_a_fit_reads(inputs.dataset)
    for path in files:
        if path is not None and path.is_file() and not path.name.startswith("."):
            status = path.stat()
            key.update(f"{path}\n{status.st_size}\n{status.st_mtime_ns}\n".encode())
    chosen = out.with_name(f"{out.stem}.checkpoint-{key.hexdigest()[:12]}.safetensors")
    for stale in out.parent.glob(f"{out.stem}.checkpoint-*.safetensors"):
        if stale != chosen:
            stale.unlink()
    return chosen
