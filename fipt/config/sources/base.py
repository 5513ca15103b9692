"""What every source of a scene has."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import Field

from fipt.config.layout import Layout
from fipt.config.resources import PIXELS
from fipt.config.sections import Sections
from fipt.errors import FiptError
from fipt.scene.setup import RelightSetup
from fipt.settings import Rounds, Settings, dumped

_LONGEST, _LONGEST_PATH = 255, 4095
"""Bytes of a name and of a path that Linux allows."""
ESTIMATED = "colmap"
"""What `poses` of a scene says where poses are estimated."""

RECONSTRUCTED = "reconstruct"
"""What `mesh` of a scene says where the mesh is made of the images."""

Setups = dict[str, RelightSetup]


class SourceEntry(Settings):
    """What a person writes about a scene, whatever its source."""

    preset: str = Field(default="default", description="name of a file in fipt/config/presets")
    setups: Setups | None = Field(default=None, description="relight setups of this scene, beside the common ones")
    rounds: Rounds | None = Field(default=None, description="most refinements of this scene; absent: the common key")
    settings: Sections | None = Field(default=None, description="stage sections of this scene")  # pyright: ignore[reportInvalidTypeForm] - made by create_model

    @property
    def below(self) -> Mapping[str, Any]:
        """Stage sections that lie below the preset of such a scene."""
        return {}


@dataclass(frozen=True)
class Place:
    """What a source knows of its scene.

    Attributes
    ----------
    scene
        Its name.
    layout
        Paths of its results.
    settings
        Section -> settings.
    data_root
        What {data_root} in paths stands for; None: nothing was said.
    """

    scene: str
    layout: Layout
    settings: Mapping[str, Any]
    data_root: str | None

    def path(self, text: str, key: str) -> str:
        """A path as given by ``key`` of the scene, {data_root} and ~ replaced.

        Raises
        ------
        FiptError
            If {data_root} was not set, or it cannot be a path of the workflow.
        """
        if "{data_root}" in text and not self.data_root:
            raise FiptError(
                f"scenes.{self.scene}.{key} is {text}, but data_root is not set",
                "add --config data_root=FOLDER",
            )
        try:
            return self.plain(str(Path(text.replace("{data_root}", self.data_root or "")).expanduser()), key)
        except RuntimeError as error:  # ~ of a user that there is not
            raise FiptError(f"scenes.{self.scene}.{key} is {text} ({error})", "write the whole path") from error

    def plain(self, path: str, key: str) -> str:
        """Return a path that the workflow can name; ``key`` of the scene names it, or what names it.

        Raises
        ------
        FiptError
            If it holds braces, which the workflow takes for wildcards, or a control character; if it is longer than
            systems allow.
        """
        if len(os.fsencode(path)) > _LONGEST_PATH or any(len(os.fsencode(p)) > _LONGEST for p in Path(path).parts):
            raise FiptError(
                f"scenes.{self.scene}.{key}: paths must have at most {_LONGEST_PATH} bytes, names {_LONGEST}; this one "
                f"has {len(os.fsencode(path))}: {path[:60]}...",
                "check the path",
            )
        if any(letter in "{}" or ord(letter) < 32 for letter in path):
            raise FiptError(
                f"scenes.{self.scene}.{key}: paths must hold no braces or control characters; found {path!r}",
                "rename the file or folder",
            )
        return path

    def paths(self, values: Any, key: str) -> Any:
        """Plain values with every text placed that names {data_root} or starts with ~."""
        if isinstance(values, dict):
            return {name: self.paths(value, f"{key}.{name}") for name, value in values.items()}
        if isinstance(values, list):
            return [self.paths(value, key) for value in values]
        if isinstance(values, str) and ("{data_root}" in values or values.startswith("~")):
            return self.path(values, key)
        return values


class Photographs(ABC):
    """Photographs that a scene starts at: true ones, or those of a simulated camera."""

    @property
    @abstractmethod
    def folder(self) -> str:
        """Folder of the photographs."""

    @abstractmethod
    def of(self, views: list[str], shard: str) -> list[str]:
        """Files of the brackets of a shard, which are those of its views, and what is needed to read them."""

    @abstractmethod
    def calibration(self, shards: Mapping[str, list[str]]) -> list[str]:
        """Files that tell the camera: calibration frames, and photographs."""


class Source(ABC):
    """Where the data of a scene come from.

    Attributes
    ----------
    known
        Whether the room is known: in code, or of a scene file. There is truth then.
    photographs
        What the scene starts at, where it starts at photographs.
    """

    known: bool = False
    photographs: Photographs | None = None

    def __init__(self, place: Place) -> None:
        self.place = place

    @cached_property
    @abstractmethod
    def views(self) -> dict[str, list[str]]:
        """Split (``train``, ``val``) -> names of its views, in the source's order.

        Raises
        ------
        FiptError
            If the source cannot be read.
        """

    @property
    @abstractmethod
    def has_segments(self) -> bool:
        """Whether its dataset has segment ids.

        Raises
        ------
        FiptError
            If the source must be read to know it, and cannot be.
        """

    @property
    def has_truth(self) -> bool:
        """Whether its dataset has true materials.

        Raises
        ------
        FiptError
            If the source must be read to know it, and cannot be.
        """
        return self.known

    @property
    def pixels(self) -> int:
        """Pixels of a view, as far as they are known without opening one: what jobs ask for depends on it."""
        return PIXELS

    @property
    def given_mesh(self) -> str | None:
        """The mesh that an import reads, which need not be there; None: there is no such import."""
        return None

    @property
    def photographed(self) -> bool:
        """Whether the dataset comes from photographs, true or simulated."""
        return self.photographs is not None

    @property
    def simulated(self) -> bool:
        """Whether a known room is photographed by a simulated camera."""
        return self.known and self.photographed

    @property
    def rendered(self) -> bool:
        """Whether a known room is the dataset itself."""
        return self.known and not self.photographed

    @property
    def imported(self) -> bool:
        """Whether the dataset is imported: from another layout, or from developed photographs."""
        return not self.rendered

    @property
    def estimated(self) -> bool:
        """Whether the poses of photographed views are estimated from the images."""
        return False

    @property
    def has_true_setups(self) -> bool:
        """Whether a setup of lights means in it what it means in the known room."""
        return self.known

    @property
    def checks_poses(self) -> bool:
        """Whether cameras are checked through the mesh where the settings do not say."""
        return self.estimated

    def imported_files(self) -> list[str]:
        """What an import reads beside developed photographs; when one changes, it is imported again."""
        return []

    def given_files(self) -> list[str]:
        """Files of somebody else that an import or a room is made of, as far as they are known without their pixels.

        Raises
        ------
        FiptError
            If the source cannot be read.
        """
        return self.scene_files()

    def import_options(self) -> list[str]:
        """Options of ``fipt import`` that say what is imported."""
        return []

    @property
    def reconstructed(self) -> bool:
        """Whether the mesh is made of the images."""
        return False

    def mesh_origin(self) -> list[str]:
        """Cameras of the views that a mesh was made of: they say where its origin is."""
        return [self.place.layout.posed_transforms] if self.reconstructed else []

    def mesh_options(self) -> list[str]:
        """Options of ``fipt import`` that say of which views the mesh was made."""
        return [text for path in self.mesh_origin() for text in ("--mesh-views", path)]

    def view_files(self) -> list[str]:
        """What an import of the views alone reads, for a mesh that is made of them."""
        return [path for path in self.imported_files() if path != self.place.layout.estimated_mesh]

    def view_options(self) -> list[str]:
        """Options of ``fipt import`` for the views alone."""
        estimated = self.place.layout.estimated_mesh
        return ["none" if text == estimated else text for text in self.import_options()]

    def view_settings(self) -> str:
        """Settings of that import, JSON: a mesh is made of the full images."""
        return json.dumps(dumped(self.place.settings["import"].of_views), sort_keys=True)

    def depth_files(self) -> dict[str, str]:
        """Training view -> its depth map that exists, where the source names them."""
        return {}

    def depth_options(self) -> list[str]:
        """Options of ``fipt depth`` that say where these are named."""
        return []

    def scene_files(self) -> list[str]:
        """A scene file and every file that it refers to."""
        return []

    def scene_options(self) -> list[str]:
        """Options of ``fipt synthesize`` that say which room."""
        return []

    def room_files(self) -> list[str]:
        """What holds a known room, made with the dataset or imported with developed photographs."""
        made = self.place.layout.known_room if self.rendered else self.place.layout.imported_images
        return [made] if self.known else []


def options(**values: str | None) -> list[str]:
    """Flags and values of a command line; what is None is left out."""
    return [text for key, value in values.items() if value is not None for text in (f"--{key}", value)]
