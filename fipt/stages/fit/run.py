"""The fit stage: files in, model out."""

import hashlib
from pathlib import Path

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.formats.arrays import on_disk
from fipt.formats.manifests import Stats
from fipt.model.networks import Field, SceneBox
from fipt.model.store import load_field, save_field
from fipt.scene.confidence import Confidence, write_confidence
from fipt.scene.dataset import Dataset
from fipt.scene.environment import beyond, read_environment
from fipt.scene.samples import FootprintSamples, clipped_of, pixels_of, scene_box, segments_of
from fipt.scene.shading import Shading, read_shards
from fipt.scene.voxels import read_cache
from fipt.stages.fit.batches import Pixels
from fipt.stages.fit.confidence import measure, of_pixels
from fipt.stages.fit.hidden import find_hidden
from fipt.stages.fit.loop import fit
from fipt.stages.fit.parts import estimate_parts, part_classes, part_targets
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.stage import FitInputs


def fit_model(inputs: FitInputs, settings: FitSettings) -> Stats:
    """Fit a round's model and write it to ``out``, confidence.npz beside it; the checkpoint goes away then."""
    stats: Stats = {}
    torch.set_num_threads(settings.threads or torch.get_num_threads())
    data = Dataset(inputs.dataset, inputs.segments)
    shards, baked = read_shards(inputs.samples, inputs.shading)
    kind = data.segment_kind(settings.segments)
    if kind is None:
        print(
            "warning: no segments; roughness and metallic are fitted point by point, without search or propagation: "
            "they are unsure wherever no view sees a highlight (docs/stages/segment.md has figures)"
        )
    empty = on_disk(inputs.out.parent)  # what there is for every pixel stays out of memory
    ids = kind and [segments_of(data, shard, kind, empty) for shard in shards]
    images = [pixels_of(data, shard, empty) for shard in shards]
    lamp_gain = settings.evidence or 1.5
    eyes = {view: data.camera(view).center for shard in shards for view in shard.views}
    clipped = [clipped_of(data, shard, empty) for shard in shards]
    confidence = measure(shards, baked, images, clipped, eyes, lamp_gain)
    if settings.min_confidence > 0:
        images = _sure_enough(shards, baked, images, clipped, confidence, settings.min_confidence, lamp_gain)
    outside = read_environment(inputs.environment)
    edges = [beyond(shard, [data.camera(view) for view in shard.views], outside) for shard in shards]
    weighted = confidence if settings.confidence else None
    pixels = Pixels(shards, baked, images, ids or None, weighted, edges, clipped, empty)
    center, side = scene_box(shards)
    field = Field(settings, SceneBox(tuple(center.tolist()), side))
    if inputs.previous is not None and settings.warm_start:
        field.load_state_dict(load_field(inputs.previous).state_dict())
    checkpoint = _checkpoint(inputs, settings)
    targets = hidden = None
    if kind is not None and settings.part_search:
        classes = None
        if kind == "part" and data.has_segments("semantic"):
            views = [view for shard in shards for view in shard.views]
            pairs = ((data.segments(view, "part"), data.segments(view, "semantic")) for view in views)
            classes = part_classes(pairs, pixels.largest_segment + 1)
        found = estimate_parts(pixels, center, side, lamp_gain, classes)
        targets = part_targets(found, settings)
        stats["parts"] = [
            {"segment": int(k), "roughness": float(found.roughness[k]), "metallic": float(found.metallic[k])}
            | {"gain": round(float(found.gain[k]), 4), "pixels": int(found.pixels[k])}
            | {"base_color": found.base_color[k].tolist(), "uniform": round(float(found.uniform[k]), 3)}
            for k in np.flatnonzero(found.pixels)
        ]
        if inputs.cache is not None and settings.hidden > 0:
            unseen = find_hidden(pixels, read_cache(inputs.cache), found.pixels > 0)
            hidden = unseen if len(unseen) else None
    fit(field, pixels, kind, settings, checkpoint, stats, targets, hidden)
    write_confidence(inputs.out.with_name("confidence.npz"), confidence)
    save_field(inputs.out, field, settings)
    checkpoint.unlink(missing_ok=True)
    stats["segments"] = kind or "none"
    stats["fused_segments"] = inputs.segments is not None
    return stats


def _sure_enough(
    shards: list[FootprintSamples],
    shading: list[Shading],
    images: list[tuple[np.ndarray, np.ndarray]],
    clipped: list[np.ndarray],
    confidence: Confidence,
    least: float,
    lamp_gain: float,
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Images (P, 3) and weights (P,) of each shard; no weight is left to pixels that show unsure surface.

    Lamps keep theirs, and what is clipped may be one: they teach the mask, and nothing about reflectance.
    """
    chosen, best = [], 0.0
    for shard, baked, (radiance, valid), above in zip(shards, shading, images, clipped, strict=True):
        sure, lamp = of_pixels(shard, baked, radiance, confidence, lamp_gain)
        chosen.append((radiance, np.where((sure >= least) | lamp | above, valid, 0)))
        best = max(best, float(sure[valid > 0].max(initial=0)))
    if best < least:
        raise FiptError(
            f"fit.min_confidence {least} leaves no pixel of the training views; the surest has {best:.3f}",
            "lower fit.min_confidence",
        )
    return chosen


def _checkpoint(inputs: FitInputs, settings: FitSettings) -> Path:
    """Checkpoint file of exactly this fit; those of other inputs or settings are stale and removed."""
    key, out = hashlib.sha256(settings.model_dump_json().encode()), inputs.out
    folders = [*inputs.samples, *inputs.shading, *([inputs.segments] if inputs.segments else [])]
    files = [inputs.previous, inputs.cache, inputs.environment]
    for path in [*(Path(f"{folder}.manifest.json") for folder in folders), *files]:
        if path is not None and path.is_file():
            key.update(path.read_bytes())
    chosen = out.with_name(f"{out.stem}.checkpoint-{key.hexdigest()[:12]}.safetensors")
    for stale in out.parent.glob(f"{out.stem}.checkpoint-*.safetensors"):
        if stale != chosen:
            stale.unlink()
    return chosen
