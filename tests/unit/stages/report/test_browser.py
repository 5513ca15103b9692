"""The page in a browser: what the controls do, and that nothing fails or is loaded."""

import base64
import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from fipt.conventions import LUMINANCE
from fipt.formats.images import srgb_decode, srgb_encode
from fipt.scene.emitters import default_name
from fipt.scene.setup import RelightSetup
from fipt.stages.report import images, page, room
from fipt.stages.report.content import gather
from fipt.stages.report.settings import ReportSettings
from tests import browser as chromium
from tests import scenes
from tests.fake_results import olat_layers, write_camera_setup, write_extras, write_olat, write_results

FIRST = default_name(0)

pytestmark = pytest.mark.skipif(chromium.executable() is None, reason="needs Chromium: apt-get install chromium")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """One browser for all tests of this file."""
    opened = chromium.Browser(tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    """What the page shows: small fake results, and in 3D a room with one colour a wall."""
    root = write_results(tmp_path_factory.mktemp("results") / "a <b>& <script> room")
    write_extras(root)
    write_olat(root)
    write_camera_setup(root)
    (root / "dataset" / "views.json").unlink()
    return replace(gather(root, ReportSettings()), room=walls())


def walls():
    """A box room seen from its middle: -x red, +x green, -z blue; the rest grey."""
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 4, (6, 4000, 3))
    colors = np.full((6, 4000, 3), 0.3)
    for wall in range(6):
        places[wall, :, wall // 2] = 4 * (wall % 2)
    for wall, color in ((0, (0.6, 0, 0)), (1, (0, 0.6, 0)), (4, (0, 0, 0.6))):
        colors[wall] = color
    model = room.colored(scenes.box((0, 0, 0), (4, 4, 4)), places.reshape(-1, 3), colors.reshape(-1, 3))
    ahead = room.Viewpoint("ahead", [2, 2, 2], [0, 0, -1], 60)
    lamp = room.Marker(FIRST, FIRST, "#ffffff", [2, 3, 1])
    return room.RoomModel(images.packed(model), False, [0, 1, 0], [ahead], [lamp])


@pytest.fixture
def shown(browser, content, tmp_path):
    """The page, opened."""
    return open_page(browser, content, tmp_path)


def open_page(browser, content, folder):
    path = folder / "report.html"
    path.write_text(page.render(content), encoding="utf-8")
    browser.said.clear()
    browser.look(1200, 800)
    browser.open(path)
    browser.wait("document.getElementById('mixer').dataset.ready")
    return browser


def set_control(browser, selector, value):
    """Move a control as a person would: its value, then the event."""
    name = "checked" if isinstance(value, bool) else "value"
    browser.run(
        f"(() => {{ const control = document.querySelector({json.dumps(selector)});"
        f" control.{name} = {json.dumps(value)}; control.dispatchEvent(new Event('input', {{bubbles: true}}));"
        " return new Promise(requestAnimationFrame); })()"
    )


def canvas(browser):
    """(H, W, 3) pixels of the mixed view."""
    script = (
        "new Promise((done) => requestAnimationFrame(() => done(document.querySelector('.mix canvas').toDataURL())))"
    )
    data = browser.run(script).partition(",")[2]
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        return np.array(image.convert("RGB"), np.float64)


CURVES = {
    "clip": lambda x: x,
    "soft": lambda x: x * (1 + x / 16) / (1 + x),
    "film": lambda x: x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14),
}


def expected(content, gains, stops=0.0, curve="clip"):
    """The mix by the linear model: layer -> gain of each channel."""
    mixed = sum(layer * np.array(gains.get(name, 1.0)) for name, layer in olat_layers().items())
    linear = CURVES[curve](mixed * content.exposure * 2.0**stops)
    return 255 * srgb_encode(np.clip(linear, 0, 1))


def check(browser, content, gains, **display):
    pixels = canvas(browser)
    np.testing.assert_allclose(pixels, expected(content, gains, **display), atol=0.75)  # half for the rounding
    assert np.ptp(pixels) > 50
    assert browser.said == []


def test_at_first_the_room_is_as_it_was_captured(shown, content):
    check(shown, content, {})


def test_strength_and_switch_of_every_part(shown, content):
    set_control(shown, f"#mix-{FIRST} [name=strength]", 1.5)
    check(shown, content, {FIRST: 2.25})
    set_control(shown, "#mix-rest [name=strength]", 0.5)
    set_control(shown, "#mix-outside [name=on]", False)
    check(shown, content, {FIRST: 2.25, "rest": 0.25, "outside": 0})
    shown.run("document.querySelector('#mix-rest [data-only]').click()")
    check(shown, content, {FIRST: 0, "rest": 0.25, "outside": 0})
    shown.run("document.querySelector('#mix-rest [data-only]').click()")
    check(shown, content, {FIRST: 2.25, "rest": 0.25})
    shown.run("document.querySelector('[type=reset]').click()")
    shown.run("new Promise((done) => setTimeout(done, 100))")
    check(shown, content, {})


def recolored(color):
    """Gains of lamp 0, whose radiance is 4, 4, 2, in a colour of the same luminance."""
    linear, own = srgb_decode(np.array(color) / 255), np.array([4.0, 4, 2])
    return linear * (own @ LUMINANCE) / (linear @ LUMINANCE) / own


def test_another_colour_keeps_the_luminance(shown, content):
    set_control(shown, f"#mix-{FIRST} [name=color]", "#4080ff")
    gain = recolored([0x40, 0x80, 0xFF])
    assert (gain * [4, 4, 2]) @ LUMINANCE == pytest.approx(np.dot([4, 4, 2], LUMINANCE))
    check(shown, content, {FIRST: gain})
    assert not shown.run("document.querySelector('#mix-rest [name=color]') !== null")


@pytest.mark.parametrize(("curve", "stops"), [("soft", 1.5), ("film", -1.0), ("clip", 2.0)])
def test_exposure_and_tone_curve(shown, content, curve, stops):
    set_control(shown, "[name=exposure]", stops)
    set_control(shown, "[name=curve]", curve)
    check(shown, content, {}, stops=stops, curve=curve)


def test_the_mix_is_a_light_setup_that_gives_the_same_light(shown, content):
    """The setup's own meaning of its keys, applied to the emitters, against the gains of the page."""
    text = "document.querySelector('.setup').textContent"
    assert yaml.safe_load(shown.run(text)) == {"setups": {"mix": {}}}
    set_control(shown, f"#mix-{FIRST} [name=strength]", 1.2)
    set_control(shown, f"#mix-{FIRST} [name=color]", "#4080ff")
    set_control(shown, "#mix-rest [name=on]", False)
    set_control(shown, "#mix-outside [name=strength]", 0.5)
    setup = RelightSetup.model_validate(yaml.safe_load(shown.run(text))["setups"]["mix"])
    assert setup.environment.scale == pytest.approx(0.25)
    assert [(edit.called, edit.scale) for edit in setup.emitters] == [
        ((FIRST,), pytest.approx(1.44)),
        ((default_name(1), default_name(2)), 0),
    ]
    first = setup.emitters[0]
    color = np.array(first.color)
    meant = first.scale * (np.dot([4, 4, 2], LUMINANCE) / (color @ LUMINANCE)) * color / [4, 4, 2]
    np.testing.assert_allclose(meant, 1.44 * recolored([0x40, 0x80, 0xFF]), rtol=1e-3)
    check(shown, content, {FIRST: meant, "rest": 0, "outside": 0.25})


def test_the_keyboard_moves_every_control(shown, content):
    shown.run(f"document.querySelector('#mix-{FIRST} [name=strength]').focus()")
    for _ in range(10):
        shown.press("ArrowLeft", 37)
    check(shown, content, {FIRST: 0.81})
    shown.run("document.querySelector('.stage input').focus()")
    for _ in range(4):
        shown.press("ArrowRight", 39)
    assert shown.run("document.querySelector('.stage').style.getPropertyValue('--at')") == "52%"
    controls = "[...document.querySelectorAll('main button, main input, main select, main canvas[tabindex]')]"
    assert shown.run(f"{controls}.filter((control) => control.tabIndex < 0).length") == 0
    unnamed = f"{controls}.filter((c) => !c.labels?.length && !c.ariaLabel && !c.textContent.trim())"
    assert shown.run(f"{unnamed}.map((control) => control.outerHTML.slice(0, 80))") == []


def test_layers_and_truth_beside_the_photograph(shown):
    source = "(at) => document.querySelectorAll('.stage img')[at].src"
    thumb = "document.querySelector('[data-layer=KEY] img').src"
    assert shown.run(f"({source})(1) === {thumb.replace('KEY', 'photo')}")
    assert shown.run(f"({source})(0) === {thumb.replace('KEY', 'render')}")
    assert shown.run("document.querySelector('[name=truth]').disabled")  # a photograph is its own truth
    shown.run("document.querySelector('[data-layer=roughness]').click()")
    assert shown.run(f"({source})(0) === {thumb.replace('KEY', 'roughness')}")
    shown.run("document.querySelector('[name=truth]').click()")
    assert shown.run(f"({source})(1) === document.querySelector('[data-truth=roughness] img').src")
    assert shown.run("document.querySelector('.side').textContent") == "Roughness, truth"


def test_every_picture_loads_and_nothing_else_does(shown):
    assert shown.run("document.images.length") > 25
    shown.run("Promise.all([...document.images].map((image) => image.src && image.decode()))")
    assert shown.run("[...document.images].filter((image) => image.src && !image.naturalWidth).length") == 0
    assert shown.run("performance.getEntriesByType('resource').filter((e) => !e.name.startsWith('data:')).length") == 0
    assert shown.run("document.title").startswith("a <b>& <script> room")
    assert shown.said == []


def test_the_video_plays(shown):
    video = "document.querySelector('video')"
    shown.run(f"{video}.scrollIntoView(); {video}.play()")
    shown.wait(f"{video}.readyState >= 2 && {video}.currentTime > 0")
    assert shown.run(f"[{video}.videoWidth, {video}.videoHeight, {video}.duration]") == [8, 6, 1.5]
    assert shown.said == []


@pytest.mark.parametrize(("width", "dark", "phone"), [(1440, True, False), (800, False, False), (390, False, True)])
def test_nothing_is_wider_than_the_window(shown, width, dark, phone):
    shown.look(width, 800, dark, phone)
    assert shown.run("document.documentElement.scrollWidth") == width
    paper = shown.run("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, paper[4:-1].split(","))) < 384) is dark


# --- 3D -------------------------------------------------------------------------------------------


def middle(browser, tmp_path):
    """Colour in the middle of the 3D view."""
    browser.wait("document.getElementById('room').dataset.ready")
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    box = "document.querySelector('.space canvas').getBoundingClientRect()"
    x, y = browser.run(f"(() => {{ const b = {box}; return [b.x + b.width / 2, b.y + b.height / 2]; }})()")
    browser.screenshot(tmp_path / "shot.png")
    with Image.open(tmp_path / "shot.png") as shot:
        return np.array(shot.convert("RGB"))[int(y), int(x)]


def stand(browser, place):
    browser.run("document.getElementById('room').scrollIntoView({behavior: 'instant'})")
    browser.wait("document.getElementById('room').dataset.ready")
    select = "document.querySelector('#room select')"
    browser.run(f"{select}.value = '{place}'; {select}.dispatchEvent(new Event('change'))")


def test_the_room_is_walked_through(shown, tmp_path):
    stand(shown, 0)
    assert middle(shown, tmp_path).argmax() == 2  # blue is ahead
    # straight ahead the light is 1.25 (0.45 + 0.3), on the wall's 0.6
    assert middle(shown, tmp_path)[2] == pytest.approx(255 * srgb_encode(np.array(0.6 * 1.25 * 0.75)), abs=3)
    shown.run("document.querySelector('.space canvas').focus()")
    for _ in range(20):  # of 0.08 radians
        shown.press("ArrowRight", 39)
    assert middle(shown, tmp_path).argmax() == 1  # green is to the right
    for _ in range(40):
        shown.press("ArrowLeft", 37)
    assert middle(shown, tmp_path).argmax() == 0
    assert shown.said == []


def test_the_lamp_is_marked_where_it_is(shown, tmp_path):
    """The lamp is 1 m ahead and 1 m above: at 60 degrees of view it lies outside; 1 m lower and 2 m back, in sight."""
    stand(shown, 0)
    middle(shown, tmp_path)
    assert shown.run("document.querySelector('.mark-lamp').hidden")
    shown.run("document.querySelector('.space canvas').focus()")
    step = 0.02 * np.sqrt(48)  # of a key, metres
    for _ in range(10):
        shown.press("s", 83)
    middle(shown, tmp_path)
    style = "document.querySelector('.mark-lamp').style"
    left, top = (float(shown.run(f"{style}.{side}")[:-1]) for side in ("left", "top"))
    assert left == pytest.approx(50, abs=0.1)
    assert top == pytest.approx(50 - 50 / np.tan(np.radians(30)) / (1 + 10 * step), abs=0.1)
    assert shown.run("document.querySelector('.mark-lamp').getAttribute('href')") == f"#mix-{FIRST}"


def test_textures_and_turned_nodes_of_other_programs(browser, content, tmp_path):
    """A quad with a texture, orange above and teal below, in a node that turns and moves it; written by trimesh."""
    colors = np.uint8([[[230, 120, 40]] * 8] * 4 + [[[20, 110, 120]] * 8] * 4)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(colors))
    visual = trimesh.visual.TextureVisuals(uv=(corners[:, :2] + 1) / 2, material=material)
    quad = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)
    scene = trimesh.Scene()
    place = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0])
    place[:3, 3] = [5, 1, 2]
    scene.add_geometry(quad, transform=place)
    buffer = io.BytesIO(scene.export(file_type="glb"))
    seen = [room.Viewpoint(name, [2, 1 + y, 2], [1, 0, 0], 40) for name, y in (("high", 0.5), ("low", -0.5))]
    model = room.RoomModel(images.packed(buffer.getvalue()), True, [0, 1, 0], seen, [])
    shown = open_page(browser, replace(content, room=model), tmp_path)
    for number, row in enumerate((0, 7)):
        stand(shown, number)
        light = 1.25 * (0.45 + 0.3 * np.cos(np.arctan2(0, 3)) - 0.1)  # it faces away from the side that has more light
        expected = 255 * srgb_encode(srgb_decode(colors[row, 0] / 255) * light)
        np.testing.assert_allclose(middle(shown, tmp_path), expected, atol=4)
    assert shown.said == []


def test_a_browser_is_found_by_its_name(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", {"google-chrome": "/opt/chrome"}.get)
    assert chromium.executable() == "/opt/chrome"
