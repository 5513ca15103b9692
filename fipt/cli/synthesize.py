"""``fipt synthesize``: make a dataset with ground truth from the room in code."""

import json
from pathlib import Path
from typing import Annotated

import typer


def command(
    dataset: Annotated[Path, typer.Option(help="Dataset folder to write.")],
    room: Annotated[bool, typer.Option("--room", help="Write mesh, cameras and names.")] = False,
    views: Annotated[list[str] | None, typer.Option(help="Views to render, comma-separated; repeatable.")] = None,
    settings: Annotated[str, typer.Option(help="Settings as JSON.")] = "{}",
    manifest: Annotated[Path | None, typer.Option(help="Manifest to write last.")] = None,
    stats: Annotated[Path | None, typer.Option(help="Figures of the run, JSON.")] = None,
    setup: Annotated[
        str | None,
        typer.Option(help="Light setup as JSON: render only how the views look under it."),
    ] = None,
    setup_name: Annotated[str | None, typer.Option(help="Name of the light setup.")] = None,
) -> None:
    """Make a dataset with ground truth from a room in code.

    First --room (mesh, cameras, ids), then --views for the pictures and the truth of some views.
    With --setup and --setup-name the views go to relight_truth/NAME/ instead.
    """
    from fipt.errors import FiptError
    from fipt.io.files import check_name
    from fipt.io.manifests import recorded, write_manifest
    from fipt.settings import dumped, parse
    from fipt.synthesize import dataset as writer

    names = [name for item in views or [] for name in item.split(",") if name]
    if room == bool(names):
        raise FiptError("give either --room or --views", "run --room first, then --views for each shard")
    if (setup is None) != (setup_name is None) or (room and setup is not None):
        raise FiptError("--setup and --setup-name belong together, with --views", "give both or neither")
    chosen = parse("synthesize", settings)
    record = dumped(chosen)
    light = None
    if setup is not None:
        light, record["setup"] = writer.parse_setup(setup), json.loads(setup)
        check_name(setup_name, "light setup")

    from fipt.render.variant import set_variant

    set_variant()
    with recorded(stats, "synthesize", record) as figures:
        if room:
            files = writer.write_room(dataset, chosen)
        else:
            files, rate = writer.write_images(dataset, names, chosen, light, setup_name)
            figures["views"], figures["paths_per_second"] = len(names), round(rate)
        if manifest is not None:
            write_manifest(manifest, "synthesize", files, record)
