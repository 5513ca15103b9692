"""``fipt damp``: a shard's traced shading and that of the round before -> its shading of this round."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import SamplesFolder, SettledFile, ShardFolder

if TYPE_CHECKING:
    from fipt.stages.shade.settings import RefineSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class DampInputs:
    """Files of ``fipt damp``."""

    samples: SamplesFolder
    traced: Annotated[Path, "Traced shading of this shard."]
    every: Annotated[tuple[Path, ...], "Traced shading of all shards, in the order of their views."]
    previous: Annotated[Path, "Shading of this shard of the round before."]
    out: ShardFolder
    settled: SettledFile = None


def run(inputs: DampInputs, settings: "RefineSettings") -> dict[str, Any]:
    """Keep the share of the last round's shading that all views together say.

    Where the loop of fit and refinement has settled, the shading of the round before is the result.
    """
    from fipt.formats.files import atomic_folder, check_disk, manifest_beside
    from fipt.scene.samples import read_samples
    from fipt.scene.settled import read_state, write_change
    from fipt.scene.shading import Shading, read_shading, save_shading
    from fipt.stages.shade.change import damped, measured_change, read_differences
    from fipt.stages.shade.integrate import HOLDS, copy_shading, write_shading_manifest

    state = read_state(inputs.settled)
    if state is not None and state.settled is not None:
        return copy_shading(inputs.previous, inputs.out, state, settings)
    change = measured_change(*read_differences(inputs.every))
    if change.light_missing:
        log.warning("the emitters that were found give too little light: the shading of the round before stays")
    samples = read_samples(inputs.samples)
    old, new = read_shading(inputs.previous, samples), Shading(read_shading(inputs.traced, samples).words.copy())
    check_disk(inputs.out.parent, new.nbytes, "the shading")
    damped(samples, new, old, change.kept)
    with atomic_folder(inputs.out, HOLDS) as folder:
        save_shading(folder, new)
        write_change(folder, change)
        manifest_beside(inputs.out).unlink(missing_ok=True)  # it must not vouch for what is being exchanged
    write_shading_manifest("refine", inputs.out, settings)
    return change.figures
