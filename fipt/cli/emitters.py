"""``fipt emitters``: model and images -> emitting triangles of a round."""

from pathlib import Path
from typing import Annotated

import typer

from fipt.cli.options import (
    DatasetFolder,
    DecisionsJson,
    ModelFile,
    SamplesFolders,
    SettingsJson,
    ShadingFolders,
    StatsFile,
    listed,
    stage,
)


def command(
    dataset: DatasetFolder,
    samples: SamplesFolders,
    shading: ShadingFolders,
    model: ModelFile,
    out: Annotated[Path, typer.Option(help="File to write, emitters.npz; emitters.json comes beside it.")],
    decisions: DecisionsJson = "",
    settings: SettingsJson = "{}",
    stats: StatsFile = None,
) -> None:
    """Extract the triangles that emit light and their radiance."""
    with stage("emitters", settings, stats) as (chosen, figures):
        import numpy as np

        from fipt.formats.arrays import on_disk
        from fipt.model.store import load_field
        from fipt.scene.dataset import Dataset
        from fipt.scene.emitters import write_emitters
        from fipt.scene.review import numbers, parse_decisions
        from fipt.scene.samples import clipped_of, pixels_of
        from fipt.scene.shading import read_shards
        from fipt.stages.emitters.extract import extract

        data = Dataset(dataset)
        mesh = data.mesh()
        decided = parse_decisions(decisions, len(mesh.triangles))
        shards, baked = read_shards(listed(samples), listed(shading))
        empty = on_disk(out.parent)
        images = [pixels_of(data, shard, empty) for shard in shards]
        field = load_field(model)
        clipped = [clipped_of(data, shard, empty) for shard in shards]
        found = extract(mesh, shards, baked, images, field.query_mask, chosen, clipped, decided)
        write_emitters(out, found, mesh)
        lamps = int(found.emitter.max(initial=-1)) + 1
        figures["triangles"], figures["lamps"] = len(found.triangle), lamps
        bounds = len(np.unique(found.emitter[found.lower_bound]))
        warnings = []
        if bounds:
            warnings.append(f"{bounds} of {lamps} lamps are clipped in every exposure: their radiance is a lower bound")
        for text in decided.accept:
            if not np.isin(sorted(numbers(text, len(mesh.triangles))), found.triangle).any():
                warnings.append(f"no pixel shows the accepted triangles {text}: their radiance cannot be measured")
        if warnings:
            figures["warnings"] = warnings
        for warning in warnings:
            print(f"warning: {warning}")
        if lamps == 0:
            print("warning: no emitter found; refined shading will have no light of its own")
        else:
            print(f"emitters: {lamps} lamps of {len(found.triangle)} triangles")
