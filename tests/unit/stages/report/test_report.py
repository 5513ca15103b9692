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
from fipt.conventions import FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.files import write_text
from fipt.formats.images import write_png
from fipt.scene import display
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import default_name
from fipt.stages.report import capture, content, images, views
from fipt.stages.report.page import build_page, duration, figure, number, size
from fipt.stages.report.selection import Selection
from fipt.stages.report.settings import ReportSettings
from tests.fake_results import write_camera_setup, write_emitters, write_extras, write_results


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
    arguments += ["--relight", root / "relight", "--samples", root / "samples" / "train-000"]
    assert main(["metrics", *map(str, [*arguments, "--out", root / "metrics.json"])]) == 0
    return root


def test_the_page_shows_everything_there_is(results):
    page = Page(build_page(results, ReportSettings()))
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
        {"id": name} for name in ("figures", "views", "room", "emitters", "relit", "checks", "run")
    ]


def test_every_picture_is_embedded_and_nothing_is_loaded(results):
    text = build_page(results, ReportSettings(width=4))
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
    assert not [script for script in page.all("script") if "src" in script]
    assert page.all("meta")[1]["content"].startswith("default-src 'none'; ")
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
    text = build_page(root, ReportSettings())
    page = Page(text)
    assert {script.get("type") for script in page.all("script")} == {
        None,
        "application/json",
        "application/octet-stream",
    }
    assert len(page.all("script")) == text.count("<script")
    assert page.all("b")[:1] == [{}]  # the template's own, around the view's name
    assert len(page.all("b")) == 1
    assert "x&amp;&lt;script&gt;" in text
    assert "onerror" not in "".join(str(attributes) for _, attributes in page.tags)


def test_no_emitter_is_said_in_bold(results):
    write_emitters(results, 0)
    text = build_page(results, ReportSettings())
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
    Page(build_page(results, ReportSettings()))


def test_an_empty_folder_gives_a_page(tmp_path):
    page = Page(build_page(tmp_path, ReportSettings()))
    assert tmp_path.name in page.words
    with pytest.raises(FiptError, match="does not exist"):
        build_page(tmp_path / "nothing", ReportSettings())


def test_a_damaged_file_is_named(results):
    write_text(results / "metrics.json", "{")
    with pytest.raises(FiptError, match=r"metrics\.json is not JSON"):
        build_page(results, ReportSettings())


def test_held_out_views_come_first_and_the_rest_is_counted(results):
    page = Page(build_page(results, ReportSettings(max_views=1)))
    assert "1 more view is in the results folder" in page.words
    assert page.words.count("held out re-rendered") == 1


def test_the_verb_writes_the_page(results, tmp_path):
    out, stats = tmp_path / "page.html", tmp_path / "stats.json"
    arguments = ["report", "--results", results, "--out", out, "--stats", stats]
    assert main([*map(str, arguments)]) == 0
    assert out.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert json.loads(stats.read_text())["page_bytes"] == out.stat().st_size


def test_the_median_is_that_of_all_held_out_views():
    """Twelve of twenty views are shown; the others are worse than all of them."""
    every = {f"v{k}": 20.0 + k if k < 12 else 10.0 for k in range(20)}
    rows = [views.ViewRow(f"v{k}", "val", every[f"v{k}"], {}, {}) for k in range(12)]
    trained = views.ViewRow("t", "train", 21.0, {}, {})
    typical, median = content._typical([trained, *rows], {"val": {"render_psnr_views": every | {"bad": None}}})
    assert (typical.name, median) == ("v1", 21.0)
    assert content._typical([trained], {}) == (None, None)


def test_a_scene_without_held_out_views_is_judged_on_its_training_views(results):
    path = results / "metrics.json"
    figures = json.loads(path.read_text())
    figures["val"] = dict.fromkeys(figures["val"]) | {"pixels": {"materials": 0}}
    path.write_text(json.dumps(figures))
    words = Page(build_page(results, ReportSettings())).words
    assert "Training views against ground truth, 40 pixels counted" in words


def test_one_exposure_brings_the_median_to_middle_grey():
    photos = [np.full((2, 2, 3), 0.1), np.full((2, 4, 3), 0.4), np.zeros((9, 9, 3))]
    assert display.common_exposure(photos) == pytest.approx(0.5)
    assert display.common_exposure([]) == 1.0


def test_a_video_and_some_of_its_frames(results, monkeypatch):
    write_camera_setup(results)
    text = build_page(results, ReportSettings())
    page = Page(text)
    (video,) = page.all("video")
    kind, _, data = video["src"].partition(";base64,")
    assert kind == "data:video/mp4"
    assert base64.b64decode(data) == (results / "relight" / "walk.mp4").read_bytes()
    assert "controls" in video
    assert video["poster"].startswith("data:image/webp;base64,")
    assert "walk 6 images frame-0001 frame-0003 frame-0004 frame-0006" in page.words
    assert "media-src data:" in page.all("meta")[1]["content"]
    # a setup without cameras is still shown by views; a path as large as this only by its name
    assert "c As captured, re-rendered dim" in page.words
    monkeypatch.setattr(views, "_LARGEST_VIDEO", 100)
    page = Page(build_page(results, ReportSettings()))
    assert page.all("video") == []
    assert "The video is too large for this page: relight/walk.mp4" in page.words
    (results / "relight" / "walk.mp4").unlink()
    page = Page(build_page(results, ReportSettings()))
    assert "walk 6 images" in page.words
    assert "The video is" not in page.words


def test_a_camera_of_a_setup_may_be_called_as_a_view(results):
    write_camera_setup(results, 3)
    for path in (results / "relight" / "walk").iterdir():
        path.rename(path.with_stem(path.stem.replace("frame-0002", "c")))
    write_exr(results / "relight" / "walk" / "c.exr", {"": np.full((40, 30, 3), 0.5, np.float32)})
    manifest = results / "relight" / "walk.manifest.json"
    manifest.write_text(manifest.read_text().replace("frame-0002", "c"))
    (film,) = content.gather(results, ReportSettings(), Selection(["dim"], ["walk"])).camera_setups
    assert [(seen.label, seen.width, seen.height) for seen in film.shown if seen.label == "c"] == [("c", 30, 40)]


def setup_manifest(name, scale):
    """Write the manifest of a shard that was rendered under lamps of this scale."""
    write_text(name, json.dumps({"settings": {"setup": {"emitters": [{"scale": scale}]}}}))


def test_a_setup_is_shown_as_it_is_now_not_as_it_was(results):
    """Setup walk was filmed and is seen by views now; then the other way round, and deleted."""
    write_camera_setup(results)
    relight = results / "relight"
    write_exr(relight / "walk" / "c.exr", {"": np.full((6, 8, 3), 0.3, np.float32)})
    setup_manifest(relight / "walk.camera-000.manifest.json", 0.11)
    setup_manifest(relight / "walk.val-000.manifest.json", 0.22)
    seen = content.gather(results, ReportSettings(), Selection(["dim", "walk"], []))
    assert [picture.label for picture in seen.relit[0].relit] == ["dim", "walk"]
    assert seen.camera_setups == []
    assert "0.22" in seen.setups["walk"]
    filmed = content.gather(results, ReportSettings(), Selection([], ["walk"]))
    assert [film.setup for film in filmed.camera_setups] == ["walk"]
    assert filmed.relit == []
    assert list(filmed.setups) == ["walk"]
    assert "0.11" in filmed.setups["walk"]
    # By hand, nobody says what the setups are now: what was filmed is a film.
    held = content.gather(results, ReportSettings())
    assert [film.setup for film in held.camera_setups] == ["walk"]
    assert [picture.label for picture in held.relit[0].relit] == ["dim"]


def test_the_verb_is_told_which_setups_there_are(results, tmp_path):
    write_camera_setup(results)
    arguments = [
        "report",
        "--results",
        results,
        "--out",
        tmp_path / "page.html",
        "--setups",
        "",
        "--camera-setups",
        "walk",
    ]
    assert main([*map(str, arguments)]) == 0
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "walk 6 images" in page.words
    assert "As captured, re-rendered dim" not in page.words


def test_the_verb_is_told_which_sections_there_are(results, tmp_path, capsys):
    for name in ("poses/poses.json", "geometry/geometry.json", "capture/qa.json", "export/check.json"):
        write_text(results / name, "{}")  # of a run before, and of another form
    options = ["report", "--results", str(results), "--out", str(tmp_path / "page.html")]
    assert main([*options, "--sections", ""]) == 0
    assert main([*options, "--sections", "poses"]) == 2
    assert "poses.json is not what fipt pose writes" in capsys.readouterr().err
    assert main([*options, "--sections", "mesh"]) == 2
    assert "sections must be some of capture, poses, geometry, export; found 'mesh'" in capsys.readouterr().err


def test_a_setup_has_its_own_manifest_not_that_of_a_longer_name(results):
    for name in ("dim.a", "dim"):
        write_exr(results / "relight" / name / "c.exr", {"": np.full((6, 8, 3), 0.3, np.float32)})
    setup_manifest(results / "relight" / "dim.a.val-000.manifest.json", 0.11)
    setup_manifest(results / "relight" / "dim.val-000.manifest.json", 0.22)
    setups = content.gather(results, ReportSettings()).setups
    assert "0.11" in setups["dim.a"]
    assert "0.22" in setups["dim"]


def test_emitters_of_an_older_version_have_their_default_names(results):
    path = results / "round-1" / "emitters.json"
    write_emitters(results, 2)
    listed = json.loads(path.read_text())
    for emitter in listed["emitters"]:
        del emitter["name"]
    path.write_text(json.dumps(listed))
    assert [lamp["name"] for lamp in content.gather(results, ReportSettings()).emitters] == [
        default_name(0),
        default_name(1),
    ]


def test_a_photograph_stands_beside_its_relit_view(results, tmp_path):
    photo = 3 * read_rgb(results / "relight" / "dim" / "c.exr")
    write_exr(tmp_path / "photos" / "c.exr", {"": photo})
    arguments = ["--dataset", results / "dataset", "--materials", results / "materials"]
    arguments += ["--render", results / "render", "--emitters", results / "round-1" / "emitters.npz"]
    arguments += ["--relight", results / "relight", "--reference", f"dim={tmp_path / 'photos'}"]
    assert main(["metrics", *map(str, [*arguments, "--out", results / "metrics.json"])]) == 0
    page = Page(build_page(results, ReportSettings()))
    assert "As captured, re-rendered dim dim, photographed" in page.words
    assert "multiplied by 0.333, fitted to the relit views" in page.words
    shown = {image["alt"]: image["src"] for image in page.all("img") if "src" in image}
    assert shown["dim, photographed, view c"] == shown["dim, view c"]
    (tmp_path / "photos" / "c.exr").unlink()  # as when results are moved to another machine
    assert "photographed, view c" not in build_page(results, ReportSettings())


def test_maps_are_transparent_where_nothing_is_hit():
    pixels = images.surface_map(np.array([[0.5, 1.0]]), np.array([[1.0, 0.0]]), encode=False)
    assert pixels.tolist() == [[[128, 128, 128, 255], [255, 255, 255, 0]]]


def test_difference_is_black_where_pictures_agree():
    photo = np.array([[[0.2] * 3, [0.0] * 3]])
    pixels = images.difference_map(np.array([[[0.2] * 3, [1.0] * 3]]), photo, 1.0)
    assert pixels[0, 0].tolist() == [0, 0, 3]
    assert pixels[0, 1].min() > 150


def test_a_swatch_is_the_lamps_colour_at_full_brightness():
    assert images.swatch([8.0, 4.0, 0.0]) == "#ffbc00"
    assert images.swatch([0.0, 0.0, 0.0]) == "#000000"


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


# --- capture --------------------------------------------------------------------------------------


def write_capture(root):
    """A capture report: view a is fine, b has a clipped lamp, c was rejected; a lens with vignetting."""
    frame = {"file": "1.arw", "shutter": 0.1, "stops": 0.0, "ratio": None, "measured": None}
    short = {"file": "2.arw", "shutter": 0.025, "stops": -2.0, "ratio": 4.0, "measured": 4.2}
    figures = {"accepted": True, "frames": [frame, short], "clipped": 0.031, "noisy": 0.0, "dynamic_range": 18.25}
    figures |= {"sharpness": 0.9, "moved": 0.0, "white_balance": [2.0, 1.0, 1.5]}
    views = {"a": figures, "b": figures, "c": {"accepted": False, "reason": "c.arw is <truncated>"}}
    finding = {"kind": "clipped", "severity": "warning", "views": ["b"]}
    finding |= {"message": "view b: the shortest exposure is clipped", "remedy": "add shorter exposures"}
    board = {"kind": "checkerboard", "rms": 0.123, "frames": ["1", "2"], "not_found": 1, "model": "k1"}
    curve = {"curve": [[0.1, 0.99], [0.9, 0.6]], "spread": 0.001, "corner": 0.5}
    calibration = {"sources": {"lens": "checkerboard (2 frames)"}, "absent": ["no white reference"]}
    calibration |= {"figures": {"board": board, "vignetting": curve}, "vignetting": [-0.4, -0.1]}
    content = {"views": views, "findings": [finding], "calibration": calibration}
    content["exposure"] = {"scale": 0.25, "from": "which brings the median luminance to 0.2"}
    write_text(root / "capture" / "qa.json", json.dumps(content))
    flags = np.zeros((6, 8), np.uint32)
    flags[0] = FLAG_SATURATED
    write_exr(root / "dataset" / "images" / "b.exr", {"": np.full((6, 8, 3), 0.2, np.float32), "flags.Y": flags})


def test_the_capture_has_a_section_where_there_is_a_report(results):
    write_capture(results)
    write_text(results / "dataset" / "views.json", '{"views": {}}')
    text = build_page(results, ReportSettings())
    page = Page(text)
    for said in (
        "3 photographed views , 1 of them rejected",
        "Warning. view b: the shortest exposure is clipped . Add shorter exposures .",
        "rejected: c.arw is <truncated>",
        "2 over 2 EV",
        "5.0%",
        "3.1%",
        "lens: checkerboard (2 frames)",
        "no white reference",
        "reprojection error 0.12 pixels rms (checkerboard, 2 frames, not found in 1)",
    ):
        assert said.replace(" ", "") in page.words.replace(" ", ""), said
    assert "<truncated>" not in text
    (curve,) = page.all("polyline")
    last = curve["points"].split()[-1]
    assert [float(v) for v in last.split(",")] == pytest.approx([1.0, 0.5])  # corner: 1 - 0.4 - 0.1 of the light
    assert len(page.all("circle")) == 2


def test_clipped_pixels_are_marked_in_the_thumbnail(results):
    write_capture(results)
    data = Dataset(results / "dataset")
    pixels = capture.marked(data, "b", 1.0)
    np.testing.assert_array_equal(pixels[0], np.tile(capture.MARKS[FLAG_SATURATED], (8, 1)))
    np.testing.assert_array_equal(pixels[1:], display.tone_mapped(data.image("b")[0], 1.0)[1:])


def test_a_damaged_capture_report(results):
    write_text(results / "capture" / "qa.json", "{}")
    with pytest.raises(FiptError, match=r"qa\.json is not a capture report"):
        build_page(results, ReportSettings())


def test_estimated_poses_have_a_section(results):
    found = {"accepted": True, "reason": None, "features": 900, "neighbours": ["b"], "points": 77, "track_length": 3.25}
    found |= {"error": 0.456, "agreement": {"shift": 0.0012, "turn": 0.034}, "spread": None}
    lost = {"accepted": False, "reason": "no pose: <nothing> to see"}
    content = {"views": {"a": found, "b": {**found, "neighbours": ["a", "c"]}, "c": lost}, "points": 123, "error": 0.5}
    content["graph"] = [{"views": ["a", "b"], "matches": 40, "shared_points": 30}]
    content["graph"].append({"views": ["a", "c"], "matches": 16, "shared_points": 0})
    content["groups"] = [["a", "b"], ["d", "e"]]
    run = {"incremental": [2], "global": [], "agreeing": 2, "believed": 2}
    content["runs"] = [{"min_matches": 15, **run}, {"min_matches": 30, **run}]
    content |= {"min_matches": 15, "align": {"from": "reference", "scale": 1.23456, "outliers": {"b": 0.5}}}
    write_text(results / "poses" / "poses.json", json.dumps(content))
    write_png(results / "poses" / "poses.png", np.zeros((4, 6, 3), np.uint8))
    text = build_page(results, ReportSettings())
    page = Page(text)
    for said in (
        "2 of 3 views have a pose, from 123 points with a mean reprojection error of 0.50 pixels",
        "1 pairs of views share points; fewest neighbours has a: 1",
        "Weakly linked with the others: d, e.",
        "900 77 3.2 0.46 1 0.12%, 0.03°",
        "rejected: no pose: <nothing> to see",
        "15 matches link two views (used): models of 2 cameras by incremental, none by global mapping",
        "scale: 1.235",
        "outliers: b 0.5",
    ):
        assert said.replace(" ", "") in page.words.replace(" ", ""), said
    assert "<nothing>" not in text
    assert any("Cameras and points" in image["alt"] for image in page.all("img"))
    write_text(results / "poses" / "poses.json", "{}")
    with pytest.raises(FiptError, match=r"poses\.json is not what fipt pose writes"):
        build_page(results, ReportSettings())


def test_lamps_have_names_and_pictures(results):
    """The list with names, where there is one, and not the last round's; names are text, never markup."""
    content = json.loads((results / "round-1" / "emitters.json").read_text())
    content["emitters"][0] |= {"name": "</script><b>desk", "thumbnail": "emitter-0.png"}
    write_text(results / "emitters" / "emitters.json", json.dumps(content))
    write_png(results / "emitters" / "emitter-0.png", np.full((72, 96, 3), 90, np.uint8))
    page = build_page(results, ReportSettings())
    assert "<b>desk" not in page
    section = page[page.index('<section id="emitters">') :]
    assert '<th scope="row">&lt;/script&gt;&lt;b&gt;desk</th>' in section
    assert 'width="96" height="72" alt="&lt;/script&gt;&lt;b&gt;desk, outlined"' in section
    (results / "emitters" / "emitter-0.png").unlink()
    with pytest.raises(FiptError, match=r"the image of an emitter is missing: .*emitter-0\.png"):
        build_page(results, ReportSettings())


def test_lamps_that_are_lower_bounds_say_so(results):
    path = results / "round-1" / "emitters.json"
    content = json.loads(path.read_text())
    content["emitters"][0]["lower_bound"] = True
    write_text(path, json.dumps(content))
    assert "≥ 4" in Page(build_page(results, ReportSettings())).words
