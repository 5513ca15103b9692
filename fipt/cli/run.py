"""``fipt run``: a front to Snakemake for one scene; the rules files alone say what runs after what."""

import contextlib
import io
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fipt.errors import EXIT_CODE, FiptError
from fipt.outcome import failures

if TYPE_CHECKING:
    from fipt.config.reading import Configuration
    from fipt.config.scene import SceneConfig

WORKFLOW = Path(__file__).parents[1] / "workflow"
STOPPING_POINTS = (
    "capture",
    "dataset",
    "shading",
    "materials",
    "render",
    "relight",
    "export",
    "metrics",
    "report",
    "compare",
)
"""Targets of fipt/workflow/rules/targets.smk, in the order of the pipeline."""


def command(
    scene: Annotated[
        str, typer.Argument(help="Name of a scene of the config; several with commas between them; or all.")
    ],
    target: Annotated[
        str, typer.Argument(help=f"Where to stop: {', '.join(STOPPING_POINTS)}; or a file below results/.")
    ] = "report",
    configfile: Annotated[
        list[Path] | None, typer.Option(help="Config file on top of config/config.yaml; repeatable.")
    ] = None,
    config: Annotated[list[str] | None, typer.Option(help="KEY=VALUE on top of all files; repeatable.")] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Processors to use; default: all.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Of target compare: one seed, and only methods that take little time.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="List the jobs that would run, and why.")] = False,
) -> None:
    """Run every stage of SCENE that is not up to date, as far as TARGET.

    Snakemake runs the jobs; results/SCENE with its logs/ is below the working directory. A run that was killed goes on
    when it is started again. Of several scenes, one that fails does not stop the others; it is named at the end.
    """
    from fipt.config import read

    if quick and target != "compare":
        raise FiptError(f"--quick is of the target compare; this is {target}", f"fipt run {scene} compare --quick")
    found = read(configfile or (), [*(config or ()), *(["compare={quick: true}"] if quick else [])])
    names = _names(scene, found)
    if target not in STOPPING_POINTS and not target.startswith("results/"):
        points = ", ".join(STOPPING_POINTS)
        raise FiptError(f"there is no target {target!r}", f"targets: {points}, or a file below results/")
    options = ["--cores", str(cores or "all"), *(("--dry-run",) if dry_run else ())]
    given = {"scenes": found.sheet.path} if found.sheet else {}
    code = snakemake({**found.plain, **given, "only": names}, target, options, listed=len(names) > 1)
    if code in (0, EXIT_CODE) and not dry_run:
        for name in names:
            _conclude(found, name, target, alone=len(names) == 1, done=code == 0)
        if len(names) > 1 and any(Path("results", name).is_dir() for name in names):
            _write_index()
    raise typer.Exit(code)


def _names(text: str, found: "Configuration") -> list[str]:
    """Scenes that were asked for."""
    from fipt.config.reading import shown

    if text == "all" and text not in found.scenes:
        return list(found.only)
    names = list(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in found.scenes:
            raise FiptError(f"there is no scene {name!r}", f"scenes: {shown(found.scenes)}")
    return names


def _conclude(found: "Configuration", name: str, target: str, *, alone: bool, done: bool) -> None:
    """Write down of what the results of a scene were made, if its run ended well, and say what it found."""
    results = Path("results", name)
    if not done and (alone or not results.is_dir() or failures(results)):
        return
    _record(found.scenes[name], found.plain, results)
    if alone and target in ("report", str(results / "findings.json"), str(results / "report.html")):
        tell_findings(results)


def _record(scene: "SceneConfig", plain: Mapping[str, Any], results: Path) -> None:
    """Write down of what the results were made."""
    from fipt.config.kept import named_paths
    from fipt.provenance import record

    named = [path for _, path in named_paths(scene)]
    own = {**plain, "scenes": {scene.name: plain.get("scenes", {}).get(scene.name)}}
    record(results, own, [*scene.given_files(), *named])


def _write_index() -> None:
    from fipt.stages.report.index import INDEX, write_index

    rooms = write_index(Path("results"))
    typer.echo(f"fipt: results/{INDEX} shows {rooms} rooms", err=True)


def tell_findings(results: Path) -> None:
    """Say on standard error what a run found wrong with itself; findings are no failure."""
    from fipt.scene.findings import read_findings

    found = read_findings(results / "findings.json")
    if not found:
        typer.echo("fipt: nothing was found wrong", err=True)
        return
    typer.echo(f"fipt: {len(found)} finding{'s' if len(found) > 1 else ''} (pictures: {results}/findings):", err=True)
    for finding in found:
        typer.echo(f"  {finding.headline}", err=True)


def snakemake(config: Mapping[str, Any], target: str, options: Sequence[str], listed: bool = False) -> int:
    """Run Snakemake in this process, with our view of it instead of its own; return the exit code.

    Parameters
    ----------
    config : mapping
        The whole configuration.
    target : str
        Rule or file to make.
    options : sequence of str
        More options of Snakemake's command line.
    listed : bool
        Whether the workflow names the jobs that fail, as it does of several scenes.
    """
    from snakemake.cli import args_to_api, parse_args
    from snakemake_interface_logger_plugins.registry import LoggerPluginRegistry

    from fipt.cli import run_view

    LoggerPluginRegistry().register_plugin("snakemake_logger_plugin_fipt", run_view)
    with tempfile.TemporaryDirectory() as folder:
        configfile = Path(folder, "config.json")
        configfile.write_text(json.dumps(config), encoding="utf-8")
        argv = ["--snakefile", str(WORKFLOW / "Snakefile"), "--workflow-profile", str(WORKFLOW / "profiles" / "local")]
        argv += ["--logger", "fipt", *options, "--configfile", str(configfile), "--", target]
        with contextlib.redirect_stderr(io.StringIO()):  # it says which profile it uses
            parser, args = parse_args(argv)
        done = False
        with run_view.interruptible(), contextlib.suppress(KeyboardInterrupt):  # which `conclude` knows of
            done = args_to_api(args, parser)
    return run_view.LogHandler.last.conclude(done, listed)
