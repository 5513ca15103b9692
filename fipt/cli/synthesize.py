"""``fipt synthesize``: make a dataset with ground truth, or a RAW capture, from a room in code or a scene file."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    dataset: Annotated[Path, typer.Option(help="Dataset folder to write.")],
    room: Annotated[bool, typer.Option("--room", help="Write mesh, cameras and names.")] = False,
    scene: Annotated[
        Path | None, typer.Option(help="Mitsuba scene file (XML) of the room; default: the room in code.")
    ] = None,
    views: Annotated[list[str] | None, typer.Option(help="Views to render, comma-separated; repeatable.")] = None,
    settings: Annotated[str, typer.Option(help="Settings as JSON.")] = "{}",
    manifest: Annotated[Path | None, typer.Option(help="Manifest to write last.")] = None,
    stats: Annotated[Path | None, typer.Option(help="Figures of the run, JSON.")] = None,
    setup: Annotated[
        str | None,
        typer.Option(help="Light setup, JSON or YAML file: render only how the views look under it."),
    ] = None,
    setup_name: Annotated[str | None, typer.Option(help="Name of the light setup.")] = None,
    raw: Annotated[
        Path | None,
        typer.Option(help="Capture folder: photograph the views into RAW brackets there instead of writing pictures."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="Capture folder: write its calibration frames, table, cameras and mesh.")
    ] = None,
    truth: Annotated[
        bool, typer.Option("--truth", help="With --views: only truth and ids, for a dataset of developed photographs.")
    ] = False,
    from_images: Annotated[
        bool, typer.Option("--from-images", help="With --raw: photograph the pictures of any dataset, all of them.")
    ] = False,
) -> None:
    """Make a dataset with ground truth from a room in code, or with --scene from one that someone modelled.

    First --room (mesh, cameras, ids), then --views for the pictures and the truth of some views;
    --scene goes with each of them.
    With --setup and --setup-name the views go to relight_truth/NAME/ instead.

    As a simulated camera would see it: after --room, --calibration OUT once, then --views with
    --raw OUT; --truth --views for the dataset that they become. --from-images --raw OUT makes a
    whole capture of the pictures of any dataset. The camera is the section raw of the settings.
    """
    from fipt.errors import FiptError
    from fipt.formats.files import check_name
    from fipt.formats.manifests import recorded, write_manifest
    from fipt.registry import parse
    from fipt.scene.setup import parse_setup
    from fipt.settings import dumped
    from fipt.synthetic import dataset as writer

    names = [name for item in views or [] for name in item.split(",") if name]
    if sum((room, bool(names), calibration is not None, from_images)) != 1:
        raise FiptError(
            "give one of --room, --views, --calibration and --from-images",
            "run --room first, then --views for each shard",
        )
    if raw is not None and (room or calibration is not None or setup is not None):
        raise FiptError("--raw belongs to --views or --from-images, without --setup", "leave the others out")
    if truth and (not names or raw is not None or setup is not None):
        raise FiptError("--truth belongs to --views, without --raw and --setup", "leave the others out")
    if scene is not None and (calibration is not None or from_images):
        raise FiptError("--scene belongs to --room and --views", "leave it out: the dataset tells the rest")
    if from_images and raw is None:
        raise FiptError("--from-images needs --raw", "say where the capture should be written")
    for place in (raw, calibration):
        if manifest is not None and place is not None and not place.is_relative_to(manifest.parent):
            raise FiptError(
                f"a manifest lists files below its own folder; {place} is not below {manifest.parent}",
                "put the manifest into the scene's folder, above the capture",
            )
    if raw is not None and names and manifest is not None and not dataset.is_relative_to(manifest.parent):
        raise FiptError(
            f"with --raw, the truth of the views goes to {dataset}, which is not below {manifest.parent}",
            "put the manifest into the scene's folder, above dataset and capture",
        )
    if (setup is None) != (setup_name is None) or (not names and setup is not None):
        raise FiptError("--setup and --setup-name belong together, with --views", "give both or neither")
    chosen = parse("synthesize", settings)
    record = dumped(chosen)
    if scene is not None:
        record["scene_file"] = str(scene)
    light = None
    if setup is not None:
        light = parse_setup(setup)
        record["setup"] = dumped(light)
        check_name(setup_name, "light setup")

    from fipt.render.variant import set_variant

    set_variant()
    with recorded(stats, "synthesize", record) as figures:
        if room:
            files, figures["coverage"] = writer.write_room(dataset, chosen, scene)
        elif calibration is not None:
            files = writer.write_capture_rest(dataset, calibration, chosen)
        elif from_images:
            files = writer.photograph(dataset, raw, chosen)
            figures["views"] = sum(file.parent.name == "truth" and file.suffix == ".exr" for file in files)
        elif truth:
            files = writer.write_truths(dataset, names, chosen, scene)
        else:
            if raw is None:
                files, rate = writer.write_images(dataset, names, chosen, scene, light, setup_name)
            else:
                files, rate = writer.write_brackets(dataset, raw, names, chosen, scene)
            figures["views"], figures["paths_per_second"] = len(names), round(rate)
        if manifest is not None:
            write_manifest(manifest, "synthesize", files, record)
