"""A room that someone modelled: a Mitsuba scene file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from fipt.config.sources.base import Place, options
from fipt.config.sources.known import KnownEntry, KnownRoom


class MitsubaEntry(KnownEntry):
    """A room of a scene file: 24 + 8 views of 320x240 where nothing else is said."""

    source: Literal["mitsuba"] = Field(description="a room of a scene file")
    path: str = Field(description="a scene file (XML); {data_root} is replaced by that key")

    @property
    def below(self) -> Mapping[str, Any]:
        """Someone else's room asks for larger pictures than one in code."""
        return {"synthesize": {"train_views": 24, "val_views": 8, "width": 320, "height": 240}}


class MitsubaRoom(KnownRoom):
    """A room of a scene file."""

    def __init__(self, entry: MitsubaEntry, place: Place) -> None:
        super().__init__(entry, place)
        self._path = entry.path

    @property
    def path(self) -> str:
        """The scene file."""
        return self.place.path(self._path, "path")

    def scene_options(self) -> list[str]:
        """Options of ``fipt synthesize`` that say which room."""
        return options(scene=self.path)

    def scene_files(self) -> list[str]:
        """The scene file and every file that it refers to."""
        return self._files

    @cached_property
    def _files(self) -> list[str]:
        from fipt.synthetic.scenefile.xml import scene_files

        return sorted(map(str, scene_files(Path(self.path))))
