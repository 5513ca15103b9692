"""Whole views from simulated brackets, against the truth of the simulated camera."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.scene.dataset import read_layers
from fipt.scene.lens import Lens
from fipt.stages.capture.brackets import read_capture
from fipt.stages.capture.calibrate import calibrate
from fipt.stages.capture.calibration import Calibration, Noise, Vignetting
from fipt.stages.capture.develop import bracket_exposures, develop, develop_views, read_frames, write_view
from fipt.stages.capture.facts import sharpness
from fipt.stages.capture.ldr import merge_ldr
from fipt.stages.capture.settings import CaptureSettings
from fipt.stages.capture.view import View, downscaled
from fipt.synthetic import capture as writer
from fipt.synthetic.camera import optics, reference_time
from fipt.synthetic.settings import SimulatedCamera
from tests import captures

SMALL = {"scale": 1, "full_well": 40_000.0}


def bright(camera: object) -> np.ndarray:
    return captures.scene_image(camera, emitter=200.0)


def bracket(folder: Path, **changes: object) -> tuple[Calibration, dict[str, np.ndarray], float]:
    """Write one bracket without calibration frames; return the true calibration, the truth, the scale of radiance."""
    settings = SimulatedCamera(**{**SMALL, **changes})
    view = captures.cameras(1, (160, 120))[0]
    planes = optics(view, settings)
    writer.write_bracket(folder, 0, bright(planes.source), planes, settings)
    sensor = planes.sensor
    calibration = Calibration(
        "raw",
        None,
        sensor.width,
        sensor.height,
        noise=Noise((16383 - 512) / settings.full_well, 3.0 * (16383 - 512) / settings.full_well, 100.0),
        vignetting=Vignetting((sensor.cx, sensor.cy), float(np.hypot(160, 120) / 2), settings.vignetting),
        lens=Lens(160, 120, sensor.fx, sensor.fy, sensor.cx, sensor.cy, sensor.distortion),
        white_balance=tuple(1 / np.array(settings.sensitivity)),
    )
    truth = read_layers(folder / "truth" / f"{view.name}.exr")
    return calibration, truth, settings.white_radiance * reference_time(settings)


def matches(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Precision and recall of a mask."""
    both = (found & true).sum()
    return both / max(found.sum(), 1), both / max(true.sum(), 1)


def errors(view: View, truth: dict[str, np.ndarray], scale: float) -> np.ndarray:
    """Signed relative errors of the pixels that count."""
    good = (view.valid > 0.99) & (truth["saturated"] == 0) & (truth["outside"] == 0) & (truth["moved"] == 0)
    return (view.radiance * scale / truth[""] - 1)[good]


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_radiance_and_masks_with_every_mosaic_and_shuffled_exposures(tmp_path: Path, pattern: str) -> None:
    calibration, truth, scale = bracket(tmp_path, pattern=pattern, shuffled=True, ghosts=("train_000",))
    capture = read_capture(tmp_path)
    view = develop(capture.brackets[0], calibration, CaptureSettings())
    error = errors(view, truth, scale)
    assert np.percentile(np.abs(error), 50) < 0.005
    assert np.percentile(np.abs(error), 90) < 0.018
    assert abs(np.median(error)) < 0.001
    for flag, name in ((FLAG_SATURATED, "saturated"), (FLAG_MOVED, "moved")):
        precision, recall = matches(view.flags & flag > 0, truth[name] > 0.5)
        assert precision >= 0.95, name
        assert recall >= 0.95, name
    assert (view.valid[view.flags & (FLAG_SATURATED | FLAG_MOVED) > 0] < 0.01).all()


@pytest.mark.parametrize(("count", "step"), [(1, 2.0), (3, 2.0), (9, 1.0)])
def test_any_number_of_exposures(tmp_path: Path, count: int, step: float) -> None:
    calibration, truth, scale = bracket(tmp_path, exposures=count, step=step)
    capture = read_capture(tmp_path)
    assert [len(found.shots) for found in capture.brackets] == [count]
    view = develop(capture.brackets[0], calibration, CaptureSettings())
    assert abs(np.median(errors(view, truth, scale))) < 0.005
    precision, recall = matches(view.flags & FLAG_SATURATED > 0, truth["saturated"] > 0.5)
    assert min(precision, recall) >= 0.95
    assert not (view.flags & FLAG_MOVED).any()


def test_the_hat_merge_is_there_and_sees_the_same_masks(tmp_path: Path) -> None:
    calibration, truth, scale = bracket(tmp_path)
    found = read_capture(tmp_path).brackets[0]
    mosaic, hat = (develop(found, calibration, CaptureSettings(merge=merge)) for merge in ("mosaic", "hat"))
    assert (mosaic.flags == hat.flags).all()
    for view in (mosaic, hat):
        assert abs(np.median(errors(view, truth, scale))) < 0.001
    assert np.mean(errors(mosaic, truth, scale) ** 2) <= np.mean(errors(hat, truth, scale) ** 2)


def test_what_the_sensor_does_not_see_is_marked(tmp_path: Path) -> None:
    calibration, truth, _ = bracket(tmp_path, distortion=(0.1, 0.01, 0.0, 0.0, 0.0))
    view = develop(read_capture(tmp_path).brackets[0], calibration, CaptureSettings())
    assert (truth["outside"] > 0.5).sum() > 1000
    assert matches(view.flags & FLAG_OUTSIDE > 0, truth["outside"] > 0.5) == (1.0, 1.0)
    assert (view.valid[truth["outside"] > 0.5] < 0.6).all()


def test_calibration_from_frames_alone_reaches_the_errors_promised(tmp_path: Path) -> None:
    made = captures.write(tmp_path, views=1, size=(160, 120), calibration_frames=12, dark_offset=(2.0, -1.0, 3.0, 0.5))
    (tmp_path / "captures.tsv").unlink()
    capture = read_capture(tmp_path)
    settings = CaptureSettings(downscale=2)
    calibration = calibrate(capture, settings)
    view = develop(capture.brackets[0], calibration, settings)
    error = errors(view, made.truth("train_000"), made.camera_truth["radiance_of_full_second"])
    assert np.percentile(np.abs(error), 50) < 0.005
    assert np.percentile(np.abs(error), 90) < 0.018
    assert abs(np.median(error)) < 0.003
    camera = view.facts["camera"]
    assert camera["fl_x"] == pytest.approx(made.cameras[0].fx, rel=3e-3)
    assert (camera["w"], camera["h"], camera["cx"], camera["cy"]) == (160, 120, 80.0, 60.0)


def test_wrong_shutter_times_are_reported_and_can_be_measured(tmp_path: Path) -> None:
    calibration, _, _ = bracket(tmp_path, shutter_error=0.04)
    found = read_capture(tmp_path).brackets[0]
    stated, measured = (develop(found, calibration, CaptureSettings(times=times)) for times in ("snapped", "measured"))
    assert any(ratio["differs"] for ratio in stated.facts["ratios"])
    assert any("the exposures' ratio is " in warning for warning in stated.facts["warnings"])
    frames = read_frames(found, calibration)
    _, ratios = bracket_exposures(frames, frames[0].black, "measured")
    seconds = [frame.seconds for frame in writer.exposures(SimulatedCamera(**SMALL, shutter_error=0.04))][::-1]
    for ratio, long, short in zip(ratios[:2], seconds, seconds[1:], strict=False):
        assert ratio["measured"] == pytest.approx(long / short, rel=3e-3)
    used = [entry["exposure"] for entry in measured.facts["exposures"]]
    assert used[0] / used[2] == pytest.approx(seconds[0] / seconds[2], rel=5e-3)
    assert used[0] / used[2] != pytest.approx(16, rel=5e-3)


def test_the_facts_are_those_of_the_view(tmp_path: Path) -> None:
    calibration, truth, _ = bracket(tmp_path, ghosts=("train_000",))
    found = read_capture(tmp_path).brackets[0]
    view = develop(found, calibration, CaptureSettings())
    facts = json.loads(json.dumps(view.facts))
    assert [entry["shutter"] for entry in facts["exposures"]] == sorted((s.shutter for s in found.shots), reverse=True)
    assert facts["exposures"][0]["clipped"] > facts["exposures"][-1]["clipped"] > 0
    assert facts["shares"]["moved"] == pytest.approx((truth["moved"] > 0.5).mean(), rel=0.05)
    assert facts["shares"]["saturated"] == pytest.approx((truth["saturated"] > 0.5).mean(), rel=0.05)
    # Five exposures 2 EV apart reach 8 EV further than one, whose range is full well over read noise.
    assert facts["measurable_stops"] == pytest.approx(8 + np.log2(40_000 / 3), abs=0.1)
    assert any("are clipped in the shortest exposure" in warning for warning in facts["warnings"])
    assert facts["camera_white_balance"] == pytest.approx([1 / 0.55, 1.0, 1 / 0.65], rel=1e-3)


def test_sharpness_falls_with_blur_and_not_with_exposure(np_rng: np.random.Generator) -> None:
    texture = np.exp(cv2.GaussianBlur(np_rng.normal(0, 3, (100, 120, 3)).astype(np.float32), (0, 0), 0.8))
    plain = View(texture, np.ones((100, 120), np.float32), np.zeros((100, 120), np.uint32), None)
    blurred = replace(plain, radiance=cv2.GaussianBlur(texture, (0, 0), 2.0))
    assert sharpness(blurred) < 0.6 * sharpness(plain)
    assert sharpness(replace(plain, radiance=7 * texture)) == pytest.approx(sharpness(plain), rel=0.01)


def test_averaging_down_keeps_light_and_any_flag() -> None:
    radiance = np.arange(5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
    flags = np.zeros((5, 7), np.uint32)
    flags[1, 1] = FLAG_SATURATED
    flags[2, :2] = FLAG_NOISE
    flags[2, 4] = FLAG_MOVED | FLAG_NOISE
    view = View(radiance, (flags == 0).astype(np.float32), flags, Lens(7, 5, 10.0, 10.0, 3.5, 2.5))
    small = downscaled(view, 2)
    assert small.radiance.shape == (2, 3, 3)
    assert small.radiance[0, 1] == pytest.approx(radiance[:2, 2:4].mean(axis=(0, 1)))
    assert small.valid.tolist() == [[0.75, 1.0, 1.0], [0.5, 1.0, 0.75]]
    assert small.flags.tolist() == [[FLAG_SATURATED, 0, 0], [0, 0, FLAG_MOVED]]
    assert (small.lens.width, small.lens.height, small.lens.fx, small.lens.cx) == (3, 2, 5.0, 1.75)


def test_averaging_down_leaves_out_what_moved_unless_a_block_is_a_lower_bound() -> None:
    radiance = np.full((2, 8, 3), 0.1, np.float32)
    flags, valid = np.zeros((2, 8), np.uint32), np.ones((2, 8), np.float32)
    radiance[:, 0], flags[:, 0], valid[:, 0] = 10.0, FLAG_MOVED, 0  # somebody in white
    radiance[0, 2], flags[0, 2], valid[:, 2:4] = 10.0, FLAG_SATURATED, 0  # a lamp, and its neighbours
    radiance[:, 4:6], flags[:, 4:6], valid[:, 4:6] = 0.3, FLAG_OUTSIDE, 0
    small = downscaled(View(radiance, valid, flags, None), 2)
    assert small.radiance[0, :, 0] == pytest.approx([0.1, (10 + 3 * 0.1) / 4, 0.3, 0.1])
    assert small.valid.tolist() == [[0.5, 0.0, 0.0, 1.0]]


def test_half_floats_only_where_they_lose_nothing(tmp_path: Path) -> None:
    def stored(largest: float, floor: float, half: bool = True) -> np.ndarray:
        radiance = np.full((4, 4, 3), 1 + 1e-4, np.float32)
        radiance[0, 0] = largest
        view = View(radiance, np.ones((4, 4), np.float32), np.zeros((4, 4), np.uint32), None, floor)
        write_view(tmp_path, "v", view, half)
        channels = read_exr(tmp_path / "hdr" / "v.exr", required=["valid.Y", "flags.Y"])
        assert channels["flags.Y"].dtype == np.uint32
        return channels["R"]

    assert stored(2.0, 1e-3)[1, 1] == 1
    for exact in (stored(1e5, 1e-3), stored(2.0, 1e-7), stored(2.0, 1e-3, half=False)):
        assert exact[1, 1] == np.float32(1 + 1e-4)


# --- other images ---------------------------------------------------------------------------


def test_merged_views_pass_through_untouched(tmp_path: Path, np_rng: np.random.Generator) -> None:
    image = np_rng.uniform(0, 9, (6, 8, 3)).astype(np.float32)
    image[2, 3, 1] = np.nan
    write_exr(tmp_path / "kitchen 1.exr", {"": image})
    capture = read_capture(tmp_path)
    assert [found.view for found in capture.brackets] == ["kitchen_1"]
    calibration = calibrate(capture, CaptureSettings())
    view = develop(capture.brackets[0], calibration, CaptureSettings())
    good = np.isfinite(image).all(axis=2)
    assert (view.radiance[good] == image[good]).all()
    assert (view.valid == good).all()
    assert view.facts["camera"] is None
    assert "taken as they are" in calibration.absent[0]


def test_8_bit_brackets_give_radiance_up_to_a_factor_and_say_what_they_are(tmp_path: Path) -> None:
    """Images through a gamma curve, which is not told."""
    x, y = np.meshgrid(np.linspace(0, 1, 96), np.linspace(0, 1, 64))
    light = (0.02 * np.exp(5.0 * x + 0.8 * np.sin(9 * y)))[..., None] * np.array([0.8, 1.0, 1.2])
    light[20:30, 60:70] = 400.0
    lines = ["view\tfile\tshutter"]
    for k, seconds in enumerate((1 / 8, 1 / 32, 1 / 128, 1 / 2, 2.0)):
        value = 255 * np.clip(2 * light * seconds, 0, 1) ** (1 / 2.2)
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.rint(value[..., ::-1]).astype(np.uint8))
        lines.append(f"v\t{k}.png\t{seconds}")
    (tmp_path / "captures.tsv").write_text("\n".join(lines))
    capture = read_capture(tmp_path)
    view = develop(capture.bracket("v"), calibrate(capture, CaptureSettings()), CaptureSettings())
    emitter = np.zeros(light.shape[:2], bool)
    emitter[20:30, 60:70] = True
    ratio = (view.radiance / light)[~emitter]
    ratio /= np.median(ratio, axis=0)
    assert np.percentile(np.abs(ratio - 1), 50) < 0.02
    assert np.percentile(np.abs(ratio - 1), 90) < 0.06
    assert ((view.flags & FLAG_SATURATED > 0) == emitter).all()
    assert (view.valid[emitter] == 0).all()
    assert view.facts["ldr"] is True


def test_black_counts_in_the_longest_8_bit_image_alone_and_clipped_in_the_shortest() -> None:
    curve = np.repeat(np.log(np.maximum(np.arange(256), 0.5) / 128)[:, None], 3, axis=1)
    exposures = (4.0, 1.0, 0.25)
    light = np.exp(curve[:, 0])
    codes = [  # red and black; clipped everywhere; clipped or black, so that nothing tells; the middle one alone tells
        [(200, 1, 0), (255, 255, 255), (255, 255, 255), (255, 255, 255)],
        [(50, 0, 0), (255, 255, 255), (0, 0, 0), (100, 100, 100)],
        [(12, 0, 0), (255, 255, 255), (0, 0, 0), (0, 0, 0)],
    ]
    images = [np.array([row], np.uint8) for row in codes]
    radiance, saturated, _, _ = merge_ldr(images, exposures, curve)
    assert radiance[0, 0, 1:] == pytest.approx(light[[1, 0]] / 4, rel=1e-2)
    assert radiance[0, 1] == pytest.approx(np.full(3, light[255] / 0.25), rel=1e-2)
    assert np.isfinite(radiance[0, 2]).all()
    assert radiance[0, 3] == pytest.approx(np.full(3, light[100]), rel=1e-3)
    assert saturated.tolist() == [[False, True, False, False]]


def test_exposure_times_and_vignetting_of_8_bit_brackets_are_those_that_are_asked_for(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(96, dtype=np.float32) + 0.5, np.arange(64, dtype=np.float32) + 0.5)
    vignetting = Vignetting((48.0, 32.0), float(np.hypot(96, 64) / 2), (-0.5,))
    light = 0.5 * (1 + 0.4 * np.sin(x / 7) * np.sin(y / 5))
    lines = ["view\tfile\tshutter"]
    for k, seconds in enumerate((1 / 2, 1 / 10, 1 / 37)):  # 1/10 s may be 2^(-10/3) s, 1/37 s is a video's
        value = 255 * np.clip(2 * light * vignetting.falloff(x, y) * seconds, 0, 1) ** (1 / 2.2)
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.repeat(np.rint(value)[..., None], 3, axis=2).astype(np.uint8))
        lines.append(f"v\t{k}.png\t{seconds}")
    (tmp_path / "captures.tsv").write_text("\n".join(lines))
    capture = read_capture(tmp_path)
    settings = CaptureSettings(times="nominal")
    view = develop(capture.bracket("v"), replace(calibrate(capture, settings), vignetting=vignetting), settings)
    assert [entry["exposure"] for entry in view.facts["exposures"]] == pytest.approx([1 / 2, 1 / 10, 1 / 37])
    ratio = view.radiance[..., 1] / light
    assert np.percentile(np.abs(ratio / np.median(ratio) - 1), 90) < 0.05
    corners = ratio[[3, 3, -4, -4], [3, -4, 3, -4]].mean()  # without the correction they are 0.55 of the centre
    assert corners == pytest.approx(np.median(ratio[28:36, 44:52]), rel=0.05)
    snapped = calibrate(capture, CaptureSettings()).response
    assert np.abs(np.array(snapped) - calibrate(capture, settings).response).max() > 1e-3


# --- bad input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("not raw", "DSC00002.dng is not a RAW file that LibRaw reads; leave it out or convert it to DNG"),
        ("truncated", "DSC00002.dng is truncated or damaged (Input/output error); copy it from the card again"),
        (
            "no mosaic",
            "DSC00003.dng holds no colour mosaic (sRAW, mRAW or linear RAW); photograph in full RAW; these files are "
            "demosaiced already",
        ),
        (
            "no exposure time",
            "DSC00003.dng states no exposure time; give it in captures.tsv (columns view, file, shutter)",
        ),
        (
            "doubled exposure",
            "view DSC00001: DSC00002.dng and DSC00003.dng have the same exposure (1/250 s); remove one of them, or "
            "list the files of each view in captures.tsv",
        ),
        (
            "wrong size",
            "DSC00003.dng must be 128x96 as the calibration; found 112x96; calibrate with frames of the same camera "
            "and image size",
        ),
        (
            "other orientation",
            "view DSC00001: the frames of a bracket must have one orientation; DSC00003.dng differs; remove it, or "
            "list the files of each view in captures.tsv",
        ),
        (
            "other camera",
            "the frames of a capture must be of one camera; DSC00003.dng and 0 others are of fipt Other camera 0002, "
            "the rest of fipt Simulated camera 0001; put the photographs of each camera into a folder of their own",
        ),
    ],
)
def test_faults_are_one_line_that_names_the_file(tmp_path: Path, fault: str, message: str) -> None:
    sound = Calibration("raw", "fipt Simulated camera", 128, 96)
    captures.write(tmp_path, faults=(fault,), calibration_frames=1)
    (tmp_path / "captures.tsv").unlink()
    capture = read_capture(tmp_path)
    with pytest.raises(FiptError) as caught:
        develop_views(capture, [capture.brackets[0].view], sound, tmp_path / "out", CaptureSettings(incomplete="error"))
    assert str(caught.value).replace(f"{tmp_path}/", "") == message
    assert not (tmp_path / "out").exists()


def test_a_file_that_cannot_be_read_costs_its_exposure_and_is_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    captures.write(tmp_path, faults=("not raw",), calibration_frames=1)
    (tmp_path / "captures.tsv").unlink()
    capture = read_capture(tmp_path)
    develop_views(capture, ["DSC00001"], Calibration("raw", None, 128, 96), tmp_path / "out", CaptureSettings())
    assert f"{tmp_path}/DSC00002.dng is not a RAW file that LibRaw reads" in caplog.text
    warnings = json.loads((tmp_path / "out" / "DSC00001.json").read_text())["warnings"]
    assert warnings[0] == "view DSC00001 has 4 exposures where the other views have 5: 1/250 s missing"
