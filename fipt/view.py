"""Any file of the pipeline as an image for eyes."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.conventions import LUMINANCE, ROUGHNESS_LEVELS
from fipt.errors import FiptError
from fipt.formats.arrays import load_npz
from fipt.formats.exr import read_exr
from fipt.formats.files import existing_file
from fipt.formats.images import read_ids, to_display
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples, read_samples
from fipt.scene.shading import read_shading

SHADING_LAYERS = (
    "Ld",
    *(f"Ls0.{level}" for level in range(len(ROUGHNESS_LEVELS))),
    *(f"Ls1.{level}" for level in range(len(ROUGHNESS_LEVELS))),
)
"""Names of the outputs in shading.npy; Ls0 and Ls1 by roughness level, 0 = smoothest."""

_MIDDLE_GREY = 0.2
"""Linear value that the median luminance of a dataset's images is shown at."""

_ID_FOLDERS = ("IndexMA", "segmentation")
"""Folders of the FIPT layouts whose EXR files hold ids as floating-point numbers."""


@dataclass(frozen=True)
class NotedImage:
    """An image and one line about it.

    Attributes
    ----------
    pixels
        (H, W, 3) uint8.
    note
        What is shown and what else the file holds.
    """

    pixels: np.ndarray
    note: str


def viewed(path: str | Path, layer: str = "", view: str = "", samples: str | Path | None = None) -> NotedImage:
    """Turn a file of the pipeline into an image.

    Parameters
    ----------
    path
        ``.exr`` (all layers side by side unless one is named), id maps (``.png``), an array of a
        samples folder or a shading.npy (``.npy``), ``.npz`` (a table of its arrays).
    layer
        Layer of an EXR file, or output of a shading.npy (`SHADING_LAYERS`, default Ld).
    view
        View of a shard, default its first.
    samples
        Samples folder of a shading.npy, default ``samples/{shard}`` of the same results.
    """
    path = existing_file(path, "the file to view")
    readers: dict[str, Callable[[], NotedImage]] = {
        ".exr": lambda: _exr(path, layer),
        ".png": lambda: NotedImage(false_color(read_ids(path)), "ids in false colours"),
        ".npy": lambda: _shard_array(path, layer, view, samples),
        ".npz": lambda: _table(path),
    }
    if path.suffix not in readers:
        raise FiptError(f"{path} cannot be viewed", f"give a file {', '.join(readers)}")
    return readers[path.suffix]()


def shown(name: str, values: np.ndarray) -> np.ndarray:
    """Values as (H, W, 3) uint8, by their kind.

    RGB is clipped to [0, 1] and sRGB-encoded; ``normal`` maps [-1, 1] to [0, 1]; ids get false
    colours; other scalars are linear, divided by their maximum where that exceeds 1.
    """
    if name == "ids" or values.dtype.kind in "iu":
        return false_color(values if values.ndim == 2 else values[..., 0])
    values = np.nan_to_num(values.astype(np.float32))
    if name == "normal":
        return np.rint(np.clip(0.5 + 0.5 * values, 0, 1) * 255).astype(np.uint8)
    if values.ndim == 3:
        return to_display(values)
    grey = np.clip(values / max(float(values.max()), 1.0), 0, 1)
    return np.repeat(np.rint(grey * 255).astype(np.uint8)[..., None], 3, axis=-1)


def false_color(ids: np.ndarray) -> np.ndarray:
    """Give every id of an (H, W) map its own colour, the same in every image; 0 and -1 black."""
    keys = np.rint(ids).astype(np.int64)
    mixed = (keys.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    colors = np.stack([(mixed >> np.uint64(shift)) & np.uint64(255) for shift in (0, 8, 16)], -1)
    return np.where(keys[..., None] > 0, 64 + colors * 3 // 4, 0).astype(np.uint8)


# --- datasets -------------------------------------------------------------------------------------


def montage(folder: str | Path, views: Sequence[str] = ()) -> NotedImage:
    """Return a dataset at a glance: a row for each view with its image, true kd, roughness, metallic, emission, parts.

    Parameters
    ----------
    folder
        Of the dataset; columns that it has nothing for are left out.
    views
        Names; default: four of those that have images, spread over all.
    """
    data = Dataset(folder)
    names = [camera.name for camera in data.cameras if (data.root / "images" / f"{camera.name}.exr").is_file()]
    if not names:
        raise FiptError(f"{folder} has no images yet", "render or import its views")
    views = list(views) or [names[k] for k in np.unique(np.linspace(0, len(names) - 1, 4).astype(int))]
    images = [data.image(view)[0] for view in views]
    seen = np.concatenate([(image @ np.array(LUMINANCE, np.float32)).ravel() for image in images])
    exposure = _MIDDLE_GREY / max(float(np.median(seen)), 1e-9)
    rows, columns = [], ["image"]
    for view, image in zip(views, images, strict=True):
        tiles, truth = {"image": to_display(image * exposure)}, data.truth(view) or {}
        for name in ("kd", "roughness", "metallic"):
            if name in truth:
                tiles[name] = shown(name, truth[name])
        if "emission" in truth:
            tiles["emission"] = to_display(truth["emission"] * exposure)
        kind = data.segment_kind()
        if kind:
            tiles[kind] = false_color(data.segments(view, kind))
        rows.append(np.concatenate(list(tiles.values()), axis=1))
        columns = list(tiles)
    if len({row.shape for row in rows}) > 1:
        raise FiptError(f"the views {', '.join(views)} differ in size or in what is known of them", "choose others")
    return NotedImage(
        np.concatenate(rows), f"rows: {', '.join(views)}; columns: {', '.join(columns)}; shown times {exposure:.3g}"
    )


# --- EXR ------------------------------------------------------------------------------------------


def _exr(path: Path, layer: str) -> NotedImage:
    layers = _layers(read_exr(path))
    if layer and layer not in layers:
        raise _no_layer(path, layer, layers)
    chosen = {layer: layers[layer]} if layer else layers
    ids = path.parent.name in _ID_FOLDERS
    tiles = [shown("ids" if ids else name, values) for name, values in chosen.items()]
    ranges = ", ".join(f"{name or 'RGB'} {v.min():.3g}..{v.max():.3g}" for name, v in chosen.items())
    return NotedImage(np.concatenate(tiles, axis=1), f"left to right: {ranges}")


def _layers(channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Group channels: RGB under their common name ('' for the image itself), others alone."""
    layers, rest = {}, dict(channels)
    for name in sorted({channel.rpartition(".")[0] for channel in channels}):
        letters = [f"{name}.{letter}" if name else letter for letter in "RGB"]
        if all(letter in rest for letter in letters):
            layers[name] = np.stack([rest.pop(letter) for letter in letters], axis=-1)
    return layers | {name.removesuffix(".Y"): values for name, values in rest.items()}


# --- shards ---------------------------------------------------------------------------------------


def _shard_array(path: Path, layer: str, view: str, folder: str | Path | None) -> NotedImage:
    """One view of an array over a shard's samples (shading.npy or an array of the samples folder)."""
    if path.name != "shading.npy":
        samples, name = read_samples(path.parent), path.stem
    else:
        # results/S/round-k/shading/{shard}/shading.npy belongs to results/S/samples/{shard}
        root = path.resolve().parents
        samples = read_samples(folder or root[3] / "samples" / root[0].name)
        name = layer or SHADING_LAYERS[0]
        if name not in SHADING_LAYERS:
            raise _no_layer(path, name, SHADING_LAYERS)
    view = view or samples.views[0]
    if view not in samples.views:
        raise FiptError(f"the shard has no view {view}", f"choose one of {', '.join(samples.views)}")
    index = samples.views.index(view)
    note = f"view {view}, one of {len(samples.views)} from {samples.views[0]} to {samples.views[-1]}"
    if name in SHADING_LAYERS:
        pixels, exposure = _shading(path, samples, index, SHADING_LAYERS.index(name))
        note = f"shown times {exposure:.3g}; {note}"
    elif name in _PER_PIXEL:
        pixels = _PER_PIXEL[name](samples, index)
    else:
        raise FiptError(f"{path} cannot be viewed", f"give shading.npy, {', '.join(_PER_PIXEL)}")
    image = pixels.reshape(*samples.shapes[index], *pixels.shape[1:])
    return NotedImage(shown(name, image), f"{name} up to {pixels.max():.4g}; {note}")


def _shading(path: Path, samples: FootprintSamples, index: int, output: int) -> tuple[np.ndarray, float]:
    """(P, 3) output of shading.npy times an exposure that suits it, and that exposure."""
    shading = read_shading(path.parent)
    if len(shading) != len(samples.position):
        raise FiptError(
            f"{path} holds shading of {len(shading)} samples; its samples folder has {len(samples.position)}",
            "name the samples folder it was made from with --samples",
        )
    own = samples.of_view(index)
    values = shading[own][:, output].astype(np.float64) * samples.weight[own, None]
    pixels = _summed(values, samples, index)
    exposure = 1.0 / max(float(np.percentile(pixels, 98)), 1e-9)
    return pixels * exposure, exposure


def _summed(values: np.ndarray, samples: FootprintSamples, index: int) -> np.ndarray:
    """(P, ...) sums over each pixel's samples of a view's (samples, ...) values."""
    pixels = samples.pixels(index)
    total = np.zeros((pixels.stop - pixels.start, *values.shape[1:]))
    np.add.at(total, samples.pixel_of_sample(index), values)
    return total


def _first(name: str) -> Callable[[FootprintSamples, int], np.ndarray]:
    """Reader of the value at each pixel's first sample; 0 where it has none."""

    def read(samples: FootprintSamples, index: int) -> np.ndarray:
        values, pixels = getattr(samples, name), samples.pixels(index)
        starts = samples.offsets[pixels.start : pixels.stop + 1]
        result = np.zeros((len(starts) - 1, *values.shape[1:]))
        some = np.diff(starts) > 0
        result[some] = values[starts[:-1][some]] + (name == "triangle")  # 0 is black, for misses
        if name == "position":
            low = result[some].min(axis=0) if some.any() else 0.0
            result = (result - low) / max(np.ptp(result[some], axis=0).max(), 1e-9)
        if name == "footprint":
            result /= max(result.max(), 1e-9)
        return result.astype(np.int64) if name == "triangle" else result

    return read


_PER_PIXEL: dict[str, Callable[[FootprintSamples, int], np.ndarray]] = {
    **{name: _first(name) for name in ("position", "normal", "triangle", "footprint")},
    "weight": lambda samples, index: _summed(samples.weight[samples.of_view(index)], samples, index),
    "center": lambda samples, index: samples.center[samples.pixels(index)].astype(np.float64),
    "offsets": lambda samples, index: np.bincount(
        samples.pixel_of_sample(index), minlength=samples.pixels(index).stop - samples.pixels(index).start
    ).astype(np.float64),
}
"""Array of a samples folder -> (P, ...) values of a view: weights summed, offsets as samples per pixel,
position and footprint scaled to [0, 1]."""


def _no_layer(path: Path, layer: str, layers: Iterable[str]) -> FiptError:
    names = ", ".join(name or "''" for name in layers)
    return FiptError(f"{path} has no layer {layer}", f"choose one of {names}")


# --- npz ------------------------------------------------------------------------------------------


def _table(path: Path) -> NotedImage:
    """Arrays of an npz file, and one line for each emitter where it holds emitters."""
    arrays = load_npz(path)
    lines = [f"{path.name}: {len(arrays)} arrays"]
    lines += [
        f"{name:<12} {values.dtype!s:<8} {values.shape!s:<16} {_range(values)}" for name, values in arrays.items()
    ]
    if {"emitter", "radiance", "area"} <= arrays.keys():
        index = arrays["emitter"]
        lines.append(f"{len(np.unique(index))} emitters: triangles, area in m2, mean radiance")
        for emitter in np.unique(index):
            own = index == emitter
            area = arrays["area"][own]
            mean = (arrays["radiance"][own] * area[:, None]).sum(0) / max(area.sum(), 1e-12)
            color = " ".join(f"{value:8.3f}" for value in mean)
            lines.append(f"{emitter:>4} {own.sum():>6} {area.sum():>8.4f} {color}")
    return NotedImage(_text(lines), "\n".join(lines))


def _range(values: np.ndarray) -> str:
    if values.size == 0 or values.dtype.kind not in "iufb":
        return ""
    values = values.astype(np.float64)
    return f"{values.min():.4g} .. {np.median(values):.4g} .. {values.max():.4g}"


def _text(lines: list[str]) -> np.ndarray:
    from PIL import Image, ImageDraw, ImageFont

    text, font = "\n".join(lines), ImageFont.load_default_imagefont()  # fixed width, small
    _, _, right, bottom = ImageDraw.Draw(Image.new("L", (1, 1))).multiline_textbbox((0, 0), text, font)
    image = Image.new("RGB", (int(right) + 12, int(bottom) + 12), "white")
    ImageDraw.Draw(image).multiline_text((6, 6), text, "black", font)
    return np.asarray(image.resize((2 * image.width, 2 * image.height), Image.Resampling.NEAREST))
