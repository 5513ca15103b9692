"""A simulated capture on disk: names, times, calibration frames, faults; and what a simple development finds in it."""

import csv
import json
from datetime import datetime
from fractions import Fraction
from pathlib import Path

import cv2
import exifread
import numpy as np
import pytest
import rawpy

from fipt.errors import FiptError
from fipt.scene.cameras import Camera, read_transforms
from fipt.scene.mesh import read_mesh
from fipt.synthetic import capture as writer
from fipt.synthetic.camera import exposures, optics
from fipt.synthetic.settings import SimulatedCamera
from tests import captures, scenes


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> captures.Capture:
    return captures.write(tmp_path_factory.mktemp("capture") / "raw", size=(96, 64), calibration_frames=12)


def exif(path: Path) -> dict[str, object]:
    with open(path, "rb") as file:
        return exifread.process_file(file)


def values(path: Path) -> np.ndarray:
    """Mosaic in shares of the sensor's range, black levels off."""
    with rawpy.imread(str(path)) as raw:
        mosaic = raw.raw_image_visible.astype(np.float64)
        white = raw.white_level
    black = np.array([float(level) for level in exif(path)["Image BlackLevel"].values]).reshape(2, 2)
    rows, columns = np.indices(mosaic.shape)
    return (mosaic - black[rows % 2, columns % 2]) / (white - black.mean())


# --- brackets ---------------------------------------------------------------------------------


def test_frames_are_numbered_in_the_order_of_their_times(made):
    paths = sorted(made.folder.glob("*.dng"))
    assert [p.name for p in paths] == [f"DSC{k:05d}.dng" for k in range(1, 11)]
    assert paths[:5] == made.frames("train_000")
    times = [
        datetime.strptime(f"{tags['EXIF DateTimeOriginal']}.{tags['EXIF SubSecTimeOriginal']}", "%Y:%m:%d %H:%M:%S.%f")
        for tags in map(exif, paths)
    ]
    gaps = np.diff([time.timestamp() for time in times])
    assert (gaps > 0).all()
    # The walk to the next view takes longer than anything within a bracket.
    assert np.argmax(gaps) == 4
    assert gaps[4] > 10 * np.delete(gaps, 4).max()


def test_the_table_says_what_the_files_say(made):
    with open(made.folder / "captures.tsv", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    assert [row["file"] for row in rows] == [path.name for path in sorted(made.folder.glob("*.dng"))]
    assert [row["view"] for row in rows] == ["train_000"] * 5 + ["val_001"] * 5
    for row in rows:
        tags = exif(made.folder / row["file"])
        assert Fraction(row["shutter"]) == tags["EXIF ExposureTime"].values[0]
        assert Fraction(row["aperture"]) == tags["EXIF FNumber"].values[0]
        assert int(row["iso"]) == tags["EXIF ISOSpeedRatings"].values[0]


def test_focal_length_and_field_of_view_agree(made):
    tags = exif(made.frames("train_000")[0])
    view = made.cameras[0]
    assert float(tags["EXIF FocalLength"].values[0]) == pytest.approx(36 * view.fx / view.width, abs=0.06)


@pytest.mark.parametrize(("width", "height"), [(160, 120), (120, 160), (300, 200)])
def test_the_equivalent_focal_length_is_by_the_diagonal(width, height):
    camera = SimulatedCamera(boards=())
    planes = optics(Camera("train_000", "train", width, height, 114, 114, width / 2, height / 2, np.eye(4)), camera)
    header = writer.header_of(Fraction(1, 4), datetime(2026, 1, 1), planes, camera)
    sensor = planes.sensor
    diagonals = np.hypot(36, 24) / np.hypot(sensor.width, sensor.height)
    assert header.focal_length_35 == pytest.approx(sensor.fx * diagonals)


def test_cameras_are_those_of_the_undistorted_views(made):
    read = read_transforms(made.folder / "transforms.json")
    assert [c.name for c in read] == ["train_000", "val_001"]
    assert [c.split for c in read] == ["train", "val"]
    for camera, view in zip(read, made.cameras, strict=True):
        assert (camera.width, camera.height, camera.fx, camera.cx) == (view.width, view.height, view.fx, view.cx)
        np.testing.assert_array_equal(camera.world_from_camera, view.world_from_camera)
        assert made.truth(camera.name)[""].shape == (camera.height, camera.width, 3)


def test_exposures_may_come_in_any_order(tmp_path):
    shuffled = captures.write(tmp_path / "raw", shuffled=True, calibration_frames=1)
    taken = [[exif(path)["EXIF ExposureTime"].values[0] for path in shuffled.frames(v.name)] for v in shuffled.cameras]
    assert sorted(taken[0]) == sorted(taken[1]) == [frame.printed for frame in exposures(shuffled.settings)]
    assert taken[0] != sorted(taken[0])
    assert taken[0] != taken[1]


def test_a_view_is_the_same_whoever_is_photographed_with_it(made, tmp_path):
    plane = made.optics[1]
    files = writer.write_bracket(tmp_path, 1, captures.scene_image(plane.source), plane, made.settings)
    assert [f.name for f in files[:-1]] == [f.name for f in made.frames("val_001")]
    for again, before in zip(files, [*made.frames("val_001"), made.folder / "truth" / "val_001.exr"], strict=True):
        assert again.read_bytes() == before.read_bytes()


def test_files_can_name_another_camera(tmp_path):
    named = captures.write(
        tmp_path / "raw", views=1, header={"make": "SONY", "model": "ILCE-7M3"}, calibration_frames=1
    )
    tags = exif(named.frames("train_000")[0])
    assert (tags["Image Make"].values, tags["Image Model"].values) == ("SONY", "ILCE-7M3")


# --- what a simple development finds ------------------------------------------------------------


def developed(made: captures.Capture, view: str) -> np.ndarray:
    """(H, W, 3) radiance by the plainest means: longest unclipped sample, bilinear colours, true camera."""
    known, sensor = made.camera_truth, made.optics[0].sensor
    merged = np.full((sensor.height, sensor.width), np.nan)
    for path, frame in zip(made.frames(view), known["exposures"], strict=True):
        share = values(path)
        merged = np.where(share < 0.95, share / frame["seconds"] * known["radiance_of_full_second"], merged)
    columns, rows = np.meshgrid(np.arange(sensor.width) + 0.5, np.arange(sensor.height) + 0.5)
    r2 = ((columns - sensor.cx) ** 2 + (rows - sensor.cy) ** 2) * 4 / (sensor.width**2 + sensor.height**2)
    a, b, c = known["vignetting"]
    merged /= 1 + a * r2 + b * r2**2 + c * r2**3
    image = np.zeros((sensor.height, sensor.width, 3))
    kernel = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]]) / 4.0
    for channel, letter in enumerate("RGB"):
        mask = np.zeros(merged.shape)
        for place in range(4):
            mask[place // 2 :: 2, place % 2 :: 2] = known["pattern"][place] == letter
        blurred = [cv2.filter2D(part, -1, kernel, borderType=cv2.BORDER_REFLECT) for part in (merged * mask, mask)]
        image[..., channel] = blurred[0] / blurred[1] / known["sensitivity"][channel]
    # OpenCV puts the origin in the middle of the first pixel.
    matrix = sensor.matrix - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    straight = cv2.undistort(image.astype(np.float32), matrix, np.array(sensor.distortion))
    height, width = straight.shape[:2]
    return straight.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_development_with_the_known_camera_gives_the_true_view(tmp_path, pattern):
    made = captures.write(
        tmp_path / "raw", views=1, size=(96, 64), pattern=pattern, shutter_error=0.02, calibration_frames=1
    )
    truth = made.truth("train_000")
    assert truth["saturated"].max() == 0
    error = developed(made, "train_000") / truth[""] - 1
    inner = np.abs(error[3:-3, 3:-3])
    assert np.median(inner) < 0.006
    assert abs(np.median(error)) < 0.0015  # no bias: colours, vignetting and true times are right


def test_nominal_times_are_wrong_by_a_known_amount(made):
    first, second = (values(path) for path in made.frames("train_000")[2:4])
    both = (first > 0.05) & (second < 0.9)
    ratio = np.median(second[both] / first[both])
    known = made.camera_truth["exposures"]
    assert both.sum() > 500
    assert ratio == pytest.approx(known[3]["seconds"] / known[2]["seconds"], rel=0.003)
    printed = float(Fraction(known[3]["printed"]) / Fraction(known[2]["printed"]))
    assert printed == 4.0  # 1/15 and 1/60 are off alike; 1/250 and 1/60 are not
    assert float(Fraction(known[2]["printed"]) / Fraction(known[1]["printed"])) == pytest.approx(250 / 60)


def test_a_ghost_is_in_one_frame_only(tmp_path):
    made = captures.write(tmp_path / "raw", views=1, ghosts=("train_000",), calibration_frames=1)
    moved = made.truth("train_000")["moved"]
    assert 0.005 < (moved == 1).mean() < 0.2
    frames = [values(path) / frame["seconds"] for path, frame in zip(
        made.frames("train_000"), made.camera_truth["exposures"], strict=True)]  # fmt: skip
    # Where the mask is full (the lens moves it by less than its radius), only the third frame differs.
    row, column = (int(2 * np.median(index)) for index in np.nonzero(moved == 1))
    window = np.s_[row - 2 : row + 2, column - 2 : column + 2]
    light = [frame[window].mean() for frame in frames]
    assert light[1] == pytest.approx(light[3], rel=0.1)
    assert not 0.5 < light[2] / light[3] < 2


# --- calibration frames -------------------------------------------------------------------------


def test_checkerboards_calibrate_to_the_true_lens(made):
    known = made.camera_truth
    columns, rows = known["board"]["corners"]
    board = np.array([(x, y, 0) for y in range(rows) for x in range(columns)], np.float32) * known["board"]["square"]
    found = []
    for path in made.calibration("checkerboard"):
        with rawpy.imread(str(path)) as raw:
            grey = cv2.cvtColor(raw.postprocess(no_auto_bright=True, use_camera_wb=True), cv2.COLOR_RGB2GRAY)
        seen, corners = cv2.findChessboardCorners(grey, (columns, rows))
        if seen:
            found.append(cv2.cornerSubPix(grey, corners, (3, 3), (-1, -1), (3, 50, 1e-4)))
    assert len(found) >= 10
    rms, matrix, lens, _, _ = cv2.calibrateCamera(
        [board] * len(found), found, grey.shape[::-1], None, None, flags=cv2.CALIB_FIX_K3
    )
    assert rms < 0.3
    sensor = made.optics[0].sensor
    np.testing.assert_allclose(matrix[[0, 1], [0, 1]], (sensor.fx, sensor.fy), rtol=0.01)
    np.testing.assert_allclose(matrix[:2, 2] + 0.5, (sensor.cx, sensor.cy), atol=2.5)
    # Lenses agree where they send points, even where single coefficients do not.
    x, y = np.meshgrid(np.linspace(-0.55, 0.55, 9), np.linspace(-0.35, 0.35, 7))
    points = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    sent = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens)[0][:, 0] + 0.5
    true = np.stack(sensor.distort(x, y), axis=-1).reshape(-1, 2)
    assert np.sqrt(((sent - true) ** 2).sum(axis=1).mean()) < 1.0


def test_board_poses_in_the_truth_project_to_the_corners(made):
    known, sensor = made.camera_truth, made.optics[0].sensor
    path = made.calibration("checkerboard")[4]  # the one in the middle
    pose = np.array(known["board"]["camera_from_board"][4])
    columns = known["board"]["corners"][0]
    square = known["board"]["square"]
    mosaic = values(path)[1::2, ::2]  # one green of the cell
    for x in range(columns - 1):
        middle = pose[:, :3] @ ((x + 0.5) * square, 0.5 * square, 0) + pose[:, 3]
        column, row = sensor.distort(*(middle[:2] / middle[2]))
        dark = mosaic[int(row / 2), int(column / 2)] < 0.2
        assert dark == (x % 2 == 0)


def test_charuco_boards_are_recognised_corner_by_corner(tmp_path):
    large = {"size": (320, 240), "boards": ("charuco",), "board": (6, 4)}
    made = captures.write(tmp_path / "raw", views=1, calibration_frames=1, exposures=1, **large)
    known, sensor = made.camera_truth["board"], made.optics[0].sensor
    columns, rows = known["corners"]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known["dictionary"]))
    board = cv2.aruco.CharucoBoard((columns + 1, rows + 1), known["square"], known["marker"], dictionary)
    assert not made.calibration("checkerboard")
    for path, pose in zip(made.calibration("charuco"), known["camera_from_board"], strict=True):
        with rawpy.imread(str(path)) as raw:
            grey = cv2.cvtColor(raw.postprocess(no_auto_bright=True, use_camera_wb=True), cv2.COLOR_RGB2GRAY)
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        assert len(ids) > 0.9 * columns * rows
        places = np.stack([ids.ravel() % columns, ids.ravel() // columns, 0 * ids.ravel()], -1) * known["square"]
        seen = places @ np.array(pose)[:, :3].T + np.array(pose)[:, 3]
        true = np.stack(sensor.distort(*(seen[:, :2] / seen[:, 2:]).T), -1)
        error = np.linalg.norm(corners.reshape(-1, 2) + 0.5 - true, axis=1)
        assert np.median(error) < 0.3


def test_flat_frames_show_the_vignetting_only(made):
    known, sensor = made.camera_truth, made.optics[0].sensor
    paths = made.calibration("flat")
    mean = np.mean([values(path) for path in paths], axis=0)
    red = mean[::2, ::2] / known["sensitivity"][0]
    columns, rows = np.arange(sensor.width)[::2] + 0.5, np.arange(sensor.height)[::2] + 0.5
    expected = sensor.falloff(columns[None], rows[:, None], tuple(known["vignetting"]))
    assert sensor.falloff(np.array(0.0), np.array(0.0), tuple(known["vignetting"])) == pytest.approx(0.53)
    ratio = red / expected
    assert ratio.std() / ratio.mean() < 0.01
    assert np.median(ratio) == pytest.approx(0.6, rel=0.005)


def test_dark_frames_hold_the_true_black_levels(tmp_path):
    made = captures.write(tmp_path / "raw", views=1, dark_offset=(2.0, 0.0, -3.0, 1.0), calibration_frames=1)
    true = made.camera_truth["black"]
    assert np.subtract(true, made.settings.black_levels).tolist() == [2, 0, -3, 1]
    stack = []
    for path in made.calibration("dark"):
        with rawpy.imread(str(path)) as raw:
            stack.append(raw.raw_image_visible.astype(float))
    mean = np.mean(stack, axis=0)
    np.testing.assert_allclose([mean[p // 2 :: 2, p % 2 :: 2].mean() for p in range(4)], true, atol=0.06)


def test_the_grey_card_shows_the_sensitivities(made):
    mosaic = values(made.calibration("white")[0])
    height, width = mosaic.shape
    card = mosaic[3 * height // 8 // 2 * 2 : 5 * height // 8, 3 * width // 8 // 2 * 2 : 5 * width // 8]
    red, green, blue = card[::2, ::2].mean(), card[::2, 1::2].mean(), card[1::2, 1::2].mean()
    np.testing.assert_allclose([red / green, blue / green], made.settings.sensitivity[::2], rtol=0.01)


# --- faults and other entrances -----------------------------------------------------------------


def test_every_fault_spoils_what_it_says_and_nothing_else(tmp_path):
    small = {"views": 1, "size": (48, 32), "exposures": 3, "calibration_frames": 1}
    sound = captures.write(tmp_path / "sound", **small)
    everything = {p.relative_to(sound.folder): p.read_bytes() for p in sorted(sound.folder.rglob("*.*"))}
    for fault in captures.FAULTS:
        spoilt = captures.write(tmp_path / fault, faults=(fault,), **small)
        changed = [
            name
            for name, content in everything.items()
            if not (spoilt.folder / name).is_file() or (spoilt.folder / name).read_bytes() != content
        ]
        places = {str(name.parent) for name in changed}
        expected = {
            "dark-centred flat": {"calibration/flat"},
            "board absent": {"calibration/checkerboard"},
            "clipped shortest": {".", "truth"},
        }.get(fault, {"."})
        assert places == expected, fault
        if expected == {"."}:
            assert len(changed) == 1, fault


def test_the_clipped_view_is_clipped_in_truth(tmp_path):
    made = captures.write(tmp_path / "raw", views=1, faults=("clipped shortest",), calibration_frames=1)
    assert made.truth("train_000")["saturated"].mean() > 0.3
    assert (values(made.frames("train_000")[0]) > 0.999).mean() > 0.1


def test_posed_pictures_become_a_capture(tmp_path):
    settings = SimulatedCamera(**captures.SMALL | {"scale": 1, "exposures": 3})
    given = captures.cameras(2, (80, 60))
    mesh = scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    images = (captures.scene_image(camera) for camera in given)
    files = writer.simulate_capture(images, given, settings, tmp_path / "raw", mesh)
    assert all(file.is_file() for file in files)
    assert len(list((tmp_path / "raw").glob("*.dng"))) == 6
    assert len(read_mesh(tmp_path / "raw" / "mesh.ply").triangles) == 2
    views = read_transforms(tmp_path / "raw" / "transforms.json")
    for view in views:
        assert 60 < view.width < 80
        made = captures.Capture(tmp_path / "raw", views, [], settings)
        np.testing.assert_allclose(made.truth(view.name)[""], captures.scene_image(view), rtol=2e-3)


def test_a_capture_has_one_camera(tmp_path):
    one, other = captures.cameras(1)[0], captures.cameras(1, (80, 60))[0]
    with pytest.raises(FiptError, match="one camera"):
        writer.simulate_capture([], [one, other], SimulatedCamera(), tmp_path / "raw")
    assert not (tmp_path / "raw").exists()


def test_a_ghost_needs_a_view(tmp_path):
    with pytest.raises(FiptError, match="train_007 is none"):
        captures.write(tmp_path / "raw", ghosts=("train_007",))
    assert not (tmp_path / "raw").exists()


def test_the_truth_of_the_camera_is_complete(made):
    truth = json.loads((made.folder / "truth" / "camera.json").read_text())
    assert truth["sensor"]["distortion"] == list(made.settings.distortion)
    assert truth["white"] == 16383
    assert len(truth["board"]["camera_from_board"]) == len(made.calibration("checkerboard"))
    assert [len(made.calibration(kind)) for kind in ("flat", "dark", "white")] == [4, 4, 1]
