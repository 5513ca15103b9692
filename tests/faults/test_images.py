"""Images are not trusted: their unit means nothing, and what is no radiance is named."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.conventions import FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr, read_rgb, write_exr
from fipt.formats.images import as_rgb, srgb_encode
from fipt.scene.cameras import read_radiance_scale
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import Emitters, write_emitters
from fipt.scene.environment import NOTHING, edited
from fipt.scene.setup import parse_setup
from fipt.stages.environment.fit import find_environment
from fipt.stages.environment.settings import ConstantEnvironment
from fipt.stages.importing import defects
from fipt.stages.importing.build import import_scene
from fipt.stages.importing.defects import DefectCheck
from fipt.stages.importing.encoding import EncodingCheck, sentences
from fipt.stages.importing.settings import ImportSettings
from fipt.stages.render.lights import apply_setup
from fipt.stages.segment.given import read_id_image
from fipt.synthetic.scenefile.textures import _image
from tests.faults.faults import Fault, contents, named, refused
from tests.layouts import room, write_nerfstudio, write_synthetic

IMPORT = ("import", "--source", "src", "--format", "nerfstudio", "--dataset", "out")
QUICK = ImportSettings(overlay=False, prepare="never")
LEVELS = [2.0**power for power in (-40, -20, -7, 7, 20, 40)] + [1e-6, 1e-3, 1e3, 1e6]


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def images(folder: str) -> list[Path]:
    return sorted(Path(folder).rglob("images/*.exr"))


def source(change: Callable[[np.ndarray], np.ndarray], view: str = "") -> None:
    """A source whose images, or one of them, are changed."""
    write_nerfstudio(Path("src"))
    for path in images("src"):
        if view in path.name:
            write_exr(path, {"": change(read_rgb(path)).astype(np.float32)})


def times(factor: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda image: image * np.float64(factor)


@pytest.mark.parametrize("factor", LEVELS)
def test_the_unit_of_radiance_means_nothing(factor: float) -> None:
    source(times(1.0))
    import_scene("src", "nerfstudio", "plain", QUICK)
    source(times(factor))
    done = import_scene("src", "nerfstudio", "other", QUICK)
    assert read_radiance_scale("plain/transforms.json") == 1.0
    scale = read_radiance_scale("other/transforms.json")
    assert np.log2(scale).is_integer()
    assert 0.7 < scale * factor < 1.42
    assert any("the source's radiance is multiplied by" in warning for warning in done.warnings)
    for plain, other in zip(images("plain"), images("other"), strict=True):
        exact = np.log2(factor).is_integer()  # then images have the same bits
        np.testing.assert_allclose(read_rgb(other), read_rgb(plain) * scale * factor, rtol=0 if exact else 1e-6)


def test_truth_has_the_unit_of_its_images() -> None:
    write_synthetic(Path("src"))
    for path in [*Path("src").rglob("Image/*.exr"), *Path("src").rglob("Emit/*.exr")]:
        write_exr(path, {"": read_rgb(path) * 1000})
    import_scene("src", "fipt-synthetic", "once", QUICK)
    scale = read_radiance_scale("once/transforms.json")
    data = Dataset("once")
    view = data.views("train")[0]
    emission = data.truth(view)["emission"]
    assert emission.max() == data.image(view)[0].max() == pytest.approx(50000 * scale)
    # and of a dataset that is imported again
    for path in [*Path("once").rglob("images/*.exr"), *Path("once").rglob("truth/*.exr")]:
        layers = {("" if "images" in str(path) else "emission"): Dataset("once").truth(path.stem)["emission"] * 1000}
        if "truth" in str(path):
            write_exr(path, layers)
        else:
            write_exr(path, {"": read_rgb(path) * 1000})
    Path("once/import.manifest.json").unlink()
    import_scene("once", "fipt", "twice", QUICK)
    twice = Dataset("twice")
    assert twice.truth(view)["emission"].max() == twice.image(view)[0].max() < 100
    assert twice.radiance_scale < scale, "the factor from the first source, not from the dataset between"


def test_people_read_and_write_the_unit_of_the_source() -> None:
    scale = 2.0**-20
    source(times(1 / scale))
    import_scene("src", "nerfstudio", "out", QUICK)
    data = Dataset("out")
    assert data.radiance_scale == scale
    one, few = np.array([3], np.int32), np.array([0.5], np.float32)
    light = np.full((1, 3), 4.0, np.float32)
    found = Emitters(one, light, few, one * 0, one, few, few, np.zeros(1, bool), error=light / 100)
    write_emitters(Path("emitters.npz"), found, room(), data.radiance_scale)
    row = json.loads(Path("emitters.json").read_text())["emitters"][0]
    assert row["radiance"] == [4 / scale] * 3
    assert row["error"] == pytest.approx([0.04 / scale] * 3)

    stated = ConstantEnvironment(radiance=(2 / scale, 0, 0))
    np.testing.assert_array_equal(find_environment(data, [], stated, {}, dict).radiance, [[[2, 0, 0]]])
    lights = [
        {"shape": "sphere", "center": [1, 1, 1], "radiance": [8 / scale, 0, 0]},
        {"shape": "spot", "position": [1, 1, 1], "direction": [0, -1, 0], "intensity": [0, 2 / scale, 0]},
    ]
    edits = [{"scale": 0.5}, {"index": 0, "radiance": [1 / scale] * 3}]
    setup = parse_setup(json.dumps({"emitters": edits, "lights": lights, "environment": {"radiance": [1 / scale] * 3}}))
    here = setup.in_unit(scale)
    lit = apply_setup(room(), found, here)[1].radiance
    np.testing.assert_array_equal(np.unique(lit, axis=0), [[1, 1, 1], [8, 0, 0]])
    assert here.lights[1].intensity == (0, 2, 0)
    assert edited(NOTHING, here.environment).radiance.tolist() == [[[1, 1, 1]]]
    of_file = parse_setup(json.dumps({"environment": {"file": "night.exr", "scale": 0.5}})).in_unit(scale)
    assert of_file.environment is not None
    assert of_file.environment.scale == 0.5 * scale
    assert setup.in_unit(1.0) is setup


def one_pixel(value: float) -> Callable[[], None]:
    def change(image: np.ndarray) -> np.ndarray:
        image[2, 3, 1] = value
        return image

    return lambda: source(change, "view_1")


def cropped() -> None:
    write_nerfstudio(Path("src"))
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "displayWindow": (np.array([0, 0], np.int32), np.array([15, 11], np.int32)),
        "dataWindow": (np.array([4, 3], np.int32), np.array([11, 8], np.int32)),
    }
    pixels = {letter: np.full((6, 8), 0.2, np.float32) for letter in "RGB"}
    OpenEXR.File(header, pixels).write("src/images/view_1.exr")


REFUSED = [
    Fault("one pixel of 3e38", one_pixel(3e38), "view_1.exr must hold finite radiance >= 0; 1 pixels are"),
    Fault("one pixel of 1e20", one_pixel(1e20), "more than the sun, the first at row 2, column 3"),
    Fault("one pixel that is negative", one_pixel(-1), "1 pixels are negative, the first at row 2, column 3"),
    Fault("black", lambda: source(lambda image: image * 0), "every pixel of 2 views is black"),
    Fault("a cropped EXR", cropped, "its data window [[4, 3], [11, 8]] must be its display window [[0, 0], [15, 11]]"),
]


@named(REFUSED)
def test_what_cannot_be_radiance_is_refused(fault: Fault, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    fault.plant()
    before = contents(tmp_path)
    said = refused(capsys, *IMPORT, "--settings", QUICK.model_dump_json())
    assert fault.said in said
    assert contents(tmp_path) == before


def views(change: Callable[[np.ndarray], np.ndarray], flags: bool = False) -> dict[str, object]:
    """What is said of four views of noisy surface and a lamp of 20, after a change of their pixels."""
    rng, check = np.random.default_rng(3), EncodingCheck()
    for view in "abcd":
        image = 0.3 * rng.lognormal(0, 0.6, (48, 64, 3)) * rng.uniform(0.2, 1, (48, 64, 1))
        image[5:9, 10:20] = (20, 16, 12)
        share = rng.uniform(0, 1, (10, 1))  # of the pixels along its rim
        image[4, 10:20] = (1 - share) * image[4, 10:20] + share * (20, 16, 12)
        seen = change(image).astype(np.float32)
        clipped = (image != change(image)).any(axis=-1) * np.uint32(FLAG_SATURATED)
        check.add(view, {"": seen} | ({"flags.Y": clipped} if flags else {}), np.ones((48, 64)))
    return check.facts()


def test_radiance_is_not_suspected() -> None:
    assert views(lambda image: image) == {}
    assert views(lambda image: image.astype(np.float16)) == {}
    assert views(lambda image: np.minimum(image, 1.5), flags=True) == {}  # lower bounds that say so
    flat = EncodingCheck()
    flat.add("drawn", {"": np.repeat(np.arange(3) / 2, 4096).reshape(64, 192, 1) * np.ones(3)}, np.ones((64, 192)))
    assert flat.facts() == {}


def test_eight_bits_are_named() -> None:
    encoded = views(lambda image: np.rint(255 * srgb_encode(np.clip(image, 0, 1))) / 255)
    assert encoded["levels"]["even"]
    assert encoded["levels"]["count"] <= 256
    assert "likely still encoded for a display" in sentences(encoded)[0]
    decoded = views(lambda image: (np.rint(255 * np.clip(image, 0, 1) ** (1 / 2.2)) / 255) ** 2.2)
    assert "decoded from 8 bits" in sentences(decoded)[0]


@pytest.mark.parametrize("most", [1.0, 2.7])
def test_light_that_is_cut_off_is_named(most: float) -> None:
    found = views(lambda image: np.minimum(image, most))
    assert found["cut"]["radiance"] == pytest.approx(most)
    assert "light is cut off there without a flag" in sentences(found)[0]


def framed(image: np.ndarray, k: int) -> np.ndarray:
    image[:3], image[:, -5:] = 0.1 * k, 0.1 * k
    return image


def sprinkled(image: np.ndarray, k: int) -> np.ndarray:
    image[20, 7:9] = 0
    return image


def hot(image: np.ndarray, k: int) -> np.ndarray:
    image[30 + k, 30] = 1e5
    return image


Pixels = Callable[[np.ndarray, int], np.ndarray]
DEFECTS: dict[str, tuple[Pixels, str]] = {
    "nothing": (lambda image, k: image, ""),
    "half floats": (lambda image, k: image.astype(np.float16), ""),
    "no red in all views": (lambda image, k: image * (0, 1, 1), "all views: no red at all; a channel is missing"),
    "no blue in one view": (lambda image, k: image * (1, 1, k != 1), "view_1: no blue at all; a channel is missing"),
    "grey": (lambda image, k: np.repeat(image[..., :1], 3, axis=-1), "all views: no colours; red, green and blue"),
    "a border": (framed, "all views: rows or columns of one value at an edge, up to 5"),
    "dead pixels": (sprinkled, "2 pixels have one and the same value in all views: a border, a watermark, or defects"),
    "hot pixels": (hot, "all views: pixels that are 1000 times as bright as all around them, up to 1"),
    "half floats that are too small": (lambda image, k: (image * 1e-6).astype(np.float16), "values in their darker"),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_pixels_that_show_no_room_are_named(name: str) -> None:
    change, said = DEFECTS[name]
    rng, check = np.random.default_rng(3), DefectCheck()
    for k in range(4):
        image = 0.3 * rng.lognormal(0, 0.6, (64, 80, 3)) * rng.uniform(0.2, 1, (64, 80, 1))
        check.add(f"view_{k}", {"": change(image, k).astype(np.float32)}, np.ones((64, 80)))
    told = defects.sentences(check.facts(), 4)
    assert len(told) == (name != "nothing" and name != "half floats"), told
    assert said in "".join(told)
    unweighted = DefectCheck()
    for k in range(4):  # a pixel of no weight may be anything, and hides nothing
        image = np.full((64, 80, 3), 0.5) * rng.uniform(0.2, 1, (64, 80, 1))
        weight = np.ones((64, 80))
        image[5, 5], weight[5, 5] = np.nan, 0
        unweighted.add(f"view_{k}", {"": image.astype(np.float32)}, weight)
    assert "grey" in unweighted.facts()
    masked = DefectCheck()
    masked.add("a", {"": np.zeros((64, 80, 3))}, np.zeros((64, 80)))
    assert masked.facts() == {}


def test_an_alpha_is_named_and_defects_stand_beside_the_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    write_nerfstudio(Path("src"), w=80, h=64, fl_x=32, fl_y=32, cx=40, cy=32)
    for path in images("src"):
        image = np.random.default_rng(1).lognormal(-1, 0.8, (64, 80, 3)).astype(np.float32)
        write_exr(path, {"": image, "A": np.linspace(0, 2, 80, dtype=np.float32) * np.ones((64, 1), np.float32)})
    assert main([*IMPORT, "--settings", QUICK.model_dump_json()]) == 0
    assert "an alpha that is not 1, in up to 100.0% of the pixels" in capsys.readouterr().err
    assert json.loads(Path("out/prepare.json").read_text())["images"]["defects"]["alpha"]
    assert set(read_exr(images("out")[0])) == {"R", "G", "B"}


def test_what_is_strange_stands_beside_the_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    write_nerfstudio(Path("src"), w=64, h=48, fl_x=32, fl_y=32, cx=32, cy=24)
    for path in images("src"):
        rng = np.random.default_rng(1)
        write_exr(path, {"": np.minimum(rng.lognormal(-1, 0.8, (48, 64, 3)), 1).astype(np.float32)})
    assert main([*IMPORT, "--settings", QUICK.model_dump_json()]) == 0
    assert "of the pixels have one largest value, 1, in different colours" in capsys.readouterr().err
    assert json.loads(Path("out/prepare.json").read_text())["images"]["cut"]["views"]


def test_16_bits_are_not_cut_to_8(tmp_path: Path) -> None:
    values = np.array([[300, 30000, 65535], [0, 77, 40000]], np.uint16)
    colors = np.stack([values, values[::-1], values // 2], axis=-1)
    for name, pixels in (("grey", values), ("rgb", colors), ("rgba", np.dstack([colors, values]))):
        cv2.imwrite(f"{name}.png", pixels)
        found, alpha, _ = _image(tmp_path / f"{name}.png", 1.0, 4)
        shown = pixels[..., 2::-1] if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)
        np.testing.assert_allclose(found, shown / 65535, atol=1e-6)
        assert (alpha is None) == (name != "rgba")
    with Image.open("grey.png") as grey:
        np.testing.assert_allclose(as_rgb(grey)[..., 1], values / 65535)
    with pytest.raises(FiptError, match=r"rgb\.png must have 8 bits a colour; it has 16"):
        read_id_image(Path("rgb.png"), {(1, 0, 0): 1})
