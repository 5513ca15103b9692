"""Developed photographs become a dataset: poses, intrinsics, weights, exposure, rejected views."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.scene.cameras import Camera, read_transforms, write_transforms
from fipt.scene.dataset import Dataset, read_rejected, write_views
from fipt.scene.mesh import write_ply
from fipt.scene.sources import EXIF_LENS
from fipt.stages.importing.build import Beside, import_scene
from fipt.stages.importing.settings import ImportSettings
from fipt.stages.importing.stage import ImportInputs, run
from tests.layouts import POSES, room

PLAIN = ImportSettings(overlay=False)
WIDTH, HEIGHT = 8, 6
CAMERA = {"w": WIDTH, "h": HEIGHT, "fl_x": 5.0, "fl_y": 5.0, "cx": 4.1, "cy": 3.0}
SCALE = 0.25
VALID = np.linspace(0.2, 1, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)


def flags():
    found = np.zeros((HEIGHT, WIDTH), np.uint32)
    found[0, :4] = FLAG_SATURATED, FLAG_SATURATED | FLAG_MOVED, FLAG_OUTSIDE, FLAG_NOISE
    return found


def weights():
    """As development writes them: what is clipped, moved or outside has none."""
    found = VALID.copy()
    found[0, :3] = 0
    return found


def radiance():
    values = np.arange(WIDTH * HEIGHT * 3, dtype=np.float32).reshape(HEIGHT, WIDTH, 3) / 8
    values[5, 5] = -0.01  # noise
    values[0, 2] = np.nan  # outside
    return values


@pytest.fixture
def developed(tmp_path: Path) -> Path:
    """Views a and c, a rejected b, one without a pose; poses, mesh, a description of the room."""
    folder = tmp_path / "capture"
    for view in ("a", "c", "lost"):
        write_exr(folder / "hdr" / f"{view}.exr", {"": radiance(), "valid.Y": weights(), "flags.Y": flags()})
        (folder / f"{view}.json").write_text(json.dumps({"camera": CAMERA}))
    states = {view: {"accepted": True} for view in ("a", "c", "lost")}
    states["b"] = {"accepted": False, "reason": "a frame is truncated"}
    (folder / "qa.json").write_text(json.dumps({"views": states, "exposure": {"scale": SCALE}}))
    cameras = []
    for view, pose in zip("abc", POSES, strict=True):
        matrix = np.eye(4)
        matrix[:3] = np.stack([pose.right, pose.up, -pose.forward, pose.origin], axis=1)
        cameras.append(Camera(view, "val" if view == "c" else "train", 16, 12, 11.0, 11.0, 8.0, 6.0, matrix))
    write_transforms(tmp_path / "poses" / "transforms.json", cameras)
    # poses of photographs: any picture may stand there, and its distortion
    text = (tmp_path / "poses" / "transforms.json").read_text().replace(".exr", ".ARW")
    (tmp_path / "poses" / "transforms.json").write_text(text)
    (tmp_path / "poses" / "room.json").write_text("{}")
    write_ply(tmp_path / "mesh.ply", room())
    return tmp_path


def imported(root: Path, settings: ImportSettings = PLAIN, **options: object) -> Dataset:
    chosen = {"mesh": root / "mesh.ply", "poses": root / "poses" / "transforms.json", **options}
    mesh, beside = chosen.pop("mesh"), Beside(**chosen)
    import_scene(root / "capture", "capture", root / "dataset", settings, mesh, beside=beside)
    return Dataset(root / "dataset")


def test_views_have_their_pose_and_the_calibrated_camera(developed: Path) -> None:
    data = imported(developed)
    assert [(camera.name, camera.split) for camera in data.cameras] == [("a", "train"), ("c", "val")]
    for camera, pose in zip(data.cameras, (POSES[0], POSES[2]), strict=True):
        np.testing.assert_allclose(camera.center, pose.origin)
        found = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        assert found == (WIDTH, HEIGHT, 5.0, 5.0, 4.1, 3.0)
    assert read_rejected(developed / "dataset" / "views.json") == {"b": "a frame is truncated"}
    assert not (developed / "dataset" / "images" / "b.exr").exists()
    assert (developed / "dataset" / "room.json").read_text() == "{}"


def test_clipped_pixels_count_as_bounds_and_noise_becomes_black(developed: Path) -> None:
    data = imported(developed)
    image, weight = data.image("a")
    expected = weights()
    expected[0, 0] = 1  # clipped, and nothing else
    np.testing.assert_array_equal(weight, expected)
    values = np.where(weight[..., None] > 0, np.maximum(radiance(), 0) * SCALE, 0)
    np.testing.assert_allclose(image, values)
    assert image[5, 5].max() == 0
    np.testing.assert_array_equal(data.flags("a"), flags())
    assert data.clipped("a").sum() == 2


def test_flags_are_read_with_the_image(developed: Path) -> None:
    data = imported(developed)
    assert data.flags("c") is not None
    data.image("a")
    (data.root / "images" / "a.exr").unlink()
    np.testing.assert_array_equal(data.flags("a"), flags())


def test_the_exposure_can_be_given(developed: Path) -> None:
    image, _ = imported(developed, ImportSettings(overlay=False, exposure=2.0)).image("a")
    np.testing.assert_allclose(image[3], radiance()[3] * 2)


def test_ids_of_the_developed_views(developed: Path) -> None:
    ids = np.arange(WIDTH * HEIGHT, dtype=np.uint16).reshape(HEIGHT, WIDTH)
    for view in "ac":
        write_png(developed / "ids" / "part" / f"{view}.png", ids)
    (developed / "ids" / "part.json").write_text('{"1": "wall"}')
    data = imported(developed, segments=developed / "ids")
    np.testing.assert_array_equal(data.segments("c", "part"), ids)
    assert json.loads((data.root / "segments" / "part.json").read_text()) == {"1": "wall"}
    write_png(developed / "ids" / "part" / "c.png", ids[:3])
    with pytest.raises(FiptError, match="must be 8x6 like the image; it is 8x3"):
        imported(developed, segments=developed / "ids")
    with pytest.raises(FiptError, match="must hold part/ or semantic/"):
        imported(developed, segments=developed / "poses")


def test_estimated_poses_bring_intrinsics_and_what_was_rejected(developed: Path) -> None:
    """With poses.json beside them, as fipt pose writes it; the room's description lies beside the mesh."""
    folder = developed / "poses"
    cameras = [
        replace(camera, fx=5.5, fy=5.5, width=WIDTH, height=HEIGHT)
        for camera in read_transforms(folder / "transforms.json")
    ]
    write_transforms(folder / "transforms.json", cameras[:1])
    write_views(folder / "views.json", ["a", "c", "b"], {"c": "two mappings disagree", "b": "a frame is truncated"})
    (folder / "poses.json").write_text("{}")
    (folder / "room.json").rename(developed / "room.json")
    data = imported(developed)
    assert [(camera.name, camera.fx) for camera in data.cameras] == [("a", 5.5)]
    assert data.rejected == {"c": "two mappings disagree", "b": "a frame is truncated"}
    assert (developed / "dataset" / "room.json").is_file()


def test_without_calibration_the_poses_know_the_camera(developed: Path) -> None:
    (developed / "capture" / "a.json").write_text(json.dumps({"camera": None}))
    with pytest.raises(FiptError, match="must be 16x12 like its camera; it is 8x6"):
        imported(developed)


def of_the_views(root: Path, **keys: float | str | None) -> None:
    """Rewrite the poses: their cameras have the size of the developed views, and more keys (None: removed)."""
    path = root / "poses" / "transforms.json"
    content = json.loads(path.read_text())
    for frame in content["frames"]:
        for key, value in {**CAMERA, "fl_x": 6.5, "fl_y": 6.5, **keys}.items():
            frame[key] = value
    path.write_text(json.dumps(content))


@pytest.mark.parametrize("camera", [None, CAMERA])
def test_distortion_that_nothing_has_undone_is_refused(developed: Path, camera: dict | None) -> None:
    facts = {"camera": camera, "sources": {"lens": EXIF_LENS}}
    for view in "ac":
        (developed / "capture" / f"{view}.json").write_text(json.dumps(facts))
    of_the_views(developed, k1=-0.12, k2=0.01)
    with pytest.raises(FiptError, match=r"view a: lens distortion must be zero, .* found k1 = -0\.12; undistort the"):
        imported(developed)
    of_the_views(developed, k1=2e-4, k2=None)  # of undistorted images, by a program that always estimates some
    assert imported(developed).cameras[0].fx == 6.5


def test_calibration_undoes_distortion_whatever_the_poses_state(developed: Path) -> None:
    of_the_views(developed, k1=-0.12)
    assert imported(developed).cameras[0].fx == 5.0


def test_intrinsics_of_poses_beat_the_focal_length_of_exif(developed: Path) -> None:
    for view in "ac":
        facts = {"camera": CAMERA, "sources": {"lens": EXIF_LENS}}
        (developed / "capture" / f"{view}.json").write_text(json.dumps(facts))
    of_the_views(developed, w=WIDTH + 1)
    assert imported(developed).cameras[0].fx == 5.0  # those of the poses are of another shape
    of_the_views(developed, cx=4.3)
    assert [(camera.fx, camera.cx) for camera in imported(developed).cameras] == [(6.5, 4.3)] * 2
    of_the_photographs = {"w": 2 * WIDTH, "h": 2 * HEIGHT, "fl_x": 13.0, "fl_y": 13.0, "cx": 8.6, "cy": 6.0}
    of_the_views(developed, **of_the_photographs)  # which development has averaged down
    assert [(camera.fx, camera.cx) for camera in imported(developed).cameras] == [(6.5, 4.3)] * 2
    of_the_views(developed, fl_x=None, fl_y=None)
    assert imported(developed).cameras[0].fx == 5.0


def test_poses_of_other_images_do_not_count_for_the_split(developed: Path) -> None:
    """As where every exposure of a bracket has a pose."""
    path = developed / "poses" / "transforms.json"
    content = json.loads(path.read_text())
    named = list(zip("abc", content["frames"], strict=True))
    frames = [{**frame, "file_path": f"{view}{n}.ARW"} for view, frame in named for n in ("", "1")]
    for frame in frames:
        frame.pop("split")
    path.write_text(json.dumps({**content, "frames": frames}))
    # of a, a1, b, b1, c, c1 every fourth would be a and c
    cameras = imported(developed, ImportSettings(overlay=False, val_every=4)).cameras
    assert [(camera.name, camera.split) for camera in cameras] == [("a", "val"), ("c", "train")]


def test_images_of_8_bits_are_named_of_merged_views_too(developed: Path, np_rng: np.random.Generator) -> None:
    steps = np_rng.integers(1, 256, (96, 128, 3)).astype(np.float32) / 255
    for view in "ac":
        layers = {"": steps if view == "a" else steps[::-1], "valid.Y": np.ones((96, 128), np.float32)}
        layers["flags.Y"] = np.zeros((96, 128), np.uint32)
        write_exr(developed / "capture" / "hdr" / f"{view}.exr", layers)
        (developed / "capture" / f"{view}.json").write_text(json.dumps({"camera": {**CAMERA, "w": 128, "h": 96}}))
    report = developed / "capture" / "qa.json"
    beside = Beside(developed / "poses" / "transforms.json")

    def said() -> str:
        args = (developed / "capture", "capture", developed / "dataset", PLAIN, developed / "mesh.ply")
        return " ".join(import_scene(*args, beside=beside).warnings)

    assert said() == ""
    report.write_text(json.dumps({**json.loads(report.read_text()), "kind": "merged"}))
    assert "all images together have 255 values only, in even steps" in said()


def test_masks_of_poses_are_not_used_and_named(developed: Path, caplog: pytest.LogCaptureFixture) -> None:
    of_the_views(developed, mask_path="masks/a.png")
    inputs = ImportInputs(
        source=developed / "capture", format="capture", dataset=developed / "dataset", mesh=developed / "mesh.ply",
        poses=developed / "poses" / "transforms.json",
    )  # fmt: skip
    figures = run(inputs, PLAIN)
    assert "the poses name masks of 3 views (a, b, c), which are not used" in " ".join(figures["warnings"])
    assert "which are not used" in caplog.text


def test_bad_input(developed: Path) -> None:
    with pytest.raises(FiptError, match="--poses belongs to the format capture"):
        imported(developed, poses=None)
    poses = developed / "poses" / "transforms.json"
    poses.write_text(poses.read_text().replace("/a.ARW", "/x.ARW").replace("/c.ARW", "/y.ARW"))
    with pytest.raises(FiptError, match=r"it has b, accepted are a, c, lost"):
        imported(developed)
    poses.write_text(poses.read_text().replace("/b.ARW", "/z.ARW"))
    with pytest.raises(FiptError, match=r"must have poses of the photographed views, a, c, lost; it has x, y, z"):
        imported(developed)
    (developed / "capture" / "qa.json").write_text("{}")
    with pytest.raises(FiptError, match="is damaged"):
        imported(developed)
    (developed / "capture" / "qa.json").unlink()
    with pytest.raises(FiptError, match=r"the capture report is missing"):
        imported(developed)
    assert not (developed / "dataset").exists()
