"""The segment stage: ids of a shard's views, each view by itself."""

import json

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.manifests import Stats, withdraw_manifest, write_manifest
from fipt.progress import progress
from fipt.scene.dataset import Dataset
from fipt.scene.samples import read_samples
from fipt.scene.segments import write_view_ids
from fipt.settings import dumped
from fipt.stages.segment.degraded import DegradedIds
from fipt.stages.segment.given import GivenIds
from fipt.stages.segment.predict import Mask2Former
from fipt.stages.segment.settings import DegradedSegments, GivenSegments, PredictedSegments, SegmentSettings
from fipt.stages.segment.stage import SegmentInputs

CLASSES = "classes.json"
"""Names of the classes, beside the folder of the views."""


def segment_views(inputs: SegmentInputs, settings: SegmentSettings) -> Stats:
    """Write the ids of the views of a samples shard, the names of their classes and the manifest; return figures.

    Raises
    ------
    FiptError
        If the mode is none that makes ids of views, or the ids cannot be had.
    """
    if not isinstance(settings, PredictedSegments | GivenSegments | DegradedSegments):
        raise FiptError(
            f"segment.mode must be mask2former, given or degraded for ids of views; it is {settings.mode}",
            "set segment.mode",
        )
    data, shard, out = Dataset(inputs.dataset), read_samples(inputs.samples), inputs.out
    stats: Stats = {}
    if isinstance(settings, GivenSegments):
        source = GivenIds(data, shard, settings)
        found = source.views()
    elif isinstance(settings, DegradedSegments):
        source = DegradedIds(data, shard, settings)
        found = source.views()
    else:
        source = Mask2Former(settings)
        found = source.views(data, list(shard.views))
        stats["device"] = source.device
    withdraw_manifest(inputs.manifest)
    files = []
    with progress("segment", len(shard.views), " views") as bar:
        for view, ids, classes in found:
            files.append(out / f"{view}.npz")
            write_view_ids(files[-1], ids, classes)
            bar.advance()
        stats["views_per_s"] = bar.rate
    # Every shard writes the same names.
    names = {str(k): name for k, name in sorted(source.names.items())}
    write_text(out.parent / CLASSES, json.dumps(names, indent=1, ensure_ascii=False) + "\n")
    if isinstance(source, GivenIds) and source.warnings:
        stats["warnings"] = source.warnings
    write_manifest(inputs.manifest, "segment", [*files, out.parent / CLASSES], dumped(settings))
    return stats
