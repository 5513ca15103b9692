"""``fipt fuse``: segment ids of single views -> ids on the mesh, the same in all views."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder

if TYPE_CHECKING:
    from fipt.stages.segment.settings import FuseSettings


@dataclass(frozen=True, kw_only=True)
class FuseInputs:
    """Files of ``fipt fuse``."""

    dataset: DatasetFolder
    segments: Annotated[Path, "Folder with views/VIEW.npz and classes.json; fused/ and fusion.npz, .json go there."]
    geometry: Annotated[bool, "Grow parts by shape and colour instead; no views/ is needed."] = False


def run(inputs: FuseInputs, settings: "FuseSettings") -> dict[str, Any]:
    """Fuse segment ids of single views on the mesh, so that all views agree.

    Segments of different views become one where they overlap on the mesh. Training views vote; the
    ids of all views are then drawn from the mesh.
    """
    from fipt.formats.files import make_folder

    if inputs.geometry:
        from fipt.stages.segment.geometry import grow_parts as fused
    else:
        from fipt.stages.segment.fuse import fuse_views as fused

    make_folder(inputs.segments)
    return fused(inputs.dataset, inputs.segments, settings)
