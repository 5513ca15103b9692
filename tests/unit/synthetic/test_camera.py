"""The simulated camera against closed forms and OpenCV."""

from fractions import Fraction

import cv2
import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.blocks import block_mean
from fipt.scene.cameras import Camera
from fipt.synthetic import camera as sim
from fipt.synthetic.settings import SimulatedCamera
from tests.captures import cameras, scene_image

LENS = (-0.12, 0.03, 0.002, -0.003, 0.004)
VIEW = cameras(1)[0]


def camera(**changes) -> SimulatedCamera:
    return SimulatedCamera(**{"distortion": LENS, "principal_offset": (1.5, -2.25), "scale": 2, **changes})


# --- shutter ----------------------------------------------------------------------------------


def test_printed_times_belong_to_third_stops():
    true = 2.0 ** (np.arange(15, -40, -1) / 3)
    printed = np.array([float(Fraction(time)) for time in sim.PRINTED_TIMES])
    assert len(printed) == len(true)
    assert (np.abs(printed / true - 1) < 0.07).all()
    # Each printed time is nearest to its own third.
    np.testing.assert_array_equal(np.rint(3 * np.log2(printed)), np.arange(15, -40, -1))


def test_a_bracket_is_spaced_evenly_but_its_printed_times_are_not():
    frames = sim.exposures(camera(exposures=5, step=2, longest=0.25))
    assert [frame.seconds for frame in frames] == pytest.approx([4.0**-k for k in (5, 4, 3, 2, 1)])
    assert [str(frame.printed) for frame in frames] == ["1/1000", "1/250", "1/60", "1/15", "1/4"]
    thirds = sim.exposures(camera(exposures=3, step=1 / 3, longest=1))
    assert [str(frame.printed) for frame in thirds] == ["3/5", "4/5", "1"]


def test_shutter_errors_belong_to_the_time_not_to_the_frame():
    few, many = (sim.exposures(camera(shutter_error=0.03, exposures=n)) for n in (3, 5))
    assert [f.seconds for f in few] == [f.seconds for f in many[2:]]
    errors = np.array([f.seconds * 4**k for k, f in enumerate(reversed(many), 1)]) - 1
    assert (errors != 0).all()
    assert (np.abs(errors) < 0.15).all()
    assert [f.printed for f in many] == [f.printed for f in sim.exposures(camera(exposures=5))]


def test_times_that_no_camera_has_are_refused():
    with pytest.raises(FiptError, match="1/8000"):
        sim.exposures(camera(exposures=9, step=2))


# --- geometry ---------------------------------------------------------------------------------


def test_distortion_is_opencvs():
    sensor = sim.optics(VIEW, camera()).sensor
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.6, 0.6, (2, 50))
    points = np.stack([x, y, np.ones(50)], axis=-1)
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), sensor.matrix, np.array(LENS))[0][:, 0]
    np.testing.assert_allclose(np.stack(sensor.distort(x, y), -1), expected, atol=1e-9)
    np.testing.assert_allclose(sensor.undistort(*expected.T), (x, y), atol=1e-9)


def test_distortion_that_folds_is_refused():
    with pytest.raises(FiptError, match="distortion"):
        sim.optics(VIEW, camera(distortion=(-0.9, 0, 0, 0, 0)))


@pytest.mark.parametrize("lens", [LENS, (0.1, 0, 0, 0, 0), (0, 0, 0, 0, 0)])
def test_the_source_holds_all_that_the_sensor_sees(lens):
    planes = sim.optics(VIEW, camera(distortion=lens))
    sensor, source = planes.sensor, planes.source
    assert (sensor.width, sensor.height) == (2 * VIEW.width, 2 * VIEW.height)
    columns, rows = np.meshgrid(np.linspace(0, sensor.width, 60), np.linspace(0, sensor.height, 50))
    x, y = sensor.undistort(columns, rows)
    columns, rows = source.fx * x + source.cx, source.fy * y + source.cy
    # Half a pixel around, so that interpolation needs nothing from beyond the border.
    assert columns.min() >= 0.5
    assert rows.min() >= 0.5
    assert columns.max() <= source.width - 0.5
    assert rows.max() <= source.height - 0.5


@pytest.mark.parametrize("scale", [1, 2])
def test_a_given_picture_is_used_as_far_as_it_reaches(scale):
    source = Camera("a", "train", 101, 76, 70.0, 71.0, 50.0, 39.0, np.eye(4))
    planes = sim.optics_within(source, camera(scale=scale))
    needed = sim.optics(planes.view, camera(scale=scale))
    assert planes.source is source
    assert planes.left >= needed.left
    assert planes.top >= needed.top
    assert source.width - planes.left >= needed.source.width - needed.left
    assert source.height - planes.top >= needed.source.height - needed.top
    assert planes.view.width * scale > 0.7 * source.width
    # A pixel's corner in the view and in the source lie on the same ray.
    assert (planes.left - source.cx) / source.fx == pytest.approx(-planes.view.cx / planes.view.fx)
    assert (planes.top - source.cy) / source.fy == pytest.approx(-planes.view.cy / planes.view.fy)


def test_a_picture_too_small_is_refused():
    tiny = Camera("tiny", "train", 4, 6, 8.0, 8.0, 2.0, 3.0, np.eye(4))
    with pytest.raises(FiptError, match="tiny of 4x6"):
        sim.optics_within(tiny, camera(principal_offset=(0, 0)))


# --- light on the sensor ----------------------------------------------------------------------


@pytest.mark.parametrize("pattern", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_an_even_wall_shows_vignetting_and_the_sensitivity_of_each_colour(pattern):
    settings = camera(pattern=pattern, principal_offset=(0, 0), white_radiance=50, sensitivity=(0.5, 1.0, 0.8))
    planes = sim.optics(VIEW, settings)
    signal = sim.expose_source(np.full((planes.source.height, planes.source.width, 3), 5, np.float32), planes, settings)
    height, width = signal.shape
    for place, letter in enumerate(pattern):
        relative = {"R": 0.5, "G": 1.0, "B": 0.8}[letter]
        part = signal[place // 2 :: 2, place % 2 :: 2]
        assert part[height // 4, width // 4] == pytest.approx(5 / 50 * relative, rel=1e-3)
    # The corner itself is half a pixel's diagonal outside the last centre: 0.53 there.
    corner = signal[0, 0] / {"R": 0.5, "G": 1.0, "B": 0.8}[pattern[0]] * 10
    assert corner == pytest.approx(0.53, abs=0.01)


def test_each_pixel_looks_where_the_lens_sends_it():
    """A picture that is linear in the plane z = 1 must come out as the undistorted position, whatever the sampling."""
    settings = camera(sensitivity=(1, 1, 1), vignetting=(0, 0, 0), white_radiance=1.0)
    planes = sim.optics(VIEW, settings)
    source, sensor = planes.source, planes.sensor
    x = (np.arange(source.width) + 0.5 - source.cx) / source.fx
    y = (np.arange(source.height) + 0.5 - source.cy) / source.fy
    image = np.stack(np.broadcast_arrays(2 + x[None], 2 + y[:, None], 2 + x[None] - y[:, None]), -1).astype(np.float32)
    signal = sim.expose_source(image, planes, settings)
    columns, rows = np.meshgrid(np.arange(sensor.width) + 0.5, np.arange(sensor.height) + 0.5)
    points = np.stack([columns, rows], -1).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    u, v = cv2.undistortPoints(points, sensor.matrix, np.array(LENS), criteria=stop)[:, 0].T.reshape(2, *columns.shape)
    for place, expected in ((0, 2 + u), (1, 2 + v), (2, 2 + v), (3, 2 + u - v)):
        window = np.s_[place // 2 :: 2, place % 2 :: 2]
        # 1e-4 of a sensor pixel is about 1e-6 in this plane.
        np.testing.assert_allclose(signal[window], expected[window], atol=3e-6)


def test_a_pixel_averages_over_its_area():
    """Half a pixel beside the source's grid, the pixel at an edge holds both sides in equal shares."""
    plain = {"distortion": (0, 0, 0, 0, 0), "vignetting": (0, 0, 0), "white_radiance": 1.0, "sensitivity": (1, 1, 1)}
    for offset, expected in ((0.0, [0, 0, 1, 1]), (0.5, [0, 0, 0.5, 1]), (-0.25, [0, 0.25, 1, 1])):
        settings = SimulatedCamera(**plain, principal_offset=(offset, 0), scale=2)
        planes = sim.optics(VIEW, settings)
        image = np.zeros((planes.source.height, planes.source.width, 3), np.float32)
        image[:, planes.left + 40 :] = 1
        row = sim.expose_source(image, planes, settings)[0]
        np.testing.assert_allclose(row[38:42], expected, atol=1e-4)


def test_camera_colours_are_mixed_before_the_sensitivity():
    mixing = (0.8, 0.2, 0, 0.1, 0.8, 0.1, 0, 0.3, 0.7)
    settings = camera(mixing=mixing, sensitivity=(0.5, 1, 0.8), vignetting=(0, 0, 0), white_radiance=1.0)
    planes = sim.optics(VIEW, settings)
    image = np.broadcast_to(np.float32((0.2, 0.4, 0.6)), (planes.source.height, planes.source.width, 3))
    cell = sim.expose_source(image, planes, settings)[:2, :2].ravel()
    np.testing.assert_allclose(cell, [0.5 * 0.24, 0.4, 0.4, 0.8 * 0.54], rtol=1e-5)


def test_a_picture_of_another_size_is_refused():
    planes = sim.optics(VIEW, camera())
    with pytest.raises(FiptError, match=r"must be .* it is 10x10"):
        sim.expose_source(np.ones((10, 10, 3), np.float32), planes, camera())


# --- read-out ---------------------------------------------------------------------------------


def test_noise_has_the_variance_of_photons_and_amplifier():
    settings = camera(full_well=20_000, read_noise=8.0, bits=14, black_levels=(500, 500, 500, 500))
    gain = (16383 - 500) / 20_000
    for share in (0.0, 0.02, 0.5):
        raw = sim.read_out(np.full((300, 300), share, np.float32), sim.reference_time(settings), settings, "a")
        electrons = (raw.astype(float) - 500) / gain
        variance = share * 20_000 + 8.0**2 + 1 / 12 / gain**2  # and rounding
        assert electrons.mean() == pytest.approx(share * 20_000, abs=4 * np.sqrt(variance / raw.size))
        assert electrons.var() == pytest.approx(variance, rel=4 * np.sqrt(2 / raw.size))


def test_light_adds_up_over_the_true_time():
    settings = camera(black_levels=(0, 0, 0, 0), full_well=1e6, bits=16)
    signal = np.full((40, 40), 0.001, np.float32)
    frames = sim.exposures(settings)
    means = [sim.read_out(signal, frame.seconds, settings, "a").mean() / 65535 for frame in frames]
    np.testing.assert_allclose(means, 0.001 * 4.0 ** np.arange(5), rtol=0.005)


@pytest.mark.parametrize(("bits", "white", "expected"), [(12, None, 4095), (14, 15000, 15000), (16, None, 65535)])
def test_full_pixels_stop_at_the_white_level(bits, white, expected):
    settings = camera(bits=bits, white_level=white, black_levels=(64, 64, 64, 64))
    raw = sim.read_out(np.full((20, 20), 50, np.float32), 1.0, settings, "a")
    assert (raw == expected).all()
    assert (sim.read_out(np.zeros((20, 20), np.float32), 1.0, settings, "a") < 100).all()


def test_black_levels_lie_at_their_positions_with_their_fractions():
    settings = camera(black_levels=(500.25, 520.5, 540.0, 560.75), dark_offset=(1.5, 0, 0, -2), read_noise=4.0)
    raw = sim.read_out(np.zeros((401, 601), np.float32), 0.1, settings, "a")
    means = [raw[place // 2 :: 2, place % 2 :: 2].mean() for place in range(4)]
    np.testing.assert_allclose(means, [501.75, 520.5, 540, 558.75], atol=0.03)


def test_noise_belongs_to_the_frame_and_the_seed():
    signal = np.full((30, 40), 0.3, np.float32)
    settings, time = camera(), 1e-3
    first = sim.read_out(signal, time, settings, "a/0")
    np.testing.assert_array_equal(first, sim.read_out(signal, time, settings, "a/0"))
    assert (first != sim.read_out(signal, time, settings, "a/1")).any()
    assert (first != sim.read_out(signal, time, camera(seed=1), "a/0")).any()


def test_bad_pixels_are_the_same_in_every_frame():
    settings = camera(hot_pixels=0.01, dead_pixels=0.005)
    bad = sim.defects((60, 80), settings)
    assert (len(bad.hot), len(bad.dead)) == (48, 24)
    assert not np.intersect1d(bad.hot, bad.dead).size
    frames = sim.exposures(settings)
    dark = np.zeros((60, 80), np.float32)
    long, short = (sim.read_out(dark, frame.seconds, settings, "d").ravel() for frame in (frames[-1], frames[-2]))
    glow = (long[bad.hot] - 512.0) / (16383 - 512)
    np.testing.assert_allclose(glow, bad.glow, atol=0.02)
    np.testing.assert_allclose((short[bad.hot] - 512.0) / (16383 - 512), bad.glow / 4, atol=0.02)
    lit = sim.read_out(dark + 0.5, frames[0].seconds, settings, "d").ravel()
    assert (lit[bad.dead] < 530).all()
    assert (np.delete(lit, np.union1d(bad.dead, bad.hot)) > 7000).all()


# --- truth ------------------------------------------------------------------------------------


def test_a_view_is_the_mean_of_its_blocks():
    settings = camera(scale=3)
    planes = sim.optics(VIEW, settings)
    image = scene_image(planes.source)
    truth = sim.view_truth(image, planes, settings)
    assert truth[""].shape == (VIEW.height, VIEW.width, 3)
    row, column = 17, 41
    top, left = planes.top + 3 * row, planes.left + 3 * column
    block = image[top : top + 3, left : left + 3]
    np.testing.assert_allclose(truth[""][row, column], block.mean(axis=(0, 1)), rtol=1e-6)
    # The view's own camera sees the same smooth picture.
    direct = scene_image(VIEW)
    assert np.median(np.abs(truth[""] / direct - 1)) < 0.003


def test_saturation_in_the_truth_is_that_of_the_shortest_frame():
    """Without distortion the sensor's pixels are those of the truth: compare with a noise-free read-out."""
    settings = camera(distortion=(0, 0, 0, 0, 0), principal_offset=(0, 0), scale=2, white_radiance=20)
    planes = sim.optics(VIEW, settings)
    image = scene_image(planes.source)
    truth = sim.view_truth(image, planes, settings)["saturated.Y"]
    signal = sim.expose_source(image, planes, settings)
    full = (signal >= 1).reshape(VIEW.height, 2, VIEW.width, 2)
    assert 5 < (truth > 0.5).sum() < 0.1 * truth.size
    assert (truth[full.all(axis=(1, 3))] == 1).all()
    assert (truth[full.any(axis=(1, 3))] > 0).all()


def test_pincushion_distortion_leaves_corners_unseen_and_barrel_does_not():
    for k1, seen in ((0.1, False), (-0.1, True)):
        settings = SimulatedCamera(distortion=(k1, 0, 0, 0, 0), scale=2)
        planes = sim.optics(VIEW, settings)
        outside = sim.view_truth(scene_image(planes.source), planes, settings)["outside.Y"]
        assert outside[0, 0] == (0 if seen else 1)
        assert outside.any() != seen
        assert outside[VIEW.height // 2, VIEW.width // 2] == 0


@pytest.mark.parametrize("white", [60.0, 10.0])
def test_a_ghost_changes_one_exposure_where_its_mask_says(white):
    settings = camera(ghosts=(VIEW.name,), white_radiance=white)
    planes = sim.optics(VIEW, settings)
    image = scene_image(planes.source)
    moved = sim.ghost(image, planes, settings)
    assert moved.frame == 2
    mask = sim.view_truth(image, planes, settings, moved)["moved.Y"]
    where = block_mean(
        (moved.image != image).any(axis=-1)[
            planes.top : planes.top + planes.sensor.height, planes.left : planes.left + planes.sensor.width
        ],
        2,
    )
    assert 0.005 < (mask > 0).mean() < 0.1
    assert (where[mask > 0] > 0).all()
    assert not sim.view_truth(image, planes, settings)["moved.Y"].any()
    # It is not clipped in its own exposure, so that there is something to see.
    inside = moved.image[moved.image != image]
    assert inside.max() * 16 < white
