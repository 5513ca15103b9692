"""Configurations from files and overrides, checked, with the settings of every scene resolved."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
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
from fipt.errors import FiptError
from fipt.formats.yaml import parse_yaml, read_yaml
from fipt.validation import checked

CONFIG_FILE = "config/config.yaml"
"""The configuration that is read where it exists, in the working directory."""

DEMO_FILE = Path(__file__).resolve().parent / "demo.yaml"
"""The configuration where there is none."""


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
    """

    scenes: dict[str, SceneConfig]
    only: tuple[str, ...]
    rounds: int
    plain: Mapping[str, Any]

    def scene(self, name: str) -> SceneConfig:
        """A scene, or a run of a method on it: SCENE/methods/RUN."""
        scene, _, run = name.partition("/methods/")
        return self.scenes[scene].methods.run(run) if run else self.scenes[scene]

    def runs(self, estimator: Estimator | Literal["any"], but: Estimator | None = None) -> str:
        """Regular expression of the runs of methods whose materials such an estimator makes, ``but`` for one."""
        found = []
        for name, scene in self.scenes.items():
            wanted = {name: card.estimator for name, card in scene.methods.cards.items() if card.estimator != but}
            cards = [name for name, own in wanted.items() if estimator in (own, "any")]
            if not cards:
                continue
            seed = r"(?:\.seed-[1-9]\d*)?"
            found.append(f"{re.escape(name)}/methods/(?:{'|'.join(map(re.escape, cards))}){seed}")
        return "|".join(found) or "(?!)"


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
    refuse_renamed(values)
    config: Config = checked(Config, values)
    scenes = {name: SceneFamily(name, entry, config).scene for name, entry in config.scenes.items()}
    only = [config.only] if isinstance(config.only, str) else config.only
    for name in only or ():
        if name not in scenes:
            raise FiptError(f"only: there is no scene {name!r}", f"scenes: {', '.join(scenes)}")
    return Configuration(
        scenes=scenes,
        only=tuple(dict.fromkeys(scenes if only is None else only)),
        rounds=max(scene.rounds for scene in scenes.values()),
        plain=given(config),
    )
