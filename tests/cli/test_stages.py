"""Every verb of the pipeline on a tiny room, end to end; and what each says of bad input."""

import json
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import drjit
import numpy as np
import pytest
import torch
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion

from fipt.cli.main import main
from fipt.conventions import LUMINANCE, SHADING_OUTPUTS
from fipt.formats import files
from fipt.formats.arrays import load_npz, save_npy, save_npz
from fipt.formats.exr import read_rgb, write_exr
from fipt.formats.images import srgb_encode
from fipt.formats.manifests import read_manifest
from fipt.model import store
from fipt.scene.cameras import read_transforms, write_transforms
from fipt.scene.dataset import read_layers
from fipt.scene.emitters import read_emitters
from fipt.scene.environment import read_environment
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.review import ranges, read_review
from fipt.scene.samples import read_samples
from fipt.scene.shading import read_shading
from fipt.stages.fit import loop
from tests import scenes

FEW = {"diffuse_spp": 4, "specular_spp": 2, "smooth_spp": 2}
FIT = {
    "steps": 60,
    "batch": 128,
    "levels": 4,
    "table_log2": 10,
    "learning_rate": 0.01,
    "threads": 1,
    "emission_weight": 0.1,
}
NIGHT = {
    "emitters": [{"scale": 0}],
    "lights": [{"shape": "sphere", "center": [1.2, 0.8, 2.0], "radius": 0.2, "radiance": [5, 0, 0]}],
}


@pytest.fixture(scope="module")
def threads(backend):
    """Verbs may set the number of threads of the whole process."""
    before = torch.get_num_threads(), drjit.thread_count()
    yield
    torch.set_num_threads(before[0])
    drjit.set_thread_count(before[1])


def arguments(root: Path) -> dict[str, list]:
    """The call of every verb, by name."""
    data, train, val = root / "dataset", root / "samples" / "train-000", root / "samples" / "val-000"
    outside = ["--environment", root / "environment.npz"]
    cache, zero, one = root / "cache.npz", root / "round-0", root / "round-1"
    shading, model, emitters = zero / "shading" / "train-000", zero / "model.safetensors", zero / "emitters.npz"
    fitted = ["--dataset", data, "--model", model, "--emitters", emitters]
    images = [*fitted, "--views", "c", "--cache", cache, *outside, "--rays-per-side", 3]
    return {
        "samples": ["--dataset", data, "--views", "a,b", "--out", train],
        "environment": ["--dataset", data, "--samples", train, "--out", root / "environment.npz"],
        "cache": ["--dataset", data, "--samples", train, "--out", cache],
        "bake": ["--dataset", data, "--samples", train, "--cache", cache, *outside, "--out", shading],
        "fit": [
            "--dataset",
            data,
            "--samples",
            train,
            "--shading",
            shading,
            "--cache",
            cache,
            *outside,
            "--out",
            model,
        ],
        "emitters": ["--dataset", data, "--samples", train, "--shading", shading, "--model", model, "--out", emitters],
        "review": [
            *("--dataset", data, "--samples", train, "--emitters", emitters),
            *("--out", root / "emitters", "--review", root / "emitters_review.yaml"),
        ],
        "refine": [
            *fitted,
            "--samples",
            train,
            "--cache",
            cache,
            *outside,
            "--previous",
            shading,
            "--out",
            one / "shading" / "train-000",
        ],
        "materials": [
            *fitted,
            "--confidence",
            zero / "confidence.npz",
            "--samples",
            val,
            "--out",
            root / "materials",
            "--manifest",
            root / "materials.val-000.manifest.json",
        ],
        "render": [*images, "--out", root / "render", "--manifest", root / "render.val-000.manifest.json"],
        "relight": [
            *images,
            "--setup",
            json.dumps(NIGHT),
            "--out",
            root / "relight" / "night",
            "--manifest",
            root / "relight" / "night.val-000.manifest.json",
        ],
        "olat": [
            *images,
            "--views",
            "c",
            "--out",
            root / "olat",
            "--manifest",
            root / "olat.val-000.manifest.json",
        ],
    }


SETTINGS = {
    "samples": {"grid": 3},
    "environment": {},
    "cache": {"resolution": 32},
    "bake": FEW,
    "fit": FIT,
    "emitters": {"points": 20},
    "review": {"width": 96},
    "refine": FEW | {"max_depth": 3},
    "materials": {},
    "render": {"spp": 16, "max_depth": 3},
    "relight": {"spp": 16, "max_depth": 3},
    "olat": {"spp": 16, "max_depth": 3},
}


def call(verb, root, *replaced, settings=None, stats=None):
    """Run a verb as `arguments` says, with options replaced or added: ("--out", path, ...). Return the exit code."""
    options = list(map(str, arguments(root)[verb]))
    for name, value in zip(replaced[::2], replaced[1::2], strict=True):
        if name in options:
            options[options.index(name) + 1] = str(value)
        else:
            options += [name, str(value)]
    options += ["--settings", json.dumps(SETTINGS[verb] if settings is None else settings)]
    return main([verb, *options, *(["--stats", str(stats)] if stats else [])])


@pytest.fixture(scope="module")
def scene(threads, tmp_path_factory):
    """Results of all verbs on the box room, one round and a refinement."""
    root = tmp_path_factory.mktemp("scene")
    scenes.write_dataset(root / "dataset")
    for verb in SETTINGS:
        assert call(verb, root, stats=root / "stats" / f"{verb}.json") == 0, verb
        if verb == "samples":
            assert call("samples", root, "--views", "c", "--out", root / "samples" / "val-000") == 0
    return root


@pytest.fixture
def work(scene, tmp_path):
    """A copy of the results that a test may spoil."""
    return Path(shutil.copytree(scene, tmp_path / "scene"))


# --- what the verbs write -------------------------------------------------------------------------


def test_files_of_a_run(scene):
    found = {str(path.relative_to(scene)) for path in scene.rglob("*") if path.is_file()}
    found = {name for name in found if not name.startswith(("dataset/", "samples/", "stats/"))}
    assert found == {
        "environment.npz",
        "cache.npz",
        "round-0/shading/train-000/shading.npy",
        "round-0/shading/train-000.manifest.json",
        "round-0/model.safetensors",
        "round-0/confidence.npz",
        "round-0/emitters.npz",
        "round-0/emitters.json",
        "emitters/emitters.json",
        "emitters/emitter-0.png",
        "emitters.manifest.json",
        "emitters_review.yaml",
        "round-1/shading/train-000/shading.npy",
        "round-1/shading/train-000.manifest.json",
        "materials/c.exr",
        "materials.val-000.manifest.json",
        "render/c.exr",
        "render.val-000.manifest.json",
        "relight/night/c.exr",
        "relight/night.val-000.manifest.json",
        "olat/c.exr",
        "olat.val-000.manifest.json",
    }


@pytest.mark.parametrize("verb", SETTINGS)
def test_stats_of_a_run(scene, verb):
    content = json.loads((scene / "stats" / f"{verb}.json").read_text())
    assert content["stage"] == verb
    assert content["wall_s"] > 0
    assert content["peak_memory_bytes"] > 1e7
    assert SETTINGS[verb].items() <= content["settings"].items()


def test_the_fit_knows_unseen_surface(scene):
    content = json.loads((scene / "stats" / "fit.json").read_text())
    assert {"target", "base", "hidden"} <= set(content["loss"])
    assert content["loss"]["hidden"] > 0


def test_manifests_name_what_was_written(scene):
    for verb, path in (
        ("samples", "samples/train-000.manifest.json"),
        ("bake", "round-0/shading/train-000.manifest.json"),
        ("refine", "round-1/shading/train-000.manifest.json"),
        ("review", "emitters.manifest.json"),
        ("materials", "materials.val-000.manifest.json"),
        ("render", "render.val-000.manifest.json"),
        ("relight", "relight/night.val-000.manifest.json"),
        ("olat", "olat.val-000.manifest.json"),
    ):
        manifest = read_manifest(scene / path, verb)
        assert SETTINGS[verb].items() <= manifest["settings"].items()
        assert manifest["files"]
        assert all(((scene / path).parent / name).is_file() for name in manifest["files"])


def test_shading_fits_its_samples(scene):
    samples = read_samples(scene / "samples" / "train-000")
    cache = load_npz(scene / "cache.npz")
    for k in (0, 1):
        shading = read_shading(scene / f"round-{k}" / "shading" / "train-000")[:]
        assert shading.shape == (len(samples.position), SHADING_OUTPUTS, 3)
        assert np.isfinite(shading).all()
        assert 0.05 < shading[:, 0].mean() < cache["radiance"].max()


def test_the_lamp_is_found_and_seen(scene):
    emitters = read_emitters(scene / "round-0" / "emitters.npz")
    np.testing.assert_array_equal(np.sort(emitters.triangle), scenes.room().triangle)
    np.testing.assert_allclose(emitters.radiance, [scenes.LAMP_RADIANCE] * 2, rtol=1e-5)
    layers = read_layers(scene / "materials" / "c.exr")
    image, wall = scenes.picture(scenes.cameras()[2])
    np.testing.assert_array_equal(layers["hit"], 1)
    np.testing.assert_array_equal(layers["emission_mask"] > 0, wall == 7)
    assert (wall == 7).any()
    assert layers["base_color"].shape == image.shape
    # the lamp's pixels are exact, those at its edge show its share as far as nine rays tell; the rest is lit by it
    render = read_rgb(scene / "render" / "c.exr")
    inside, edge = binary_erosion(wall == 7), binary_dilation(wall == 7) & ~binary_erosion(wall == 7)
    np.testing.assert_allclose(render[inside], image[inside], rtol=1e-5)
    np.testing.assert_allclose(render[edge], image[edge], atol=3)
    assert render[wall != 7].mean() > 0.01


def test_the_new_light_is_red_and_the_old_one_off(scene):
    night = read_rgb(scene / "relight" / "night" / "c.exr")
    assert night[..., 1:].max() < 1e-3  # the denoiser is never quite black
    assert night[..., 0].max() > 0.05
    _, _wall = scenes.picture(scenes.cameras()[2])
    lamp = read_layers(scene / "materials" / "c.exr")["emission_mask"] > 0
    assert night[lamp].max() < 1.0


@pytest.fixture(scope="module")
def exported(scene, tmp_path_factory):
    """The room for other programs, and the check of its files."""
    folder, zero = tmp_path_factory.mktemp("export"), scene / "round-0"
    out, data, samples = folder / "export", scene / "dataset", scene / "samples"
    fitted = {
        "--model": zero / "model.safetensors",
        "--emitters": zero / "emitters.npz",
        "--confidence": zero / "confidence.npz",
        "--environment": scene / "environment.npz",
        "--samples": samples / "train-000",
        "--manifest": folder / "export.manifest.json",
        "--settings": json.dumps({"texel_density": 20}),
    }
    options = ["--name", "tiny", "--dataset", data, "--out", out, *(text for pair in fitted.items() for text in pair)]
    assert main(["export", *map(str, options)]) == 0
    clean = folder / "render"
    settings = {"spp": 512, "max_depth": 3}
    assert call("render", scene, "--out", clean, "--manifest", folder / "render.json", settings=settings) == 0
    options = ["--dataset", data, "--samples", samples / "val-000", "--export", out, "--render", clean]
    options += ["--out", out / "check.json", "--settings", json.dumps({"check_spp": 128, "max_depth": 5})]
    assert main(["check-export", *map(str, options)]) == 0
    return out


def test_every_exported_file_shows_the_room(exported):
    from fipt.stages.export.check import psnr

    check = json.loads((exported / "check.json").read_text())
    assert list(check["formats"]) == ["glb", "usd", "mitsuba", "exact"]
    ours = read_rgb(exported.parent / "render" / "c.exr")
    for kind, entry in check["formats"].items():
        picture = read_rgb(exported / "check" / kind / "c.exr")
        assert psnr(picture, ours) > (27 if kind == "mitsuba" else 30), kind
        assert psnr(picture[:, ::-1], ours) < 20, kind
        assert entry["psnr"] == pytest.approx(psnr(picture, ours), abs=0.1)
        assert set(entry["views"]) == {"c"}


def test_the_export_lists_its_files(exported):
    manifest = read_manifest(exported.parent / "export.manifest.json", "export")
    written = {str(path.relative_to(exported.parent)) for path in exported.rglob("*") if path.is_file()}
    checked = {name for name in written if name.startswith(("export/check", "export.", "render"))}
    assert set(manifest["files"]) == written - checked
    facts = json.loads((exported / "export.json").read_text())
    assert facts["scene"] == "tiny"
    assert [lamp["radiance"] for lamp in facts["emitters"]] == [pytest.approx(scenes.LAMP_RADIANCE)]
    script = (exported / "blender.py").read_text()
    compile(script, "blender.py", "exec")


def test_a_check_without_its_files(exported, scene, refused, tmp_path):
    common = ["--dataset", str(scene / "dataset"), "--samples", str(scene / "samples" / "val-000"), "--out", "x.json"]
    here = ["--render", str(scene / "render")]
    assert main(["check-export", *common, *here, "--export", str(tmp_path)]) == 2
    assert main(["check-export", *common, "--render", str(tmp_path), "--export", str(exported)]) == 2


def test_the_only_lamp_alone_is_the_room_as_it_is(scene, tmp_path):
    layers = read_layers(scene / "olat" / "c.exr")
    assert set(layers) == {"emitter-0"}
    assert call("relight", scene, "--setup", "{}", "--out", tmp_path, "--manifest", tmp_path / "m.json") == 0
    np.testing.assert_array_equal(layers["emitter-0"], read_rgb(tmp_path / "c.exr"))


def film(root, own, name="film", **more):
    """Render a setup's own cameras and join the pictures; return the folder, both stats and the exit code."""
    out, data = root / "relight" / name, root / "dataset"
    made = ("--setup", json.dumps({"cameras": own}), "--out", out, "--manifest", f"{out}.camera-000.manifest.json")
    code = call("relight", root, *made, stats=root / "stats" / "relight.json")
    options = ["--dataset", data, "--cameras", json.dumps(own), "--images", out]
    options += ["--manifest", f"{out}.manifest.json", "--stats", root / "stats" / "video.json"]
    code = code or main(["video", *map(str, options), "--settings", json.dumps(more)])
    stats = [root / "stats" / f"{verb}.json" for verb in ("relight", "video")]
    return out, *(json.loads(path.read_text()) if path.is_file() else {} for path in stats), code


def test_a_free_camera_sees_what_a_view_there_sees(work):
    """View c's place and direction, and the same from afar: the room in closed form, and its cameras."""
    view = scenes.cameras()[2]
    eye, ahead = view.center, -view.world_from_camera[:3, 2]
    here = {"position": eye.tolist(), "target": (eye + 2 * ahead).tolist()}
    own = {"look_at": {"c": here, "wide": {**here, "fov": 120, "width": 15, "height": 11}}}
    out, relit, joined, code = film(work, own)
    assert code == 0
    assert relit["warnings"] == []
    same = work / "same"
    assert call("relight", work, "--setup", "{}", "--out", same, "--manifest", work / "same.manifest.json") == 0
    np.testing.assert_allclose(read_rgb(out / "c.exr"), read_rgb(same / "c.exr"), rtol=1e-2, atol=2e-2)
    image, wall = scenes.picture(view)
    np.testing.assert_array_equal(read_rgb(out / "c.exr")[wall == 7].max(), image[wall == 7].max())
    cameras = {camera.name: camera for camera in read_transforms(out / "transforms.json")}
    np.testing.assert_allclose(cameras["c"].world_from_camera, view.world_from_camera, atol=1e-12)
    assert (cameras["wide"].width, cameras["wide"].height) == (15, 11)
    # shown with the exposure of the photographs, as the report does
    photos = [read_rgb(work / "dataset" / "images" / f"{name}.exr") for name in "abc"]
    exposure = 0.2 / np.median(np.concatenate([(photo @ LUMINANCE).ravel() for photo in photos]))
    assert joined["exposure"] == pytest.approx(exposure, rel=1e-5)
    with Image.open(out / "c.png") as shown:
        expected = 255 * np.clip(srgb_encode(np.clip(exposure * read_rgb(out / "c.exr"), 0, 1)), 0, 1)
        np.testing.assert_allclose(np.array(shown), expected, atol=0.51)
    options = ["--dataset", work / "dataset", "--cameras", json.dumps(own), "--images", out, "--max-views", 1]
    options += ["--manifest", work / "m.json", "--stats", work / "m.stats.json"]
    assert main(["video", *map(str, options)]) == 0
    assert json.loads((work / "m.stats.json").read_text())["exposure"] == pytest.approx(
        0.2 / np.median(photos["abc".index("c")] @ LUMINANCE), rel=1e-5
    )
    manifest = read_manifest(work / "relight" / "film.manifest.json", "video")
    assert set(manifest["files"]) == {"film/transforms.json", "film/c.png", "film/wide.png"}
    assert not (work / "relight" / "film.mp4").exists()


def test_a_path_becomes_a_video_in_any_shards(work, capsys):
    path = {"keyframes": ["c", {"position": [2, 1.5, 2], "target": [2, 1, 0]}], "frames": 3, "width": 9, "height": 7}
    out, relit, joined, code = film(work, {"path": path}, exposure=0.5)
    assert code == 0
    assert (joined["images"], joined["exposure"]) == (3, 0.5)
    assert relit["warnings"] == []
    assert (work / "relight" / "film.mp4").stat().st_size == joined["video_bytes"] > 500
    assert len(read_manifest(work / "relight" / "film.manifest.json", "video")["files"]) == 5
    alone = ("--setup", json.dumps({"cameras": {"path": path}}), "--out", work / "x", "--manifest", work / "x.json")
    options = [*map(str, arguments(work)["relight"]), "--cameras", "frame-0002"]
    for name, value in zip(alone[::2], alone[1::2], strict=True):
        options[options.index(name) + 1] = str(value)
    assert main(["relight", *options, "--settings", json.dumps(SETTINGS["relight"])]) == 0
    assert [made.name for made in (work / "x").iterdir()] == ["frame-0002.exr"]
    np.testing.assert_array_equal(read_rgb(work / "x" / "frame-0002.exr"), read_rgb(out / "frame-0002.exr"))
    # fewer frames, and pictures alone: nothing of before is taken along
    *_, code = film(work, {"path": path | {"frames": 2, "video": "png"}})
    assert code == 0
    assert not (work / "relight" / "film.mp4").exists()
    assert len(read_manifest(work / "relight" / "film.manifest.json", "video")["files"]) == 3


def test_cameras_that_stand_badly_are_told(work, capsys):
    outside = {"position": [9, 9, 9], "target": [12, 9, 9]}
    close = {"position": [0.01, 1.5, 2], "target": [2, 1.5, 2]}
    out, relit, _, code = film(work, {"look_at": {"lost": outside, "close": close}})
    assert code == 0
    said = capsys.readouterr().err
    assert len(relit["warnings"]) == 2
    for text in ("less than 3 cm from a surface: close", "in a wall or object, or outside the room: lost"):
        assert f"warning: 1 of 2 cameras stand {text}" in said
        assert any(text in warning for warning in relit["warnings"])
    assert not read_rgb(out / "lost.exr").any()


def test_own_cameras_that_cannot_be(work, refused, capsys):
    def said(own):
        setup = json.dumps({"cameras": own})
        return refused("relight", "--setup", setup, "--out", work / "none", "--manifest", work / "none.json")

    assert "through view 'd', which there is not; use " in said({"path": {"keyframes": ["a", "d"], "frames": 2}})
    assert "setup.cameras.path.frames: input should be greater" in said(
        {"path": {"keyframes": ["a", "b"], "frames": 0}}
    )
    out, *_, code = film(work, {"look_at": {"x": {"position": [2, 1, 2], "target": [1, 1, 1]}}})
    assert code == 0
    capsys.readouterr()
    options = ["--dataset", work / "dataset", "--images", out, "--manifest", work / "none.json", "--cameras"]
    taller = '{"look_at": {"x": {"position": [2, 1, 2], "target": [1, 1, 1], "height": 99}}}'
    assert main(["video", *map(str, options), taller]) == 2
    assert "x.exr must be 16x99 like its camera; it is 16x12; run fipt relight again" in capsys.readouterr().err
    other = '{"look_at": {"y": {"position": [2, 1, 2], "target": [1, 1, 1]}}}'
    assert main(["video", *map(str, options), other]) == 2
    assert "y.exr" in capsys.readouterr().err
    assert not (work / "none").exists()
    assert not (work / "none.json").exists()
    assert main(["relight", *map(str, arguments(work)["relight"]), "--cameras", "x"]) == 2
    assert "--cameras needs a setup with cameras" in capsys.readouterr().err


def test_running_again_gives_the_same(work):
    """Also into folders that exist already."""
    for verb in ("samples", "environment", "cache", "bake", "fit", "emitters", "refine", "render"):
        before = content(work, skip="stats")
        assert call(verb, work) == 0
        after = content(work, skip="stats")
        assert {name for name, data in before.items() if after.get(name) != data} == set(), verb
        assert set(after) == set(before)


def test_shards_of_one_view_give_the_same_shading(scene, tmp_path):
    """Results do not depend on the size of shards."""
    both = read_shading(scene / "round-0" / "shading" / "train-000")
    samples = read_samples(scene / "samples" / "train-000")
    for index, view in enumerate("ab"):
        assert call("samples", scene, "--views", view, "--out", tmp_path / "samples" / view) == 0
        assert call("bake", scene, "--samples", tmp_path / "samples" / view, "--out", tmp_path / "bake" / view) == 0
        np.testing.assert_array_equal(read_shading(tmp_path / "bake" / view)[:], both[samples.of_view(index)])


# --- light from outside ---------------------------------------------------------------------------

MISSING = 1
"""The wall +x, whose radiance the pictures show all the same: as if it were far outside."""


@pytest.fixture(scope="module")
def opened(threads, tmp_path_factory):
    """Results of all verbs on the box room without one wall."""
    root = tmp_path_factory.mktemp("opened")
    scenes.write_dataset(root / "dataset")
    mesh = scenes.room().mesh
    write_ply(root / "dataset" / "mesh.ply", Mesh(mesh.vertices, np.delete(mesh.triangles, [2, 3], axis=0)))
    for verb in SETTINGS:
        assert call(verb, root, stats=root / "stats" / f"{verb}.json") == 0, verb
        if verb == "samples":
            assert call("samples", root, "--views", "c", "--out", root / "samples" / "val-000") == 0
    return root


def test_a_closed_room_has_no_light_from_outside(scene):
    assert json.loads((scene / "stats" / "environment.json").read_text())["mode"] == "none"
    assert load_npz(scene / "environment.npz")["radiance"].shape == (1, 1, 3)


def test_light_from_outside_is_found_and_lights_the_room(opened, tmp_path):
    found = read_environment(opened / "environment.npz")
    assert found.mode == "map"
    np.testing.assert_allclose(found.radiance, np.broadcast_to(scenes.COLORS[MISSING], (32, 64, 3)), rtol=1e-4)
    _, wall = scenes.picture(scenes.cameras()[2])
    outside = binary_erosion(wall == MISSING + 1)
    assert outside.sum() > 20
    shown = read_rgb(opened / "render" / "c.exr")[outside]
    np.testing.assert_allclose(shown, np.broadcast_to(scenes.COLORS[MISSING], shown.shape), rtol=1e-3)
    # the opening lights as the wall did; without the background it is dark (denoising is not linear)
    noisy = SETTINGS["bake"] | {"denoise": False}
    assert call("bake", opened, "--out", tmp_path / "lit", settings=noisy) == 0
    options = [str(a) for a in arguments(opened)["bake"]]
    at = options.index("--environment")
    options[options.index("--out") + 1] = str(tmp_path / "dark")
    assert main(["bake", *options[:at], *options[at + 2 :], "--settings", json.dumps(noisy)]) == 0
    lit, dark = (read_shading(tmp_path / name)[:][:, 0].mean(axis=0) for name in ("lit", "dark"))
    gained = lit - dark
    assert gained[1] > 0.05
    np.testing.assert_allclose(gained / gained[1], scenes.COLORS[MISSING] / 0.5, atol=0.02)  # green


def test_setups_change_the_light_from_outside(opened, tmp_path):
    _, wall = scenes.picture(scenes.cameras()[2])
    outside = binary_erosion(wall == MISSING + 1)
    write_exr(tmp_path / "sky.exr", {"": np.broadcast_to(np.float32([3, 0, 0]), (4, 8, 3))})
    for edit, expected in (
        ({"scale": 0.5}, 0.5 * scenes.COLORS[MISSING]),
        ({"radiance": [0, 0, 4]}, [0, 0, 4]),
        ({"file": str(tmp_path / "sky.exr"), "scale": 2}, [6, 0, 0]),
    ):
        setup = json.dumps({"emitters": [{"scale": 0}], "environment": edit})
        assert call("relight", opened, "--setup", setup, "--out", opened / "relight" / "other") == 0
        picture = read_rgb(opened / "relight" / "other" / "c.exr")
        shown = picture[outside]
        np.testing.assert_allclose(shown, np.broadcast_to(expected, shown.shape), rtol=1e-3, atol=1e-5)
        inside = picture[wall == 4].mean(axis=0)
        assert inside.argmax() == np.argmax(expected)
        assert inside.max() > 2e-3


def test_lamps_and_outside_alone_add_up_to_any_mix_of_them(opened, tmp_path):
    """Within 40 dB as displayed, denoised, though the denoiser is not linear."""
    many = {"spp": 1024, "max_depth": 3}
    assert call("olat", opened, "--out", tmp_path, "--manifest", tmp_path / "m.json", settings=many) == 0
    layers = read_layers(tmp_path / "c.exr")
    assert set(layers) == {"emitter-0", "outside"}
    tint = np.array([0.5, 1.0, 2.0])
    radiance = (scenes.LAMP_RADIANCE * tint).tolist()
    for setup, gains in (
        ({}, (1, 1)),
        ({"emitters": [{"radiance": radiance}], "environment": {"scale": 3}}, (tint, 3)),
        ({"emitters": [{"scale": 0.2}], "environment": {"scale": 2}}, (0.2, 2)),
    ):
        relit = ("--setup", json.dumps(setup), "--out", tmp_path / "relit", "--manifest", tmp_path / "r.json")
        assert call("relight", opened, *relit, settings=many) == 0
        direct = read_rgb(tmp_path / "relit" / "c.exr")
        mixed = gains[0] * layers["emitter-0"] + gains[1] * layers["outside"]
        shown = [srgb_encode(np.clip(2 * picture, 0, 1)) for picture in (mixed, direct)]
        assert 0.1 < shown[1].mean() < 0.9
        assert -10 * np.log10(((shown[0] - shown[1]) ** 2).mean()) > 40, setup


def test_bad_environments(work, refused, tmp_path):
    out = ("--out", work / "new.npz")

    def said(**settings):
        return refused("environment", *out, settings=settings)

    assert "environment.mode is given, but environment.file is missing" in said(mode="given")
    assert "environment.file is only for mode given; mode is auto" in said(file="sky.exr")
    assert "environment.radiance is only for mode constant; mode is map" in said(mode="map", radiance=[1, 1, 1])
    assert "environment.mode constant needs training pixels that see no surface" in said(mode="constant")
    assert "environment.mode: input should be" in said(mode="sky")
    assert "sky.exr" in said(mode="given", file=str(tmp_path / "sky.exr"))
    write_exr(tmp_path / "sky.exr", {"": np.full((4, 8, 3), np.nan)})
    assert "32 texels are NaN" in said(mode="given", file=str(tmp_path / "sky.exr"))
    assert "32 texels are NaN" in refused(
        "relight", "--setup", json.dumps({"environment": {"file": str(tmp_path / "sky.exr")}})
    )
    save_npz(work / "flat.npz", mode=np.array("map"), radiance=np.ones((4, 8)), up=np.array("y"), rotation=0.0)
    for verb in ("bake", "fit", "refine", "render"):
        assert "must be a map of shape (height, width, 3); found (4, 8)" in refused(
            verb, "--environment", work / "flat.npz"
        )


# --- bad input ------------------------------------------------------------------------------------


def content(root, skip=()):
    """Path -> bytes of all files below a folder."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and not str(path.relative_to(root)).startswith(skip or "\0")
    }


@pytest.fixture
def refused(work, capsys):
    """A function that runs a verb, which must fail with one line and leave all files as they are; returns the line."""

    def refused(verb, *replaced, settings=None):
        before = content(work)
        folders = {path for path in work.rglob("*") if path.is_dir()}
        capsys.readouterr()
        assert call(verb, work, *replaced, settings=settings) == 2
        error = [line for line in capsys.readouterr().err.splitlines() if "error" in line.lower()]
        assert len(error) == 1
        assert error[0].startswith("fipt: error: ")
        assert content(work) == before
        left = {path for path in work.rglob("*") if path.is_dir()} - folders
        assert not [path for path in left if "tmp" in path.name]
        return error[0]

    return refused


def test_bad_meshes(work, refused):
    path, room = work / "dataset" / "mesh.ply", scenes.room().mesh
    out = ("--out", work / "new" / "train-000")
    path.unlink()
    assert "the mesh is missing" in refused("samples", *out)
    write_ply(path, Mesh(room.vertices, room.triangles[:0]))
    assert "must hold triangles" in refused("samples", *out) or "not a readable mesh" in refused("samples", *out)
    vertices = room.vertices.copy()
    vertices[[2, 5], 1] = np.nan
    write_ply(path, Mesh(vertices, room.triangles))
    assert "2 are NaN or infinite, the first is vertex 2" in refused("samples", *out)


def test_a_view_that_sees_nothing(work, refused):
    cameras = scenes.cameras()
    away = scenes.look_at("b", (10, 1, 1), (20, 1, 1))
    write_transforms(work / "dataset" / "transforms.json", [cameras[0], away, cameras[2]])
    assert "view b: all rays miss the mesh" in refused("samples", "--out", work / "samples" / "new")


def test_an_unknown_view(refused):
    assert "view d is not among the accepted views" in refused("samples", "--views", "a,d")


@pytest.mark.parametrize("verb", ["environment", "cache", "fit", "emitters"])
def test_bad_pictures(work, refused, verb):
    path = work / "dataset" / "images" / "b.exr"
    image = read_rgb(path)
    for value, word in ((np.nan, "NaN"), (np.inf, "infinite"), (-1.0, "negative")):
        bad = image.copy()
        bad[3, 4, 1] = bad[5, 5] = value
        write_exr(path, {"": bad})
        line = refused(verb)
        assert f"b.exr must hold finite radiance >= 0; 2 pixels are {word}, the first at row 3, column 4" in line
    write_exr(path, {"": image[:-1]})
    assert "b.exr must be 16x12 like its camera; it is 16x11" in refused(verb)
    write_exr(path, {"R": image[..., 0], "Y": image[..., 1]})
    assert "must have the channels R, G, B; G, B not among R, Y" in refused(verb)
    path.unlink()
    assert "missing" in refused(verb)


def test_shading_of_other_samples(work, refused):
    shading = read_shading(work / "round-0" / "shading" / "train-000")
    save_npy(work / "other" / "shading.npy", shading.words[:-3])
    assert "must hold shading of shape" in refused("fit", "--shading", work / "other")
    assert "shading" in refused("emitters", "--shading", work / "other")
    assert "shading" in refused("refine", "--previous", work / "other")


def test_shards_that_do_not_pair_up(work, refused):
    two = f"{work}/samples/train-000,{work}/samples/val-000"
    assert "--samples and --shading must name as many shards; 2 and 1 given" in refused("fit", "--samples", two)
    assert "shards" in refused("emitters", "--samples", two)


def test_damaged_files(work, refused):
    for verb, _option, path in (
        ("bake", "--cache", "cache.npz"),
        ("fit", "--cache", "cache.npz"),
        ("render", "--environment", "environment.npz"),
        ("refine", "--emitters", "round-0/emitters.npz"),
        ("materials", "--model", "round-0/model.safetensors"),
        ("materials", "--confidence", "round-0/confidence.npz"),
        ("fit", "--shading", "round-0/shading/train-000/shading.npy"),
    ):
        target = work / path
        whole = target.read_bytes()
        target.write_bytes(whole[: len(whole) // 2])
        line = refused(verb)
        assert target.name in line, verb
        target.unlink()
        assert target.name in refused(verb)
        target.write_bytes(whole)


def test_a_cache_that_is_something_else(work, refused):
    assert "emitters.npz" in refused("bake", "--cache", work / "round-0" / "emitters.npz")


class Killed(Exception):
    """Stands for kill -9 after some step."""


@pytest.fixture
def killed(work, monkeypatch):
    """The results after a fit that was killed in its 30th step; the settings of that fit."""
    original, calls = loop.losses, []

    def later(*given):
        calls.append(1)
        if len(calls) == 30:
            raise Killed
        return original(*given)

    settings = FIT | {"checkpoint_every": 10}
    (work / "round-0" / "model.safetensors").unlink()
    monkeypatch.setattr(loop, "losses", later)
    with pytest.raises(Killed):
        call("fit", work, settings=settings)
    monkeypatch.setattr(loop, "losses", original)
    assert len(list((work / "round-0").glob("model*"))) == 1  # the checkpoint, and no model
    return settings


def test_a_killed_fit_goes_on_and_gives_the_same_model(work, killed, scene, capsys):
    assert call("fit", work, settings=killed) == 0
    assert "going on from step 20" in capsys.readouterr().out
    assert [path.name for path in (work / "round-0").glob("model*")] == ["model.safetensors"]
    whole, resumed = (store.load_field(root / "round-0" / "model.safetensors").state_dict() for root in (scene, work))
    assert all(torch.equal(value, resumed[name]) for name, value in whole.items())


@pytest.mark.parametrize("change", ["settings", "inputs"])
def test_a_checkpoint_of_another_fit_is_not_used(work, killed, change, capsys):
    if change == "inputs":
        assert call("bake", work, settings=FEW | {"seed": 3}) == 0
    assert call("fit", work, settings=killed | ({"seed": 3} if change == "settings" else {})) == 0
    assert "going on" not in capsys.readouterr().out
    assert [path.name for path in (work / "round-0").glob("model*")] == ["model.safetensors"]


def test_files_of_another_version(work, killed, refused, monkeypatch):
    shutil.copy(next((work / "round-0").glob("model*")), work / "model.safetensors")
    assert "is a checkpoint of the fit, not a field" in refused("materials", "--model", work / "model.safetensors")
    monkeypatch.setitem(store.VERSIONS, "fit", 99)
    assert "this is version 99; delete it and run the fit again" in refused("fit", settings=killed)


def test_a_light_setup_that_names_no_emitter(refused):
    assert "names emitter 7, which is none of 1 lamps; indices are 0 to 0" in refused(
        "relight", "--setup", '{"emitters": [{"index": 7, "scale": 0}]}'
    )
    assert "unknown key setup.lamps" in refused("relight", "--setup", '{"lamps": []}')


def test_a_setup_whose_objects_cannot_be_used(refused, tmp_path):
    def setup(**keys):
        return ("--setup", json.dumps(keys))

    (tmp_path / "a.ply").write_text("nothing")
    thing = {"file": str(tmp_path / "a.ply"), "position": [2, 1, 2]}
    assert "a.ply is not a readable mesh" in refused("relight", *setup(objects=[thing]))
    assert "an object's file is missing" in refused("relight", *setup(objects=[thing | {"file": "none.glb"}]))
    assert "names segment 77, which does not exist; there are 0" in refused("relight", *setup(remove=[{"segment": 77}]))
    light = {"shape": "sphere", "center": [2, 1, 2], "radiance": [1, -1, 1]}
    assert "setup.lights.0.radiance.1" in refused("relight", *setup(lights=[light]))


def test_a_pixel_is_a_point_of_the_room(scene, capsys):
    """Straight ahead of a camera is where it looks."""
    eye, to = np.array([1.0, 1.2, 1.0]), np.array([2.4, 2.4, 3.4])
    data = str(scene / "dataset")
    assert main(["point", data, "c", str(scenes.WIDTH / 2), str(scenes.HEIGHT / 2)]) == 0
    first, second = capsys.readouterr().out.splitlines()[-2:]
    at = np.array(json.loads(first.removeprefix("at: ")))
    scale = min((scenes.SIZE - eye) / (to - eye))
    np.testing.assert_allclose(at, eye + scale * (to - eye), atol=2e-3)
    assert second.startswith("segment 0, ")
    assert main(["point", data, "c", "99", "0"]) == 2
    assert "column 99, row 0 is outside" in capsys.readouterr().err


def test_a_setup_file_puts_an_object_in_and_takes_a_wall_away(scene, tmp_path):
    """The view sees a red cube before it; and where the far wall was, nothing but black."""
    setup = tmp_path / "setup.yaml"
    setup.write_text(
        "objects:\n  - {shape: cube, size: 0.5, position: [2.0, 2.0, 2.7], base_color: [0.8, 0.02, 0.02]}\n"
        "remove:\n  - {box: {center: [2, 1.5, 5], size: [4.1, 3.1, 0.1]}}\n"
    )
    out = ("--setup", setup, "--out", tmp_path / "out", "--manifest", tmp_path / "m.json")
    assert call("relight", scene, *out) == 0
    image, plain = read_rgb(tmp_path / "out" / "c.exr"), read_rgb(scene / "render" / "c.exr")
    _, wall = scenes.picture(scenes.cameras()[2])
    assert (wall == 6).sum() > 10
    red = image[..., 0] > 3 * image[..., 1]
    assert red.sum() > 3
    gone = (wall == 6) & ~red
    inner = binary_erosion(gone)
    assert plain[inner].mean() > 0.01
    assert image[inner].max() < 1e-3


@pytest.mark.parametrize("verb", SETTINGS)
def test_settings_that_do_not_exist(refused, verb):
    assert f"unknown key {verb}.stepz; allowed keys of {verb}: " in refused(verb, settings={"stepz": 3})


def test_a_disk_that_is_too_small(work, refused, monkeypatch, capsys):
    monkeypatch.setattr(files.shutil, "disk_usage", lambda place: SimpleNamespace(free=1000))
    for verb in ("bake", "refine"):
        assert f"the {verb} shading needs" in refused(verb)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is forbidden to root")
def test_a_folder_that_cannot_be_written(work, refused):
    (work / "closed").mkdir(mode=0o500)
    for verb in ("samples", "cache", "bake", "fit", "emitters"):
        assert "cannot be written" in refused(verb, "--out", work / "closed" / "new" / "x.npz")


def test_a_folder_that_is_a_file(work, refused):
    (work / "taken").write_text("mine")
    for verb in ("samples", "cache", "bake", "emitters"):
        assert "taken" in refused(verb, "--out", work / "taken" / "x.npz")


def test_what_a_person_decides_reaches_the_pictures(work):
    """The only lamp is rejected, and the room is dark; then a wall is accepted, and shines as the pictures show it."""
    lamp = scenes.room().triangle
    decided = {"mesh_triangles": len(scenes.room().mesh.triangles), "reject": [ranges(lamp)]}
    review = work / "emitters_review.yaml"
    before = read_review(review)
    assert (before.triangles, before.emission()) == ((frozenset(lamp.tolist()),), "")
    text = review.read_text().replace("verdict: auto", "verdict: reject")
    review.write_text(text)
    assert json.loads(read_review(review).emission()) == decided
    assert call("emitters", work, "--decisions", json.dumps(decided)) == 0
    assert call("review", work, "--decisions", read_review(review).listing()) == 0
    assert json.loads((work / "emitters" / "emitters.json").read_text())["emitters"] == []
    assert [path.name for path in (work / "emitters").glob("*.png")] == [f"rejected-{lamp.min()}.png"]
    assert read_review(review).emission() == json.dumps(decided, sort_keys=True)
    assert call("render", work) == 0
    wall = scenes.picture(scenes.cameras()[2])[1]
    assert read_rgb(work / "render" / "c.exr").max() < 0.01

    assert call("emitters", work, "--decisions", json.dumps(decided | {"accept": ["0-1"]})) == 0
    found = read_emitters(work / "round-0" / "emitters.npz")
    np.testing.assert_array_equal(found.triangle, [0, 1])
    np.testing.assert_allclose(found.radiance, [scenes.COLORS[0]] * 2, rtol=1e-5)
    assert call("render", work) == 0
    assert (read_rgb(work / "render" / "c.exr").max(axis=-1)[wall == 1] > 0.1).all()


def test_the_list_replaces_nothing_but_a_list(work, refused):
    assert "is replaced, but holds" in refused("review", "--out", work / "round-0")
    assert (work / "round-0" / "model.safetensors").is_file()
    assert call("review", work) == 0
    (work / "emitters" / ".stamp").touch()  # as workflow engines leave it
    assert call("review", work) == 0


def test_what_a_person_decides_while_lamps_are_looked_at_stays(work, monkeypatch):
    from fipt.stages.emitters import review as stage

    path, look = work / "emitters_review.yaml", stage.sightings

    def edited(*args):
        path.write_text(path.read_text().replace("verdict: auto", "verdict: accept"))
        return look(*args)

    monkeypatch.setattr(stage, "sightings", edited)
    assert call("review", work) == 0
    assert "verdict: accept" in path.read_text()


def test_names_reach_setup_and_list(work, refused):
    triangles = len(scenes.room().mesh.triangles)
    named = {"mesh_triangles": triangles, "names": {"my lamp": ranges(scenes.room().triangle)}}
    assert call("review", work, "--decisions", json.dumps(named)) == 0
    (lamp,) = json.loads((work / "emitters" / "emitters.json").read_text())["emitters"]
    assert (lamp["name"], lamp["share"], lamp["seen_by"]) == ("my lamp", 1.0, ["a", "b"])
    setup, lamps = json.dumps({"emitters": [{"name": "my lamp", "off": True}]}), work / "emitters" / "emitters.json"
    assert call("relight", work, "--setup", setup, "--emitter-names", lamps) == 0
    assert read_rgb(work / "relight" / "night" / "c.exr").max() < 0.01
    assert "names emitter 'my lamp', which is none of 1 emitters; there are emitter-0" in refused(
        "relight", "--setup", setup
    )
    wrong = json.dumps(named | {"mesh_triangles": 3})
    assert f"of a mesh of 3; the mesh has {triangles}" in refused("review", "--decisions", wrong)
    (work / "emitters_review.yaml").write_text("emitters: [")
    assert "emitters_review.yaml is not YAML" in refused("review")


def test_no_emitter_is_no_error(work, capsys):
    """The run goes on: paths are dark but for the cache, and renders are black."""
    assert call("emitters", work, settings={"points": 5, "threshold": 1.0}) == 0
    assert "warning: no emitter found" in capsys.readouterr().err
    assert json.loads((work / "round-0" / "emitters.json").read_text())["emitters"] == []
    for verb in ("refine", "materials", "render", "relight"):
        assert call(verb, work) == 0
    assert not read_layers(work / "materials" / "c.exr")["emission_mask"].any()
    assert read_rgb(work / "render" / "c.exr").max() < 0.01
    assert read_shading(work / "round-1" / "shading" / "train-000")[:][:, 0].mean() > 0
    assert read_rgb(work / "relight" / "night" / "c.exr")[..., 0].max() > 0.05  # the new light


def test_without_segments_the_fit_says_so(work, capsys):
    shutil.rmtree(work / "dataset" / "segments")
    assert call("fit", work, settings=FIT | {"steps": 2}) == 0
    assert "warning: no segments" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["render", "relight", "olat"])
def test_a_view_that_the_dataset_lacks(verb, scene, tmp_path, capsys):
    made = ("--views", "nowhere", "--out", tmp_path / "out", "--manifest", tmp_path / "out.manifest.json")
    assert call(verb, scene, *made) == 2
    assert "view nowhere is not among the accepted views" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
