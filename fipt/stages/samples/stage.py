"""``fipt samples``: cameras and mesh -> footprint samples of a shard."""

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from fipt.inputs import DatasetFolder, Names, ShardFolder

if TYPE_CHECKING:
    from fipt.stages.samples.settings import SamplesSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class SamplesInputs:
    """Files of ``fipt samples``."""

    dataset: DatasetFolder
    views: Names
    out: ShardFolder


def run(inputs: SamplesInputs, settings: "SamplesSettings") -> dict[str, Any]:
    """Trace the footprint samples of every pixel, once. Views that a check rejected are left out.

    Raises
    ------
    FiptError
        If no training view is left.
    """
    from fipt.errors import FiptError
    from fipt.formats.files import atomic_folder, manifest_beside
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.scene.dataset import Dataset
    from fipt.scene.samples import write_samples
    from fipt.settings import dumped
    from fipt.stages.samples.trace import trace

    figures: dict[str, Any] = {}
    data = Dataset(inputs.dataset)
    if not data.views("train"):
        raise FiptError(
            f"{inputs.dataset} has no training view that no check rejected", "see views.json and check_poses.json there"
        )
    samples = trace(data, inputs.views, settings, figures, inputs.out)
    sparse = figures["views_mostly_off_mesh"]
    if sparse:
        log.warning("more than half of the pixels miss the mesh in %s", ", ".join(sparse))
    out, manifest = inputs.out, manifest_beside(inputs.out)
    with atomic_folder(out, r"\w+\.npy|views\.json") as folder:
        names = [file.name for file in write_samples(folder, samples)]
        withdraw_manifest(manifest)
    files = [out / name for name in names]
    write_manifest(manifest, "samples", files, dumped(settings))
    return figures
