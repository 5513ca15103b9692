"""A room in code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from fipt.config.sources.known import KnownEntry, KnownRoom
from fipt.synthetic.settings import RoomName


class ProceduralEntry(KnownEntry):
    """A room in code: nothing to download."""

    source: Literal["procedural"] = Field(description="a room in code")
    room: RoomName | None = Field(default=None, description="which one; default: what `synthesize.room` says")

    @property
    def below(self) -> Mapping[str, Any]:
        """The room is a setting of the stage that makes it."""
        return {"synthesize": {"room": self.room}} if self.room else {}


class ProceduralRoom(KnownRoom):
    """A room in code."""
