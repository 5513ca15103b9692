"""Methods that are compared: a card each, and what a scene runs of them.

A run of a method lies in results/SCENE/methods/RUN/, with the layout of a scene: RUN is the method's name, with another
seed NAME.seed-N. It takes over whatever its settings do not change (docs/adr/0046-methods.md).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from fipt.config.failed import why_failed
from fipt.config.sections import Sections
from fipt.errors import FiptError
from fipt.formats.files import check_distinct, check_name
from fipt.formats.yaml import read_yaml
from fipt.registry import SECTIONS
from fipt.settings import Rounds, Settings, dumped
from fipt.validation import checked

if TYPE_CHECKING:
    from fipt.config.scene import SceneConfig

CARDS = Path(__file__).resolve().parent / "method_cards"
"""Folder of the cards of methods that this program knows, one YAML file each."""

OWN = "fipt"
"""The method that is the scene's own run."""

Estimator = Literal["fit", "irradiance", "true-constants", "inverse-trace", "imported"]
Kind = Literal["method", "ablation", "reimplementation", "substitute", "imported", "bound", "sensitivity"]
Quantity = Literal["kd", "reflectance", "base_color", "roughness", "metallic", "emission"]

SEEDED: Mapping[Estimator, tuple[str, ...]] = {"fit": ("fit", "refine"), "inverse-trace": ("inverse_trace",)}
"""Estimators that draw random numbers -> sections whose seeds they are; other estimators have none."""

_SEED = re.compile(r"(.+)\.seed-([1-9]\d*)")

_STAGES: tuple[tuple[tuple[str, ...], str], ...] = (
    (("samples",), r"samples/|stats/samples\."),
    (("segment", "fuse"), r"segments([/.]|$)|stats/(segment|fuse)\b"),
    (("cache",), r"cache\.npz|stats/cache\."),
    (("environment",), r"environment\.npz|stats/environment\."),
    (("bake",), r"round-0/shading/|stats/bake\."),
    (("regroup", "emitters", "fit"), r"round-0/|stats/\w+\.round-0\."),
    (("refine",), r"round-\d+/|stats/\w+\.round-\d+\."),
)
"""Sections -> regular expression of what their stages write, in the order of the pipeline."""

_OF_DATASET = tuple(SECTIONS)[: list(SECTIONS).index("plant_errors")]
"""Sections of the stages that make the dataset, which runs take over."""

_SOURCE = r"(room|raw|capture|poses|geometry)([/.]|$)"
_DATASET = r"dataset([/.]|$)"
_UNSPOILT = r"dataset/(relight_truth[\w.-]+\.manifest\.json|prepare\.json|room\.json)$"
"""What a dataset with planted errors has in common with that of its scene, for the workflow to know."""


class Method(Settings):
    """A method that is compared with others: its card."""

    label: str = Field(description="name in tables")
    kind: Kind = Field(description="what it is")
    estimator: Estimator = Field(default="fit", description="what makes its materials and emitters")
    source: str = Field(description="where it comes from")
    deviations: str = Field(default="none", description="what deviates from its source")
    inputs: tuple[str, ...] = Field(
        default=("images", "cameras", "mesh", "segments"), description="what of the scene it looks at"
    )
    not_estimated: tuple[Quantity, ...] = Field(
        default=(), description="what it does not estimate: null in its figures"
    )
    oracle: tuple[str, ...] = Field(default=(), description="what it takes from the truth")
    needs: tuple[Literal["segments", "truth"], ...] = Field(
        default=(), description="what a scene must have; else it is listed as not applicable"
    )
    preset: str | None = Field(default=None, description="preset that lies on top of the scene's settings")
    settings: Sections | None = Field(default=None, description="stage sections that lie on top of them all")  # pyright: ignore[reportInvalidTypeForm] - made by create_model
    rounds: Rounds | None = Field(default=None, description="last round; absent: that of the scene")
    series: str = Field(default="", description="of a sensitivity: what is wrong; methods of one series are one plot")
    size: float = Field(default=0.0, ge=0, description="of a sensitivity: how much of it")
    unit: str = Field(default="", description="unit of the size")
    quick: bool = Field(default=False, description="take part in `fipt run SCENE compare --quick`")


Methods = dict[str, Method]


def known_methods(*others: Methods | None) -> Methods:
    """Cards of this program, then those that a configuration adds or replaces.

    Raises
    ------
    FiptError
        If a method cannot be called so, or has settings that change nothing.
    """
    found = dict(_shipped())
    for methods in others:
        found |= methods or {}
    check_distinct(found, "methods")
    for name, card in found.items():
        check_name(name, "method")
        if _SEED.fullmatch(name):
            raise FiptError(f"a method must not be called {name!r}: that is a seed of a method", "rename it")
        if (idle := _idle_section(card)) is not None:
            raise FiptError(
                f"methods.{name}.settings.{idle} would change nothing: runs of methods take over the scene's dataset",
                "make it a scene of its own, or use plant_errors",
            )
    if found[OWN].estimator != "fit" or found[OWN].settings is not None or found[OWN].rounds is not None:
        raise FiptError(f"methods.{OWN} is the scene's own run: it can have no settings of its own", "rename it")
    return found


def _idle_section(card: Method) -> str | None:
    """Section of a card that no job of its runs reads; cameras of a dataset with planted errors are checked anew."""
    said = card.settings.model_fields_set if card.settings is not None else set()
    read = {"check_poses"} if "plant_errors" in said else set()
    return next((section for section in _OF_DATASET if section in said - read), None)


@cache
def _shipped() -> Methods:
    return {
        path.stem: checked(Method, read_yaml(path), f"method {path.stem}: ") for path in sorted(CARDS.glob("*.yaml"))
    }


@dataclass(frozen=True)
class MethodRun:
    """A method with a seed."""

    method: str
    seed: int = 0

    @property
    def name(self) -> str:
        """Of its folder in results/SCENE/methods."""
        return f"{self.method}.seed-{self.seed}" if self.seed else self.method

    @classmethod
    def of(cls, name: str) -> MethodRun:
        """The run that a folder's name stands for."""
        seeded = _SEED.fullmatch(name)
        return cls(seeded[1], int(seeded[2])) if seeded else cls(name)

    @property
    def parent(self) -> MethodRun:
        """The run of which this one differs by its method alone; of the own method the scene itself."""
        return MethodRun(OWN, 0 if self.method == OWN else self.seed)


def shared_paths(parent: SceneConfig, settings: Mapping[str, Any], estimator: Estimator) -> re.Pattern[str]:
    """Paths below a scene's folder that its run with other settings takes over: all before the first change."""
    if settings["plant_errors"] != parent.settings["plant_errors"]:
        return re.compile(f"{_SOURCE}|{_UNSPOILT}")
    shared = [_SOURCE, _DATASET]
    for sections, written in _STAGES:
        if "fit" in sections and estimator != "fit":
            break
        if any(settings[section] != parent.settings[section] for section in sections):
            break
        shared.append(written)
    return re.compile("|".join(shared))


def _changed(before: Settings, after: Settings) -> dict[str, Any]:
    """Keys of settings whose values are new, those that only plans read too."""
    old, new = before.model_dump(mode="json"), after.model_dump(mode="json")
    return {name: value for name, value in new.items() if name not in old or old[name] != value}


_ORDER = ("method", "reimplementation", "substitute", "imported", "bound", "ablation", "sensitivity")
"""Kinds of methods as tables list them."""


class SceneMethods:
    """What is compared on a scene.

    Parameters
    ----------
    scene
        The scene; methods take over its files.
    cards
        Method -> its card.
    run
        Makes the scene as a run of a method sees it, by the run's name.
    """

    def __init__(self, scene: SceneConfig, cards: Methods, run: Callable[[str], SceneConfig]) -> None:
        self._scene, self.cards, self.run = scene, cards, run

    @property
    def chosen(self) -> list[str]:
        """Names of the methods that the settings ask for; the scene's own run is always among them.

        Raises
        ------
        FiptError
            If there is no such method.
        """
        settings = self._scene.settings["compare"]
        order = sorted(self.cards, key=lambda name: _ORDER.index(self.cards[name].kind))
        wanted = settings.methods or [name for name in order if self.cards[name].kind != "sensitivity"]
        for name in (*wanted, *settings.sensitivity):
            if name not in self.cards and name not in self.series:
                raise FiptError(f"compare.methods: there is no method {name!r}", f"methods: {', '.join(self.cards)}")
        if settings.quick and not settings.methods:
            wanted = [name for name in wanted if self.cards[name].quick]
        planted = [name for asked in settings.sensitivity for name in self.series.get(asked, (asked,))]
        return list(dict.fromkeys([OWN, *wanted, *planted]))

    @property
    def series(self) -> dict[str, list[str]]:
        """Series of sensitivities, and ``all``, -> their methods, by size."""
        own = sorted((name for name, card in self.cards.items() if card.series), key=lambda name: self.cards[name].size)
        found = {"all": own}
        for name in own:
            found.setdefault(self.cards[name].series, []).append(name)
        return found

    def reasons(self) -> dict[str, str]:
        """Methods that the scene lacks something for -> what."""
        lacks = {name: self._lack(name, self.cards[name]) for name in self.chosen if name != OWN}
        return {name: reason for name, reason in lacks.items() if reason is not None}

    def _lack(self, name: str, card: Method) -> str | None:
        if "segments" in card.needs and self._scene.segmentation.origin == "none":
            return "needs segment ids, and the scene has none"
        if "truth" in card.needs and not self._scene.source.has_truth:
            return "needs true materials, and the scene has none"
        if card.rounds is not None and card.rounds > self._scene.rounds:
            return f"needs round {card.rounds}, and the last of the scene is {self._scene.rounds}"
        own = self.run(name)
        if card.estimator == "imported":
            return own.others.lack()
        if card.estimator == "fit" and own.rounds == self._scene.rounds and own.settings == self._scene.settings:
            return "is the scene's own run: its settings are the same"
        return None

    def runs(self) -> list[MethodRun]:
        """Methods with seeds that are compared, in the order of the table: those that can be and have not failed."""
        return [run for run in self._wanted() if self._failure(run) is None]

    def failed(self) -> dict[str, str]:
        """Runs that have failed -> why."""
        found = {run.name: self._failure(run) for run in self._wanted()}
        return {name: why for name, why in found.items() if why is not None}

    def _failure(self, run: MethodRun) -> str | None:
        """Why a run has failed, or that of which it takes over files; None: it has not."""
        if run == run.parent:
            return None
        why = why_failed(self._scene, run.name)
        parent = why or self._failure(run.parent)
        return why or (parent and f"it takes over files of {run.parent.name}, which failed")

    def _wanted(self) -> list[MethodRun]:
        """Methods with seeds, in the order of the table; a method without random numbers has one."""
        settings, missing = self._scene.settings["compare"], self.reasons()
        found = []
        for name in self.chosen:
            card = self.cards[name]
            one = settings.quick or card.estimator not in SEEDED or card.kind == "sensitivity"
            seeds = 1 if one else settings.seeds
            found += [MethodRun(name, seed) for seed in range(seeds) if name not in missing]
        return found

    # --- what jobs read

    def files(self) -> list[str]:
        """What every run of a method reached."""
        return [self._scene.layout.method.format(method=run.name) for run in self.runs()]

    def options(self) -> list[str]:
        """Options of ``fipt compare`` that say which methods are not applicable or have failed, and why."""
        absent = {"--not-applicable": self.reasons(), "--failed": self.failed()}
        return [text for flag, why in absent.items() for name in why for text in (flag, f"{name}={why[name]}")]

    def metrics(self, method: str) -> str:
        """Figures of a run."""
        return self.run(method).layout.metrics

    def findings(self, method: str) -> list[str]:
        """Findings of a run, where an error is planted: do they point at it."""
        run = MethodRun.of(method)
        return [self.run(method).layout.findings] if self.cards[run.method].kind == "sensitivity" else []

    def card_json(self, method: str) -> str:
        """Card of a run as sorted JSON, with its name, seed and what its settings are that the scene's are not."""
        run = MethodRun.of(method)
        own, scene = self.run(method), self._scene
        changed = {name: _changed(scene.settings[name], own.settings[name]) for name in own.settings}
        changed = {name: values for name, values in changed.items() if values}
        card = dumped(self.cards[run.method])
        if card["estimator"] == "imported":
            settings = own.settings["import_results"]
            card["views"] = list(settings.only)
            if settings.only:
                card["label"] += f", {len(settings.only)} view{'s' * (len(settings.only) > 1)} only"
            taken = {
                "scale of every picture": settings.scaled,
                "photographs under the other light": settings.input != "views",
            }
            card["oracle"] = [*card["oracle"], *(what for what, is_taken in taken.items() if is_taken)]
        card |= {"id": run.method, "seed": run.seed, "settings": changed}
        card |= {"rounds": own.rounds, "random": card["estimator"] in SEEDED}
        return json.dumps(card, sort_keys=True)

    def stats(self, method: str) -> list[str]:
        """Times and memory of the jobs that estimate; not of what is rendered to judge them."""
        own = self.run(method)
        return [own.where(own.layout.stats.format(label=label)) for label in self._labels(own, MethodRun.of(method))]

    def _labels(self, own: SceneConfig, run: MethodRun) -> Iterable[str]:
        estimator = self.cards[run.method].estimator
        train, every = own.views.shards("train"), own.views.shards("all")
        if estimator == "imported":
            return
        yield from (f"samples.{shard}" for shard in every)
        if own.segmentation.by_view():
            yield from (f"segment.{shard}" for shard in train)
        if own.segmentation.is_fused:
            yield "fuse"
        if estimator in ("fit", "irradiance"):
            yield from ("environment", "cache", *(f"bake.round-0.{shard}" for shard in train))
        if estimator != "fit":
            yield estimator
            return
        for k in range(own.rounds + 1):
            yield f"fit.round-{k}"
            if k == 0 or own.settings["emitters"].every_round:
                yield f"emitters.round-{k}"
            if own.segmentation.is_regrouped:
                yield f"regroup.round-{k}"
            yield from (f"refine.round-{k}.{shard}" for shard in train if k)

    def shown(self) -> list[str]:
        """Manifests of the maps and renderings of the first seed of every method, their figures, and their truth."""
        scene, found = self._scene, []
        for run in self.runs():
            if run.seed:
                continue
            own = scene if run.method == OWN else self.run(run.name)
            found.append(own.layout.metrics)
            if own.estimator == "imported":
                found.append(own.layout.results_of_others)
                continue
            found += [own.layout.materials.format(shard=shard) for shard in own.views.shards("all")]
            found += [own.layout.render.format(shard=shard) for shard in own.views.shards("val")]
            found += own.setups.relit()
        return [*found, *scene.images(["all"]), *scene.setups.truth()]
