"""``fipt tidy``: remove what nothing but a new fit reads from a finished room."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    scenes: Annotated[list[str], typer.Argument(metavar="SCENE...", help="Names of scenes with results.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="Only say what would go.")] = False,
    undo: Annotated[bool, typer.Option("--undo", help="Let the next run make again what is gone.")] = False,
) -> None:
    """Remove footprint samples, shading and other large files of SCENE that a run can make again.

    A tidied room stays up to date, and `fipt verify` accepts it. A new fit, report or list of findings needs what is
    gone: `fipt tidy SCENE --undo`, then `fipt run SCENE`.
    """
    from fipt.config.layout import Layout
    from fipt.formats.files import check_name
    from fipt.tidy import restore, tidy

    for scene in scenes:
        results = Path(Layout(check_name(scene, "scene")).root)
        if undo:
            print(f"{results}: the next run makes again what {len(restore(results))} manifests stood for")
            continue
        found = tidy(results, dry_run)
        for what, size in found.sizes.items():
            print(f"  {what}: {size / 1e6:.1f} MB")
        verb = "would shrink" if dry_run else "has shrunk"
        print(f"{results} {verb} from {found.before / 1e6:.1f} MB to {found.after / 1e6:.1f} MB")
