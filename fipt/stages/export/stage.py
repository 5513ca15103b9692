"""``fipt export``: model and emitters -> textures, glTF, Mitsuba, USD, Blender, cameras."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import (
    ConfidenceFile,
    DatasetFolder,
    EmitterNames,
    EmittersFile,
    EnvironmentFile,
    ManifestFile,
    ModelFile,
    SamplesFolders,
)

if TYPE_CHECKING:
    from fipt.stages.export.settings import ExportSettings


@dataclass(frozen=True, kw_only=True)
class ExportInputs:
    """Files of ``fipt export``."""

    dataset: DatasetFolder
    samples: SamplesFolders
    model: ModelFile
    emitters: EmittersFile
    confidence: ConfidenceFile
    out: Annotated[Path, "Folder of the exported room."]
    manifest: ManifestFile
    name: Annotated[str, "Name of the room in the files."] = "room"
    environment: EnvironmentFile = None
    emitter_names: EmitterNames = None


def run(inputs: ExportInputs, settings: "ExportSettings") -> dict[str, Any]:
    """Write the room for other programs: scene.glb, scene.usdc, mitsuba/, blender.py, textures/, cameras/."""
    from fipt.formats.files import check_name
    from fipt.stages.export.write import write_export

    check_name(inputs.name, "the room's name")
    return write_export(inputs, settings)
