"""``fipt check-export``: load every exported file back, render it, and compare with our own images."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.conventions import RAYS_PER_SIDE
from fipt.inputs import DatasetFolder, RaysPerSide, check_rays

if TYPE_CHECKING:
    from fipt.stages.export.settings import ExportSettings


@dataclass(frozen=True, kw_only=True)
class CheckExportInputs:
    """Files of ``fipt check-export``."""

    dataset: DatasetFolder
    export: Annotated[Path, "Folder of the exported room."]
    render: Annotated[Path, "Folder of our images of held-out views."]
    out: Annotated[Path, "check.json to write; the images go to a folder check beside it."]
    rays_per_side: RaysPerSide = RAYS_PER_SIDE

    def __post_init__(self) -> None:
        check_rays(self.rays_per_side)


def run(inputs: CheckExportInputs, settings: "ExportSettings") -> dict[str, Any]:
    """Say how near the exported room, loaded back and path traced by Mitsuba, comes to our own images."""
    from fipt.stages.export.check import check_export

    return check_export(inputs, settings)
