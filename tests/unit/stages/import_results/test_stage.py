"""Outputs of another program: they are judged as they are, and what is not there stays unknown."""

import json
import pickle

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.config import load
from fipt.conventions import FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.arrays import save_npz
from fipt.formats.exr import read_rgb, write_exr
from fipt.scene.dataset import Dataset, read_layers, write_views
from fipt.scene.samples import write_samples
from fipt.stages.import_results.layouts import scaled_to
from tests.scenes import samples_of, write_dataset

KD = 0.25


@pytest.fixture
def room(tmp_path):
    """A dataset with the truth of two views, and samples of them."""
    write_dataset(tmp_path / "room")
    data = Dataset(tmp_path / "room")
    for view in data.views("train"):
        camera = data.camera(view)
        shape = camera.height, camera.width
        layers = {"kd": np.full((*shape, 3), KD), "reflectance": np.full((*shape, 3), 0.5)}
        layers |= {"roughness.Y": np.ones(shape), "emission": np.zeros((*shape, 3))}
        write_exr(tmp_path / "room" / "truth" / f"{view}.exr", {k: v.astype(np.float32) for k, v in layers.items()})
    views = data.views("train")
    shapes = tuple((data.camera(view).height, data.camera(view).width) for view in views)
    count = sum(height * width for height, width in shapes)
    (tmp_path / "samples").mkdir()
    write_samples(tmp_path / "samples", samples_of(np.zeros((count, 3)), views=tuple(views), shapes=shapes))
    return tmp_path


def call(room, settings, code=0):
    options = ["--dataset", str(room / "room"), "--samples", str(room / "samples"), "--scene", "kitchen"]
    options += ["--out", str(room / "run"), "--manifest", str(room / "run" / "others.manifest.json")]
    assert main(["import-results", *options, "--settings", json.dumps({"path": str(room)} | settings)]) == code


def metrics(room):
    out = room / "run" / "metrics.json"
    folders = [text for name in ("materials", "render") for text in (f"--{name}", str(room / "run" / name))]
    assert main(["metrics", "--dataset", str(room / "room"), *folders, "--partial", "--out", str(out)]) == 0
    return json.loads(out.read_text())


def size(room, number=0):
    data = Dataset(room / "room")
    camera = data.camera(data.views("train")[number])
    return camera.height, camera.width


def write_kd(room, value=KD, views=None):
    count = len(Dataset(room / "room").views("train")) if views is None else views
    for number in range(count):
        image = np.full((*size(room, number), 3), value, np.float32)
        write_exr(room / "brdf" / "theirs" / "kitchen" / f"{number:03d}_kd.exr", {"": image})


def test_rejected_views_keep_their_number(room):
    """Files are numbered by all views; the checks of ours that left one out know nothing of them."""
    views = Dataset(room / "room").views("train")
    for number, value in enumerate((0.2, 0.4, 0.6)[: len(views)]):
        write_exr(
            room / "brdf" / "theirs" / "kitchen" / f"{number:03d}_kd.exr",
            {"": np.full((*size(room, number), 3), value, np.float32)},
        )
    path = room / "room" / "views.json"
    write_views(path, views, {views[0]: "blurred"})
    call(room, {"method": "theirs"})
    assert not (room / "run" / "materials" / f"{views[0]}.exr").exists()
    found = read_layers(room / "run" / "materials" / f"{views[1]}.exr")["kd"]
    np.testing.assert_allclose(found, 0.4, rtol=1e-5)


def test_a_quantity_that_is_not_there_has_no_figure(room):
    write_kd(room, KD + 0.1)
    call(room, {"method": "theirs"})
    found = metrics(room)
    assert found["train"]["kd_psnr"] == pytest.approx(20.0, abs=1e-3)
    assert found["train"]["published"]["kd_psnr"] == pytest.approx(19.9, abs=0.3)
    assert [found["train"][name] for name in ("reflectance_psnr", "roughness_l1", "emission_iou")] == [None] * 3
    assert found["val"]["kd_psnr"] is None
    assert found["train"]["render_psnr"] is None
    assert "emitters" not in found


def test_arrays_of_numbered_files(room):
    for number in range(len(Dataset(room / "room").views("train"))):
        shape = size(room, number)
        arrays = {"diffuse": np.full((*shape, 3), KD), "roughness": np.full((*shape, 1), 0.5)}
        save_npz(room / f"{number:06d}.npz", **arrays)
    call(room, {"layout": "npz"})
    found = metrics(room)["train"]
    assert (found["roughness_l1"], found["reflectance_psnr"]) == (0.5, None)


def test_scaling_takes_the_energy_of_the_dark_values(room):
    truth = np.full((4, 5, 3), 0.2, np.float32)
    truth[0, 0] = 9.0
    assert scaled_to(3 * np.where(truth < 1, truth, 7), truth)[1, 1] == pytest.approx([0.2] * 3)
    assert not scaled_to(0 * truth, truth).any()
    write_kd(room, 2 * KD)
    call(room, {"method": "theirs", "scaled": True})
    view = Dataset(room / "room").views("train")[0]
    assert read_layers(room / "run" / "materials" / f"{view}.exr")["kd"][0, 0] == pytest.approx([KD] * 3, rel=1e-3)


@pytest.mark.parametrize("fill", [np.nan, 0.0, 0.9])
def test_scaling_leaves_out_what_the_photograph_does_not_show(room, fill):
    """Four rows are masked, and one pixel is clipped."""
    data = Dataset(room / "room")
    (view,) = data.views("val")
    photo = data.image(view)[0] + np.float32(0.1)
    height, width = photo.shape[:2]
    write_exr(room / "viewsynthesis" / "theirs" / "kitchen" / "000.exr", {"": 2 * photo})
    valid, flags = np.ones((height, width), np.float32), np.zeros((height, width), np.uint32)
    valid[:4], flags[5, 5] = 0, FLAG_SATURATED
    shown = photo.copy()
    shown[:4], shown[5, 5] = fill, 0.01
    write_exr(room / "room" / "images" / f"{view}.exr", {"": shown, "valid.Y": valid, "flags.Y": flags})
    call(room, {"method": "theirs", "scaled": True})
    np.testing.assert_allclose(read_rgb(room / "run" / "render" / f"{view}.exr"), photo, rtol=2e-3)


def test_bad_files_are_one_line_and_write_nothing(room, capsys):
    def refused(settings, *said):
        call(room, settings, code=2)
        line = capsys.readouterr().err.strip()
        assert "\n" not in line
        assert all(text in line for text in said), line
        assert not (room / "run" / "materials").exists()

    refused({"method": "theirs"}, "holds no outputs of this scene")
    write_kd(room, views=1)
    refused({"method": "theirs"}, "must hold a file for each of", "001_kd.exr")
    write_kd(room)
    write_exr(room / "brdf/theirs/kitchen/001_kd.exr", {"": np.zeros((3, 3, 3), np.float32)})
    refused({"method": "theirs"}, "001_kd.exr: kd must have shape")
    for number in range(len(Dataset(room / "room").views("train"))):
        (room / f"{number:06d}.npz").write_bytes(pickle.dumps({"kd": [1]}))
    refused({"layout": "npz"}, "000000.npz")


def test_what_holds_nothing_is_named(room, caplog):
    """Layers of zeros, and of one value where that cannot be; all zeros are refused."""
    brdf = room / "brdf/theirs/kitchen"
    views = Dataset(room / "room").views("train")
    write_kd(room)
    for number in range(len(views)):
        for name in ("roughness", "emission"):
            write_exr(brdf / f"{number:03d}_{name}.exr", {"": np.zeros((*size(room, number), 3), np.float32)})
    image = np.random.default_rng(0).random((*size(room), 3), np.float32)
    write_exr(brdf / "000_kd.exr", {"": image})
    call(room, {"method": "theirs"})
    assert f"materials: kd is one value in all pixels of {', '.join(views[1:])}\n" in caplog.text
    assert f"materials: roughness is 0 in all pixels of {', '.join(views)}\n" in caplog.text
    assert f"materials: emission is 0 in all pixels of {', '.join(views)}\n" in caplog.text
    before = (room / "run" / "others.manifest.json").read_bytes()
    write_kd(room, 0.0)
    call(room, {"method": "theirs"}, code=2)
    assert (room / "run" / "others.manifest.json").read_bytes() == before


def test_a_card_of_another_program(room):
    write_kd(room, views=2)
    card = {"label": "Theirs", "kind": "imported", "estimator": "imported", "source": "their paper"}
    scene = {"source": "procedural", "settings": {"synthesize": {"train_views": 3, "val_views": 1}}}

    def methods(**settings):
        own = card | {"settings": {"import_results": {"scene": "kitchen", "method": "theirs", **settings}}}
        return load({"scenes": {"room": scene}, "methods": {"theirs": own}}).scenes["room"].methods

    with pytest.raises(FiptError, match="a file for each of 3 views"):
        methods(path=str(room)).reasons()
    for number in range(2):
        (room / f"brdf/theirs/kitchen/{number:03d}_kd.exr").unlink()
    found = methods(path=str(room), scaled=True)
    assert "no outputs of this scene" in found.reasons()["theirs"]
    assert json.loads(found.card_json("theirs"))["oracle"] == ["scale of every picture"]
    assert found.stats("theirs") == []
    with pytest.raises(FiptError, match="must be a folder"):
        methods(path=str(room / "nowhere")).reasons()
