"""A scene, and the same scene as runs of methods see it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from typing import Any

from fipt.config.layout import OF_SEVERAL, Layout
from fipt.config.methods import OWN, SEEDED, MethodRun, known_methods, shared_paths
from fipt.config.scene import SceneConfig
from fipt.config.schema import Config, SceneEntry, source_of
from fipt.config.sections import Sections, given, preset, resolved
from fipt.config.sources.base import Place
from fipt.errors import FiptError
from fipt.formats.files import check_distinct, check_name


class SceneFamily:
    """Makes the configuration of a scene, and of runs of methods when they are asked for.

    Parameters
    ----------
    name
        Of the scene.
    entry
        What a person wrote about it.
    config
        The whole configuration.
    known
        Settings by what was said of them, and by the run of a method: scenes of which the same is said share them.
    """

    def __init__(self, name: str, entry: SceneEntry, config: Config, known: dict[Any, Any]) -> None:
        check_name(name, "scene")
        if name.lower() in OF_SEVERAL:
            raise FiptError(f"a scene must not be called {name!r}: results/{name} is of several scenes", "rename it")
        self._name, self._entry, self._config, self._known = name, entry, config, known
        self._runs: dict[str, SceneConfig] = {}

    @cached_property
    def cards(self) -> dict[str, Any]:
        """Method -> its card."""
        return known_methods(self._config.methods)

    @cached_property
    def scene(self) -> SceneConfig:
        """The scene itself."""
        config, entry, name = self._config, self._entry, self._name
        setups = (config.setups or {}) | (entry.setups or {})
        check_distinct(setups, "setups")
        for setup, light in setups.items():
            check_name(setup, "relight setup")
            for camera in light.cameras.names if light.cameras is not None else ():
                check_name(camera, f"camera of setup {setup}:")
        place = Place(name, Layout(name), self._settings(), config.data_root)
        return SceneConfig(
            place=place,
            source=source_of(entry, place),
            given_setups=setups,
            rounds=config.rounds if entry.rounds is None else entry.rounds,
            views_per_shard=config.views_per_shard,
            said=given(entry),
            family=self,
        )

    def _settings(self, run: MethodRun | None = None) -> Mapping[str, Any]:
        entry = self._entry
        written = json.dumps([entry.below, entry.preset, entry.settings and given(entry.settings)], sort_keys=True)
        said = written, run
        if said not in self._known:
            where = f"scene {self._name}: " if run is None else f"scene {self._name}, method {run.method}: "
            self._known[said] = resolved(self._layers(run, where), where)
        return self._known[said]

    def _layers(self, run: MethodRun | None, where: str) -> list[Any]:
        entry, config = self._entry, self._config
        below = Sections.model_validate(entry.below)
        layers = [below, preset(entry.preset, f"scenes.{self._name}.preset"), config, entry.settings or Sections()]
        if run is None:
            return layers
        card = self.cards[run.method]
        if card.preset is not None:
            layers.append(preset(card.preset, f"methods.{run.method}.preset"))
        layers.append(card.settings or Sections())
        if run.seed:
            before = resolved(layers, where)
            seeds = {name: {"seed": before[name].seed + run.seed} for name in SEEDED.get(card.estimator, ())}
            layers.append(Sections.model_validate(seeds))
        return layers

    def run(self, name: str) -> SceneConfig:
        """The scene as a run of a method sees it; a method's own first run is the scene.

        Raises
        ------
        FiptError
            If there is no such method, or its settings cannot be.
        """
        if name not in self._runs:
            run = MethodRun.of(name)
            self._runs[name] = self.scene if run == run.parent else self._made(run)
        return self._runs[name]

    def _made(self, run: MethodRun) -> SceneConfig:
        if run.method not in self.cards:
            raise FiptError(f"there is no method {run.method!r}", f"methods: {', '.join(self.cards)}")
        card, scene, settings = self.cards[run.method], self.scene, self._settings(run)
        parent = scene if run.parent == MethodRun(OWN) else self.run(run.parent.name)
        own = f"{self._name}/methods/{run.name}"
        rounds = 0 if card.estimator != "fit" else scene.rounds if card.rounds is None else card.rounds
        return SceneConfig(
            place=Place(own, Layout(own), settings, self._config.data_root),
            source=scene.source,
            given_setups=scene.given_setups,
            rounds=min(rounds, scene.rounds),
            views_per_shard=scene.views_per_shard,
            said={},
            parent=parent,
            shared=shared_paths(parent, settings, card.estimator),
            estimator=card.estimator,
        )
