"""``fipt check-export``: load every exported file back, render it, and compare with our own pictures."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, SamplesFolders, SettingsJson, StatsFile, listed, stage


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    export: Annotated[Path, typer.Option(help="Folder of the exported room.")],
    render: Annotated[Path, typer.Option(help="Folder of our pictures of held-out views.")],
    out: Annotated[Path, typer.Option(help="check.json to write; the pictures go to a folder check beside it.")],
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Say how near the exported room, loaded back and path traced by Mitsuba, comes to our own pictures."""
    with stage("export", settings, stats) as (chosen, _):
        from fipt.stages.export.check import check_export

        check_export(dataset, [Path(folder) for folder in listed(samples)], export, render, out, chosen)
