"""Which scenes, with which settings: reads, merges and checks the configuration.

A scene's settings come from, later ones winning: the settings classes (which are the preset
``default``), what its source changes in them, the scene's preset, the config's stage sections,
the scene's own ``settings``.
The workflow and ``fipt run`` both ask here, so that they mean the same by one config file.
Nothing heavy is loaded.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import yaml
from pydantic import BaseModel, Field, create_model

from fipt.errors import FiptError
from fipt.formats.files import check_name, existing_file
from fipt.registry import settings_classes
from fipt.scene.review import FILE as REVIEW_FILE
from fipt.scene.review import Review, closest, read_review
from fipt.scene.setup import RelightSetup, check_keyframes
from fipt.settings import Positive, Settings, dumped, layer_of
from fipt.validation import checked

RESULTS = "results"
"""Folder of all results, in the working directory."""

CONFIG_FILE = "config/config.yaml"
"""The configuration that is read where it exists, in the working directory."""

ESTIMATED = "colmap"
"""What `poses` of a scene says where poses are estimated."""

_CAMERA_FILES = (
    "transforms.json",
    *(f"transforms_{split}.json" for split in ("train", "val", "test")),
    *(f"{split}/transforms.json" for split in ("train", "val")),
    "cam.txt",
    "K_list.txt",
)

PRESETS = Path(__file__).resolve().parent / "presets"

STAGES = settings_classes()
"""Section -> class of its settings."""

LAYERS = {section: layer_of(model) for section, model in STAGES.items()}
"""Section -> class of what one layer of the configuration may say about it."""

Setups = dict[str, RelightSetup]

Sections = create_model(
    "Sections",
    __base__=Settings,
    __doc__="One optional section for each stage; absent keys keep what the layer before says.",
    **{stage: (layer | None, Field(default=None, description=layer.__doc__)) for stage, layer in LAYERS.items()},
)


class SceneEntry(Settings):
    """One scene."""

    source: Literal["procedural", "mitsuba", "dataset", "raw"] = Field(
        description="procedural: a room in code; mitsuba: a room of a scene file, 24 + 8 views of 320x240 where "
        "nothing else is said; dataset: posed HDR views that exist; raw: bracketed photographs"
    )
    preset: str = Field(default="default", description="name of a file in fipt/config/presets")
    path: str | None = Field(
        default=None,
        description="folder (or transforms.json) of a dataset, or of photographs, or scene file (XML); {data_root} is "
        "replaced by that key",
    )
    simulate_raw: bool | None = Field(
        default=None,
        description="true: a simulated camera (`synthesize.raw`) photographs the procedural or modelled room, and the "
        "scene starts at these RAW files",
    )
    format: Literal["nerfstudio", "fipt-synthetic", "fipt-real"] | None = Field(
        default=None, description="layout of a dataset: they share file names, but not axes"
    )
    mesh: str | None = Field(
        default=None,
        description="mesh of photographs, or of a dataset whose layout brings none; {data_root} is replaced",
    )
    poses: str | None = Field(
        default=None,
        description="poses of photographed views: `colmap` estimates them; or a transforms.json, COLMAP folder, "
        "Metashape XML or RealityCapture CSV, by view name; {data_root} is replaced",
    )
    segments: str | None = Field(
        default=None,
        description="folder with part/VIEW.png or semantic/VIEW.png of photographed views; {data_root} is replaced",
    )
    setups: Setups | None = Field(default=None, description="relight setups of this scene, beside the common ones")
    settings: Sections | None = Field(default=None, description="stage sections of this scene")


class Config(Sections):
    """The whole configuration."""

    scenes: dict[str, SceneEntry] = Field(min_length=1, description="name of a scene -> where it comes from")
    rounds: Annotated[int, Field(ge=0, le=20)] = Field(
        default=2, description="refinements after the first fit; 0 = bake and fit only"
    )
    views_per_shard: Positive = Field(default=16, description="views that one job works on")
    setups: Setups | None = Field(default=None, description="relight setups of every scene")
    only: str | list[str] | None = Field(default=None, description="names of the scenes to run; absent = all")
    data_root: str | None = Field(default=None, description="folder that {data_root} in paths stands for")


@dataclass(frozen=True)
class Scene:
    """A scene, its settings resolved.

    Attributes
    ----------
    name
        Its folder below results/.
    source, path, format, mesh, poses, segments, simulate_raw
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
    poses: str | None
    segments: str | None
    simulate_raw: bool
    settings: dict[str, Any]
    setups: Setups
    rounds: int
    views_per_shard: int
    data_root: str | None

    def json(self, stage: str) -> str:
        """Settings of a stage as sorted JSON, for ``--settings``."""
        values = dumped(self.settings[stage])
        if stage == "fit" and self.segmentation == "none":
            values["segments"] = "none"
        if stage == "segment":
            for key in {"model", "path"} & values.keys():
                values[key] = self._placed(values[key], f"settings.segment.{key}")
        if stage == "environment" and "file" in values:
            values["file"] = self.environment_path()
        if stage == "check_poses":
            values["enabled"] = self.checks_poses
        if stage == "poses" and values["align"]["reference"]:
            values["align"]["reference"] = self.reference_path()
        return json.dumps(values, sort_keys=True)

    def setup_json(self, setup: str) -> str:
        """A relight setup as sorted JSON, for ``--setup``."""
        values = dumped(self.setups[setup])
        del values["reference"]
        if values["cameras"] and values["cameras"]["path"]:
            for key in ("fps", "video"):  # other pictures do not follow from these
                del values["cameras"]["path"][key]
        for entry in _with_files(values):
            entry["file"] = self._placed(entry["file"], f"setups.{setup}")
        return json.dumps(values, sort_keys=True)

    def cameras_json(self, setup: str) -> str:
        """A setup's own cameras as sorted JSON, for ``--cameras``."""
        return json.dumps(dumped(self.setups[setup].cameras), sort_keys=True)

    @property
    def filmed(self) -> list[str]:
        """Setups with cameras of their own; the others are seen by views of the dataset."""
        return [name for name, setup in self.setups.items() if setup.cameras is not None]

    @property
    def relit(self) -> list[str]:
        """Setups that views of the dataset see."""
        return [name for name in self.setups if name not in self.filmed]

    @property
    def references(self) -> dict[str, str]:
        """Relight setup -> folder of photographs under its light."""
        given = {name: setup.reference for name, setup in self.setups.items() if setup.reference is not None}
        return {name: self._placed(path, f"setups.{name}.reference") for name, path in given.items()}

    def reference_files(self) -> list[str]:
        """Photographs with which relit views are compared.

        Raises
        ------
        FiptError
            If a setup names a folder without any.
        """
        from fipt.scene.references import reference_files

        views = [view for shard in self.shards(self.settings["relight"].split).values() for view in shard]
        return [str(path) for folder in self.references.values() for path in reference_files(folder, views).values()]

    def source_path(self) -> str:
        """Return the path of a dataset, of photographs or of a scene file, ``{data_root}`` replaced."""
        return self._placed(self.path, "path")

    def mesh_path(self) -> str | None:
        """Return the path of the mesh that the config names, or None."""
        return self._placed(self.mesh, "mesh") if self.mesh else None

    def environment_path(self) -> str | None:
        """Return the environment map of mode given, or None."""
        file = getattr(self.settings["environment"], "file", None)
        return self._placed(file, "settings.environment.file") if file else None

    def reference_path(self) -> str | None:
        """Return the file with known positions to which estimated poses are brought, or None."""
        file = self.settings["poses"].align.reference
        return self._placed(file, "settings.poses.align.reference") if file else None

    @cached_property
    def segmentation(self) -> str:
        """Where the fit's segment ids come from: ``dataset``, or a mode: mask2former, given, geometry, none.

        Raises
        ------
        FiptError
            If the source must be read to know it, and cannot be.
        """
        mode = self.settings["segment"].mode
        if mode == "none" or self.settings["fit"].segments == "none":
            return "none"
        if mode != "auto":
            return mode
        if self.source == "dataset":
            from fipt.scene.sources import has_segments

            return "dataset" if has_segments(self._source) else "geometry"
        return "dataset" if self.synthesized or self.segments else "geometry"

    def segment_files(self) -> list[str]:
        """What the ids of views are made of beside the dataset: given ids, or a local folder of weights."""
        from fipt.stages.segment.given import id_files

        chosen = self.settings["segment"]
        key = {"given": "path", "mask2former": "model"}[chosen.mode]
        place = Path(self._placed(getattr(chosen, key), f"settings.segment.{key}"))
        if chosen.mode == "mask2former":
            return sorted(str(path) for path in place.glob("*") if path.suffix in (".json", ".safetensors"))
        return [str(path) for path in id_files(place)]

    @cached_property
    def review(self) -> Review:
        """What a person decided about the lamps that were found, in results/SCENE/emitters_review.yaml.

        Raises
        ------
        FiptError
            If the file is wrong, or a light setup names a lamp that nobody called so.
        """
        path = Path(RESULTS, self.name, REVIEW_FILE)
        found = read_review(path) or Review(0)
        for setup in self.setups:
            for name in self.names_in(setup):
                if name not in found.names():
                    raise FiptError(
                        f"setups.{setup} of scene {self.name} names the lamp {name!r}, and no lamp has this name",
                        f"name it in {path}, which a run without this setup writes; there are "
                        f"{closest(name, [*found.names(), 'emitter-N'])}",
                    )
        return found

    def names_in(self, setup: str) -> list[str]:
        """Names by which a relight setup chooses lamps, but for those that every lamp has."""
        called = [name for edit in self.setups[setup].emitters for name in edit.called]
        return [name for name in called if not re.fullmatch(r"emitter-(0|[1-9]\d*)", name)]

    def emission_options(self) -> list[str]:
        """Options of ``fipt emitters`` that say what a person decided about lamps; none where nobody did."""
        return ["--decisions", self.review.emission()] if self.review.emission() else []

    def listing_options(self) -> list[str]:
        """Options of ``fipt review`` that say how a person named lamps, and which are rejected."""
        return ["--decisions", self.review.listing()] if self.review.listing() else []

    def setup_files(self, setup: str) -> list[str]:
        """Files that a relight setup names: another environment map, objects and mesh lights with their textures."""
        named = [entry["file"] for entry in _with_files(dumped(self.setups[setup]))]
        if not named:
            return []
        from fipt.scene.objects import object_files  # not for setups without files: it loads much

        files = [file for path in named for file in object_files(self._placed(path, f"setups.{setup}"))]
        return list(dict.fromkeys(files))

    def check_setups(self) -> None:
        """Look for the files and views that setups name: they may be read hours after the start.

        Raises
        ------
        FiptError
            If a file, a photograph or a keyframe's view is not there.
        """
        for setup in self.setups:
            for path in self.setup_files(setup):
                existing_file(path, f"a file of setups.{setup}")
            if setup in self.filmed:
                self.relit_shards(setup)
        if self.references:
            self.reference_files()

    def names_fused(self, setup: str) -> bool:
        """Whether a setup chooses segments that are fused from the views, not connected parts of the mesh."""
        return self.setups[setup].chooses_segments and self.segmentation not in ("dataset", "none")

    @property
    def true_setups(self) -> list[str]:
        """Setups of which there can be true pictures: views of a known room, whose segments are parts of its mesh."""
        return [name for name in self.relit if not self.names_fused(name)] if self.synthesized else []

    @property
    def synthesized(self) -> bool:
        """Whether the room is known: in code, or of a scene file."""
        return self.source in ("procedural", "mitsuba")

    @property
    def checks_poses(self) -> bool:
        """Whether cameras are checked through the mesh: true photographs' and estimated ones, unless settings say."""
        wanted = self.settings["check_poses"].enabled
        return self.source == "raw" or self.estimated if wanted is None else wanted

    @property
    def exported(self) -> bool:
        """Whether every run writes the room for other programs and checks that."""
        return self.settings["export"].enabled

    @property
    def simulated(self) -> bool:
        """Whether the views of a known room are photographed by a simulated camera."""
        return self.synthesized and self.simulate_raw

    def scene_options(self) -> list[str]:
        """Options of the verbs of known rooms that say which; none for the room in code."""
        return ["--scene", self.source_path()] if self.source == "mitsuba" else []

    def scene_files(self) -> list[str]:
        """Return the scene file and every file that it refers to; none for the room in code."""
        return self._scene_files if self.source == "mitsuba" else []

    @property
    def photographed(self) -> bool:
        """Whether the dataset comes from photographs, true or simulated."""
        return self.source == "raw" or self.simulated

    @property
    def estimated(self) -> bool:
        """Whether the poses of photographed views are estimated from the pictures."""
        return self.poses == ESTIMATED

    @property
    def pose_files(self) -> list[str]:
        """What estimates poses writes and an import reads: cameras first."""
        return [f"{RESULTS}/{self.name}/poses/{name}.json" for name in ("transforms", "views", "poses")]

    def poses_path(self) -> str:
        """Return the file with the poses of photographed views."""
        if self.estimated:
            return self.pose_files[0]
        return f"{self.room}/transforms.json" if self.simulated else self._placed(self.poses, "poses")

    @property
    def room(self) -> str:
        """Folder of a simulated capture's room: its mesh and the poses of its views."""
        return f"{RESULTS}/{self.name}/room"

    def capture_path(self) -> str:
        """Folder of the photographs."""
        return f"{RESULTS}/{self.name}/raw" if self.simulated else self.source_path()

    def import_options(self) -> list[str]:
        """Options of ``fipt import`` that say what is imported."""
        if self.source == "dataset":
            options = {"source": self.source_path(), "format": self.format, "mesh": self.mesh_path()}
        else:
            developed = {"source": f"{RESULTS}/{self.name}/capture", "format": "capture"}
            options = developed | {"mesh": self.mesh_path(), "poses": self.poses_path()}
            if self.simulated:
                options |= {"mesh": f"{self.room}/mesh.ply"}
            elif self.segments:
                options |= {"segments": self._placed(self.segments, "segments")}
        return [text for key, value in options.items() if value is not None for text in (f"--{key}", value)]

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
        if self.synthesized:
            made = self.settings["synthesize"]
            counts = {"train": made.train_views, "val": made.val_views}
            return {split: [f"{split}_{i:03d}" for i in range(n)] for split, n in counts.items()}
        if self.source == "raw" and self.estimated:
            names = [bracket.view for bracket in self._capture.brackets]
            held_out = names[:: self.settings["import"].val_every]
            return {"train": [name for name in names if name not in held_out], "val": held_out}
        frames = self._photographed if self.source == "raw" else self._source.frames
        return {split: [frame.name for frame in frames if frame.split == split] for split in ("train", "val")}

    def source_files(self) -> list[str]:
        """What is imported: cameras, mesh and pictures of a dataset; poses, mesh and ids of photographs.

        When one changes, it is imported again.
        """
        if self.source == "raw":
            files = [*(self.pose_files if self.estimated else [self.poses_path()]), self.mesh_path()]
            if self.segments:
                folder = Path(self._placed(self.segments, "segments"))
                files += map(str, sorted(folder.glob("*/*.png")))
            return files
        if self.simulated:
            posed = self.pose_files if self.estimated else [f"{self.room}/transforms.json"]
            return [f"{self.room}/mesh.ply", *posed, f"{self.room}/room.json"]
        root, mesh = self._source.root, self.mesh_path() or self._source.mesh
        found = [root / name for name in _CAMERA_FILES if (root / name).is_file()]
        if Path(self.source_path()).is_file():
            found.append(Path(self.source_path()))
        found += [frame.image for frame in self._source.frames]
        return sorted({str(path) for path in [*found, *([mesh] if mesh else [])]})

    def photographs(self, views: Iterable[str]) -> list[str]:
        """Files of the brackets of some views of a true capture, and its table where it has one."""
        brackets = {bracket.view: bracket for bracket in self._capture.brackets}
        table = self._capture.folder / "captures.tsv"
        files = [shot.path for view in views for shot in brackets[view].shots]
        return sorted(map(str, [*files, *([table] if table.is_file() else [])]))

    def calibration_files(self) -> list[str]:
        """Calibration frames of a true capture, or its calibration.json; perhaps none."""
        folder = Path(self.source_path())
        found = [path for path in (folder / "calibration").glob("*/*") if path.is_file()]
        given = folder / "calibration.json"
        return sorted(map(str, [*found, *([given] if given.is_file() else [])]))

    def shards(self, *splits: str) -> dict[str, list[str]]:
        """Shard -> names of its views; for the splits named, or ``all``."""
        if splits == ("all",):
            splits = ("train", "val")
        return {shard: views for split in splits for shard, views in self._cut(split, self.views[split]).items()}

    def _cut(self, kind: str, names: list[str]) -> dict[str, list[str]]:
        size = self.views_per_shard
        return {f"{kind}-{start // size:03d}": names[start : start + size] for start in range(0, len(names), size)}

    @cached_property
    def _scene_files(self) -> list[str]:
        from fipt.synthetic.scenefile.xml import scene_files

        return sorted(map(str, scene_files(Path(self.source_path()))))

    @cached_property
    def _source(self) -> Any:
        from fipt.scene.sources import read_source

        every = self.settings["import"].val_every
        return read_source(self.source_path(), self.format, every)

    @cached_property
    def _capture(self) -> Any:
        from fipt.stages.capture.brackets import read_capture

        return read_capture(self.source_path(), self.settings["capture"].frames)

    @cached_property
    def _photographed(self) -> list[Any]:
        """Posed views of which there are photographs."""
        from fipt.scene.sources import read_poses

        poses = self.poses_path()
        posed = read_poses(poses, self.settings["import"].val_every)
        known = [bracket.view for bracket in self._capture.brackets]
        frames = [frame for frame in posed if frame.name in known]
        if not any(frame.split == "train" for frame in frames):
            raise FiptError(
                f"{poses} must have poses of the views in {self.source_path()}; it has "
                f"{', '.join(frame.name for frame in posed[:3])}, photographed are {', '.join(known[:3])}",
                "name the poses' pictures as the views",
            )
        return frames

    def relit_shards(self, setup: str) -> dict[str, list[str]]:
        """Shards of the views that a setup relights, or of its own cameras.

        Raises
        ------
        FiptError
            If a camera path goes through a view that there is not.
        """
        own = self.setups[setup].cameras
        if own is None:
            return self.shards(self.settings["relight"].split)
        if own.path is not None:
            check_keyframes(own.path, [*self.views["train"], *self.views["val"]])
        return self._cut("camera", own.names)

    def lamp_shards(self) -> dict[str, list[str]]:
        """Shards of the views that are rendered with each lamp alone -> these views."""
        chosen = (self.views["val"] or self.views["train"])[: self.settings["olat"].views]
        own = {shard: [view for view in views if view in chosen] for shard, views in self.shards("all").items()}
        return {shard: views for shard, views in own.items() if views}

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


def _with_files(setup: dict[str, Any]) -> list[dict[str, Any]]:
    """Entries of a dumped light setup that name a file."""
    entries = [setup["environment"] or {}, *setup["lights"], *setup["objects"]]
    return [entry for entry in entries if entry.get("file")]


def _scene(name: str, entry: SceneEntry, config: Config) -> Scene:
    check_name(name, "scene")
    where = f"scenes.{name}"
    _check_keys(entry, where)
    setups = (config.setups or {}) | (entry.setups or {})
    for setup, light in setups.items():
        check_name(setup, "relight setup")
        for camera in light.cameras.names if light.cameras is not None else ():
            check_name(camera, f"camera of setup {setup}:")
    source = Sections.model_validate(_SOURCE_SETTINGS.get(entry.source, {}))
    layers = (source, preset(entry.preset, f"{where}.preset"), config, entry.settings or Sections())
    settings = {}
    for stage, model in STAGES.items():
        values: dict[str, Any] = {}
        for layer in layers:
            _merge(values, _section(layer, stage))
        settings[stage] = checked(model, values, f"scene {name}: ", stage)
    possible = entry.poses == ESTIMATED and entry.simulate_raw
    if entry.source in ("procedural", "mitsuba") and entry.poses is not None and not possible:
        raise FiptError(
            f"{where}.poses of a known room may be {ESTIMATED}, where simulate_raw is true; found {entry.poses}",
            f"remove {where}.poses, or photograph the room",
        )
    return Scene(
        name=name,
        source=entry.source,
        path=entry.path,
        format=entry.format,
        mesh=entry.mesh,
        poses=entry.poses,
        segments=entry.segments,
        simulate_raw=bool(entry.simulate_raw),
        settings=settings,
        setups=setups,
        rounds=config.rounds,
        views_per_shard=config.views_per_shard,
        data_root=config.data_root,
    )


_SOURCE_KEYS = {
    "procedural": ((), ("simulate_raw", "poses")),
    "mitsuba": (("path",), ("simulate_raw", "poses")),
    "dataset": (("path", "format"), ("mesh",)),
    "raw": (("path", "poses", "mesh"), ("segments",)),
}
"""Source of a scene -> the keys that it needs, and those that it may have."""

_SOURCE_SETTINGS = {"mitsuba": {"synthesize": {"train_views": 24, "val_views": 8, "width": 320, "height": 240}}}
"""Source of a scene -> what is below its preset."""


_PATHS = {
    "mitsuba": "a scene file (XML)",
    "dataset": "the folder of the dataset",
    "raw": "the folder of the photographs",
}


def _check_keys(entry: SceneEntry, where: str) -> None:
    """Refuse keys that belong to another source, and missing ones."""
    needed, allowed = _SOURCE_KEYS[entry.source]
    for key in ("path", "format", "mesh", "poses", "segments", "simulate_raw"):
        given = getattr(entry, key) is not None
        if given and key not in (*needed, *allowed):
            sources = " or ".join(name for name, keys in _SOURCE_KEYS.items() if key in (*keys[0], *keys[1]))
            raise FiptError(f"{where}.{key} is only for source: {sources}", f"remove {where}.{key}")
        if not given and key in needed:
            formats = get_args(get_args(SceneEntry.model_fields["format"].annotation)[0])
            what = {
                "path": _PATHS[entry.source],
                "format": "one of " + ", ".join(formats),
                "poses": f"{ESTIMATED}, or a transforms.json with the pose of every view",
                "mesh": "the room's mesh",
            }[key]
            raise FiptError(f"{where}.{key} is missing", f"source: {entry.source} needs {key}: {what}")


def preset(name: str, where: str) -> Sections:
    """Read a preset; ``where`` is the key that names it, for the error."""
    known = sorted(path.stem for path in PRESETS.glob("*.yaml"))
    if name not in known:
        raise FiptError(f"{where}: there is no preset {name!r}", f"presets: {', '.join(known)}")
    path = PRESETS / f"{name}.yaml"
    return checked(Sections, read_yaml(path), f"fipt/config/presets/{path.name}: ")


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
