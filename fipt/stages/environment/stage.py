"""``fipt environment``: samples and images of the training views -> environment.npz."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import CacheFile, DatasetFolder, SamplesFolders

if TYPE_CHECKING:
    from fipt.stages.environment.settings import EnvironmentSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class EnvironmentInputs:
    """Files of ``fipt environment``."""

    dataset: DatasetFolder
    samples: SamplesFolders
    cache: CacheFile
    out: Annotated[Path, "File to write, environment.npz."]


def run(inputs: EnvironmentInputs, settings: "EnvironmentSettings") -> dict[str, Any]:
    """Find the radiance of rays that leave the mesh: stated, given, or seen by pixels without surface."""
    from functools import partial

    from fipt.scene.dataset import Dataset
    from fipt.scene.environment import write_environment
    from fipt.scene.samples import read_samples
    from fipt.scene.voxels import read_cache
    from fipt.stages.environment.fit import find_environment

    figures: dict[str, Any] = {}
    shards = [read_samples(folder) for folder in inputs.samples]
    found = find_environment(Dataset(inputs.dataset), shards, settings, figures, partial(read_cache, inputs.cache))
    write_environment(inputs.out, found)
    mean = found.mean
    log.info("environment: %s, mean radiance %.4g %.4g %.4g", found.mode, *mean)
    if sun := figures.get("sun"):
        log.info("a sun along (%.3f, %.3f, %.3f), irradiance %.4g %.4g %.4g", *sun["direction"], *sun["irradiance"])
    return figures | {"mode": found.mode, "mean": mean.tolist()}
