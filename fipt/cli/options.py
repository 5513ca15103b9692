"""Options that several verbs share, and how a verb with a ray tracer starts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

DatasetFolder = Annotated[Path, typer.Option("--dataset", help="Dataset folder.")]
Names = Annotated[list[str], typer.Option("--views", help="Views, comma-separated; repeatable.")]
SamplesFolder = Annotated[Path, typer.Option("--samples", help="Folder of a samples shard.")]
SamplesFolders = Annotated[list[str], typer.Option("--samples", help="Hits shards, comma-separated; repeatable.")]
ShadingFolders = Annotated[list[str], typer.Option("--shading", help="Shading of the samples shards, in their order.")]
CacheFile = Annotated[Path, typer.Option("--cache", help="Radiance cache, cache.npz.")]
ModelFile = Annotated[Path, typer.Option("--model", help="Fitted model, model.safetensors.")]
EmittersFile = Annotated[Path, typer.Option("--emitters", help="Emitters, emitters.npz.")]
EnvironmentFile = Annotated[
    Path | None, typer.Option("--environment", help="Light from outside, environment.npz; without it there is none.")
]
LampsFile = Annotated[
    Path | None,
    typer.Option("--emitter-names", help="emitters.json of fipt review: names of emitters; else their numbers."),
]
DecisionsJson = Annotated[
    str,
    typer.Option("--decisions", help="What emitters_review.yaml decides, by triangle, JSON (docs/stages/emitters.md)."),
]
SettingsJson = Annotated[str, typer.Option("--settings", help="Settings of this stage, JSON.")]
StatsFile = Annotated[Path | None, typer.Option("--stats", help="Write time, rate and memory here, JSON.")]
ManifestFile = Annotated[Path, typer.Option("--manifest", help="Manifest of what was written.")]


def listed(items: list[str]) -> list[str]:
    """Split repeated, comma-separated options."""
    return [name for item in items for name in item.split(",") if name]


@contextmanager
def stage(name: str, settings: str, stats: Path | None, backend: bool = True) -> Iterator[tuple[Any, Any]]:
    """Parse settings, choose the device, time the run: yields (settings model, figures to fill in)."""
    from fipt.formats.manifests import recorded
    from fipt.registry import parse
    from fipt.settings import dumped

    chosen = parse(name, settings)
    if backend:
        from fipt.render.variant import set_variant

        set_variant(threads=getattr(chosen, "threads", 0) or None)
    with recorded(stats, name, dumped(chosen)) as figures:
        yield chosen, figures
