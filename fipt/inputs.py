"""Files and names that the inputs of several stages share, each with the help of its option.

The inputs of a stage are a frozen dataclass of fields ``Annotated[TYPE, "help"]``, and `fipt.cli.verbs` makes the
options of its verb from them: the field ``held_out`` is ``--held-out``, one with a default may be left out. TYPE is
`Path`, `str`, `int`, `float`, `bool` (a flag), a tuple of paths or strings (comma-separated, repeatable), or one of
these or None. A field that carries `POSITIONAL` too is named by its place instead, the items of a tuple that carries
`UNSPLIT` may hold commas.
"""

from pathlib import Path
from typing import Annotated

from fipt.errors import FiptError

POSITIONAL = object()
"""Mark of a field that stands in the command line without the name of an option."""
UNSPLIT = object()
"""Mark of a tuple whose items are given one by one, since they may hold commas."""

DatasetFolder = Annotated[Path, "Dataset folder."]
Names = Annotated[tuple[str, ...], "Views, comma-separated; repeatable."]
SamplesFolder = Annotated[Path, "Folder of a samples shard."]
SamplesFolders = Annotated[tuple[Path, ...], "Samples shards, comma-separated; repeatable."]
ShadingFolders = Annotated[tuple[Path, ...], "Shading of the samples shards, in their order."]
CacheFile = Annotated[Path, "Radiance cache, cache.npz."]
ModelFile = Annotated[Path, "Fitted model, model.safetensors."]
ConfidenceFile = Annotated[Path, "confidence.npz of the model."]
EmittersOut = Annotated[Path, "emitters.npz to write; emitters.json comes beside it."]
EmittersFile = Annotated[Path, "Emitters, emitters.npz."]
SettledFile = Annotated[Path | None, "settled.json of the round before; without it, that is round 0."]
EnvironmentFile = Annotated[Path | None, "Light from outside, environment.npz; without it there is none."]
EmitterNames = Annotated[Path | None, "emitters.json of fipt review: the emitters' names; without it, emitter-N."]
DecisionsJson = Annotated[str, "What emitters_review.yaml decides, by triangle, JSON (docs/stages/emitters.md)."]
ManifestFile = Annotated[Path, "Manifest of what was written."]
ShardFolder = Annotated[Path, "Folder of the shard to write."]
RaysPerSide = Annotated[int, "A pixel is looked through by the square of this many rays: grid of the section samples."]

_MOST_RAYS = 64
"""Rays along a side of a pixel: their square, twice, is the least number of paths of one pixel."""


def check_rays(per_side: int) -> None:
    """Raise FiptError unless a number of rays along a side of a pixel can be traced."""
    if not 1 <= per_side <= _MOST_RAYS:
        raise FiptError(f"--rays-per-side must be 1 to {_MOST_RAYS}; it is {per_side}", "give the samples' grid")
