"""``fipt regroup``: segment ids and the shading of a round -> parts, one for each material."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder, ManifestFile, SamplesFolders, SettledFile, ShadingFolders

if TYPE_CHECKING:
    from fipt.stages.segment.settings import RegroupSettings

log = logging.getLogger(__name__)

_HOLDS = r"part|metals\.json"
"""Names in the folder that is written, as a regular expression."""


@dataclass(frozen=True, kw_only=True)
class RegroupInputs:
    """Files of ``fipt regroup``; samples and shading are those of the training shards, in the same order."""

    dataset: DatasetFolder
    samples: SamplesFolders
    shading: ShadingFolders
    out: Annotated[Path, "Folder to write: part/VIEW.png of every training view, and metals.json."]
    manifest: ManifestFile
    segments: Annotated[Path | None, "Folder of fused segment ids; absent: those of the dataset."] = None
    emitters: Annotated[
        Path | None, "What emits or may emit: pixels that show it, or lie beside, tell no material."
    ] = None
    settled: SettledFile = None
    previous: Annotated[Path | None, "Parts of the round before, which stay where the loop has settled."] = None


def run(inputs: RegroupInputs, settings: "RegroupSettings") -> dict[str, Any]:
    """Cut segments of two materials, join those that the pictures show to be of one, and move their borders.

    Under a round's shading each piece of a segment has a base colour and a roughness. Segments whose pieces are clearly
    of two kinds are cut; those that differ by no more than noise become one part. Then triangles change over to a part
    beside them that explains them better. Where the loop of fit and refinement has settled, the parts of the round
    before are the result.
    """
    from fipt.formats.manifests import withdraw_manifest, write_manifest
    from fipt.scene.settled import read_state
    from fipt.settings import dumped

    withdraw_manifest(inputs.manifest)
    state = read_state(inputs.settled)
    if state is not None and state.settled is not None and inputs.previous is not None:
        _copy(inputs.previous, inputs.out)
        log.info("settled in round %d: the parts of the round before stay", state.settled)
        figures = {"copied": True, "settled_in_round": state.settled}
    else:
        figures = _regrouped(inputs, settings)
    files = [path for path in inputs.out.rglob("*") if path.is_file()]
    write_manifest(inputs.manifest, "regroup", files, dumped(settings))
    return figures


def _copy(previous: Path, out: Path) -> None:
    """Take over the parts of the round before."""
    from fipt.formats.files import ANYTHING, atomic_folder, copy_file, link_folder
    from fipt.scene.metals import METALS

    with atomic_folder(out, _HOLDS) as folder:
        link_folder(previous / "part", folder / "part", ANYTHING)
        copy_file(previous / METALS, folder / METALS)


def _regrouped(inputs: RegroupInputs, settings: "RegroupSettings") -> dict[str, Any]:
    """Find the parts under this round's shading and write them; return the figures."""
    from fipt.formats.files import atomic_folder
    from fipt.formats.images import write_png
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import read_emitters
    from fipt.scene.metals import write_metals
    from fipt.scene.observed import read_observed, without_triangles
    from fipt.scene.samples import segments_of
    from fipt.stages.segment.borders import borders_moved
    from fipt.stages.segment.divide import divided
    from fipt.stages.segment.regroup import regrouped

    data = Dataset(inputs.dataset, inputs.segments)
    shards = read_observed(data, inputs.samples, inputs.shading)
    if inputs.emitters is not None:
        shards = without_triangles(shards, read_emitters(inputs.emitters).possible, around=True)
    kind = data.segment_kind() or "part"  # where there are none, reading says so
    before = [segments_of(data, shard.samples, kind) for shard in shards]
    regions, cuts, alike = divided(shards, before) if settings.divide else (before, 0, 1.0)
    mesh = data.mesh()
    found = regrouped(shards, regions, mesh, alike)
    parts = found.parts
    if settings.borders:
        parts = borders_moved(mesh, shards, parts)
    with atomic_folder(inputs.out, _HOLDS) as folder:
        write_metals(folder, found.metals)
        for shard, ids in zip(shards, parts, strict=True):
            for index, view in enumerate(shard.samples.views):
                own = ids[shard.samples.pixels(index)].reshape(shard.samples.shapes[index])
                write_png(folder / "part" / f"{view}.png", own)
    return {"segments": _count(before), "cuts": cuts, "parts": _count(parts), "materials": found.materials}


def _count(ids: list[Any]) -> int:
    """Number of different ids from 1 in arrays."""
    return len({int(k) for own in ids for k in set(own.tolist())} - {0})
