"""``fipt fuse``: segment ids of single views -> ids on the mesh, the same in all views."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import DatasetFolder, SettingsJson, StatsFile, stage


def command(
    dataset: DatasetFolder,
    segments: Annotated[
        Path, typer.Option(help="Folder with views/VIEW.npz and classes.json; fused/ and fusion.npz, .json go there.")
    ],
    geometry: Annotated[
        bool, typer.Option("--geometry", help="Grow parts by shape and colour instead; no views/ is needed.")
    ] = False,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Fuse segment ids of single views on the mesh, so that all views agree.

    Segments of different views become one where they overlap on the mesh. Training views vote; the
    ids of all views are then drawn from the mesh.
    """
    with stage("fuse", settings, stats) as (chosen, figures):
        from fipt.formats.files import make_folder

        if geometry:
            from fipt.stages.segment.geometry import grow_parts as run
        else:
            from fipt.stages.segment.fuse import fuse_views as run

        make_folder(segments)
        run(dataset, segments, chosen, figures)
