"""Posed HDR views that exist already."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from fipt.config.resources import PIXELS
from fipt.config.sources.base import RECONSTRUCTED, Place, Source, SourceEntry, options

_CAMERA_FILES = (
    "transforms.json",
    "views.json",
    "room.json",
    "meta.json",
    "segments/part.json",
    "segments/semantic.json",
    *(f"transforms_{split}.json" for split in ("train", "val", "test")),
    *(f"{split}/transforms.json" for split in ("train", "val")),
    "cam.txt",
    "K_list.txt",
)


class DatasetEntry(SourceEntry):
    """Posed HDR views that exist."""

    source: Literal["dataset"] = Field(description="posed HDR views that exist")
    path: str = Field(description="the folder of the dataset, or its transforms.json; {data_root} is replaced")
    format: Literal["nerfstudio", "fipt-synthetic", "fipt-real", "fipt"] = Field(
        description="one of nerfstudio, fipt-synthetic, fipt-real, or fipt (a dataset folder of this program, with its "
        "truth and ids): these layouts share file names, but not axes"
    )
    mesh: str | None = Field(
        default=None,
        description="the room's mesh; {data_root} is replaced. `reconstruct` makes one of the views; absent: the one "
        "that the layout names, else `reconstruct`",
    )


class DatasetSource(Source):
    """Posed HDR views that exist."""

    def __init__(self, entry: DatasetEntry, place: Place) -> None:
        super().__init__(place)
        self.entry = entry

    @property
    def path(self) -> str:
        """The folder of the dataset, or its transforms.json."""
        return self.place.path(self.entry.path, "path")

    @cached_property
    def views(self) -> dict[str, list[str]]:
        """Split -> names of its views."""
        return {split: [frame.name for frame in self._read.frames if frame.split == split] for split in SPLITS}

    @property
    def checks_poses(self) -> bool:
        """Cameras of others are checked: layouts share file names, but not axes."""
        return True

    @property
    def pixels(self) -> int:
        """As its first view says, where the layout does."""
        known = self._read.frames[0].intrinsics if self._read.frames else {}
        return round(known["w"] * known["h"]) if {"w", "h"} <= known.keys() else PIXELS

    @property
    def given_mesh(self) -> str | None:
        """The one that the config names, else that of the layout."""
        return self._mesh or (str(self._read.mesh) if self._read.mesh else None)

    @property
    def has_segments(self) -> bool:
        """Whether its layout brings segment ids."""
        from fipt.scene.sources import has_segments

        return has_segments(self._read)

    @property
    def has_truth(self) -> bool:
        """Whether its layout brings true materials."""
        from fipt.scene.sources import has_materials

        return has_materials(self._read)

    def imported_files(self) -> list[str]:
        """Cameras, mesh, images, masks, and the truth and ids that the layout brings."""
        from fipt.formats.layouts import known_files, truth_and_ids

        root, mesh = self._read.root, self._mesh or self._read.mesh
        found = [root / name for name in _CAMERA_FILES if (root / name).is_file()]
        if Path(self.path).is_file():
            found.append(Path(self.path))
        found += [frame.image for frame in self._read.frames]
        found += [frame.mask for frame in self._read.frames if frame.mask is not None]
        found += [file for frame in self._read.frames for file in (*known_files(frame), *truth_and_ids(frame))]
        return sorted({str(path) for path in [*found, *([mesh] if mesh else [])]})

    def given_files(self) -> list[str]:
        """What an import reads."""
        return self.view_files()

    def import_options(self) -> list[str]:
        """What is imported: the layout, and the mesh that the config names."""
        return options(source=self.path, format=self.entry.format, mesh=self._mesh)

    @property
    def reconstructed(self) -> bool:
        """Whether the mesh is made of the views: asked for, or there is none."""
        return self.entry.mesh == RECONSTRUCTED or (self.entry.mesh is None and self._read.mesh is None)

    def depth_files(self) -> dict[str, str]:
        """Training view -> depth map that its layout names."""
        from fipt.scene.sources import depth_files

        return {view: str(path) for view, path in depth_files(self._read).items()}

    def depth_options(self) -> list[str]:
        """The layout, where it names depth maps."""
        return options(layout=self.path) if self.depth_files() else []

    @property
    def _mesh(self) -> str | None:
        if self.reconstructed:
            return self.place.layout.estimated_mesh
        return self.place.path(self.entry.mesh, "mesh") if self.entry.mesh else None

    @cached_property
    def _read(self) -> Any:
        from fipt.scene.sources import read_source

        return read_source(self.path, self.entry.format, self.place.settings["import"].val_every)


SPLITS = ("train", "val")
