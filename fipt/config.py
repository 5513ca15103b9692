"""Which scenes, with which settings: reads, merges and checks the configuration.

A scene's settings come from, later ones winning: the settings classes (which are the preset
``default``), the scene's preset, the config's stage sections, the scene's own ``settings``.
The workflow and ``fipt run`` both ask here, so that they mean the same by one config file.
Nothing heavy is loaded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import yaml
from pydantic import BaseModel, Field, ValidationError, create_model

from fipt.errors import FiptError
from fipt.io.files import check_name
from fipt.settings import PRESETS, STAGES, Positive, RelightSetup, Settings, dumped

RESULTS = "results"
"""Folder of all results, in the working directory."""

CONFIG_FILE = "config/config.yaml"
"""The configuration that is read where it exists, in the working directory."""

_CAMERA_FILES = (
    "transforms.json",
    *(f"transforms_{split}.json" for split in ("train", "val", "test")),
    *(f"{split}/transforms.json" for split in ("train", "val")),
    "cam.txt",
    "K_list.txt",
)

Setups = dict[str, RelightSetup]

Sections = create_model(
    "Sections",
    __base__=Settings,
    __doc__="One optional section for each stage; absent keys keep what the layer before says.",
    **{stage: (model | None, Field(None, description=model.__doc__)) for stage, model in STAGES.items()},
)


class SceneEntry(Settings):
    """One scene."""

    source: Literal["procedural", "dataset"] = Field(
        description="procedural: a room in code; dataset: posed HDR views that exist"
    )
    preset: str = Field("default", description="name of a file in config/presets")
    path: str | None = Field(
        None,
        description="folder (or transforms.json) of a dataset; {data_root} is replaced by that key",
    )
    format: Literal["nerfstudio", "fipt-synthetic", "fipt-real"] | None = Field(
        None, description="layout of a dataset: they share file names, but not axes"
    )
    mesh: str | None = Field(None, description="mesh of a dataset whose layout brings none; {data_root} is replaced")
    setups: Setups | None = Field(None, description="relight setups of this scene, beside the common ones")
    settings: Sections | None = Field(None, description="stage sections of this scene")


class Config(Sections):
    """The whole configuration."""

    scenes: dict[str, SceneEntry] = Field(min_length=1, description="name of a scene -> where it comes from")
    rounds: Annotated[int, Field(ge=0, le=20)] = Field(
        2, description="refinements after the first fit; 0 = bake and fit only"
    )
    views_per_shard: Positive = Field(16, description="views that one job works on")
    setups: Setups | None = Field(None, description="relight setups of every scene")
    only: str | list[str] | None = Field(None, description="names of the scenes to run; absent = all")
    data_root: str | None = Field(None, description="folder that {data_root} in paths stands for")


@dataclass(frozen=True)
class Scene:
    """A scene, its settings resolved.

    Attributes
    ----------
    name
        Its folder below results/.
    source, path, format, mesh
        As in the config; paths as given, relative to the working directory.
    settings
        Stage -> its settings.
    setups
        Relight setup -> light edits.
    rounds
        The last round.
    views_per_shard
        Views in a shard.
    """

    name: str
    source: str
    path: str | None
    format: str | None
    mesh: str | None
    settings: dict[str, Any]
    setups: Setups
    rounds: int
    views_per_shard: int
    data_root: str | None

    def json(self, stage: str) -> str:
        """Settings of a stage as sorted JSON, for ``--settings``."""
        return json.dumps(dumped(self.settings[stage]), sort_keys=True)

    def setup_json(self, setup: str) -> str:
        """A relight setup as sorted JSON, for ``--setup``."""
        return json.dumps(dumped(self.setups[setup]), sort_keys=True)

    def source_path(self) -> str:
        """Return the path of a dataset, ``{data_root}`` replaced."""
        return self._placed(self.path, "path")

    def mesh_path(self) -> str | None:
        """Return the path of the extra mesh of a dataset, or None."""
        return self._placed(self.mesh, "mesh") if self.mesh else None

    def emitters_round(self, round_: int) -> int:
        """Return the round whose emitters go with the model of ``round_``."""
        return round_ if self.settings["emitters"].every_round else 0

    @cached_property
    def views(self) -> dict[str, list[str]]:
        """Split (``train``, ``val``) -> names of its views, in the source's order.

        Raises
        ------
        FiptError
            If the source cannot be read.
        """
        if self.source == "procedural":
            made = self.settings["synthesize"]
            counts = {"train": made.train_views, "val": made.val_views}
            return {split: [f"{split}_{i:03d}" for i in range(n)] for split, n in counts.items()}
        splits: dict[str, list[str]] = {"train": [], "val": []}
        for frame in self._source.frames:
            splits[frame.split].append(frame.name)
        return splits

    def source_files(self) -> list[str]:
        """Cameras, mesh and pictures of a dataset: when one changes, it is imported again."""
        root, mesh = self._source.root, self.mesh_path() or self._source.mesh
        found = [root / name for name in _CAMERA_FILES if (root / name).is_file()]
        if Path(self.source_path()).is_file():
            found.append(Path(self.source_path()))
        found += [frame.image for frame in self._source.frames]
        return sorted({str(path) for path in [*found, *([mesh] if mesh else [])]})

    def shards(self, *splits: str) -> dict[str, list[str]]:
        """Shard -> names of its views; for the splits named, or ``all``."""
        if splits == ("all",):
            splits = ("train", "val")
        size = self.views_per_shard
        return {
            f"{split}-{start // size:03d}": self.views[split][start : start + size]
            for split in splits
            for start in range(0, len(self.views[split]), size)
        }

    @cached_property
    def _source(self) -> Any:
        from fipt.io.sources import read_source

        every = self.settings["import"].val_every
        return read_source(self.source_path(), self.format, every)

    def relit_shards(self) -> dict[str, list[str]]:
        """Shards whose views are relit."""
        return self.shards(self.settings["relight"].split)

    def _placed(self, path: str, key: str) -> str:
        if "{data_root}" in path and not self.data_root:
            raise FiptError(
                f"scenes.{self.name}.{key} is {path}, but data_root is not set",
                "add --config data_root=FOLDER",
            )
        return str(Path(path.replace("{data_root}", self.data_root or "")).expanduser())


@dataclass(frozen=True)
class Configuration:
    """The checked configuration.

    Attributes
    ----------
    scenes
        Every scene of the config.
    only
        Names of the scenes that were asked for.
    rounds
        The last round of every scene.
    plain
        The configuration as plain JSON types, as given (no defaults filled in).
    """

    scenes: dict[str, Scene]
    only: tuple[str, ...]
    rounds: int
    plain: dict[str, Any]


def load(values: Mapping[str, Any]) -> Configuration:
    """Check a configuration and resolve the settings of every scene.

    Raises
    ------
    FiptError
        One line that names the key's path and what is allowed.
    """
    config = checked(Config, values)
    scenes = {name: _scene(name, entry, config) for name, entry in config.scenes.items()}
    only = [config.only] if isinstance(config.only, str) else config.only
    for name in only or ():
        if name not in scenes:
            raise FiptError(f"only: there is no scene {name!r}", f"scenes: {', '.join(scenes)}")
    return Configuration(
        scenes=scenes,
        only=tuple(dict.fromkeys(scenes if only is None else only)),
        rounds=config.rounds,
        plain=_given(config),
    )


def _scene(name: str, entry: SceneEntry, config: Config) -> Scene:
    check_name(name, "scene")
    where = f"scenes.{name}"
    if entry.source == "procedural":
        for key in ("path", "format", "mesh"):
            if getattr(entry, key) is not None:
                raise FiptError(f"{where}.{key} is only for source: dataset", f"remove {where}.{key}")
    else:
        for key in ("path", "format"):
            if getattr(entry, key) is None:
                allowed = get_args(get_args(SceneEntry.model_fields["format"].annotation)[0])
                what = "one of " + ", ".join(allowed) if key == "format" else "the dataset's folder"
                raise FiptError(f"{where}.{key} is missing", f"source: dataset needs {key}: {what}")
    setups = (config.setups or {}) | (entry.setups or {})
    for setup in setups:
        check_name(setup, "relight setup")
    layers = (preset(entry.preset, f"{where}.preset"), config, entry.settings or Sections())
    settings = {}
    for stage, model in STAGES.items():
        values: dict[str, Any] = {}
        for layer in layers:
            _merge(values, _section(layer, stage))
        settings[stage] = model.model_validate(values)
    return Scene(
        name=name,
        source=entry.source,
        path=entry.path,
        format=entry.format,
        mesh=entry.mesh,
        settings=settings,
        setups=setups,
        rounds=config.rounds,
        views_per_shard=config.views_per_shard,
        data_root=config.data_root,
    )


def preset(name: str, where: str) -> Sections:
    """Read a preset; ``where`` is the key that names it, for the error."""
    known = sorted(path.stem for path in PRESETS.glob("*.yaml"))
    if name not in known:
        raise FiptError(f"{where}: there is no preset {name!r}", f"presets: {', '.join(known)}")
    path = PRESETS / f"{name}.yaml"
    return checked(Sections, read_yaml(path), f"config/presets/{path.name}: ")


def _section(layer: Sections, stage: str) -> dict[str, Any]:
    """Return what a layer says about a stage, without the defaults of the settings class."""
    section = getattr(layer, stage)
    return {} if section is None else _given(section)


def _given(model: BaseModel) -> dict[str, Any]:
    return model.model_dump(mode="json", exclude_unset=True)


# --- Reading ------------------------------------------------------------------------------------


class _Loader(yaml.SafeLoader):
    """Reads ``1e-3`` as a number; YAML 1.1 wants ``1.0e-3`` and would give a string."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+"),
    list("-+.0123456789"),
)


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML file of keys at the top level; an empty one gives {}."""
    try:
        values = yaml.load(Path(path).read_text(encoding="utf-8"), _Loader)
    except FileNotFoundError:
        raise FiptError(f"config file {path} does not exist", "check the path") from None
    except yaml.YAMLError as error:
        raise FiptError(f"{path} is not YAML ({error})", "correct the line it names") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise FiptError(f"{path} must hold keys at its top level", "see config/README.md")
    return values


def read(files: Iterable[str | Path] = (), overrides: Iterable[str] = ()) -> Configuration:
    """Read the configuration as the workflow does.

    Parameters
    ----------
    files
        Config files on top of ``config/config.yaml`` (which is left out where it does not exist
        and other files are given); later ones win, mapping by mapping.
    overrides
        ``key=value`` with YAML values, on top of all files.
    """
    files = list(files)
    base = Path(CONFIG_FILE)
    values: dict[str, Any] = {}
    for path in [base, *files] if base.exists() or not files else files:
        _merge(values, read_yaml(path))
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise FiptError(f"--config must be KEY=VALUE; found {text!r}", "for example rounds=1")
        try:
            _merge(values, {key: yaml.load(value, _Loader)})
        except yaml.YAMLError as error:
            raise FiptError(f"--config {text!r} is not YAML ({error})", "quote it for the shell") from error
    return load(values)


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = value


# --- Checking -----------------------------------------------------------------------------------


def checked(model: type[Settings], values: Mapping[str, Any], where: str = "") -> Any:
    """Return ``values`` as ``model``, or raise one line that names the key's path.

    Parameters
    ----------
    model
        Whole configuration or a part of it.
    values
        As read from YAML.
    where
        Put before the message.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        # An unknown key explains more than the missing or wrong values that follow from it.
        problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        message, remedy = _explained(model, problems[0])
        raise FiptError(where + message, remedy) from error


def _explained(model: type[Settings], problem: Mapping[str, Any]) -> tuple[str, str]:
    """Message and remedy for one problem that pydantic reports."""
    # The members of a union of plain types stand in the location as if they were keys.
    location = [str(part) for part in problem["loc"] if part not in ("str", "list[str]")]
    path = ".".join(location)
    if location[-1] == "[key]":
        inside = ".".join(location[:-2])
        found = f"{inside}: names must be text; found {problem['input']!r}"
        return found, "put it in quotes: YAML reads no, off, yes, on and numbers as other things"
    if problem["type"] != "extra_forbidden":
        text = problem["msg"].removeprefix("Value error, ")
        found = "" if problem["type"] == "missing" else f"; found {problem.get('input')!r}"
        return f"{path}: {text[0].lower()}{text[1:]}{found}", "config/README.md explains every key"
    parent: Any = model
    for part in location[:-1]:
        parent = _inner(parent, part)
    allowed = list(parent.model_fields)
    close = get_close_matches(location[-1], allowed, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    inside = ".".join(location[:-1]) or "the top level"
    return f"unknown key {path}{hint}", f"allowed in {inside}: {', '.join(allowed)}"


def _inner(annotation: Any, part: str) -> Any:
    """Type of what stands below ``part`` (field, name or index) in a value of ``annotation``."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        annotation = annotation.model_fields[part].annotation
    else:  # dict[str, Model] or tuple[Model, ...]
        annotation = next(a for a in reversed(get_args(annotation)) if a is not Ellipsis)
    options = [a for a in get_args(annotation) if a is not type(None)]
    optional = type(None) in get_args(annotation)
    return options[0] if optional else annotation
