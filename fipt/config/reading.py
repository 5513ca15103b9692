"""Configurations from files and overrides, checked, with the settings of every scene resolved."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from fipt.config.family import SceneFamily
from fipt.config.files import merge
from fipt.config.methods import Estimator
from fipt.config.renamed import refuse_renamed
from fipt.config.scene import SceneConfig
from fipt.config.schema import Config
from fipt.config.sections import given
from fipt.config.sheet import RoomSheet, read_sheet
from fipt.conventions import NAME_PATTERN
from fipt.errors import FiptError
from fipt.formats.files import check_distinct
from fipt.formats.yaml import parse_yaml, read_yaml
from fipt.validation import checked

CONFIG_FILE = "config/config.yaml"
"""The configuration that is read where it exists, in the working directory."""

DEMO_FILE = Path(__file__).resolve().parent / "demo.yaml"
"""The configuration where there is none."""

SCENE = NAME_PATTERN.pattern
"""Regular expression of the name of any scene."""


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
        The last round of the scene that has most.
    plain
        The configuration as plain JSON types, as given (no defaults filled in).
    sheet
        The table that its scenes come from, if they do.
    """

    scenes: dict[str, SceneConfig]
    only: tuple[str, ...]
    rounds: int
    plain: Mapping[str, Any]
    sheet: RoomSheet | None = None

    def scene(self, name: str) -> SceneConfig:
        """A scene, or a run of a method on it: SCENE/methods/RUN."""
        scene, _, run = name.partition("/methods/")
        if scene not in self.scenes:
            raise FiptError(f"there is no scene {scene!r}", f"scenes: {shown(self.scenes)}")
        return self.scenes[scene].methods.run(run) if run else self.scenes[scene]

    def where(self, question: str) -> str:
        """Regular expression of the scenes that were asked for whose answer to a question is yes.

        It matches no other scene of the configuration: what one has made may be imported by another, as it is.
        A thousand names in the expression of every file would be the most of a plan's time: where all answer the same,
        it is that of any name.
        """
        kinds: dict[bool, list[str]] = {True: [], False: []}
        for name in self.only:
            kinds[bool(self.scenes[name].answer(question))].append(re.escape(name))
        kinds[False] += [re.escape(name) for name in self.scenes if name not in self.only]
        if not kinds[True]:
            return "(?!)"
        if len(kinds[False]) < len(kinds[True]):
            return f"(?!(?:{'|'.join(kinds[False])})/){SCENE}" if kinds[False] else SCENE
        return "|".join(kinds[True])

    def runs(self, estimator: Estimator | Literal["any"], but: Estimator | None = None) -> str:
        """Regular expression of the runs of methods whose materials such an estimator makes, ``but`` for one."""
        cards = next(iter(self.scenes.values())).methods.cards  # the same of every scene
        wanted = {name: card.estimator for name, card in cards.items() if card.estimator != but}
        names = [re.escape(name) for name, own in wanted.items() if estimator in (own, "any")]
        return rf"{SCENE}/methods/(?:{'|'.join(names)})(?:\.seed-[1-9]\d*)?" if names else "(?!)"

    def check(self, read: bool) -> None:
        """Look for what the scenes that were asked for name and a run would read late.

        Parameters
        ----------
        read
            Read their sources too, whose data must be there then.
        """
        for name in self.only:
            scene = self.scenes[name]
            with self._located(name):
                if read:
                    scene.source.views  # noqa: B018 - read here
                scene.check()

    @contextmanager
    def _located(self, name: str) -> Iterator[None]:
        """Tell of an error about a scene where in the sheet it comes from."""
        try:
            yield
        except FiptError as error:
            raise error if self.sheet is None else self.sheet.located(name, error) from None


def shown(names: Iterable[str], most: int = 12) -> str:
    """Names for a message, the first of them where there are many."""
    listed = list(names)
    return ", ".join(listed[:most]) + (f", ... ({len(listed)} in all)" if len(listed) > most else "")


def read(files: Iterable[str | Path] = (), overrides: Iterable[str] = ()) -> Configuration:
    """Read the configuration as the workflow does.

    Parameters
    ----------
    files
        Config files on top of ``config/config.yaml`` (which is left out where it does not exist
        and other files are given; the demo where no file is); later ones win, mapping by mapping.
    overrides
        ``key=value`` with YAML values, on top of all files.

    Raises
    ------
    FiptError
        If a file cannot be read, or what it says cannot be.
    """
    values: dict[str, Any] = {}
    for path in config_files(files):
        merge(values, read_yaml(path))
    for text in overrides:
        key, equals, value = text.partition("=")
        if not equals:
            raise FiptError(f"--config must be KEY=VALUE; found {text!r}", "for example rounds=1")
        try:
            merge(values, {key: parse_yaml(value)})
        except yaml.YAMLError as error:
            raise FiptError(f"--config {text!r} is not YAML ({error})", "quote it for the shell") from error
    return load(values)


def config_files(files: Iterable[str | Path] = ()) -> list[Path]:
    """The files that hold together: that of the working directory, those named; where there is none, the demo's."""
    base = Path(CONFIG_FILE)
    return [*([base] if base.exists() else []), *map(Path, files)] or [DEMO_FILE]


def load(values: Mapping[str, Any]) -> Configuration:
    """Check a configuration and resolve the settings of every scene.

    Raises
    ------
    FiptError
        One line that names the key's path and what is allowed.
    """
    sheet = None
    if isinstance(values.get("scenes"), str):
        sheet = read_sheet(values["scenes"])
        values = {**values, "scenes": sheet.scenes}
    refuse_renamed(values)
    config: Config = checked(Config, values)
    check_distinct(config.scenes, "scenes")
    scenes: dict[str, SceneConfig] = {}
    settings: dict[Any, Any] = {}
    for name, entry in config.scenes.items():
        try:
            scenes[name] = SceneFamily(name, entry, config, settings).scene
        except FiptError as error:
            raise error if sheet is None else sheet.located(name, error) from None
    only = [config.only] if isinstance(config.only, str) else config.only
    if only == []:
        raise FiptError("only: no scene is named", "name one, or leave the key out for all")
    for name in only or ():
        if name not in scenes:
            raise FiptError(f"only: there is no scene {name!r}", f"scenes: {shown(scenes)}")
    return Configuration(
        scenes=scenes,
        only=tuple(dict.fromkeys(scenes if only is None else only)),
        rounds=max(scene.rounds for scene in scenes.values()),
        plain=given(config),
        sheet=sheet,
    )
