"""The fit stage: files in, model out."""

import hashlib
from pathlib import Path

import numpy as np
import torch

from fipt.fit.batches import Pixels
from fipt.fit.loop import fit
from fipt.fit.parts import estimate_parts, part_targets
from fipt.io.dataset import Dataset
from fipt.io.hits import clipped_of, pixels_of, scene_box
from fipt.io.manifests import Stats
from fipt.io.shading import read_shards
from fipt.model.networks import Field, SceneBox
from fipt.model.store import load_field, save_field
from fipt.settings import Fit


def fit_model(
    dataset: Path,
    hits: list[str],
    shading: list[str],
    previous: Path | None,
    out: Path,
    settings: Fit,
    stats: Stats,
) -> None:
    """Fit a round's model and write it to ``out``; the checkpoint beside it goes away then.

    Parameters
    ----------
    hits, shading
        Folders of the training shards, in the same order.
    previous
        Model of the round before: the start, where ``settings.warm_start``.
    """
    torch.set_num_threads(settings.threads or torch.get_num_threads())
    data = Dataset(dataset)
    shards, baked = read_shards(hits, shading)
    kind = data.segment_kind(settings.segments)
    if kind is None:
        print("warning: no segments; roughness and metallic are fitted point by point, without propagation")
    segments = kind and [
        np.concatenate([np.zeros(0, np.uint16), *(data.segments(view, kind).ravel() for view in shard.views)])
        for shard in shards
    ]
    images = [pixels_of(data, shard) for shard in shards]
    clipped = [clipped_of(data, shard) for shard in shards]
    pixels = Pixels(shards, baked, images, segments or None, clipped)
    center, side = scene_box(shards)
    field = Field(settings, SceneBox(tuple(center.tolist()), side))
    if previous is not None and settings.warm_start:
        field.load_state_dict(load_field(previous)[0].state_dict())
    checkpoint = _checkpoint(out, [*hits, *shading], previous, settings)
    targets = None
    if kind is not None and settings.part_search:
        found = estimate_parts(pixels, center, side, settings.evidence or 1.5)
        targets = torch.from_numpy(part_targets(found, settings))
        stats["parts"] = [
            {"segment": int(k), "roughness": float(found.roughness[k]), "metallic": float(found.metallic[k])}
            | {"gain": round(float(found.gain[k]), 4), "pixels": int(found.pixels[k])}
            for k in np.flatnonzero(found.pixels)
        ]
    fit(field, pixels, kind, settings, checkpoint, stats, targets)
    save_field(out, field, settings)
    checkpoint.unlink(missing_ok=True)
    stats["segments"] = kind or "none"


def _checkpoint(out: Path, folders: list[str], previous: Path | None, settings: Fit) -> Path:
    """Checkpoint file of exactly this fit; those of other inputs or settings are stale and removed."""
    key = hashlib.sha256(settings.model_dump_json().encode())
    for path in [*(Path(f"{folder}.manifest.json") for folder in folders), previous]:
        if path is not None and path.is_file():
            key.update(path.read_bytes())
    chosen = out.with_name(f"{out.stem}.checkpoint-{key.hexdigest()[:12]}.safetensors")
    for stale in out.parent.glob(f"{out.stem}.checkpoint-*.safetensors"):
        if stale != chosen:
            stale.unlink()
    return chosen
