"""Bracketed photographs of a room."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from fipt.config.sources.base import ESTIMATED, RECONSTRUCTED, Photographs, Place, Source, SourceEntry, options
from fipt.config.sources.known import pose_files


class RawEntry(SourceEntry):
    """Bracketed photographs."""

    source: Literal["raw"] = Field(description="bracketed photographs")
    path: str = Field(description="the folder of the photographs; {data_root} is replaced")
    poses: str = Field(
        description="colmap estimates them; or a transforms.json with the pose of every view, a COLMAP folder, "
        "Metashape XML or RealityCapture CSV, by view name; {data_root} is replaced"
    )
    mesh: str = Field(
        default=RECONSTRUCTED,
        description="the room's mesh; {data_root} is replaced. `reconstruct` makes one of the photographs",
    )
    segments: str | None = Field(
        default=None, description="folder with part/VIEW.png or semantic/VIEW.png; {data_root} is replaced"
    )


class TruePhotographs(Photographs):
    """A folder of photographs, perhaps with calibration frames or a table of captures."""

    def __init__(self, entry: RawEntry, place: Place) -> None:
        self.entry, self.place = entry, place

    @property
    def folder(self) -> str:
        """Folder of the photographs."""
        return self.place.path(self.entry.path, "path")

    @property
    def views(self) -> list[str]:
        """Names of the photographed views."""
        return [bracket.view for bracket in self._read.brackets]

    def of(self, views: list[str], shard: str) -> list[str]:
        """Files of the brackets of some views, and the table where there is one."""
        from fipt.stages.capture.table import TABLE

        brackets = {bracket.view: bracket for bracket in self._read.brackets}
        table = self._read.folder / TABLE
        files = [shot.path for view in views for shot in brackets[view].shots]
        return sorted(map(str, [*files, *([table] if table.is_file() else [])]))

    def calibration(self, shards: Mapping[str, list[str]]) -> list[str]:
        """Calibration frames or calibration.json, perhaps none; and photographs of the shards that tell the camera."""
        views = {bracket.view for bracket in self._read.telling}
        for own in shards.values():
            if not views.isdisjoint(own):
                views |= set(own)
        return [*self.frames(), *self.of(sorted(views), "")]

    def frames(self) -> list[str]:
        """Calibration frames or calibration.json, perhaps none."""
        folder = Path(self.folder)
        found = [path for path in (folder / "calibration").glob("*/*") if path.is_file()]
        given = folder / "calibration.json"
        return sorted(map(str, [*found, *([given] if given.is_file() else [])]))

    @cached_property
    def _read(self) -> Any:
        from fipt.stages.capture.brackets import read_capture

        return read_capture(self.folder, self.place.settings["capture"].frames)


class RawSource(Source):
    """Bracketed photographs, with a mesh and poses that are given or estimated."""

    def __init__(self, entry: RawEntry, place: Place) -> None:
        super().__init__(place)
        self.entry = entry
        self.photographs = self._taken = TruePhotographs(entry, place)

    @property
    def has_segments(self) -> bool:
        """Whether ids of the views are given."""
        return self.entry.segments is not None

    @property
    def estimated(self) -> bool:
        """Whether the poses are estimated from the images."""
        return self.entry.poses == ESTIMATED

    @property
    def reconstructed(self) -> bool:
        """Whether the mesh is made of the photographs."""
        return self.entry.mesh == RECONSTRUCTED

    @property
    def checks_poses(self) -> bool:
        """True photographs' cameras are checked."""
        return True

    @cached_property
    def views(self) -> dict[str, list[str]]:
        """Split -> names of the views that have a pose; of all where poses are to be estimated."""
        if self.estimated:
            names = self._taken.views
            held_out = names[:: self.place.settings["import"].val_every]
            return {"train": [name for name in names if name not in held_out], "val": held_out}
        return {split: [frame.name for frame in self._posed if frame.split == split] for split in ("train", "val")}

    def imported_files(self) -> list[str]:
        """Poses, mesh and ids; beside them verdicts on views, what is known of the room, names of ids."""
        from fipt.formats.layouts import SEGMENT_FOLDERS
        from fipt.formats.pose_files import pose_model_files

        given = pose_files(self.place.layout) if self.estimated else pose_model_files(self._poses)
        poses, mesh = Path(self._poses).parent, Path(self._mesh).parent
        beside = [poses / "poses.json", poses / "views.json", poses / "room.json", mesh / "room.json"]
        files = [*given, self._mesh]
        if self._segments:
            files += map(str, sorted(Path(self._segments).glob("*/*.png")))
            beside += [Path(self._segments, f"{kind}.json") for kind in SEGMENT_FOLDERS]
        return list(dict.fromkeys([*files, *(str(path) for path in beside if path.is_file())]))

    def given_files(self) -> list[str]:
        """The photographs, calibration frames, and what an import reads, less what is made here."""
        made = {*pose_files(self.place.layout), self.place.layout.estimated_mesh}
        photographs = [*self._taken.frames(), *self._taken.of(self._taken.views, "")]
        return sorted({*photographs, *(file for file in self.imported_files() if file not in made)})

    def import_options(self) -> list[str]:
        """What was developed, with mesh, poses and ids."""
        developed = self.place.layout.capture_folder
        return options(source=developed, format="capture", mesh=self._mesh, poses=self._poses, segments=self._segments)

    @property
    def _poses(self) -> str:
        return pose_files(self.place.layout)[0] if self.estimated else self.place.path(self.entry.poses, "poses")

    @property
    def given_mesh(self) -> str | None:
        """The one that the config names, or that is made."""
        return self._mesh

    @property
    def _mesh(self) -> str:
        return self.place.layout.estimated_mesh if self.reconstructed else self.place.path(self.entry.mesh, "mesh")

    @property
    def _segments(self) -> str | None:
        return self.place.path(self.entry.segments, "segments") if self.entry.segments else None

    @cached_property
    def _posed(self) -> list[Any]:
        """Posed views of which there are photographs."""
        from fipt.scene.sources import read_poses

        return list(read_poses(self._poses, self.place.settings["import"].val_every, self._taken.views))
