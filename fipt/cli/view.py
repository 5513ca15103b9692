"""``fipt view``: a file of the pipeline -> PNG."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    file: Annotated[
        Path, typer.Argument(help="EXR, id map, npy of samples or shading, npz; or the folder of a dataset.")
    ],
    layer: Annotated[str, typer.Option(help="EXR layer (kd, roughness, ...), or Ld, Ls0.0 to Ls1.5 of shading.")] = "",
    shard_view: Annotated[str, typer.Option(help="View of a shard; default: its first.")] = "",
    samples: Annotated[Path | None, typer.Option(help="Samples folder of a shading.npy, if it is elsewhere.")] = None,
    views: Annotated[str, typer.Option(help="Views of a dataset, comma-separated; default: four.")] = "",
    out: Annotated[Path | None, typer.Option(help="PNG or JPEG to write; default: here, named after FILE.")] = None,
) -> None:
    """Write any result as a PNG image.

    RGB is clipped to [0, 1] and sRGB-encoded, scalars are linear, ids get false colours, npz files
    a table of what they hold. An EXR without --layer shows all its layers side by side, the folder
    of a dataset a row of images and truth for each view.
    """
    from fipt.errors import FiptError
    from fipt.formats.images import write_png
    from fipt.formats.places import same_place
    from fipt.view import montage, viewed

    parts = [file.stem, shard_view, layer]
    out = out or Path(".".join(part for part in parts if part) + ".png")
    if out.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise FiptError(f"--out must be a PNG or JPEG file; found {out}", "give it the ending .png")
    if same_place(file, out):
        raise FiptError(f"{out} is the file that is shown: it would be overwritten", "name another file with --out")
    array, given = file.suffix.lower() == ".npy", {"--shard-view": shard_view, "--samples": samples}
    useless = next((option for option, value in given.items() if value and not array), None)
    if useless or (views and not file.is_dir()):
        what = "arrays of a shard (.npy)" if useless else "the folder of a dataset"
        raise FiptError(f"{useless or '--views'} is for {what}; {file} is none", "leave the option out")
    if file.is_dir():
        made = montage(file, [view for view in views.split(",") if view])
    else:
        made = viewed(file, layer, shard_view, samples)
    write_png(out, made.pixels)
    print(f"{made.note}\n{out}")
