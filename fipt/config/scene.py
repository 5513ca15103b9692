"""A scene, its settings resolved: what the rules ask."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fipt.config.decisions import SceneDecisions
from fipt.config.layout import Layout
from fipt.config.methods import Estimator, SceneMethods
from fipt.config.others import OutputsOfOthers
from fipt.config.resources import PIXELS, TRIANGLES, Work
from fipt.config.segmentation import SceneSegmentation
from fipt.config.setups import SceneSetups
from fipt.config.sources.base import Place, Source
from fipt.config.views import SceneViews
from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.scene.setup import RelightSetup
from fipt.settings import dumped
from fipt.stages.geometry.library import check_installed
from fipt.stages.geometry.settings import STEREO, given_file

if TYPE_CHECKING:
    from fipt.config.family import SceneFamily

_BYTES_OF_TRIANGLE = 19
"""Of mesh.ply: three indices, and half a vertex."""


@cache
def _parameters(function: Callable[..., Any]) -> frozenset[str]:
    """Names of what a function takes; asked for a thousand times in a plan."""
    return frozenset(inspect.signature(function).parameters)


@dataclass(frozen=True)
class SceneConfig:
    """A scene, its settings resolved.

    Attributes
    ----------
    place
        Its name, the paths of its results, its settings.
    source
        Where its data come from.
    given_setups
        Relight setup -> what it changes.
    rounds
        The last round.
    views_per_shard
        SceneViews in a shard.
    said
        What a person wrote about it, as plain JSON types.
    parent, shared
        Of a run of a method: the scene whose files it takes over, and which below its folder.
    family
        Makes the runs of methods; None of a run.
    estimator
        What makes its model and emitters.
    """

    place: Place
    source: Source
    given_setups: Mapping[str, RelightSetup]
    rounds: int
    views_per_shard: int
    said: Mapping[str, Any]
    parent: SceneConfig | None = None
    shared: re.Pattern[str] | None = None
    family: SceneFamily | None = None
    estimator: Estimator = "fit"

    @property
    def name(self) -> str:
        """Its folder below results/."""
        return self.place.scene

    @property
    def layout(self) -> Layout:
        """Paths of its results."""
        return self.place.layout

    @property
    def settings(self) -> Mapping[str, Any]:
        """Section -> settings."""
        return self.place.settings

    def where(self, path: str) -> str:
        """Where a file of the scene lies: of a run of a method perhaps in the folder of its parent."""
        below = path.removeprefix(f"{self.layout.root}/")
        if self.parent is None or self.shared is None or below == path or not self.shared.match(below):
            return path
        return self.parent.where(f"{self.parent.layout.root}/{below}")

    @cached_property
    def methods(self) -> SceneMethods:
        """The methods that are compared on it."""
        assert self.family is not None
        return SceneMethods(self, self.family.cards, self.family.run)

    @cached_property
    def views(self) -> SceneViews:
        """Its views, in shards."""
        return SceneViews(self.source, self.views_per_shard)

    @cached_property
    def segmentation(self) -> SceneSegmentation:
        """Where its segment ids come from."""
        return SceneSegmentation(self.place, self.source, self.views)

    @cached_property
    def setups(self) -> SceneSetups:
        """Its relight setups."""
        return SceneSetups(self.given_setups, self.place, self.views, self.segmentation, self.source.has_true_setups)

    @cached_property
    def others(self) -> OutputsOfOthers:
        """What another program estimated of it, where this run of a method imports that."""
        settings = self.settings["import_results"]
        return OutputsOfOthers(settings, self.own_name, self.place, self.views, self.setups)

    @cached_property
    def decisions(self) -> SceneDecisions:
        """What a person decided about its emitters."""
        decided = self
        while decided.parent is not None:
            decided = decided.parent
        return SceneDecisions(self.name, self.layout, self.setups, Path(decided.layout.review))

    def check(self) -> None:
        """Look for what is named and read late.

        Raises
        ------
        FiptError
            If emitters_review.yaml is wrong, what a setup or given ids name is not there, a file has a name that the
            workflow cannot use, open3d is missing for a mesh, or its scan, method or depth cannot be.
        """
        for path in self.given_files():
            self.place.plain(path, "path")
        self.decisions.review  # noqa: B018 - read here
        self.setups.check()
        self.segmentation.check()
        if self._makes_mesh():
            check_installed()
        self._check_geometry()
        for path in self.environment_files():
            existing_file(path, "environment.file")

    def _check_geometry(self) -> None:
        """Refuse what no mesh is made of, and a method that needs depth which nobody gives."""
        named = [key for key in ("scan", "prior") if self._geometry(key)]
        own = (self.said.get("settings") or {}).get("geometry") or {}
        if (idle := [*named, *({"method"} & own.keys())]) and not self._wants_mesh():
            raise FiptError(
                f"scene {self.name}: settings.geometry.{idle[0]} needs `mesh: reconstruct`; the scene brings a mesh",
                f"set mesh: reconstruct, or remove the {idle[0]}",
            )
        if self._geometry("method") == "depth" and not named and self._wants_mesh() and self._wants_stereo():
            raise FiptError(
                f"scene {self.name}: settings.geometry.method depth needs depth maps or a scan; none are given",
                "set depth.given or geometry.scan, name depth_file_path in the layout, or set method: mvs",
            )

    def _wants_stereo(self) -> bool:
        """Whether nobody gives depth maps; not known of a source that cannot be read, which says so when it is."""
        if (given := self.settings["depth"].given) is not None:
            return given == STEREO
        with suppress(FiptError):
            return not self.source.depth_files()
        return False

    def _geometry(self, key: str) -> Any:
        """What the method of the mesh says under a key; None where it has none."""
        return getattr(self.settings["geometry"], key, None)

    def given_files(self) -> list[str]:
        """Files of somebody else that its source names; none where the source cannot be read, or not yet."""
        with suppress(FiptError):  # a scene that nobody asked for needs no data
            return self.source.given_files()
        return []

    def _makes_mesh(self) -> bool:
        """Whether a run makes the mesh; not known of a source that cannot be read, which says so when it is."""
        with suppress(FiptError):
            return self.source.reconstructed and not Path(self.layout.estimated_mesh).is_file()
        return False

    def _wants_mesh(self) -> bool:
        """Whether the scene's mesh is made of its views; taken to be where its source cannot be read."""
        with suppress(FiptError):
            return self.source.reconstructed
        return True

    def settings_json(self, section: str) -> str:
        """Settings of a stage as sorted JSON, for ``--settings``."""
        values = dumped(self.settings[section])
        if section == "fit" and self.segmentation.origin == "none":
            values["segments"] = "none"
        if section == "check_poses":
            values["enabled"] = self.checks_poses
        if section == "geometry":  # of the full images; materials see the smaller ones
            values["triangle_size"] *= self.settings["import"].downscale
        return json.dumps(self.place.paths(values, f"settings.{section}"), sort_keys=True)

    def work(self, shard: str | None = None) -> Work:
        """How large its jobs are, as far as that is known before they run: a plan opens no image."""
        photograph, factor = self.source.pixels, self.settings["import"].downscale if self.source.imported else 1
        pixels, places = max(photograph // factor**2, 1), [self.layout.mesh, self.source.given_mesh]
        views = len(self.views.shards("all").get(shard, ())) if shard else self.views_per_shard
        mesh = next((path for path in map(Path, filter(None, places)) if path.is_file()), None)
        triangles = TRIANGLES if mesh is None else mesh.stat().st_size // _BYTES_OF_TRIANGLE
        return Work(pixels, pixels * views, pixels * len(self.views.of("train")), triangles, photograph)

    def known_work(self, shard: str | None = None) -> Work | None:
        """How large its jobs are; None where the size of images is not known before they are read."""
        return None if self.source.pixels == PIXELS else self.work(shard)

    def memory_mb(self, section: str) -> int:
        """Megabytes of memory that a stage takes at most, of those whose settings bound it."""
        return int(1000 * self.settings[section].memory_gb)

    @property
    def rays_per_side(self) -> int:
        """Rays of a pixel along its side, as many as its footprint samples have."""
        return self.settings["samples"].grid

    @property
    def shown_views(self) -> int:
        """Views that the report shows; their photographs set the exposure of videos."""
        return self.settings["report"].max_views

    @property
    def checks_poses(self) -> bool:
        """Whether cameras are checked through the mesh: photographs' and estimated ones, unless settings say."""
        wanted = self.settings["check_poses"].enabled
        return self.source.checks_poses if wanted is None else wanted

    # --- photographs

    def prepared(self) -> list[str]:
        """What an import did to a noisy mesh, of imported scenes."""
        return [self.layout.prepared] if self.source.imported else []

    def made_mesh(self) -> list[str]:
        """What is said about a mesh that was made of the images."""
        return [self.layout.geometry, self.layout.geometry_overview] if self.source.reconstructed else []

    def judged(self) -> list[str]:
        """The capture report, of photographed scenes."""
        return [self.layout.capture_report] if self.source.photographed else []

    def developed(self) -> list[str]:
        """The capture report and the developed views, of photographed scenes."""
        shards = self.views.shards("all") if self.source.photographed else ()
        return [*self.judged(), *(self.layout.developed.format(shard=shard) for shard in shards)]

    def brackets(self, shard: str) -> list[str]:
        """The photographs of a shard; of a simulated camera all, since it is their table that tells brackets apart."""
        assert self.source.photographs is not None
        if self.source.simulated:
            return self.calibration_files()
        return self.source.photographs.of(self.views.shards("all")[shard], shard)

    def simulated_frames(self) -> list[str]:
        """Manifests of what a simulated camera took; true photographs are no files of ours."""
        return self.calibration_files() if self.source.simulated else []

    def calibration_files(self) -> list[str]:
        """What tells the camera."""
        return self.source.photographs.calibration(self.views.shards("all")) if self.source.photographs else []

    def reference_files(self) -> list[str]:
        """Known positions that estimated poses are brought to, if the config names any."""
        file = self.settings["poses"].align.reference
        return [self.place.path(file, "settings.poses.align.reference")] if file else []

    # --- the dataset

    def images(self, splits: Sequence[str], shard: str | None = None) -> list[str]:
        """Manifests of the images, ids and truth of splits or of ``all``; in a job of a shard, of that one."""
        if self.has_errors:
            return [self.layout.imported_images]
        shards = list(self.views.shards(*splits)) if shard is None else [shard]
        if self.source.rendered:
            return [self.layout.images.format(shard=name) for name in shards]
        truth = [self.layout.truth.format(shard=name) for name in shards] if self.source.simulated else []
        return [self.layout.imported_images, *truth]

    @property
    def has_errors(self) -> bool:
        """Whether errors are planted into its dataset, which is then its own."""
        return self.parent is not None and self.settings["plant_errors"] != self.parent.settings["plant_errors"]

    def before_errors(self) -> list[str]:
        """Files that a dataset with planted errors is made of."""
        assert self.parent is not None
        sound, layout = self.parent, self.parent.layout
        names = [layout.parts, layout.semantic] if self.source.rendered else sound.prepared()
        return list(map(sound.where, [layout.transforms, layout.views, layout.mesh, *sound.images(["all"]), *names]))

    def dataset_before_errors(self) -> str:
        """Folder of these."""
        assert self.parent is not None
        return self.parent.where(self.parent.layout.dataset)

    def images_to_check(self) -> list[str]:
        """Manifests of all images, where cameras are checked."""
        return self.images(["all"]) if self.checks_poses else []

    def environment_files(self) -> list[str]:
        """The environment map that the config names, if any."""
        file = getattr(self.settings["environment"], "file", None)
        return [self.place.path(file, "settings.environment.file")] if file else []

    def given_depth(self) -> list[str]:
        """Depth maps of the training views that the config names, or else its source, if any."""
        folder = self.settings["depth"].given
        if folder and folder != STEREO:
            return self._depth_in(folder, "depth.given")
        named = {} if folder == STEREO else self.source.depth_files()
        return [str(existing_file(path, f"depth of {view}")) for view, path in named.items()]

    def depth_options(self) -> list[str]:
        """Options of ``fipt depth`` that say where depth maps are named, if the source names any."""
        return self.source.depth_options() if self.settings["depth"].given is None else []

    def given_scan(self) -> list[str]:
        """The scan in coordinates of its own that the config names, if any."""
        file = self._geometry("scan")
        return [str(existing_file(self.place.path(file, "settings.geometry.scan"), "geometry.scan"))] if file else []

    def given_prior(self) -> list[str]:
        """Predicted depth of the training views that the config names, if any."""
        folder = self._geometry("prior")
        return self._depth_in(folder, "geometry.prior") if folder else []

    def _depth_in(self, folder: str, key: str) -> list[str]:
        """Depth maps of the training views in a folder that a key names."""
        placed = Path(self.place.path(folder, f"settings.{key}"))
        views = [view for shard in self.views.shards("train").values() for view in shard]
        return [str(existing_file(given_file(placed, view), f"depth of {view} ({key})")) for view in views]

    @property
    def own_name(self) -> str:
        """Its name; of a run of a method that of its scene."""
        return self.name.partition("/methods/")[0]

    # --- the model and what is made of it

    def true_samples(self) -> list[str]:
        """Manifests of the samples of all training views, where the first shading is that of the true room."""
        shards = self.views.shards("train") if self.settings["bake"].truth else ()
        return [self.layout.samples.format(shard=shard) for shard in shards]

    def true_images(self) -> list[str]:
        """Manifests of their truth."""
        return self.images(["train"]) if self.settings["bake"].truth else []

    def last_shading(self) -> list[str]:
        """Manifests of the shading of the last round."""
        return self._shading(self.rounds)

    def shading_before(self) -> list[str]:
        """Manifests of the shading of the round before; none where there is one round only."""
        return self._shading(self.rounds - 1) if self.rounds else []

    def _shading(self, round: int) -> list[str]:
        return [self.layout.shading.format(round=round, shard=shard) for shard in self.views.shards("train")]

    def last_states(self) -> list[str]:
        """Whether the loop had settled in the last two rounds."""
        return [self.layout.settled.format(round=k) for k in range(self.rounds + 1)[-2:]]

    def last_model(self) -> str:
        """The model of the last round."""
        return self.layout.model.format(round=self.rounds)

    def last_confidence(self) -> list[str]:
        """Confidence in the last model, where it is told."""
        return [self.layout.confidence.format(round=self.rounds)] if self.estimator == "fit" else []

    def last_emitters(self) -> str:
        """The emitters that go with the last model."""
        return self._emitters(self.rounds)

    def emitters_before(self, round: str) -> str:
        """The emitters that go with the model of the round before."""
        return self._emitters(int(round) - 1)

    def model_of_emitters(self, round: str) -> list[str]:
        """The model whose mask decides what emits, where it does."""
        by_mask = self.settings["emitters"].decide == "mask"
        return [self.layout.model.format(round=round)] if by_mask else []

    def emitters_of_fit(self, round: str) -> list[str]:
        """The emitters that a fit, and the parts before it, leave out, where they are decided before it."""
        return [self._emitters(int(round))] if self.settings["emitters"].decide == "regions" else []

    def emitters_before_fit(self, round: str) -> list[str]:
        """The emitters that the shading of a fit was made with, where those of its round are decided before it."""
        return [self.emitters_before(round)] if self.emitters_of_fit(round) and int(round) > 0 else []

    def _emitters(self, round: int) -> str:
        return self.layout.emitters.format(round=round if self.settings["emitters"].every_round else 0)

    def olat(self) -> list[str]:
        """Manifests of the views with one light at a time."""
        return [self.layout.olat.format(shard=shard) for shard in self.views.olat_shards()]

    def exported(self) -> list[str]:
        """The export; its check and what that rendered, if views are held out."""
        checked = [self.layout.export_check, self.layout.export_check_folder] if self.views.of("val") else []
        return [self.layout.export, *checked]

    def checked_export(self) -> list[str]:
        """The same, where every run makes it."""
        return self.exported() if self.settings["export"].enabled else []

    def sections(self) -> list[str]:
        """Sections of the report on stages that not every scene has."""
        made = {"capture": self.source.photographed, "poses": self.source.estimated}
        made |= {"geometry": self.source.reconstructed, "export": self.settings["export"].enabled}
        return [name for name, shown in made.items() if shown]

    # --- asking

    def answer(self, question: str, **known: Any) -> Any:
        """Attribute or method by its dotted name; a method is given those of ``known`` that it takes.

        Paths of a run of a method are those of the files that it takes over.
        """
        found: Any = self
        for name in question.split("."):
            found = getattr(found, name)
        if callable(found):
            takes = _parameters(getattr(found, "__func__", found))
            found = found(**{name: value for name, value in known.items() if name in takes})
        if isinstance(found, list):
            return [self.where(value) if isinstance(value, str) else value for value in found]
        return self.where(found) if isinstance(found, str) else found
