"""Calibration from simulated frames, against the truth of the simulated camera."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import lensfunpy
import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.lens import Lens
from fipt.stages.capture import lensfun
from fipt.stages.capture.brackets import read_capture
from fipt.stages.capture.calibrate import calibrate, summary
from fipt.stages.capture.calibration import Calibration, read_calibration, write_calibration
from fipt.stages.capture.calibration_frames import calibration_frames
from fipt.stages.capture.raw import Shot
from fipt.stages.capture.settings import CaptureSettings
from fipt.stages.capture.view import pinhole_of
from tests import captures

SETTINGS = CaptureSettings(board_square=0.03)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> captures.Capture:
    return captures.write(
        tmp_path_factory.mktemp("capture"),
        views=1,
        size=(200, 150),
        dark_offset=(3.0, -2.0, 1.5, 0.25),
        principal_offset=(4.0, -3.0),
        hot_pixels=3e-4,
        dead_pixels=1e-4,
        exposures=3,
    )


@pytest.fixture(scope="module")
def found(made: captures.Capture) -> Calibration:
    return calibrate(read_capture(made.folder), SETTINGS)


def test_black_levels_are_those_of_the_dark_frames(made: captures.Capture, found: Calibration) -> None:
    order = [0, 1, 3, 2]  # RGGB: positions row by row are red, green, second green, blue
    assert np.array(found.black)[order] == pytest.approx(made.camera_truth["black"], abs=0.05)


def test_bad_pixels_are_found_and_no_others(made: captures.Capture, found: Calibration) -> None:
    truth = made.camera_truth
    bad = {tuple(pixel) for pixel in truth["hot_pixels"] + truth["dead_pixels"]}
    assert len(bad) > 40
    assert set(found.bad_pixels) == bad


def test_vignetting_follows_the_true_falloff_about_the_true_centre(made: captures.Capture, found: Calibration) -> None:
    sensor = made.optics[0].sensor
    columns, rows = np.meshgrid(np.linspace(0, sensor.width, 41), np.linspace(0, sensor.height, 31))
    true = sensor.falloff(columns, rows, made.settings.vignetting)
    assert true.min() < 0.55
    fitted = found.vignetting.falloff(columns.astype(np.float32), rows.astype(np.float32))
    assert np.abs(fitted / true - 1).max() < 0.004
    assert found.vignetting.center == pytest.approx((sensor.cx, sensor.cy), abs=1.0)
    assert found.figures["vignetting"]["spread"] < 2e-3


def distorted(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Where a lens puts (H, W, 2) points of the plane z = 1, pixels."""
    points = np.dstack([rays, np.ones(rays.shape[:2])]).reshape(-1, 3)
    seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), lens.matrix, np.array(lens.distortion))
    return seen.reshape(rays.shape) + 0.5


def test_boards_give_the_true_lens(made: captures.Capture, found: Calibration) -> None:
    sensor = made.optics[0].sensor
    assert found.lens.fx == pytest.approx(sensor.fx, rel=2e-3)
    assert found.figures["board"]["rms"] < 0.15
    assert len(found.figures["board"]["frames"]) == made.settings.calibration_frames
    # Where the pixels of the undistorted image lie in the photograph.
    true = Lens(**{**made.camera_truth["sensor"], "distortion": tuple(made.camera_truth["sensor"]["distortion"])})
    columns, rows = np.meshgrid(np.linspace(0, sensor.width, 41), np.linspace(0, sensor.height, 31))
    points = np.stack([columns, rows], axis=-1)

    def through(lens: Lens) -> np.ndarray:
        pinhole = pinhole_of(lens)
        rays = (points - (pinhole.cx, pinhole.cy)) / pinhole.fx
        return distorted(lens, rays)

    assert np.sqrt(np.mean((through(found.lens) - through(true)) ** 2)) < 0.35


def test_noise_and_white_balance(made: captures.Capture, found: Calibration) -> None:
    camera = made.settings
    gain = (16383 - np.mean(camera.black_levels)) / camera.full_well
    assert found.noise.gain == pytest.approx(gain, rel=0.03)
    # Rounding adds the variance 1/12.
    assert found.noise.read == pytest.approx(np.sqrt((gain * camera.read_noise) ** 2 + 1 / 12), rel=0.03)
    assert np.array(found.white_balance) * camera.sensitivity == pytest.approx([1, 1, 1], rel=2e-3)
    assert np.array(found.color) == pytest.approx(np.eye(3), abs=1e-4)


def test_calibration_json_keeps_everything(found: Calibration, tmp_path: Path) -> None:
    write_calibration(tmp_path / "calibration.json", found)
    assert read_calibration(tmp_path / "calibration.json") == found
    assert "reprojection error" in summary(found)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.update(format=0), "must have format 1; found 0"),
        (lambda content: content.pop("noise"), "is not a calibration (KeyError('noise'))"),
        (lambda content: content.update(colour=1), "is not a calibration (TypeError("),
        (lambda content: content.pop("format"), "is not a calibration (KeyError('format'))"),
    ],
)
def test_damaged_calibrations_are_refused(found: Calibration, tmp_path: Path, change: object, message: str) -> None:
    path = tmp_path / "calibration.json"
    write_calibration(path, found)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(FiptError) as caught:
        read_calibration(path)
    assert message in str(caught.value)


def test_what_is_absent_is_said_with_what_is_done_instead(made: captures.Capture, tmp_path: Path) -> None:
    for path in made.frames("train_000"):
        (tmp_path / path.name).symlink_to(path)
    found = calibrate(read_capture(tmp_path), SETTINGS)
    sensor = made.optics[0].sensor
    assert found.vignetting is None
    assert found.black is None
    # The equivalent focal length in EXIF is whole millimetres, about 25.
    assert found.lens.fx == pytest.approx(sensor.fx, rel=0.02)
    assert found.lens.distortion == (0.0,) * 5
    assert found.white_balance == pytest.approx(1 / np.array(made.settings.sensitivity), rel=1e-3)
    assert found.absent == (
        "lens 'Simulated lens' is not in lensfun's database",
        "no dark frame: black levels as the files state, hot pixels are not known",
        "no flat field: vignetting is not corrected, corners stay too dark",
        "no board frames: distortion is not corrected",
        "no white reference: white balance from the camera (DSC00003.dng)",
    )


def test_a_given_calibration_is_taken_as_it_is(made: captures.Capture, found: Calibration, tmp_path: Path) -> None:
    for path in made.frames("train_000"):
        (tmp_path / path.name).symlink_to(path)
    write_calibration(tmp_path / "calibration.json", replace(found, white_balance=(3.0, 1.0, 2.0)))
    assert calibrate(read_capture(tmp_path), SETTINGS).white_balance == (3.0, 1.0, 2.0)


def faulty(tmp_path: Path, fault: str) -> str:
    made = captures.write(tmp_path, views=1, size=(120, 90), exposures=3, calibration_frames=4, faults=(fault,))
    with pytest.raises(FiptError) as caught:
        calibrate(read_capture(made.folder), SETTINGS)
    return str(caught.value).replace(str(tmp_path), "")


def test_a_flat_field_darker_in_its_centre_is_refused(tmp_path: Path) -> None:
    message = faulty(tmp_path, "dark-centred flat")
    assert message.startswith("/calibration/flat/DSC00005.dng must be brightest near its centre; its corners are ")
    assert message.endswith("; photograph an evenly lit surface, out of focus, without a shadow of the camera")


def test_boards_that_are_not_found_say_what_was_looked_for_and_where(tmp_path: Path) -> None:
    assert faulty(tmp_path, "board absent") == (
        "no checkerboard of 9x6 inner corners was found in any of 4 frames of /calibration/checkerboard: "
        "DSC00001.dng, DSC00002.dng, DSC00003.dng, DSC00004.dng; check capture.board_columns and board_rows; the whole "
        "board must be visible, sharp and evenly lit"
    )


def test_charuco_boards_partly_seen(tmp_path: Path, np_rng: np.random.Generator) -> None:
    """Boards drawn by OpenCV, seen through a known lens; JPEG-like images, since only corners matter."""
    (tmp_path / "calibration" / "charuco").mkdir(parents=True)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((10, 7), 0.025, 0.018, dictionary)
    drawn = board.generateImage((1000, 700))
    lens = Lens(640, 480, 520.0, 520.0, 322.0, 238.0, (-0.08, 0.0, 0.0, 0.0, 0.0))
    columns, rows = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2) - 0.5
    seen = cv2.undistortPoints(pixels, lens.matrix, np.array(lens.distortion))
    rays = np.dstack([seen.reshape(480, 640, 2), np.ones((480, 640))])
    for k in range(8):
        angles = np.radians(np_rng.uniform((-25, -25, -10), (25, 25, 10)))
        turn = cv2.Rodrigues(angles)[0]
        place = np.array([np_rng.uniform(-0.05, 0.05), np_rng.uniform(-0.03, 0.03), 0.27])
        middle = np.array([0.125, 0.0875, 0])
        pose = np.column_stack([turn[:, 0], turn[:, 1], place - turn @ middle])
        plane = rays @ np.linalg.inv(pose).T
        plane = plane[..., :2] / plane[..., 2:] * 4000 - 0.5
        image = cv2.remap(drawn, *np.moveaxis(plane.astype(np.float32), -1, 0), cv2.INTER_AREA, borderValue=128)
        cv2.imwrite(str(tmp_path / "calibration" / "charuco" / f"{k}.png"), image)
    lines = ["view\tfile\tshutter"]
    for name, time, light in (("a", "1/4", 0.9), ("b", "1/16", 0.4)):
        ramp = np.linspace(0.1, 1, 640) ** 2 * np.ones((480, 1)) * light
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.dstack([ramp * 255] * 3).astype(np.uint8))
        lines.append(f"v\t{name}.png\t{time}")
    (tmp_path / "captures.tsv").write_text("\n".join(lines))
    found = calibrate(read_capture(tmp_path), CaptureSettings())
    assert found.figures["board"]["kind"] == "charuco"
    assert found.figures["board"]["rms"] < 0.3
    assert found.lens.fx == pytest.approx(520, rel=0.01)
    assert found.lens.distortion[0] == pytest.approx(-0.08, abs=0.02)


def test_lenses_by_name_agree_with_lensfun_itself() -> None:
    shot = Shot(Path("a"), 1.0, 4.0, 100, 24.0, camera="Sony ILCE-7M3", lens="FE 24-105mm f/4 G OSS")
    name, lens, vignetting = lensfun.find_lens(shot, 600, 400, 2.5)
    assert name == "Sony FE 24-105mm f/4 G OSS"
    database = lensfunpy.Database()
    camera = database.find_cameras("Sony", "ILCE-7M3")[0]
    modifier = lensfunpy.Modifier(database.find_lenses(camera, "Sony", shot.lens)[0], 1.0, 600, 400)
    modifier.initialize(24.0, 4.0, 2.5, scale=1.0, pixel_format=np.float32)
    map_ = modifier.apply_geometry_distortion()[10::20, 10::20]
    rows, columns = np.mgrid[10:400:20, 10:600:20] + 0.5
    rays = (np.stack([columns, rows], axis=-1) - (300.0, 200.0)) / 400  # 24 of 36 mm on 600 pixels
    ours = distorted(lens, rays) - 0.5
    assert np.abs(map_ - np.stack([columns, rows], -1) + 0.5).max() > 5  # there is something to correct
    assert np.abs(ours - map_).max() < 0.3
    gain = np.ones((400, 600, 3), np.float32)
    modifier.apply_color_modification(gain)
    fitted = vignetting.falloff(columns.astype(np.float32), rows.astype(np.float32))
    assert np.abs(fitted * gain[10::20, 10::20, 1] - 1).max() < 0.005
    assert gain.max() > 1.5
    assert lensfun.find_lens(replace(shot, lens="no such lens 1-2mm"), 600, 400, 2.5) is None
    assert lensfun.find_lens(replace(shot, camera="Nobody Nothing"), 600, 400, 2.5) is None


@pytest.mark.parametrize(
    ("camera", "lens"),
    [
        ("Canon EOS 5D Mark III", "Canon EF 24-105mm f/4L IS USM"),
        ("NIKON CORPORATION NIKON D750", "Nikon AF-S Zoom-Nikkor 24-70mm f/2.8G ED"),
    ],
)
def test_cameras_are_found_whose_makers_repeat_their_name(camera: str, lens: str) -> None:
    found = lensfun.find_lens(Shot(Path("a"), 1.0, 4.0, 100, 24.0, camera=camera, lens=lens), 600, 400, 2.5)
    assert found is not None
    assert lens in found[0]


def test_empty_folders_of_frames_are_no_frames(tmp_path: Path) -> None:
    (tmp_path / "calibration" / "flat").mkdir(parents=True)
    assert calibration_frames(tmp_path) == {}
