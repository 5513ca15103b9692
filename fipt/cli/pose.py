"""``fipt pose``: views without poses -> cameras in metres, with evidence."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import SettingsJson, StatsFile, listed, stage


def command(
    out: Annotated[Path, typer.Option(help="Folder to write: transforms.json, views.json, poses.json and pictures.")],
    capture: Annotated[Path | None, typer.Option(help="Developed photographs: the folder of fipt develop.")] = None,
    source: Annotated[Path | None, typer.Option(help="Or any folder of undistorted VIEW.exr.")] = None,
    intrinsics: Annotated[Path | None, typer.Option(help="With --source: JSON with w, h, fl_x, ... in pixels.")] = None,
    held_out: Annotated[
        list[str] | None, typer.Option("--held-out", help="Views that become val, comma-separated; repeatable.")
    ] = None,
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Estimate the poses of views with COLMAP; believe them only where there is evidence.

    Incremental and global mapping must agree on every camera. Cameras that fail a check are
    rejected by name in views.json; if too few are left, the reason and what to do are said.
    Features, matches and models are kept in OUT/work and used again.
    """
    from fipt.errors import FiptError

    if (capture is None) == (source is None) or (source is None) != (intrinsics is None):
        raise FiptError("give --capture, or --source with --intrinsics", "see fipt pose --help")
    with stage("poses", settings, stats, backend=False) as (chosen, figures):
        from fipt.stages.poses.estimate import estimate, write
        from fipt.stages.poses.views import read_capture, read_folder

        held = set(listed(held_out or []))
        views = read_capture(capture, held) if source is None else read_folder(source, intrinsics, held)
        found = estimate(views, out / "work", chosen)
        write(out, views, found)
        refused = {name: e.reason for name, e in found.evidence.items() if e.reason is not None}
        figures["views"], figures["rejected"] = len(views.cameras), list(refused)
        figures["points"] = len(found.reconstruction.points)
        figures["warnings"] = [f"view {name} is rejected: {reason}" for name, reason in refused.items()]
        for warning in figures["warnings"]:
            print(f"warning: {warning}")
        print(f"{out}: {len(found.reconstruction.cameras)} of {len(views.cameras)} views have a pose")
