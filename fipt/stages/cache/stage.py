"""``fipt cache``: samples and images of the training views -> cache.npz."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, SamplesFolders

if TYPE_CHECKING:
    from fipt.stages.cache.settings import CacheSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CacheInputs:
    """Files of ``fipt cache``."""

    dataset: DatasetFolder
    samples: SamplesFolders
    out: Annotated[Path, "File to write, cache.npz."]


def run(inputs: CacheInputs, settings: "CacheSettings") -> dict[str, Any]:
    """Gather the images' radiance in voxels on the surface."""
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import read_samples, view_pixels
    from fipt.scene.voxels import write_cache
    from fipt.stages.cache.build import build, check_room

    data = Dataset(inputs.dataset)
    shards = [read_samples(folder) for folder in inputs.samples]
    mesh = data.mesh()
    check_room(mesh, shards, settings, inputs.out)
    cache = build(mesh, shards, view_pixels(data, shards), settings)
    write_cache(inputs.out, cache)
    seen = int((cache["count"] > 0).sum())
    log.info("cache: %d of %d surface voxels are seen", seen, len(cache["key"]))
    return {"voxels": len(cache["key"]), "seen_voxels": seen}
