"""The map of light from outside: its axes, its files, and the pixels that show it."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.hdr import read_hdr
from fipt.scene import environment as outside
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.setup import EnvironmentEdit
from tests import scenes


def bright(row, column, rows=16, **keys):
    """A map with one bright texel."""
    radiance = np.zeros((rows, 2 * rows, 3), np.float32)
    radiance[row, column] = [1, 2, 3]
    return EnvironmentMap("given", radiance, **keys)


# --- axes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "centre", "right", "left", "top"),
    [
        ({}, (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0)),
        ({"up": "z"}, (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1)),
        # a quarter turn, counter-clockwise from above: what was ahead is now to the left
        ({"rotation": 90.0}, (-1, 0, 0), (0, 0, -1), (0, 0, 1), (0, 1, 0)),
        ({"rotation": 90.0, "up": "z"}, (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)),
    ],
)
def test_where_the_map_is_seen(keys, centre, right, left, top):
    rows = 64
    for place, direction in (((32, 64), centre), ((32, 96), right), ((32, 32), left)):
        row, column = place
        radiance = np.zeros((rows, 2 * rows, 3), np.float32)
        radiance[row - 1 : row + 1, column - 1 : column + 1] = [1, 2, 3]
        np.testing.assert_allclose(
            EnvironmentMap("given", radiance, **keys).lookup(np.float32([direction])), [[1, 2, 3]]
        )
    radiance = np.zeros((rows, 2 * rows, 3), np.float32)
    radiance[0] = 5
    sky = EnvironmentMap("given", radiance, **keys)
    np.testing.assert_allclose(sky.lookup(np.float32([top, np.negative(top), centre])), [[5] * 3, [0] * 3, [0] * 3])


def test_lookups_are_bilinear_and_the_map_closes_at_its_sides(np_rng):
    radiance = np_rng.random((4, 8, 3)).astype(np.float32)
    sky = EnvironmentMap("given", radiance)
    centres = outside.texel_directions(4, 8)
    np.testing.assert_allclose(sky.lookup(centres), radiance.reshape(-1, 3), rtol=1e-5)
    theta = (1 + 0.5) * np.pi / 4
    seam = [0.0, np.cos(theta), np.sin(theta)]  # behind, where the last column meets the first
    np.testing.assert_allclose(sky.lookup(np.array([seam]))[0], (radiance[1, 0] + radiance[1, -1]) / 2, rtol=1e-5)


def test_a_camera_sees_the_texel_where_the_convention_says():
    """An unturned camera looks at the map's centre; its right is the map's right, its top the map's top."""
    camera = scenes.look_at("a", (0, 0, 0), (0, 0, -1), width=8, height=8, focal=8.0)
    top_right = outside.pixel_directions(camera, np.array([7]))
    row, column = bright(0, 0).texels(top_right)[0]
    assert 0 < row < 8
    assert 16 < column < 24


def test_solid_angles_cover_the_sphere_and_means_are_by_solid_angle():
    assert (outside.solid_angles(9, 20) * 20).sum() == pytest.approx(4 * np.pi)
    half = EnvironmentMap("given", np.zeros((8, 16, 3), np.float32))
    half.radiance[:2] = 1  # the cap within 45 degrees of the zenith
    np.testing.assert_allclose(half.mean, (1 - np.cos(np.pi / 4)) / 2, rtol=1e-5)


# --- light setups ---------------------------------------------------------------------------------


def test_setups_change_the_light_from_outside(tmp_path):
    sky = bright(3, 5, up="z", rotation=10.0)
    assert outside.edited(sky, None) is sky
    dim = outside.edited(sky, EnvironmentEdit(scale=0.25, rotation=20))
    np.testing.assert_array_equal(dim.radiance, 0.25 * sky.radiance)
    assert (dim.up, dim.rotation) == ("z", 30.0)
    assert not outside.edited(sky, EnvironmentEdit(scale=0)).emits
    grey = outside.edited(NOTHING, EnvironmentEdit(radiance=(1, 2, 4), scale=0.5))
    np.testing.assert_array_equal(grey.lookup(np.float32([[0, 1, 0]])), [[0.5, 1, 2]])
    write_exr(tmp_path / "other.exr", {"": np.full((4, 8, 3), 7.0)})
    other = outside.edited(sky, EnvironmentEdit(file=str(tmp_path / "other.exr"), rotation=5))
    assert (other.radiance.min(), other.up, other.rotation) == (7.0, "z", 5.0)


# --- files ----------------------------------------------------------------------------------------


def test_files_come_back(tmp_path, np_rng):
    sky = EnvironmentMap("map", np_rng.random((4, 8, 3)).astype(np.float32), "z", 12.0)
    outside.write_environment(tmp_path / "b.npz", sky)
    again = outside.read_environment(tmp_path / "b.npz")
    np.testing.assert_array_equal(again.radiance, sky.radiance)
    assert (again.mode, again.up, again.rotation) == ("map", "z", 12.0)
    outside.write_environment(tmp_path / "n.npz", NOTHING)
    assert not outside.read_environment(tmp_path / "n.npz").known
    assert outside.read_environment(None) is NOTHING


def test_a_channel_that_is_zero_is_fine(tmp_path):
    radiance = np.ones((4, 8, 3), np.float32)
    radiance[..., 1] = 0
    write_exr(tmp_path / "sky.exr", {"": radiance})
    np.testing.assert_array_equal(outside.read_map(tmp_path / "sky.exr").radiance, radiance)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda map_: np.where(np.indices(map_.shape)[0] == 3, np.nan, map_), "8 texels are NaN, the first at row 3"),
        (lambda map_: map_ * np.inf, "32 texels are infinite"),
        (lambda map_: map_ - 1.5, "32 texels are negative"),
        (lambda map_: map_[:, :4], "must be equirectangular, twice as wide as high; it is 4x4"),
    ],
)
def test_maps_that_are_none(tmp_path, change, said):
    write_exr(tmp_path / "sky.exr", {"": change(np.ones((4, 8, 3), np.float32))})
    with pytest.raises(FiptError) as error:
        outside.read_map(tmp_path / "sky.exr")
    assert said in str(error.value)


def test_maps_that_are_no_rgb_or_missing(tmp_path):
    with pytest.raises(FiptError, match=r"must be a map of shape \(height, width, 3\); found \(4, 8\)"):
        outside.checked(np.ones((4, 8)), "b.npz")
    write_exr(tmp_path / "grey.exr", {"Y": np.ones((4, 8), np.float32)})
    with pytest.raises(FiptError, match="must have the channels R, G, B"):
        outside.read_map(tmp_path / "grey.exr")
    for name in ("no.exr", "no.hdr"):
        with pytest.raises(FiptError, match="is missing"):
            outside.read_map(tmp_path / name)


def test_large_maps_are_averaged_down(monkeypatch, tmp_path, np_rng):
    monkeypatch.setattr(outside, "_MOST_ROWS", 8)
    radiance = np_rng.random((16, 32, 3)).astype(np.float32)
    write_exr(tmp_path / "sky.exr", {"": radiance})
    got = outside.read_map(tmp_path / "sky.exr").radiance
    np.testing.assert_allclose(got, radiance.reshape(8, 2, 16, 2, 3).mean(axis=(1, 3)), rtol=1e-5)


@pytest.mark.parametrize("width", [4, 300])  # narrow rows are written flat, others run-length coded
def test_hdr_images_are_read_as_mitsuba_reads_them(backend, tmp_path, np_rng, width):
    import mitsuba as mi

    image = np.exp(np_rng.normal(0, 3, (5, width, 3))).astype(np.float32)
    image[1, : width // 2] = [0, 2, 0]  # long runs, zero channels
    image[2] = 0
    mi.Bitmap(image).write(str(tmp_path / "sky.hdr"))
    got = read_hdr(tmp_path / "sky.hdr")
    np.testing.assert_allclose(got, np.array(mi.Bitmap(str(tmp_path / "sky.hdr"))), rtol=1e-6)
    np.testing.assert_allclose(got, image, atol=0.01 * image.max(axis=-1).max())
    assert (got[1, 0] == [0, 2, 0]).all()


def test_hdr_images_that_are_damaged(backend, tmp_path):
    import mitsuba as mi

    path = tmp_path / "sky.hdr"
    mi.Bitmap(np.random.default_rng(0).random((4, 300, 3)).astype(np.float32)).write(str(path))
    whole = path.read_bytes()
    for damaged in (whole[: len(whole) // 2], b"#?RADIANCE\n", whole.replace(b"-Y", b"+Y"), b""):
        path.write_bytes(damaged)
        with pytest.raises(FiptError, match=r"not a readable \.hdr image"):
            read_hdr(path)


# --- pixels ---------------------------------------------------------------------------------------


def view(covered):
    """Hits of a view whose pixels are covered to these shares (H, W)."""
    covered = np.asarray(covered, float)
    some = covered.ravel() > 0
    return scenes.samples_of(
        np.zeros((some.sum(), 3)), weight=covered.ravel()[some], counts=some, shapes=[covered.shape]
    )


def test_pixels_count_as_open_only_with_all_around_them():
    covered = np.ones((9, 9))
    covered[4:, :5] = 0  # a large opening, up to the picture's edge
    covered[1:3, 6:8] = 0  # a small hole
    expected = np.zeros((9, 9), bool)
    expected[5:, :4] = True
    np.testing.assert_array_equal(outside.open_pixels(view(covered), 0), expected)


def test_only_the_edges_of_openings_show_the_outside():
    covered = np.ones((8, 10))
    covered[4:, :5] = 0
    covered[3, :5] = 0.25  # the opening's upper edge
    covered[1, 8] = 0.5  # a crack far away
    samples = view(covered)
    camera = scenes.look_at("a", (0, 0, 0), (0, 0, -1), width=10, height=8)
    sky = outside.constant((1.0, 2.0, 0.0))
    pixel, radiance = outside.beyond(samples, [camera], sky)
    np.testing.assert_array_equal(pixel, 30 + np.arange(5))
    np.testing.assert_allclose(radiance, [[0.75, 1.5, 0]] * 5)
    assert len(outside.beyond(samples, [camera], NOTHING)[0]) == 0
