"""``fipt fit``: samples, shading, images and segments -> the model of a round."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, EnvironmentFile, SamplesFolders, ShadingFolders

if TYPE_CHECKING:
    from fipt.stages.fit.settings import FitSettings


@dataclass(frozen=True, kw_only=True)
class FitInputs:
    """Files of ``fipt fit``; samples and shading are those of the training shards, in the same order."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    out: Annotated[Path, "File to write, model.safetensors; confidence.npz comes beside it."]
    previous: Annotated[Path | None, "Model of the round before: the start, where the settings say so."] = None
    cache: Annotated[Path | None, "Radiance cache; absent: unseen surface is left alone."] = None
    environment: EnvironmentFile = None
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None


def run(inputs: FitInputs, settings: "FitSettings") -> dict[str, Any]:
    """Fit the BRDF and emission networks to the images.

    A fit that was interrupted goes on from its last checkpoint.
    """
    from fipt.stages.fit.run import fit_model

    return fit_model(inputs, settings)
