"""``fipt verify``: whether the files of a run are those that it wrote, and what tells two runs apart."""

from pathlib import Path
from typing import Annotated

import typer

_MEANING = {
    "missing": "is missing",
    "changed": "was changed after the run",
    "decayed": "is not what was written, though its time is: it decayed, or was changed before the run ended",
    "new": "is not of the run",
}


def command(
    scene: Annotated[str, typer.Argument(help="Name of a scene with results, or the folder of its results.")],
    against: Annotated[str, typer.Option(help="Another one: tell both runs apart, stage by stage.")] = "",
    crate: Annotated[
        bool, typer.Option("--crate", help="Then write results/SCENE/ro-crate-metadata.json, for archives.")
    ] = False,
) -> None:
    """Compute the hash of every file of SCENE again, and say what is not as its run wrote it.

    What a run wrote stands in results/SCENE/provenance.json. The exit code is 1 where anything differs. Only
    where nothing does, --crate describes the folder as an RO-Crate, which other programs read.
    """
    from fipt.crate import write_crate
    from fipt.provenance import changes, compared, read_provenance

    results = _folder(scene)
    if against:
        lines = list(compared(read_provenance(results), read_provenance(_folder(against))))
        print("\n".join(lines))
        raise typer.Exit(0 if all(": the same bytes" in line for line in lines) else 1)
    found = changes(results)
    for each in found:
        print(f"{each.stage}: {each.path} {_MEANING[each.kind]}")
    print(f"files that differ: {len(found)}" if found else f"{results}: every file is as its run wrote it")
    if crate and not found:
        print(f"{write_crate(results)} written")
    raise typer.Exit(1 if found else 0)


def _folder(name: str) -> Path:
    """Folder of a scene's results."""
    from fipt.config.layout import Layout
    from fipt.errors import FiptError

    if not name.strip():
        raise FiptError("the name of a scene must not be empty", "name a scene, or the folder of its results")
    named = Path(Layout(name).root)
    return Path(name) if not named.is_dir() and Path(name).is_dir() else named
