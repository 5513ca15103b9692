"""A verb from its stage: the options from the fields of the stage's inputs, the help from the docstring of `run`."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields
from importlib import import_module
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

import typer

from fipt.errors import FiptError
from fipt.formats.places import same_place
from fipt.inputs import POSITIONAL, UNSPLIT
from fipt.registry import VERBS, Verb

_WRITTEN = ("out", "emitters_out", "manifest", "raw", "stats")
"""Fields of stages' inputs that name what is written."""
_OF_DATASET = ("images", "mesh.ply", "transforms.json", "views.json")
"""What every dataset has, and no verb but those that make datasets may write."""
_SETTINGS = Annotated[str, typer.Option("--settings", help="Settings of this stage, JSON.")]
_STATS = Annotated[Path | None, typer.Option("--stats", help="Write time, rate and memory here, JSON.")]


def command_of(name: str) -> Callable[..., Any]:
    """Return the function with typer annotations that a verb calls.

    Parameters
    ----------
    name : str
        Of a verb in `fipt.registry.VERBS`.
    """
    verb = VERBS[name]
    module = import_module(verb.module)
    return module.command if verb.section is None else derived(verb, module.run)


def derived(verb: Verb, run: Callable[..., Any]) -> Callable[..., None]:
    """Make the command of a stage whose ``run(inputs, settings)`` takes a dataclass of files.

    Raises
    ------
    TypeError
        If a field of the inputs has no help, or a type that no option can have.
    """
    kind = inspect.signature(run).parameters["inputs"].annotation
    parameters = [_parameter(field) for field in fields(kind)]
    parameters += [_keyword("settings", _SETTINGS, "{}"), _keyword("stats", _STATS, None)]

    def command(**given: Any) -> None:
        settings, stats = given.pop("settings"), given.pop("stats")
        execute(verb, run, kind(**_converted(kind, given)), settings, stats)

    setattr(command, "__signature__", inspect.Signature(parameters))  # noqa: B010 - which typer reads
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    command.__doc__ = description(run)
    return command


def execute(verb: Verb, run: Callable[..., Any], inputs: Any, settings: str, stats: Path | None) -> None:
    """Run a stage: parse its settings, choose the device if it traces rays, time it, keep the figures it returns.

    Parameters
    ----------
    verb : Verb
        Its line in the registry.
    run : callable
        ``run(inputs, settings)`` of the stage's module.
    inputs : object
        The stage's dataclass of files.
    settings : str
        JSON of the section's settings.
    stats : Path or None
        File of the figures.
    """
    from fipt.formats.manifests import recorded
    from fipt.formats.origins import running
    from fipt.registry import parse
    from fipt.settings import dumped

    assert verb.section is not None
    chosen = parse(verb.section, settings)
    check_written(inputs, stats)
    if verb.rays:
        from fipt.render.variant import set_variant

        set_variant(threads=getattr(chosen, "threads", 0) or None)
    dataset = getattr(inputs, "dataset", None)
    with running(verb.section, dataset), recorded(stats, verb.section, dumped(chosen)) as figures:
        figures.update(run(inputs, chosen))


def check_written(inputs: Any, stats: Path | None = None) -> None:
    """Refuse to write what is read: a file or folder that the options name as both, whatever it is called.

    Raises
    ------
    FiptError
        One line that names both options.
    """
    named: list[tuple[str, Path]] = [] if stats is None else [("stats", stats)]
    for field in fields(inputs):
        value = getattr(inputs, field.name)
        paths = value if isinstance(value, tuple) else (value,)
        named += [(field.name, path) for path in paths if isinstance(path, Path)]
    dataset = getattr(inputs, "dataset", None)
    for option, path in named:
        if option not in _WRITTEN:
            continue
        if dataset is not None and any(
            same_place(Path(dataset, own), place) for own in _OF_DATASET for place in (path, *path.parents)
        ):
            raise FiptError(
                f"--{option} lies in what --dataset reads, {path}: it would be overwritten", f"change --{option}"
            )
        for other, given in named:
            if other != option and same_place(path, given):
                names = f"--{option} and --{other.replace('_', '-')}"
                raise FiptError(f"{names} are the same place, {path}: it would be overwritten", f"change --{option}")


def description(run: Callable[..., Any]) -> str:
    """Docstring of a stage's `run` for people: all that comes before its first section (Parameters, Raises)."""
    lines = (inspect.getdoc(run) or "").splitlines()
    ends = (index for index, line in enumerate(lines[1:]) if line and not line.strip("-"))
    return "\n".join(lines[: next(ends, len(lines))]).strip()


def _parameter(field: Field[Any]) -> inspect.Parameter:
    """Return the option, or the argument, of a field."""
    if get_origin(field.type) is not Annotated:
        raise TypeError(f"the field {field.name} needs a help: Annotated[TYPE, 'help']")
    kind, text, *marks = get_args(field.type)
    required = field.default is MISSING and field.default_factory is MISSING
    shown = list[str] if _is_list(kind) else kind
    if _is_list(kind) and not required:
        shown = list[str] | None
    name = "--" + field.name.replace("_", "-")
    option = typer.Argument(help=text) if POSITIONAL in marks else typer.Option(name, help=text)
    default = inspect.Parameter.empty if required else None if _is_list(kind) else field.default
    return _keyword(field.name, Annotated[shown, option], default)


def _keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _converted(kind: type[Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Values for the dataclass from those that typer found: lists split and typed, what is left out left out."""
    types = {field.name: get_args(field.type) for field in fields(kind)}
    return {
        name: _items(value, name, *types[name]) if _is_list(types[name][0]) else value
        for name, value in given.items()
        if not (_is_list(types[name][0]) and not value)
    }


def _items(given: Sequence[str], name: str, kind: Any, _text: str, *marks: object) -> tuple[Any, ...]:
    """Items of repeated options, which are comma-separated unless the field is marked; none may be there twice.

    Raises
    ------
    FiptError
        If one is; if names are asked for and none is given.
    """
    element = get_args(_list_of(kind))[0]
    texts = given if UNSPLIT in marks else [part for text in given for part in text.split(",")]
    items, option = [text for text in texts if text], "--" + name.replace("_", "-")
    paths = element is Path  # which may be called in many ways
    known = [str(Path(text).resolve()) for text in items] if paths else items
    twice = next((items[number] for number, text in enumerate(known) if text in known[:number]), None)
    if twice is not None and UNSPLIT not in marks:
        raise FiptError(f"{option} names {twice} twice", "name it once")
    if not items and element is str and kind == tuple[str, ...]:
        raise FiptError(f"{option} names nothing", "name at least one")
    return tuple(map(element, items))


def _is_list(kind: Any) -> bool:
    return _list_of(kind) is not None


def _list_of(kind: Any) -> Any:
    """Return the tuple type in a type that may be a tuple or None, if there is one."""
    choices = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    return next((choice for choice in choices if get_origin(choice) is tuple), None)
