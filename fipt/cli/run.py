"""``fipt run``: a front to Snakemake for some scenes; the rules files alone say what runs after what."""

import contextlib
import io
import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from fipt.bucket import opened
from fipt.errors import EXIT_CODE, FiptError
from fipt.outcome import failures
from fipt.provenance import NAME as PROVENANCE

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
_HERE_TOO = ("--keep-storage-local-copies", "--scheduler-greedy-omit-prioritize-by-temp-and-input")
"""Options of Snakemake: results in a store stay here, and their sizes are not asked for again and again."""


def command(
    asked: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENE... [TARGET]",
            help="Names of scenes of the config, perhaps where to stop (default: report): "
            f"{', '.join(STOPPING_POINTS)}; or a file below results/.",
        ),
    ],
    configfile: Annotated[
        list[Path] | None, typer.Option(help="Config file on top of config/config.yaml; repeatable.")
    ] = None,
    config: Annotated[list[str] | None, typer.Option(help="KEY=VALUE on top of all files; repeatable.")] = None,
    cores: Annotated[int | None, typer.Option(min=1, help="Processors to use; default: all.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Of target compare: one seed, and only methods that take little time.")
    ] = False,
    store: Annotated[
        str | None, typer.Option(metavar="URL", help="Keep results in object storage, too: s3://BUCKET/PREFIX.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", "-n", help="List the jobs that would run, and why.")] = False,
) -> None:
    """Run every stage of SCENE that is not up to date, as far as TARGET; two jobs at a time where there is no GPU.

    Snakemake runs the jobs; results/SCENE with its logs/ is below the working directory. A run that was killed goes on
    when it is started again. Of several scenes, one that fails does not stop the others; it is named at the end.
    Several as far as compare have a table together, in results/compare. Where no scene is called so, all is all.
    """
    from fipt.config import read
    from fipt.config.kept import check_files
    from fipt.config.reading import config_files

    found = read(configfile or (), [*(config or ()), *(["compare={quick: true}"] if quick else [])])
    check_files(found, config_files(configfile or ()))
    scenes, target = asked_for(asked, found.scenes)
    if quick and target != "compare":
        raise FiptError(f"--quick is of the target compare; this is {target}", f"fipt run {scenes[0]} compare --quick")
    options = ["--cores", str(cores or "all"), *(("--dry-run",) if dry_run else ()), *_storing(store)]
    given = {"scenes": found.sheet.path} if found.sheet else {}
    asked_config = {**found.plain, **given, "only": scenes}
    code = _run(asked_config, target, options, [found.scenes[scene] for scene in scenes], dry_run)
    if not dry_run and _has_run(code):
        for scene in scenes:
            if store and (code == 0 or len(scenes) > 1):  # else what failed is here
                opened(store).share([found.scenes[scene].layout.review])  # somebody may have decided meanwhile
                opened(store).fetch_newer(f"results/{scene}")
            concluded = _conclude(found, scene, target, alone=len(scenes) == 1, done=code == 0)
            if store and concluded:
                opened(store).share([Path("results", scene, PROVENANCE)])
        if len(scenes) > 1 and any(Path("results", scene).is_dir() for scene in scenes):
            _write_index()
    raise typer.Exit(code)


def _storing(store: str | None) -> list[str]:
    """Options of Snakemake that keep results in a store, once it is seen that it can be used."""
    if store is None:
        return []
    if find_spec("snakemake_storage_plugin_s3") is None:
        raise FiptError("--store needs the package snakemake-storage-plugin-s3", "pip install 'fipt[s3]'")
    bucket = opened(store)
    bucket.check()
    return [*("--default-storage-provider", "s3", "--default-storage-prefix", bucket.url), *_HERE_TOO]


def _run(
    config: Mapping[str, Any], target: str, options: Sequence[str], scenes: "Sequence[SceneConfig]", dry: bool
) -> int:
    """Run the workflow; a comparison once more without the methods that failed, as long as there are new ones."""
    from fipt.config.failed import forget_failures, noted

    known: list[list[str]] = []
    if target == "compare" and not dry:
        for scene in scenes:
            forget_failures(scene)
    while True:
        code = snakemake(config, target, options, listed=len(scenes) > 1)
        if target != "compare" or dry or code > EXIT_CODE:
            return code
        failed = [noted(scene) for scene in scenes]
        if code == 0 or failed == known or not any(failed):
            return code
        known = failed
        names = ", ".join(dict.fromkeys(name for each in failed for name in each))
        typer.echo(f"fipt: failed: {names}; the comparison goes on without, and says why", err=True)


def _has_run(code: int) -> bool:
    """Whether a run came to its jobs: all are done, or some failed. Where none began, results are not of this run."""
    from fipt.cli import run_view

    return code == 0 or (code == EXIT_CODE and run_view.jobs_failed())


def asked_for(asked: Sequence[str], known: Iterable[str]) -> tuple[list[str], str]:
    """Scenes and target of a command line; the last word is the target where it is no scene and not the only word.

    Raises
    ------
    FiptError
        If there is no such scene or target.
    """
    from fipt.config.reading import shown

    known = list(known)
    last = asked[-1]
    is_target = len(asked) > 1 and (last in STOPPING_POINTS or last not in known)
    scenes, target = (list(asked[:-1]), last) if is_target else (list(asked), "report")
    if scenes[0] == "all" and "all" not in known:
        scenes = [*known, *scenes[1:]]
    for scene in scenes:
        if scene not in known:
            raise FiptError(f"there is no scene {scene!r}", f"scenes: {shown(known)}")
    if target not in STOPPING_POINTS and not target.startswith("results/"):
        points = ", ".join(STOPPING_POINTS)
        raise FiptError(f"there is no target {target!r}", f"targets: {points}, or a file below results/")
    owner = Path(target).parts[1] if target.startswith("results/") and len(Path(target).parts) > 1 else None
    if owner in known and owner not in scenes:
        raise FiptError(f"{target} is of scene {owner}, which is not asked for", f"fipt run {owner} {target}")
    return list(dict.fromkeys(scenes)), target


def _conclude(found: "Configuration", name: str, target: str, *, alone: bool, done: bool) -> bool:
    """Write down of what the results of a scene were made, if its run ended well, and say what it found.

    Returns
    -------
    bool
        Whether it did end well.
    """
    results = Path("results", name)
    if not done and (alone or not results.is_dir() or failures(results)):
        return False
    _record(found.scenes[name], found.plain, results)
    if alone and target in ("report", str(results / "findings.json"), str(results / "report.html")):
        tell_findings(results)
    return True


def _record(scene: "SceneConfig", plain: Mapping[str, Any], results: Path) -> None:
    """Write down of what the results were made."""
    from fipt.config.kept import files_in_folders, named_paths
    from fipt.provenance import record

    named = [*(path for _, path in named_paths(scene)), *files_in_folders(scene)]
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
        with run_view.interruptible():
            try:
                done = args_to_api(args, parser)
            except BaseException:  # libraries make other errors of an interruption
                if not run_view.interrupted():
                    raise
    return run_view.LogHandler.last.conclude(done, listed)
