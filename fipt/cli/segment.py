"""``fipt segment``: pictures -> segment ids of every view of a shard."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, ManifestFile, SamplesFolder, SettingsJson, StatsFile, stage


def command(
    dataset: DatasetFolder,
    samples: SamplesFolder,
    out: Annotated[Path, typer.Option(help="Folder of the ids by view; classes.json is written beside it.")],
    manifest: ManifestFile,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Segment every view by itself: by Mask2Former, or from ids that exist already."""
    with stage("segment", settings, stats, backend=False) as (chosen, figures):
        from fipt.stages.segment.run import segment_views

        segment_views(dataset, samples, out, manifest, chosen, figures)
