"""The page that compares methods: who is first at what, the table, and a figure for every quantity."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fipt.formats.exr import read_rgb
from fipt.formats.images import srgb_encode
from fipt.scene import display
from fipt.scene.dataset import Dataset, read_layers
from fipt.stages.report import images
from fipt.stages.report.files import read_figures
from fipt.stages.report.images import EmbeddedImage
from fipt.stages.report.page import filled
from fipt.stages.report.plots import change_plots, sensitivity_series

_LAYERS = {"kd": "Diffuse kd", "reflectance": "Reflectance a'", "roughness": "Roughness", "metallic": "Metallic"}
_PLAIN = ("roughness", "metallic")
"""Layers that are numbers: shown in proportion."""


@dataclass(frozen=True)
class Quantity:
    """What a figure shows: its name, where it lies below a run's folder, and the truth of it by view.

    ``left_out`` (H, W) bool, by view: pixels that are not judged, as those that emit in truth are not for materials.
    """

    key: str
    label: str
    folder: str
    layer: str
    truth: Mapping[str, np.ndarray]
    exposure: float = 1.0
    left_out: Mapping[str, np.ndarray] = field(default_factory=dict)

    def read(self, results: Path, view: str) -> np.ndarray | None:
        """(H, W) or (H, W, 3) estimate of a run; None where there is none."""
        path = results / self.folder / f"{view}.exr"
        if not path.is_file():
            return None
        return read_layers(path).get(self.layer) if self.layer else read_rgb(path)

    def shown(self, values: np.ndarray) -> np.ndarray:
        """The values as they are shown, in [0, 1]."""
        values = np.clip(np.nan_to_num(values * self.exposure), 0, 1)
        return values if values.ndim == 2 else srgb_encode(values)


@dataclass(frozen=True)
class ComparedCell:
    """A method's estimate in a view, and its error."""

    estimate: EmbeddedImage
    error: EmbeddedImage


@dataclass(frozen=True)
class ComparedFigure:
    """A figure: views, their truth, and a row of cells for each method; None: not estimated."""

    quantity: Quantity
    views: Sequence[str]
    truth: Sequence[EmbeddedImage]
    rows: Sequence[tuple[Mapping[str, Any], Sequence[ComparedCell | None]]]


def build_comparison(results: Path, table: Mapping[str, Any], views: int, width: int) -> str:
    """Return the page of a scene's comparison: HTML that loads nothing from anywhere."""
    data = Dataset(results / "dataset")
    shown = display.shown_views(data, views)
    figures = [_figure(results, quantity, table["methods"], shown, width) for quantity in _quantities(data, shown)]
    columns = table["columns"]
    ranked = [column for column in columns if column["kind"] == "figure"]
    changes = _changes(ranked, table["methods"])
    return filled(
        "comparison.html",
        ("style.css", "comparison.css"),
        ("script.js",),
        scene=results.name,
        table=table,
        columns=[column for column in columns if column["kind"] != "published"],
        published=[column for column in columns if column["kind"] == "published"],
        winners=winners(table),
        bars=bars(table),
        changes=changes,
        change_plots=change_plots(ranked, table["methods"], changes),
        sensitivity=sensitivity_series(table),
        figures=[figure for figure in figures if figure.views],
        seeds=max((row["seeds"] for row in table["methods"]), default=1),
        difference_range=images.DIFFERENCE_RANGE,
    )


def winners(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Who is first in every column of the table that is ranked."""
    ranked = [column for column in table["columns"] if column["kind"] == "figure"]
    return [winner for column in ranked if (winner := _winner(column, table["methods"]))]


def bars(table: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Column -> method -> length of its bar."""
    return {column["key"]: _bars(column, table["methods"]) for column in table["columns"]}


def _quantities(data: Dataset, views: Sequence[str]) -> Iterator[Quantity]:
    """What there is a truth of, in these views."""
    photos, masked, unknown = {}, {}, {}
    for view in views:
        photos[view], valid = data.image(view)
        masked[view] = valid <= 0
        unknown[view] = masked[view] | data.clipped(view)
    truth = {view: layers for view in views if (layers := data.truth(view)) is not None}
    emits = {view: layers["emission"].max(axis=-1) > 0 for view, layers in truth.items() if "emission" in layers}
    unjudged = {view: masked[view] | emits.get(view, False) for view in truth}
    for layer, label in _LAYERS.items():
        known = {view: layers[layer] for view, layers in truth.items() if layer in layers}
        if known:
            yield Quantity(layer, label, "materials", layer, known, left_out=unjudged)
    known = {view: layers["emission"] for view, layers in truth.items() if "emission" in layers}
    brightest = max((float(values.max()) for values in known.values()), default=0.0)
    if brightest > 0:
        yield Quantity("emission", "Emission", "materials", "emission", known, 1 / brightest, masked)
    exposure = display.common_exposure(photos.values())
    yield Quantity("render", "Re-rendering", "render", "", photos, exposure, unknown)
    for folder in sorted((data.root / "relight_truth").glob("*/")):
        relit = {view: read_rgb(path) for view in views if (path := folder / f"{view}.exr").is_file()}
        if relit:
            own = display.common_exposure(relit.values())
            yield Quantity(f"relit-{folder.name}", f"Relit: {folder.name}", f"relight/{folder.name}", "", relit, own)


def _figure(
    results: Path, quantity: Quantity, methods: Sequence[Mapping[str, Any]], views: Sequence[str], width: int
) -> ComparedFigure:
    there = [view for view in views if (results / quantity.folder / f"{view}.exr").is_file()]  # not all are rendered
    known = [view for view in there if view in quantity.truth]
    truth = [_image("truth", "Truth", quantity.shown(quantity.truth[view]), width) for view in known]
    rows = []
    for row in methods:
        folder = results if row["id"] == "fipt" else results / "methods" / row["id"]
        unknown = quantity.layer in row["not_estimated"]
        # renderings have the exposure by which they were judged
        scale = read_figures(folder / "metrics.json")[1] if quantity.key == "render" else 1.0
        cells = [None if unknown else _cell(folder, quantity, row, view, width, scale) for view in known]
        if unknown or any(cells):
            rows.append((row, cells))
    return ComparedFigure(quantity, known, truth, rows)


def _cell(
    folder: Path, quantity: Quantity, row: Mapping[str, Any], view: str, width: int, scale: float
) -> ComparedCell | None:
    values = quantity.read(folder, view)
    if values is None:
        return None
    estimate, truth = quantity.shown(values * scale), quantity.shown(quantity.truth[view])
    size = np.abs(estimate - truth)
    size = size if size.ndim == 2 else size.mean(axis=-1)
    error = images.error_map(np.where(quantity.left_out.get(view, False), 0, size))
    return ComparedCell(
        _image("estimate", row["label"], estimate, width), _image("error", f"Error of {row['label']}", error, width)
    )


def _image(key: str, label: str, shown: np.ndarray, width: int) -> EmbeddedImage:
    """Values as shown, in [0, 1], or pixels (H, W, 3) uint8, as an image of the page."""
    pixels = shown if shown.dtype == np.uint8 else (shown * 255 + 0.5).astype(np.uint8)
    pixels = np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else pixels
    return EmbeddedImage(key, label, *images.embedded(pixels, width))


def _ranked(column: Mapping[str, Any], methods: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Methods that have a figure and take nothing from the truth, the best first."""
    sign = -1 if column["better"] == "higher" else 1
    known = [
        row
        for row in methods
        if row["figures"][column["key"]]["mean"] is not None
        and row["kind"] not in ("bound", "sensitivity")
        and not row["oracle"]
        and not row.get("views")
    ]
    return sorted(known, key=lambda row: sign * row["figures"][column["key"]]["mean"])


def _winner(column: Mapping[str, Any], methods: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Who is first in a column, and the next behind; None where nobody has a figure."""
    rows = _ranked(column, methods)
    if not rows:
        return None
    first = [row for row in rows if row["figures"][column["key"]]["first"]]
    behind = [row for row in rows if row not in first]
    own = next((row for row in rows if row["id"] == "fipt"), None)
    return {"column": column, "first": first, "next": behind[0] if behind else None, "own": own}


def _bars(column: Mapping[str, Any], methods: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Method -> how far towards the best its figure is, 0 to 1 between the worst and the best of the column."""
    if not column["better"]:
        return {}
    means = {row["id"]: row["figures"][column["key"]]["mean"] for row in methods}
    known = {name: value for name, value in means.items() if value is not None}
    low, high = min(known.values(), default=0), max(known.values(), default=0)
    if high == low:
        return dict.fromkeys(known, 1.0)
    toward = {name: (value - low) / (high - low) for name, value in known.items()}
    return toward if column["better"] == "higher" else {name: 1 - value for name, value in toward.items()}


def _changes(columns: Sequence[Mapping[str, Any]], methods: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What every ablation changes against the scene's own run: its figures' differences, and how they are meant."""
    own = next((row for row in methods if row["id"] == "fipt"), None)
    if own is None:
        return []
    rows = []
    for row in methods:
        if row["kind"] == "ablation":
            cells = [
                _change(column, own["figures"][column["key"]], row["figures"][column["key"]]) for column in columns
            ]
            rows.append({"label": row["label"], "cells": cells})
    return rows


def _change(column: Mapping[str, Any], own: Mapping[str, Any], other: Mapping[str, Any]) -> dict[str, Any]:
    if own["mean"] is None or other["mean"] is None:
        return {"text": "–", "kind": "unknown"}  # noqa: RUF001 (a dash is meant)
    change = other["mean"] - own["mean"]
    digits = 1 if column["unit"] == "dB" else 0 if column["key"] == "false_triangles" else 3
    noise = max(own["spread"] or 0.0, other["spread"] or 0.0, column["noise"])
    if abs(change) <= noise or round(change, digits) == 0:
        return {"text": f"{change:+.{digits}f}", "kind": "same"}
    better = (change > 0) == (column["better"] == "higher")
    return {"text": f"{change:+.{digits}f}", "kind": "better" if better else "worse"}
