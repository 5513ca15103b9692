"""Files of the fit."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fipt.inputs import DatasetFolder, EnvironmentFile, SamplesFolders, SettledFile, ShadingFolders


@dataclass(frozen=True, kw_only=True)
class FitInputs:
    """Files of ``fipt fit``; samples and shading are those of the training shards, in the same order."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    out: Annotated[Path, "File to write, model.safetensors; confidence.npz and settled.json come beside it."]
    previous: Annotated[Path | None, "Model of the round before, with confidence.npz beside it: where to start."] = None
    emitters: Annotated[Path | None, "What emits or may emit teaches no material; absent: a fitted mask tells."] = None
    emitters_before: Annotated[Path | None, "What emitted in the round before; absent: it does not change."] = None
    cache: Annotated[Path | None, "Radiance cache; absent: unseen surface is left alone."] = None
    environment: EnvironmentFile = None
    settled: SettledFile = None
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None
    first_shading: Annotated[
        tuple[Path, ...], "Shading of round 0, of the same shards: what it differs by tells how far off shading may be."
    ] = ()
