"""Scenes that give little to hold on to: each ends in a finite result, or in one clear line and exit code 2."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.jobs import run_all
from fipt.formats.arrays import load_npz
from fipt.formats.exr import read_exr, read_rgb, write_exr
from fipt.formats.images import write_png
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import read_layers
from tests import scenes
from tests.fitted import kept_threads
from tests.workflow.prepared import jobs_of

pytestmark = pytest.mark.slow

FEW = {"diffuse_spp": 4, "specular_spp": 2, "smooth_spp": 2}
CONFIG = {
    "scenes": {"room": {"source": "dataset", "format": "nerfstudio", "path": "photos", "mesh": "photos/mesh.ply"}},
    "rounds": 1,
    "import": {"overlay": False},
    "samples": {"grid": 2},
    "cache": {"resolution": 16},
    "bake": FEW,
    "refine": FEW | {"max_depth": 3},
    "fit": {"steps": 25, "batch": 128, "levels": 4, "table_log2": 10, "learning_rate": 0.01, "emission_weight": 0.1},
    "emitters": {"points": 20},
    "render": {"spp": 4, "max_depth": 3},
    "olat": {"spp": 4, "max_depth": 3},
    "findings": {"views": 2, "width": 16, "spp": 8, "max_depth": 3, "pixels": 1000},
    "report": {"width": 32},
}
RESULTS = Path("results/room")


@pytest.fixture(autouse=True)
def threads(backend):
    """Verbs may set the number of threads of the whole process."""
    with kept_threads():
        yield


@pytest.fixture
def photos(tmp_path, monkeypatch):
    """The box room as a source of pictures, in a working directory of its own."""
    monkeypatch.chdir(tmp_path)
    return scenes.write_dataset(tmp_path / "photos")


def run(**changed) -> int:
    """Run every job with some keys of the configuration changed; the exit code."""
    return run_all(jobs_of(Path(), CONFIG | changed))


def repaint(photos, change, views="abc"):
    """Put ``change`` of the picture in the place of each view's picture."""
    for view in views:
        path = photos / "images" / f"{view}.exr"
        write_exr(path, {"": np.float32(change(read_rgb(path)))})


def assert_finite() -> None:
    """No NaN and no infinity in anything that was written, and everything was."""
    assert (RESULTS / "report.html").is_file()
    for path in RESULTS.rglob("*.exr"):
        assert all(np.isfinite(values).all() for values in read_exr(path).values()), path
    for path in RESULTS.rglob("*.npz"):
        numbers = [values for values in load_npz(path).values() if values.dtype.kind != "U"]
        assert all(np.isfinite(values).all() for values in numbers), path
    for path in RESULTS.rglob("*.json"):
        json.loads(path.read_text(), parse_constant=lambda name, path=path: pytest.fail(f"{name} in {path}"))
    unread = r"<style>.*?</style>|<script( type=\"application/octet-stream\"[^>]*)?>.*?</script>|src=\"[^\"]*\""
    words = re.sub(unread, "", (RESULTS / "report.html").read_text(), flags=re.DOTALL)
    assert not re.search(r"\b(nan|inf)\b", words, re.IGNORECASE)


def test_a_single_training_view(photos):
    cameras = scenes.cameras()
    write_transforms(photos / "transforms.json", [cameras[0], cameras[2]])
    assert run() == 0
    assert_finite()
    sure = read_layers(RESULTS / "materials" / "a.exr")["confidence"]
    assert 0 < sure.max() <= 1


def test_no_held_out_view(photos, capsys):
    write_transforms(photos / "transforms.json", scenes.cameras()[:2])
    assert run() == 0
    assert_finite()
    assert json.loads((RESULTS / "metrics.json").read_text())["val"]["render_psnr"] is None
    assert not (RESULTS / "render").exists()


def test_no_specular_surface(photos):
    """Every wall is as bright from everywhere: nothing may be called smooth or metal, and matte is not proved."""
    assert run() == 0
    assert_finite()
    found = read_layers(RESULTS / "materials" / "c.exr")
    wall = found["emission_mask"] == 0
    assert found["roughness"][wall].mean() > 0.45
    assert found["metallic"][wall].mean() < 0.2


def test_a_channel_that_is_zero_everywhere(photos):
    channel = 2
    repaint(photos, lambda picture: picture * (np.arange(3) != channel))
    assert run() == 0
    assert_finite()
    for path in (RESULTS / "render").glob("*.exr"):
        assert read_rgb(path)[..., channel].max() < 1e-3
        assert read_rgb(path).max() > 0.01


def test_pictures_of_a_single_colour(photos, capsys):
    repaint(photos, lambda picture: 0 * picture + 0.4)
    assert run() == 0
    assert_finite()
    assert "no emitter found" in capsys.readouterr().err


def test_pictures_that_are_black(photos, capsys):
    repaint(photos, lambda picture: 0 * picture)
    assert run() == 2
    assert "training views must show light; every pixel of 2 views is black" in capsys.readouterr().err


def test_one_picture_is_black(photos, capsys):
    """The lens cap was on: of three views too many to go on, and nothing breaks if one does."""
    repaint(photos, lambda picture: 0 * picture, "a")
    assert run() == 2
    assert "1 of 3 do not: a" in capsys.readouterr().err
    assert run(check_poses={"enabled": False}) == 0
    assert_finite()


def test_a_view_that_sees_nothing_but_a_lamp(photos):
    cameras = scenes.cameras()
    under = scenes.look_at("b", (1.5, 2.9, 2.52), (1.5, 3.0, 2.5), focal=30.0)
    write_transforms(photos / "transforms.json", [cameras[0], under, cameras[2]])
    write_exr(photos / "images" / "b.exr", {"": scenes.image(under)[0]})
    assert (read_rgb(photos / "images" / "b.exr") == scenes.EMITTER_RADIANCE).all()
    assert run() == 0
    assert_finite()
    found = read_layers(RESULTS / "materials" / "b.exr")
    assert (found["emission_mask"] == 1).all()
    assert not found["confidence"].any()  # a lamp tells nothing of its reflectance


# --- a threshold of confidence --------------------------------------------------------------------


def test_a_threshold_that_leaves_no_pixel(photos, capsys):
    assert run(fit=CONFIG["fit"] | {"min_confidence": 1.0}) == 2
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert "fit.min_confidence 1.0 leaves no pixel of the training views; the highest confidence is 0." in error
    assert "lower fit.min_confidence" in error
    assert not list(RESULTS.glob("round-0/model*"))
    assert not list(RESULTS.glob("round-0/confidence*"))


def test_a_threshold_that_leaves_some(photos):
    mask = CONFIG["emitters"] | {"decide": "mask"}
    assert run(fit=CONFIG["fit"] | {"min_confidence": 0.3}, emitters=mask) == 0
    assert_finite()
    used, whole = (json.loads((RESULTS / f"stats/fit.round-{k}.json").read_text())["pixels"] for k in (0, 1))
    assert 0 < used < 2 * scenes.WIDTH * scenes.HEIGHT
    assert whole < 2 * scenes.WIDTH * scenes.HEIGHT
    # the lamp is found all the same: its pixels tell nothing of reflectance, but they teach the mask
    assert len(load_npz(RESULTS / "round-0" / "emitters.npz")["triangle"]) == 2


# --- the same with parts --------------------------------------------------------------------------


@pytest.mark.parametrize("what", ["a channel is zero", "one view", "no pixel has a part"])
def test_parts_are_searched_all_the_same(tmp_path, monkeypatch, what):
    """The procedural room's layout has part ids: the search and the propagation see the bad pictures too."""
    monkeypatch.chdir(tmp_path)
    small = {"train_views": 1 if what == "one view" else 2, "val_views": 1, "width": 24, "height": 18, "spp": 1}
    config = CONFIG | {"scenes": {"room": {"source": "procedural"}}, "synthesize": small | {"denoise": False}}
    # The guess of unseen light takes a quarter of the time. It knows no parts; a single view has it in another test.
    config["emitters"] = CONFIG["emitters"] | {"guess": what == "a channel is zero"}
    for job in jobs_of(tmp_path, config):
        assert job.run() == 0
        if job.label.startswith("synthesize."):
            for path in (RESULTS / "dataset" / "images").glob("*.exr"):
                picture = read_rgb(path)
                if what == "a channel is zero":
                    picture[..., 1] = 0
                write_exr(path, {"": picture})
            for path in (RESULTS / "dataset" / "segments" / "part").glob("*.png"):
                if what == "no pixel has a part":
                    write_png(path, np.zeros((18, 24), np.uint16))
            for path in (RESULTS / "dataset").glob("*.manifest.json"):
                path.unlink()  # it lists what was there before
    assert_finite()
