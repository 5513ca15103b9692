"""``fipt video`` and a setup's own cameras."""

import json

import numpy as np
import pytest
from PIL import Image

from fipt.cli.main import main
from fipt.conventions import LUMINANCE
from fipt.formats.exr import read_rgb
from fipt.formats.images import srgb_encode
from fipt.formats.manifests import read_manifest
from fipt.scene.cameras import read_transforms
from tests import scenes
from tests.fitted import call


def film(root, own, name="film", **more):
    """Render a setup's own cameras and join the images; return the folder, both stats and the exit code."""
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
    image, wall = scenes.image(view)
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
    assert call("relight", work, *alone, "--cameras", "frame-0002") == 0
    assert [made.name for made in (work / "x").iterdir()] == ["frame-0002.exr"]
    np.testing.assert_array_equal(read_rgb(work / "x" / "frame-0002.exr"), read_rgb(out / "frame-0002.exr"))
    # fewer frames, and images alone: nothing of before is taken along
    *_, code = film(work, {"path": path | {"frames": 2, "video": "png"}})
    assert code == 0
    assert not (work / "relight" / "film.mp4").exists()
    assert len(read_manifest(work / "relight" / "film.manifest.json", "video")["files"]) == 3


def test_cameras_that_stand_badly_are_warned_of(work, capsys):
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
    assert call("relight", work, "--cameras", "x") == 2
    assert "--cameras needs a setup with cameras" in capsys.readouterr().err
