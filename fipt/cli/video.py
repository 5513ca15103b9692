"""``fipt video``: what a setup's own cameras see -> PNG pictures, their cameras, an MP4."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, ManifestFile, SettingsJson, StatsFile, stage


def command(
    dataset: DatasetFolder,
    cameras: Annotated[str, typer.Option(help="The section cameras of the light setup, JSON.")],
    pictures: Annotated[Path, typer.Option(help="Folder of the pictures that fipt relight wrote.")],
    manifest: ManifestFile,
    max_views: Annotated[
        int | None,
        typer.Option(
            min=1, help="Photographs that set the exposure: max_views of the section report; default: its own."
        ),
    ] = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Write PICTURES/*.png and PICTURES/transforms.json, and of a path PICTURES.mp4; one exposure for all."""
    with stage("video", settings, stats, backend=False) as (chosen, figures):
        from fipt.scene.setup import parse_cameras
        from fipt.stages.render.video import write_video
        from fipt.stages.report.settings import ReportSettings

        most = ReportSettings().max_views if max_views is None else max_views
        write_video(dataset, parse_cameras(cameras), pictures, manifest, most, chosen, figures)
