"""``fipt import``: posed HDR views of another layout -> dataset/."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    source: Annotated[Path, typer.Option(help="Folder of the views, or its transforms.json.")],
    format: Annotated[str, typer.Option(help="nerfstudio, fipt-synthetic, fipt-real or capture.")],
    dataset: Annotated[Path, typer.Option(help="Dataset folder to write.")],
    mesh: Annotated[Path | None, typer.Option(help="PLY or OBJ mesh; default: the one in the source.")] = None,
    manifest: Annotated[Path | None, typer.Option(help="Default: import.manifest.json in the dataset.")] = None,
    poses: Annotated[
        Path | None, typer.Option(help="capture: transforms.json, COLMAP folder, Metashape XML or RealityCapture CSV.")
    ] = None,
    segments: Annotated[
        Path | None, typer.Option(help="capture: folder with part/VIEW.png or semantic/VIEW.png of developed views.")
    ] = None,
    settings: Annotated[str, typer.Option(help="Settings of this stage, JSON.")] = "{}",
    stats: Annotated[Path | None, typer.Option(help="Write time and memory here, JSON.")] = None,
) -> None:
    """Bring posed HDR views of another layout into the dataset form.

    The layouts share file names but not axes, so the format is never guessed. Look at overlay.png
    in the dataset afterwards: the lines are the mesh's edges and must lie on the photo's.

    The format capture takes developed photographs: the folder that fipt develop and fipt qa wrote.
    """
    from fipt.formats.manifests import recorded
    from fipt.registry import parse
    from fipt.settings import dumped
    from fipt.stages.importing.build import import_scene

    chosen = parse("import", settings)
    with recorded(stats, "import", dumped(chosen)) as figures:
        done = import_scene(source, format, dataset, chosen, mesh, manifest, poses, segments)
        cameras = done.cameras
        figures["views"], figures["exposure"] = len(cameras), done.source.scale
        if done.source.unposed:
            figures["warnings"] = [f"without a pose, left out: {', '.join(done.source.unposed)}"]
            print(f"warning: {figures['warnings'][0]}")
    splits = [camera.split for camera in cameras]
    print(f"{dataset}: {splits.count('train')} train and {splits.count('val')} val views")
