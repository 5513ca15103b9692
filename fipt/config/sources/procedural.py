"""A room in code."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from fipt.config.sources.known import KnownEntry, KnownRoom


class ProceduralEntry(KnownEntry):
    """A room in code: nothing to download."""

    source: Literal["procedural"] = Field(description="a room in code")


class ProceduralRoom(KnownRoom):
    """A room in code."""
