"""``fipt check-poses``: pictures, cameras and mesh -> which views show what the others show."""

import json
from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import SettingsJson, StatsFile, stage


def command(
    dataset: Annotated[Path, typer.Argument(help="Dataset folder.")],
    reject: Annotated[
        bool, typer.Option("--reject", help="Write the verdicts into the dataset: later stages leave such views out.")
    ] = False,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Check through the mesh that every view shows what the others show.

    Finds cameras that are mirrored, turned or swapped. Exit code 2 if a view fails, unless --reject
    leaves it out. With --reject and enabled: false in the settings, every view is accepted unseen.
    """
    from fipt.errors import FiptError
    from fipt.registry import parse

    looks = not reject or parse("check_poses", settings).enabled is not False
    with stage("check_poses", settings, stats, backend=looks) as (chosen, figures):
        from fipt.formats.files import write_text
        from fipt.scene.dataset import CHECKED, Dataset

        data = Dataset(dataset, unchecked=True)
        verdicts = []
        if looks:
            from fipt.stages.check_poses.compare import check, enough, table

            verdicts = check(data, chosen)
            print(table(verdicts))
            enough(verdicts, chosen)
        failed = [verdict for verdict in verdicts if not verdict.accepted]
        figures["rejected"] = [verdict.view for verdict in failed]
        figures["warnings"] = [f"{v.view} {v.reason}" for v in verdicts if v.reason]
        if reject:
            views = {verdict.view: verdict.plain() for verdict in verdicts}
            text = json.dumps({"checked": looks, "views": views}, indent=1, allow_nan=False)
            write_text(dataset / CHECKED, text + "\n")
        elif failed:
            raise FiptError(
                f"{len(failed)} of {len(verdicts)} views do not show what the others show: "
                + ", ".join(verdict.view for verdict in failed),
                "correct their cameras, or leave them out with --reject",
            )
