"""``fipt metrics``: compare materials, emitters and renderings with the truth."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from fipt.registry import parse
from fipt.settings import dumped


def command(
    dataset: Annotated[Path, typer.Option(help="dataset folder, with truth/ where it is known")],
    materials: Annotated[Path, typer.Option(help="folder of material maps")],
    render: Annotated[Path, typer.Option(help="folder of re-rendered views")],
    emitters: Annotated[Path, typer.Option(help="emitters.npz of the last round")],
    out: Annotated[Path, typer.Option(help="metrics.json to write")],
    samples: Annotated[
        str,
        typer.Option(help="samples folders, comma-separated: they tell which triangles truly emit"),
    ] = "",
    relight: Annotated[Path | None, typer.Option(help="folder with one folder of pictures per light setup")] = None,
    setups: Annotated[
        str | None,
        typer.Option(help="light setups whose truth counts, comma-separated; default: all that the dataset has"),
    ] = None,
    reference: Annotated[
        list[str] | None,
        typer.Option(help="SETUP=FOLDER: photographs of the room under a light setup, named as the views; repeatable"),
    ] = None,
    settings: Annotated[str, typer.Option(help="JSON of the config section `metrics`")] = "{}",
    stats: Annotated[Path | None, typer.Option(help="file for times and memory")] = None,
) -> None:
    """Write every figure that the files allow; what cannot be known is null.

    Definitions: docs/method.md, and in the file itself.
    """
    from fipt.cli.options import listed
    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.formats.manifests import recorded
    from fipt.registry import VERSIONS
    from fipt.scene.dataset import Dataset
    from fipt.stages.evaluate import scene
    from fipt.stages.evaluate.metrics import DEFINITIONS

    options = parse("metrics", settings)
    folders = [Path(folder) for folder in samples.split(",") if folder]
    references = {name: Path(path) for name, _, path in (text.partition("=") for text in reference or [])}
    if not all(name and str(path) != "." for name, path in references.items()):
        raise FiptError(f"--reference must be SETUP=FOLDER; found {', '.join(reference or [])}", "name both")
    if references and relight is None:
        raise FiptError("--reference needs --relight", "name the folder of the relit views")
    with recorded(stats, "metrics", dumped(options)):
        data = Dataset(dataset)
        content: dict[str, Any] = {
            split: {
                **scene.material_figures(data, materials, split),
                **scene.render_figures(data, render, split, options.fit_exposure),
            }
            for split in ("val", "train")
        }
        content["emitters"] = scene.emitter_figures(data, emitters, folders)
        counted = None if setups is None else listed([setups])
        relit = scene.relight_figures(data, relight, counted) if relight is not None else {}
        for setup, photographs in references.items():
            relit[setup] = scene.reference_figures(data, relight / setup, photographs)
        if relit:
            content["relight"] = relit
        content["definitions"] = DEFINITIONS
        content["settings"] = dumped(options)
        content["version"] = VERSIONS["metrics"]
        text = json.dumps(scene.rounded(content), indent=1, ensure_ascii=False, allow_nan=False)
        write_text(out, text + "\n")
