"""The page that compares methods: nothing that is unknown is shown, and who is first is said."""

import base64
import io
import json

import numpy as np
import pytest
from PIL import Image

from fipt.conventions import FLAG_SATURATED
from fipt.formats.exr import read_rgb, write_exr
from fipt.scene.dataset import Dataset
from fipt.stages.report.comparison import _figure, _quantities, build_comparison
from fipt.stages.report.plots import change_plots, sensitivity_series
from tests.fake_results import maps, write_maps, write_results
from tests.unit.stages.report.test_report import Page

COLUMN = {
    "key": "kd_psnr",
    "label": "kd",
    "unit": "dB",
    "better": "higher",
    "kind": "figure",
    "noise": 0.0,
    "text": "<what kd is>",
}


def row(name, mean, first=False, spread=None, **changed):
    figures = {"kd_psnr": {"mean": mean, "spread": spread, "first": first, "text": "-" if mean is None else str(mean)}}
    said = {"kind": "method", "source": "here", "deviations": "none", "inputs": [], "oracle": [], "not_estimated": []}
    return {"id": name, "label": f"M {name}", "seeds": 2, "figures": figures, **said, **changed}


@pytest.fixture
def page(tmp_path):
    results = write_results(tmp_path / "room")
    for name in ("a", "<b>"):
        for view in ("a", "b", "c"):
            estimate = maps() | {"hit": np.ones((6, 8), np.float32)}
            write_maps(results / "methods" / name / "materials" / f"{view}.exr", estimate)
    methods = [
        row("fipt", 20.0, spread=0.5),
        row("a", 22.0, first=True, kind="ablation", not_estimated=["roughness"]),
        row("<b>", 20.2, spread=0.1, kind="ablation"),
        row("bound", 40.0, kind="bound", oracle=["true materials"]),
    ]
    table = {
        "columns": [COLUMN],
        "methods": methods,
        "not_applicable": {"c": "needs <truth>"},
        "failed": {"d": "fit: no <room>"},
    }
    return Page(build_comparison(results, table, 2, 64))


def test_who_is_first_is_said(page):
    assert "M a: 22.0 Next: M <b>, 20.2. M fipt: 20.0." in page.words
    assert "c not applicable: needs <truth> d failed: fit: no <room>" in page.words


def test_changes_below_the_spread_are_grey(page):
    kinds = [cell.get("class") for cell in page.all("td")]
    assert "better" in kinds
    assert "same" in kinds
    assert "worse" not in kinds


def test_images_are_of_what_is_estimated(page):
    shown = [image["alt"] for image in page.all("img") if "alt" in image]
    assert "M a, Diffuse kd, view c" in shown
    assert "M <b>, Roughness, view c" in shown
    assert "M a, Roughness, view c" not in shown
    assert sum(element.get("class") == "none" for element in page.all("div")) == 2  # M a in two views
    assert not any(value.startswith("http") for tag, attributes in page.tags for value in map(str, attributes.values()))


def test_renderings_are_shown_as_they_were_judged(tmp_path):
    """At the exposure that was fitted, without what is masked or clipped."""
    results = write_results(tmp_path / "room")
    photo = read_rgb(results / "render" / "c.exr")
    write_exr(results / "render" / "c.exr", {"": photo / 2})
    fitted = {"val": {"render_exposure_scale": 2.0}}
    (results / "metrics.json").write_text(json.dumps(fitted))
    valid, flags = np.ones((6, 8), np.float32), np.zeros((6, 8), np.uint32)
    valid[:, :2], flags[:, 2:4] = 0, FLAG_SATURATED
    shown = photo.copy()
    shown[:, :4] = 0.7
    write_exr(results / "dataset" / "images" / "c.exr", {"": shown, "valid.Y": valid, "flags.Y": flags})
    figures = {figure.key: figure for figure in _quantities(Dataset(results / "dataset"), ["c"])}
    figure = _figure(results, figures["render"], [row("fipt", 20.0)], ["c"], 64)
    (cells,), srgb = [cells for _, cells in figure.rows], pixels(figure.truth[0])
    assert pixels(cells[0].error).max() < 3
    assert np.abs(pixels(cells[0].estimate)[:, 4:] - srgb[:, 4:]).mean() < 4
    wrong = maps() | {"kd": maps()["kd"] + np.float32(0.4), "hit": np.ones((6, 8), np.float32)}
    write_maps(results / "materials" / "c.exr", wrong)
    (cells,) = [cells for _, cells in _figure(results, figures["kd"], [row("fipt", 20.0)], ["c"], 64).rows]
    error = pixels(cells[0].error)
    assert error[:, :2].max() < 20 < error[1:, 2:].max(axis=-1).min()  # blurred by the compression


def pixels(image):
    """(6, 8, 3) of an embedded image."""
    data = base64.b64decode(image.src.partition(",")[2])
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB").resize((8, 6), Image.Resampling.BOX)).astype(float)


def test_plots_of_ablations_and_errors():
    own, worse = row("fipt", 20.0), row("a", 18.0, kind="ablation")
    planted = row("noise", 17.0, kind="sensitivity", series="noise", size=2, unit="mm", findings=[{"cause": "Off."}])
    table = {"columns": [COLUMN], "methods": [own, worse, planted], "not_applicable": {}}
    (series,) = sensitivity_series(table)
    (plot,) = series.plots
    assert [(point.x, point.y) for point in plot.points] == [(0.0, 0.0), (200.0, 96.0)]
    assert (plot.low, plot.high) == ("17.0", "20.0")
    assert list(series.findings) == [("M noise", ["Off."])]
    cells = [{"text": "-2.0", "kind": "worse"}]
    (changes,) = change_plots([COLUMN], table["methods"], [{"label": "M a", "cells": cells}])
    assert [(bar.x, bar.kind) for bar in changes.bars] == [(-50.0, "worse")]
