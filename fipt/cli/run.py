"""``fipt run``: the whole chain of a scene in one process."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fipt.run import Job


def command(
    scene: Annotated[str, typer.Argument(help="name of a scene of the config")],
    configfile: Annotated[
        list[Path] | None,
        typer.Option(help="config file on top of config/config.yaml; may be repeated"),
    ] = None,
    config: Annotated[list[str] | None, typer.Option(help="KEY=VALUE on top of all files; may be repeated")] = None,
) -> None:
    """Run every stage of SCENE that is not up to date; the same files as the workflow.

    Results go to results/SCENE below the working directory.
    """
    from fipt.config.legacy import read
    from fipt.errors import FiptError
    from fipt.run import run

    scenes = read(configfile or (), config or ()).scenes
    if scene not in scenes:
        raise FiptError(f"there is no scene {scene!r}", f"scenes: {', '.join(scenes)}")
    run(scenes[scene], call)


def call(job: "Job") -> None:
    """Call the verb of a job in this process."""
    from fipt.cli.main import run_command
    from fipt.cli.verbs import command_of

    code = run_command(command_of(job.verb), job.options, prog_name=f"fipt {job.verb}")
    if code:
        raise SystemExit(code)
