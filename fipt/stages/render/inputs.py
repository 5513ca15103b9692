"""Files that all verbs which path trace views of a fitted scene take."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from fipt.conventions import RAYS_PER_SIDE
from fipt.inputs import (
    CacheFile,
    DatasetFolder,
    EmittersFile,
    EnvironmentFile,
    ManifestFile,
    ModelFile,
    RaysPerSide,
    check_rays,
)

if TYPE_CHECKING:
    from fipt.model.fitted import FittedScene
    from fipt.scene.dataset import Dataset


@dataclass(frozen=True, kw_only=True)
class TracedInputs:
    """Files of a fitted scene, and where its images go."""

    dataset: DatasetFolder
    cache: CacheFile
    model: ModelFile
    emitters: EmittersFile
    out: Annotated[Path, "Folder of the images."]
    manifest: ManifestFile
    environment: EnvironmentFile = None
    rays_per_side: RaysPerSide = RAYS_PER_SIDE

    def __post_init__(self) -> None:
        check_rays(self.rays_per_side)

    def fitted(self, data: "Dataset") -> "FittedScene":
        """Read the scene."""
        from fipt.model.fitted import FittedScene

        return FittedScene.load(data.mesh(), self.model, self.emitters, self.environment, self.cache)
