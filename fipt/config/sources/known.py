"""Known rooms: in code, or of a scene file; perhaps photographed by a simulated camera."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Literal, Self

from pydantic import Field, model_validator

from fipt.config.layout import Layout
from fipt.config.sources.base import ESTIMATED, RECONSTRUCTED, Photographs, Place, Source, SourceEntry, options


class KnownEntry(SourceEntry):
    """What a person writes about a known room."""

    simulate_raw: bool = Field(
        default=False,
        description="true: a simulated camera (`synthesize.raw`) photographs the room, and the scene starts at these "
        "RAW files",
    )
    poses: Literal["colmap"] | None = Field(
        default=None, description="with `simulate_raw`: `colmap` estimates the poses of the photographs"
    )
    mesh: Literal["reconstruct"] | None = Field(
        default=None,
        description="with `simulate_raw`: `reconstruct` makes a mesh of the photographs; absent: the true one",
    )

    @model_validator(mode="after")
    def _photographed_if_estimated(self) -> Self:
        for key, value in (("poses", self.poses), ("mesh", self.mesh)):
            if value is not None and not self.simulate_raw:
                raise ValueError(f"{key} of a known room may be {value}, where simulate_raw is true")
        return self


class SimulatedPhotographs(Photographs):
    """Photographs of a simulated camera: its calibration frames have the table of all frames."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout

    @property
    def folder(self) -> str:
        """Folder of the photographs."""
        return self.layout.raw_folder

    def of(self, views: list[str], shard: str) -> list[str]:
        """Manifests of the calibration frames and of the brackets of a shard."""
        return [self.layout.raw_calibration, self.layout.raw.format(shard=shard)]

    def calibration(self, shards: Mapping[str, list[str]]) -> list[str]:
        """Manifests of all frames."""
        return [self.layout.raw_calibration, *(self.layout.raw.format(shard=shard) for shard in shards)]


class KnownRoom(Source):
    """A room in code, or of a scene file."""

    known = True

    def __init__(self, entry: KnownEntry, place: Place) -> None:
        super().__init__(place)
        self.entry = entry
        if entry.simulate_raw:
            self.photographs = SimulatedPhotographs(place.layout)

    @property
    def pixels(self) -> int:
        """As the settings say."""
        made = self.place.settings["synthesize"]
        return made.width * made.height

    @property
    def has_segments(self) -> bool:
        """Its parts are known."""
        return True

    @property
    def estimated(self) -> bool:
        """Whether the poses of photographed views are estimated from the images."""
        return self.entry.poses == ESTIMATED

    @property
    def reconstructed(self) -> bool:
        """Whether the mesh is made of the photographs."""
        return self.entry.mesh == RECONSTRUCTED

    @property
    def has_true_setups(self) -> bool:
        """Whether setups mean in it what they mean in the room: its coordinates and its mesh are the room's own."""
        moved = self.estimated and self.place.settings["poses"].align.reference is None
        return not (moved or self.reconstructed)

    @cached_property
    def views(self) -> dict[str, list[str]]:
        """Split -> names of its views, as the settings count them."""
        made = self.place.settings["synthesize"]
        counts = {"train": made.train_views, "val": made.val_views}
        return {split: [f"{split}_{i:03d}" for i in range(n)] for split, n in counts.items()}

    def imported_files(self) -> list[str]:
        """Mesh and poses of the photographed room."""
        if not self.simulated:
            return []
        layout = self.place.layout
        return [self._mesh, *self._poses, layout.room]

    def import_options(self) -> list[str]:
        """What was developed, the room's mesh, poses, and what is known of the room."""
        if not self.simulated:
            return []
        layout = self.place.layout
        named = {"mesh": self._mesh, "poses": self._poses[0], "room": layout.room}
        return options(source=layout.capture_folder, format="capture", **named)

    @property
    def _mesh(self) -> str:
        return self.place.layout.estimated_mesh if self.reconstructed else self.place.layout.room_mesh

    @property
    def _poses(self) -> list[str]:
        layout = self.place.layout
        return pose_files(layout) if self.estimated else [layout.room_transforms]


def pose_files(layout: Layout) -> list[str]:
    """What estimates poses writes and an import reads: cameras first."""
    return [layout.poses_transforms, layout.poses_views, layout.poses_evidence]
