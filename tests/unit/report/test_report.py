"""The page: self-contained, escaped, and content with whatever files there are."""

import base64
import io
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.io.files import write_text
from fipt.report import pictures
from fipt.report.page import build_page, duration, figure, number, size
from fipt.settings import Report
from tests.fake_results import write_emitters, write_extras, write_results


class Page(HTMLParser):
    """Tags and attributes of a page, and whether its elements are nested properly."""

    VOID = ("meta", "img", "br", "link", "input")

    def __init__(self, text):
        super().__init__()
        self.tags, self.open, self.text = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def words(self):
        return " ".join(" ".join(self.text).split())


@pytest.fixture
def results(tmp_path):
    """A whole results folder, metrics and all."""
    root = write_results(tmp_path / "scene")
    write_extras(root)
    arguments = ["--dataset", root / "dataset", "--materials", root / "materials"]
    arguments += ["--render", root / "render", "--emitters", root / "round-1" / "emitters.npz"]
    arguments += ["--relight", root / "relight", "--hits", root / "hits" / "train-000"]
    assert main(["metrics", *map(str, [*arguments, "--out", root / "metrics.json"])]) == 0
    return root


def test_the_page_shows_everything_there_is(results):
    page = Page(build_page(results, Report()))
    for text in (
        "Diffuse kd 20.0 dB",
        "Relit: dim",
        "bake · round 0",
        "1 min 15 s",
        "1.50 GB",
        "2M rays/s",
        "More than half of the pixels miss the mesh in b.",
        "View a was rejected: it is blurred.",
        "Ground truth",
        "Error by confidence",
        "0.8 to 1.0 25 20.0 100.0 0.000 0.000",
        '"diffuse_spp": 64',
        '"scale": 0.5',
        "Mesh edges over a photo",
        "one exposure",
    ):
        assert text in page.words
    assert "No emitter was found" not in page.words
    assert [heading for tag, heading in page.tags if tag == "section"] == [
        {"id": name} for name in ("figures", "views", "emitters", "relit", "checks", "run")
    ]


def test_every_picture_is_embedded_and_nothing_is_loaded(results):
    text = build_page(results, Report(width=4))
    page = Page(text)
    sources = [image["src"] for image in page.all("img") if "src" in image]
    assert len(sources) > 20
    for source in sources:
        assert source.startswith("data:image/webp;base64,")
        image = Image.open(io.BytesIO(base64.b64decode(source.partition(",")[2])))
        assert image.width <= 8
    assert [link["href"] for link in page.all("a") if not link["href"].startswith("#")] == [
        "https://arxiv.org/abs/2304.05669"
    ]
    assert set(re.findall(r"https?://[^\s\"'<)]+", text)) == {"https://arxiv.org/abs/2304.05669"}
    assert page.all("link") == []
    assert [script for script in page.all("script") if script] == []
    assert "url(" not in text
    assert "@import" not in text
    assert all(image.get("alt") for image in page.all("img") if "src" in image)


def test_names_and_messages_are_escaped(tmp_path):
    root = write_results(tmp_path / "<script>alert(1)<" / "x&<script>")
    write_text(
        root / "stats" / "fit.round-0.json",
        json.dumps({"wall_s": 1, "warnings": ["<img src=x onerror=y>"], "settings": {"</pre>": 1}}),
    )
    (root / "relight" / "dim").rename(root / "relight" / '"><b>')
    text = build_page(root, Report())
    page = Page(text)
    assert page.all("script") == [{}]
    assert page.all("b")[:1] == [{}]  # the template's own, around the view's name
    assert len(page.all("b")) == 1
    assert "x&amp;&lt;script&gt;" in text
    assert "onerror" not in "".join(str(attributes) for _, attributes in page.tags)


def test_no_emitter_is_said_in_bold(results):
    write_emitters(results, 0)
    text = build_page(results, Report())
    assert text.count("<strong>No emitter was found.</strong>") == 2
    Page(text)


@pytest.mark.parametrize(
    "missing",
    [
        "metrics.json",
        "render/c.exr",
        "materials/c.exr",
        "dataset/truth/c.exr",
        "dataset/images/c.exr",
        "dataset/views.json",
        "dataset/overlay.png",
        "round-1/emitters.json",
        "relight/dim/c.exr",
        "relight/dim.val-000.manifest.json",
        "stats/bake.round-0.train-000.json",
    ],
)
def test_a_missing_file_is_no_error(results, missing):
    (results / missing).unlink()
    Page(build_page(results, Report()))


def test_an_empty_folder_gives_a_page(tmp_path):
    page = Page(build_page(tmp_path, Report()))
    assert tmp_path.name in page.words
    with pytest.raises(FiptError, match="does not exist"):
        build_page(tmp_path / "nothing", Report())


def test_a_damaged_file_is_named(results):
    write_text(results / "metrics.json", "{")
    with pytest.raises(FiptError, match=r"metrics\.json is not JSON"):
        build_page(results, Report())


def test_held_out_views_come_first_and_the_rest_is_counted(results):
    page = Page(build_page(results, Report(max_views=1)))
    assert "1 more view is in the results folder" in page.words
    assert page.words.count("held out re-rendered") == 1


def test_the_verb_writes_the_page(results, tmp_path):
    out, stats = tmp_path / "page.html", tmp_path / "stats.json"
    arguments = ["report", "--results", results, "--out", out, "--stats", stats]
    assert main([*map(str, arguments)]) == 0
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert json.loads(stats.read_text())["page_bytes"] == out.stat().st_size


def test_one_exposure_brings_the_median_to_middle_grey():
    photos = [np.full((2, 2, 3), 0.1), np.full((2, 4, 3), 0.4), np.zeros((9, 9, 3))]
    assert pictures.common_exposure(photos) == pytest.approx(0.5)
    assert pictures.common_exposure([]) == 1.0


def test_maps_are_transparent_where_nothing_is_hit():
    pixels = pictures.surface_map(np.array([[0.5, 1.0]]), np.array([[1.0, 0.0]]), encode=False)
    assert pixels.tolist() == [[[128, 128, 128, 255], [255, 255, 255, 0]]]


def test_difference_is_black_where_pictures_agree():
    photo = np.array([[[0.2] * 3, [0.0] * 3]])
    pixels = pictures.difference_map(np.array([[[0.2] * 3, [1.0] * 3]]), photo, 1.0)
    assert pixels[0, 0].tolist() == [0, 0, 3]
    assert pixels[0, 1].min() > 150


def test_a_swatch_is_the_lamps_colour_at_full_brightness():
    assert pictures.swatch([8.0, 4.0, 0.0]) == "#ffbc00"
    assert pictures.swatch([0.0, 0.0, 0.0]) == "#000000"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (number(None), "–"),  # noqa: RUF001
        (number(12345.6), "12346"),
        (number(0.01234), "0.0123"),
        (figure(21.96), "22.0"),
        (figure(0.5, "L1"), "0.500"),
        (duration(3.21), "3.2 s"),
        (duration(185), "3 min 05 s"),
        (duration(7260), "2 h 01 min"),
        (size(4.2e8), "420 MB"),
    ],
)
def test_numbers_for_people(text, expected):
    assert text == expected
