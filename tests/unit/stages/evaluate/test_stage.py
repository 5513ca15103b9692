"""``fipt metrics`` on a tiny results folder."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.conventions import FLAG_SATURATED
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.files import write_text
from fipt.scene.emitters import BACK, FRONT
from fipt.scene.samples import write_samples
from tests.fake_results import HEIGHT, WIDTH, maps, samples, write_maps, write_results


def run(root, *more):
    """Run the verb on a results folder and return its exit code."""
    arguments = ["--dataset", root / "dataset", "--materials", root / "materials"]
    arguments += ["--render", root / "render", "--emitters", root / "round-1" / "emitters.npz"]
    arguments += ["--out", root / "metrics.json", *more]
    return main(["metrics", *map(str, arguments)])


def read(root):
    def refuse(name):
        raise AssertionError(f"{name} in metrics.json")

    return json.loads((root / "metrics.json").read_text(), parse_constant=refuse)


@pytest.fixture
def results(tmp_path):
    return write_results(tmp_path / "scene")


def test_figures_of_a_scene_with_truth(results):
    more = ("--samples", results / "samples" / "train-000", "--relight", results / "relight")
    assert run(results, *more, "--stats", results / "stats" / "metrics.json") == 0
    figures = read(results)
    for split, views in (("val", 1), ("train", 2)):
        assert figures[split]["kd_psnr"] == pytest.approx(20.0, abs=1e-4)
        assert figures[split]["reflectance_psnr"] == 100.0
        assert figures[split]["roughness_l1"] == 0.0
        assert figures[split]["emission_iou"] == 1.0
        assert figures[split]["pixels"]["materials"] == views * (HEIGHT - 1) * WIDTH
    assert figures["val"]["render_psnr"] == 100.0
    assert figures["val"]["render_psnr_views"] == {"c": 100.0}
    assert figures["train"]["render_psnr"] is None
    assert figures["val"]["published"]["kd_psnr"] is None
    assert figures["relight"]["dim"]["relight_psnr"] == 100.0
    assert set(figures["val"]) - {"pixels", "render_psnr_views", "render_exposure_scale"} - {
        "render_exposure_fitted"
    } <= set(figures["definitions"])
    assert figures["settings"] == {"fit_exposure": False}
    assert json.loads((results / "stats" / "metrics.json").read_text())["stage"] == "metrics"


def test_only_setups_that_are_named_count(results):
    """Truth and relit views of setup dim are still there; it is filmed now, or no more."""
    relight = ("--relight", results / "relight")
    assert run(results, *relight, "--setups", "dim") == 0
    assert set(read(results)["relight"]) == {"dim"}
    assert run(results, *relight, "--setups", "") == 0
    assert "relight" not in read(results)


def test_relit_views_that_are_missing_are_told(results, caplog):
    """Truth is there of both training views; one of them was relit."""
    truth, relit = (results / place / "dim" for place in ("dataset/relight_truth", "relight"))
    for path in (truth / "a.exr", truth / "b.exr", relit / "a.exr"):
        write_exr(path, {"": read_rgb(truth / "c.exr")})
    assert run(results, "--relight", results / "relight") == 0
    assert set(read(results)["relight"]["dim"]["relight_psnr_views"]) == {"a", "c"}
    assert "lacks 1 of 2 views of which there is truth (b); its mean leaves them out" in caplog.text


def test_images_of_an_earlier_plan_do_not_count(results):
    """View b was held out and rendered, as all views were relit; c alone is now."""
    write_exr(results / "render" / "b.exr", {"": np.zeros((HEIGHT, WIDTH, 3), np.float32)})
    truth, relit = (results / place / "dim" for place in ("dataset/relight_truth", "relight"))
    photos = results.parent / "photos"
    for name in "abc":
        write_exr(photos / f"{name}.exr", {"": read_rgb(relit / "c.exr")})
    for name in "ab":
        write_exr(truth / f"{name}.exr", {"": read_rgb(truth / "c.exr")})
        write_exr(relit / f"{name}.exr", {"": np.zeros((HEIGHT, WIDTH, 3), np.float32)})
    counted = ("--rendered", "c", "--relight", results / "relight", "--relit", "c")
    assert run(results, *counted) == 0
    assert read(results)["relight"]["dim"]["relight_psnr_views"] == {"c": 100.0}
    assert read(results)["train"]["render_psnr"] is None
    assert read(results)["val"]["render_psnr_views"] == {"c": 100.0}
    assert run(results, *counted, "--reference", f"dim={photos}") == 0
    assert read(results)["relight"]["dim"]["relight_psnr_views"] == {"c": 100.0}
    assert run(results, "--rendered", "") == 0
    assert read(results)["val"]["render_psnr"] is None
    assert run(results, "--rendered", "x") == 2


def test_emitting_triangles_are_judged_by_what_pixels_see(results):
    assert run(results, "--samples", results / "samples" / "train-000") == 0
    emitters = read(results)["emitters"]
    assert emitters["truth_from"] == "pixel centres that see them"
    assert (emitters["true_triangles"], emitters["found_triangles"]) == (1, 2)
    assert (emitters["false_triangles"], emitters["missed_triangles"]) == (1, 0)


def test_views_without_truth_do_not_say_that_a_triangle_is_dark(results):
    """The lamp is seen by three views, and two of them, then all, have no truth; triangle 2 is seen by none."""
    (results / "samples" / "val-000").mkdir()
    write_samples(results / "samples" / "val-000", samples(["c"]))
    every = ("--samples", f"{results / 'samples' / 'train-000'},{results / 'samples' / 'val-000'}")
    names = ("true_triangles", "false_triangles", "missed_triangles")
    truth = results / "dataset" / "truth"
    for view in "ab":
        (truth / f"{view}.exr").unlink()
        assert run(results, *every) == 0
        assert [read(results)["emitters"][name] for name in names] == [1, 1, 0]
    beside = samples(["c"])  # another one is seen in the lamp's place
    beside = replace(beside, triangle=np.where(beside.triangle == 0, 3, beside.triangle))
    write_samples(results / "samples" / "val-000", beside)
    write_maps(truth / "c.exr", maps() | {"emission_mask": np.zeros((HEIGHT, WIDTH), np.float32)})
    assert run(results, *every) == 0
    assert [read(results)["emitters"][name] for name in names] == [0, 1, 0]  # of the lamp nothing is known
    (truth / "c.exr").unlink()
    assert run(results, *every) == 0
    assert [read(results)["emitters"][name] for name in names] == [None] * 3


def test_light_on_the_other_side_is_not_what_views_see(results):
    path = results / "round-1" / "emitters.npz"
    assert run(results, "--samples", results / "samples" / "train-000") == 0
    assert read(results)["emitters"]["emitted_flux"] > 0
    arrays = load_npz(path)
    given = [emitted_flux(results, path, arrays, side) for side in (FRONT, BACK)]
    assert min(given) == 0 < max(given)


def emitted_flux(results, path, arrays, side):
    """That of emitters of one side."""
    save_npz(path, **{**arrays, "sides": np.full(len(arrays["triangle"]), side, np.int8)})
    assert run(results, "--samples", results / "samples" / "train-000") == 0
    return read(results)["emitters"]["emitted_flux"]


def test_emitting_triangles_of_a_room_in_code(results):
    room = {"emitters": [{"triangles": [0]}, {"triangles": [1, 3]}]}
    write_text(results / "dataset" / "room.json", json.dumps(room))
    assert run(results, "--samples", results / "samples" / "train-000") == 0
    emitters = read(results)["emitters"]
    assert emitters["truth_from"] == "room.json"
    assert (emitters["true_triangles"], emitters["false_triangles"]) == (3, 1)
    assert (emitters["missed_triangles"], emitters["unseen_triangles"]) == (1, 1)


@pytest.mark.parametrize("other", [{"triangles": 9}, {"emitters": [{"triangles": [0], "area": 77.0}]}])
def test_a_room_of_another_mesh_does_not_say_which_triangles_emit(results, other):
    """The mesh was scanned, or prepared: its triangles are not those of the room."""
    write_text(results / "dataset" / "room.json", json.dumps({"emitters": [{"triangles": [0]}], **other}))
    assert run(results, "--samples", results / "samples" / "train-000") == 0
    assert read(results)["emitters"]["truth_from"] == "pixel centres that see them"


def test_without_truth_only_pictures_are_judged(tmp_path):
    root = write_results(tmp_path / "real", truth=False)
    assert run(root, "--samples", root / "samples" / "train-000", "--relight", root / "relight") == 0
    figures = read(root)
    assert figures["val"]["render_psnr"] == 100.0
    assert figures["val"]["kd_psnr"] is figures["val"]["emission_iou"] is None
    assert set(figures["val"]["published"].values()) == {None}
    assert figures["emitters"]["true_triangles"] is None
    assert "relight" not in figures


def test_exposure_is_fitted_only_when_asked(results):
    picture = np.linspace(0.05, 0.9, WIDTH * HEIGHT * 3, dtype=np.float32)
    dark = picture.reshape(HEIGHT, WIDTH, 3) / 2
    write_exr(results / "render" / "c.exr", {"": dark})
    assert run(results) == 0
    assert read(results)["val"]["render_psnr"] < 20
    assert run(results, "--settings", '{"fit_exposure": true}') == 0
    figures = read(results)["val"]
    assert figures["render_exposure_fitted"] is True
    assert figures["render_exposure_scale"] == pytest.approx(2.0)
    assert figures["render_psnr"] == 100.0


def test_nan_in_a_map_is_refused_and_nothing_is_written(results, capsys):
    layers = {**maps(), "hit": np.ones((HEIGHT, WIDTH), np.float32)}
    layers["roughness"][2, 3] = np.nan
    write_maps(results / "materials" / "c.exr", layers)
    assert run(results) == 2
    assert "c.exr must hold finite values; 1 of layer roughness" in capsys.readouterr().err
    assert not (results / "metrics.json").exists()


def test_missing_pictures_and_layers_are_named(results, capsys):
    write_exr(results / "render" / "a.exr", {"": np.ones((HEIGHT, WIDTH, 3), np.float32)})
    assert run(results) == 2
    assert "image of every view; b missing" in capsys.readouterr().err
    write_maps(results / "materials" / "c.exr", maps())
    assert run(results) == 2
    assert "c.exr lacks the layers hit" in capsys.readouterr().err


def photographed(results, photo, name="dim", **channels):
    """Metrics with a photograph of view c under a setup; return the exit code."""
    write_exr(results.parent / "photos" / "c.exr", {"": photo, **channels})
    more = ("--relight", results / "relight", "--reference", f"{name}={results.parent / 'photos'}")
    return run(results, *more)


def test_photographs_under_a_setup_of_unknown_exposure(results):
    """A tenth of the pixels lie: a thing that was moved, and one clipped in the photograph."""
    relit = read_rgb(results / "relight" / "dim" / "c.exr")
    assert photographed(results, 7 * relit) == 0
    figures = read(results)["relight"]["dim"]
    assert (figures["of"], figures["relight_psnr_views"]) == ("reference", {"c": 100.0})
    assert figures["exposure"] == pytest.approx(1 / 7, rel=1e-5)
    lies = 7 * relit
    lies[0, :3], lies[1, :2] = 900.0, 0.001
    assert photographed(results, lies) == 0
    figures = read(results)["relight"]["dim"]
    assert figures["exposure"] == pytest.approx(1 / 7, rel=2e-2)
    assert figures["relight_psnr"] < 30
    mask = np.ones((HEIGHT, WIDTH), np.float32)
    mask[0, :3] = 0
    lies[0, :3] = np.nan  # without weight it is no picture
    flags = np.zeros((HEIGHT, WIDTH), np.uint32)
    flags[1, :2] = FLAG_SATURATED
    assert photographed(results, lies, **{"valid.Y": mask, "flags.Y": flags}) == 0
    assert read(results)["relight"]["dim"]["relight_psnr"] == 100.0


def test_the_truth_keeps_its_exposure(results):
    assert run(results, "--relight", results / "relight") == 0
    assert read(results)["relight"]["dim"]["of"] == "truth"
    assert read(results)["relight"]["dim"]["exposure"] == 1.0


def test_photographs_that_cannot_be_compared(results, capsys):
    relit = read_rgb(results / "relight" / "dim" / "c.exr")
    bad = relit.copy()
    bad[1, 2, 0] = np.nan
    for photo, said in (
        (bad, "c.exr must hold finite radiance >= 0; 1 pixels are NaN"),
        (relit[:-1], f"c.exr must be {WIDTH}x{HEIGHT} like its camera; it is {WIDTH}x{HEIGHT - 1}"),
        (0 * relit, "must have pixels in common that are valid and not black"),
    ):
        assert photographed(results, photo) == 2
        assert said in capsys.readouterr().err
    (results.parent / "photos" / "c.exr").rename(results.parent / "photos" / "other.exr")
    more = ("--relight", results / "relight", "--reference", f"dim={results.parent / 'photos'}")
    assert run(results, *more) == 2
    assert "must hold photographs named as the relit views; none of c.exr is there" in capsys.readouterr().err
    assert photographed(results, relit, name="bright") == 2
    assert "has no relit view to compare with" in capsys.readouterr().err
    assert run(results, *more[2:]) == 2
    assert "--reference needs --relight" in capsys.readouterr().err
    assert run(results, "--reference", "dim") == 2
    assert "--reference must be SETUP=FOLDER; found dim" in capsys.readouterr().err
    assert not (results / "metrics.json").exists()


def test_a_reference_in_radiance_hdr(results):
    """Flat RGBE written by hand: 2^(e - 136) times a byte."""
    relit = read_rgb(results / "relight" / "dim" / "c.exr")
    scale = 2.0 ** (np.floor(np.log2(relit.max(axis=-1, keepdims=True))) - 7)
    rgbe = np.concatenate([relit / scale + 0.5, np.log2(scale) + 136], axis=-1).astype(np.uint8)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {HEIGHT} +X {WIDTH}\n"
    (results.parent / "photos").mkdir()
    (results.parent / "photos" / "c.hdr").write_bytes(head.encode() + rgbe.tobytes())
    more = ("--relight", results / "relight", "--reference", f"dim={results.parent / 'photos'}")
    assert run(results, *more) == 0
    assert read(results)["relight"]["dim"]["relight_psnr"] > 45


def test_masked_and_clipped_pixels_are_left_out(results):
    """Material figures leave out what the mask does; the picture's also what is clipped: a bound is no value."""
    mask = np.ones((HEIGHT, WIDTH), np.float32)
    mask[2] = 0
    flags = np.zeros((HEIGHT, WIDTH), np.uint32)
    flags[3] = FLAG_SATURATED
    path = results / "dataset" / "images" / "c.exr"
    photo = read_rgb(path)
    wrong = photo.copy()
    wrong[[2, 3]] = 5.0
    write_exr(path, {"": photo, "valid.Y": mask, "flags.Y": flags})
    write_exr(results / "render" / "c.exr", {"": wrong})
    assert run(results) == 0
    figures = read(results)["val"]
    assert figures["render_psnr"] == 100.0
    assert figures["pixels"]["materials"] == (HEIGHT - 2) * WIDTH
    write_exr(path, {"": photo, "valid.Y": mask})
    assert run(results) == 0
    assert read(results)["val"]["render_psnr"] < 20
