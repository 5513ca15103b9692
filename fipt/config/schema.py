"""What a person writes: the whole configuration."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from fipt.config.methods import Methods
from fipt.config.sections import Sections
from fipt.config.sources.base import Place, Setups, Source
from fipt.config.sources.dataset import DatasetEntry, DatasetSource
from fipt.config.sources.mitsuba import MitsubaEntry, MitsubaRoom
from fipt.config.sources.procedural import ProceduralEntry, ProceduralRoom
from fipt.config.sources.raw import RawEntry, RawSource
from fipt.settings import Positive, Rounds

SceneEntry = Annotated[
    ProceduralEntry | MitsubaEntry | DatasetEntry | RawEntry,
    Field(discriminator="source", description="one scene"),
]
"""What a person writes about a scene."""


def source_of(entry: SceneEntry, place: Place) -> Source:
    """What follows from what a person wrote about a scene."""
    if isinstance(entry, MitsubaEntry):
        return MitsubaRoom(entry, place)
    if isinstance(entry, ProceduralEntry):
        return ProceduralRoom(entry, place)
    if isinstance(entry, DatasetEntry):
        return DatasetSource(entry, place)
    return RawSource(entry, place)


class Config(Sections):
    """The whole configuration."""

    scenes: dict[str, SceneEntry] = Field(
        min_length=1,
        description="name of a scene -> where it comes from; or the path of a sheet of rooms, see docs/many-rooms.md",
    )
    rounds: Rounds = Field(
        default=6,
        description="most refinements after the first fit, fewer where the loop settles; 0 = bake and fit only",
    )
    views_per_shard: Positive = Field(default=16, description="views that one job works on")
    setups: Setups | None = Field(default=None, description="relight setups of every scene")
    methods: Methods | None = Field(default=None, description="methods of comparisons, beside those that are known")
    only: str | list[str] | None = Field(default=None, description="names of the scenes to run; absent = all")
    data_root: str | None = Field(default=None, description="folder that {data_root} in paths stands for")
