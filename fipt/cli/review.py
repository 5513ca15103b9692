"""``fipt review``: emitters -> the list of lamps for people, and the file in which they decide."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    DecisionsJson,
    EmittersFile,
    SamplesFolders,
    SettingsJson,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    emitters: EmittersFile,
    out: Annotated[Path, typer.Option(help="Folder of emitters.json and the lamps' pictures.")],
    review: Annotated[Path, typer.Option(help="File for a person's decisions, emitters_review.yaml; they are kept.")],
    decisions: DecisionsJson = "",
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """List the lamps with names and pictures; bring emitters_review.yaml up to date."""
    with stage("review", settings, stats, backend=False) as (chosen, figures):
        from fipt.stages.emitters.review import write_listing

        shards = [Path(folder) for folder in listed(samples)]
        write_listing(dataset, shards, emitters, decisions, out, review, chosen, figures)
