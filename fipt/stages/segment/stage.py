"""``fipt segment``: images -> segment ids of every view of a shard."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, ManifestFile, SamplesFolder

if TYPE_CHECKING:
    from fipt.stages.segment.settings import SegmentSettings


@dataclass(frozen=True, kw_only=True)
class SegmentInputs:
    """Files of ``fipt segment``."""

    dataset: DatasetFolder
    samples: SamplesFolder
    out: Annotated[Path, "Folder of the ids by view; classes.json is written beside it."]
    manifest: ManifestFile


def run(inputs: SegmentInputs, settings: "SegmentSettings") -> dict[str, Any]:
    """Segment every view by itself: by Mask2Former, or from ids that exist already."""
    from fipt.stages.segment.run import segment_views

    return segment_views(inputs, settings)
