"""``fipt metrics``: compare materials, emitters and renderings with the truth."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import UNSPLIT, DatasetFolder

if TYPE_CHECKING:
    from fipt.scene.dataset import Dataset
    from fipt.stages.evaluate.settings import MetricsSettings


@dataclass(frozen=True, kw_only=True)
class MetricsInputs:
    """Files of ``fipt metrics``; setups of None are all that the dataset has, views of None all that are there."""

    dataset: DatasetFolder
    materials: Annotated[Path, "Folder of material maps."]
    render: Annotated[Path, "Folder of re-rendered views."]
    out: Annotated[Path, "metrics.json to write."]
    rendered: Annotated[
        tuple[str, ...] | None, "Views whose re-rendering counts, comma-separated; default: all that are there."
    ] = None
    emitters: Annotated[Path | None, "Emitters, emitters.npz; without them none are judged."] = None
    partial: Annotated[bool, "Maps are of another program: what they lack has no figure."] = False
    samples: Annotated[tuple[Path, ...], "Samples folders, comma-separated: they tell which triangles truly emit."] = ()
    relight: Annotated[Path | None, "Folder with one folder of images per relight setup."] = None
    setups: Annotated[
        tuple[str, ...] | None, "Setups whose truth counts, comma-separated; default: all that the dataset has."
    ] = None
    relit: Annotated[
        tuple[str, ...] | None, "Views that count under setups, comma-separated; default: all that are there."
    ] = None
    reference: Annotated[
        tuple[str, ...], "SETUP=FOLDER: photographs of the room under a setup, named as the views; repeatable.", UNSPLIT
    ] = ()


def run(inputs: MetricsInputs, settings: "MetricsSettings") -> dict[str, Any]:
    """Write every figure that the files allow; what cannot be known is null.

    Definitions: docs/method.md, and in the file itself.
    """
    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.registry import VERSIONS
    from fipt.scene.dataset import Dataset
    from fipt.settings import dumped
    from fipt.stages.evaluate import scene
    from fipt.stages.evaluate.metrics import DEFINITIONS

    references, data = _references(inputs), Dataset(inputs.dataset)
    if inputs.setups and inputs.relight is None:
        raise FiptError("--setups needs --relight", "name the folder of the relit views")
    rendered, relit_views = (_counted(data, views) for views in (inputs.rendered, inputs.relit))
    content: dict[str, Any] = {
        split: {
            **scene.material_figures(data, inputs.materials, split, inputs.partial),
            **scene.render_figures(
                data,
                inputs.render,
                [view for view in data.views(split) if view in rendered],
                settings.fit_exposure,
                inputs.partial,
            ),
        }
        for split in ("val", "train")
    }
    if inputs.emitters is not None:
        content["emitters"] = scene.emitter_figures(data, inputs.emitters, list(inputs.samples))
    relit = {}
    if inputs.relight is not None:
        relit = scene.relight_figures(data, inputs.relight, relit_views, inputs.setups)
    for setup, (ours, photographs) in references.items():
        relit[setup] = scene.reference_figures(data, ours, photographs, relit_views)
    if relit:
        content["relight"] = relit
    content |= {"definitions": DEFINITIONS, "settings": dumped(settings), "version": VERSIONS["metrics"]}
    text = json.dumps(scene.rounded(content), indent=1, ensure_ascii=False, allow_nan=False)
    write_text(inputs.out, text + "\n")
    return {}


def _counted(data: "Dataset", views: tuple[str, ...] | None) -> set[str]:
    """Accepted views among those named, or all; folders may hold images of views that an earlier plan rendered."""
    cameras = data.cameras if views is None else [data.camera(view) for view in data.accepted(views)]
    return {camera.name for camera in cameras}


def _references(inputs: MetricsInputs) -> dict[str, tuple[Path, Path]]:
    """Setup -> our images and the photographs of it."""
    from fipt.errors import FiptError

    pairs = [text.partition("=")[::2] for text in inputs.reference]
    if not all(name and path for name, path in pairs):
        raise FiptError(f"--reference must be SETUP=FOLDER; found {', '.join(inputs.reference)}", "name both")
    if pairs and inputs.relight is None:
        raise FiptError("--reference needs --relight", "name the folder of the relit views")
    return {name: (inputs.relight / name, Path(path)) for name, path in pairs if inputs.relight is not None}
