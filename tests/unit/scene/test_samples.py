"""Hits on disk: round trip, and what is said of damaged folders."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.arrays import save_npy
from fipt.scene.samples import (
    clipped_of,
    median_footprint,
    pixels_of,
    read_samples,
    scene_box,
    segments_of,
    segments_of_triangles,
    view_pixels,
    write_samples,
)
from tests import scenes

ARRAYS = ("offsets", "center", "position", "normal", "triangle", "footprint", "weight", "sub", "sub_triangle")


@pytest.fixture
def samples(np_rng):
    counts = [1, 2, 0, 1, 3, 1, 0, 1]
    return scenes.samples_of(
        np_rng.random((9, 3)),
        np_rng.integers(0, 99, 9),
        np_rng.random(9),
        counts,
        views=("b", "a"),
        shapes=[(2, 3), (1, 2)],
        sub=np_rng.random((9, 4, 3)).astype(np.float16),
        sub_triangle=np.arange(36, dtype=np.int32).reshape(9, 4),
    )


@pytest.fixture
def folder(tmp_path, samples):
    write_samples(tmp_path, samples)
    return tmp_path


def test_round_trip(tmp_path, samples):
    files = write_samples(tmp_path, samples)
    assert sorted(files) == sorted(tmp_path.iterdir())
    read = read_samples(tmp_path)
    assert read.views == samples.views
    assert read.shapes == samples.shapes
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(read, name), getattr(samples, name))
        assert getattr(read, name).dtype == getattr(samples, name).dtype
    assert isinstance(read.position, np.memmap)


def test_pixels_and_samples_of_views(samples):
    assert samples.first_pixels.tolist() == [0, 6, 8]
    assert samples.pixels(1) == slice(6, 8)
    assert samples.of_view(0) == slice(0, 8)
    assert samples.of_view(1) == slice(8, 9)
    assert samples.pixel_of_sample(0).tolist() == [0, 1, 1, 3, 4, 4, 4, 5]
    assert samples.pixel_of_sample(1).tolist() == [1]


@pytest.mark.parametrize("name", ARRAYS)
def test_missing_and_cut_arrays(folder, name):
    path = folder / f"{name}.npy"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - 3])
    with pytest.raises(FiptError, match=rf"{name}\.npy is not a complete npy array"):
        read_samples(folder)
    path.unlink()
    with pytest.raises(FiptError, match=f"is missing: .*{name}"):
        read_samples(folder)


@pytest.mark.parametrize("name", [*ARRAYS[:1], *ARRAYS[2:]])
def test_arrays_of_other_shards(folder, samples, name):
    save_npy(folder / f"{name}.npy", getattr(samples, name)[:-1])
    with pytest.raises(FiptError, match="do not belong together; delete it and run the samples stage again"):
        read_samples(folder)


def test_centres_of_another_shard(folder, samples):
    save_npy(folder / "center.npy", samples.center[:-1])
    with pytest.raises(FiptError, match="do not belong together"):
        read_samples(folder)


@pytest.mark.parametrize("text", ["{", "[]", '{"views": [{"name": "a"}]}', '{"views": 3}'])
def test_damaged_views(folder, text):
    (folder / "views.json").write_text(text)
    with pytest.raises(FiptError, match=r"views\.json is damaged"):
        read_samples(folder)


def test_box_leaves_out_what_a_doorway_shows(np_rng):
    """A ground of a hundred metres in a half percent of the pixels does not take the voxels of the room."""
    room, ground = np_rng.random((9950, 3)) * (8, 3, 12), np_rng.random((50, 3)) * (200, 0, 200)
    center, side = scene_box([scenes.samples_of(room), scenes.samples_of(ground)])
    assert 12 < side < 14
    assert np.all((room >= center - side / 2) & (room <= center + side / 2))


@pytest.mark.parametrize("share", [0.03, 0.5])
def test_box_holds_the_next_room(np_rng, share):
    """What many pixels show is not left out, however far it is."""
    count = int(10_000 * share)
    positions = np.concatenate([np_rng.random((10_000 - count, 3)), 50 + np_rng.random((count, 3))])
    assert scene_box([scenes.samples_of(positions)])[1] == pytest.approx(51 * 1.05, rel=0.01)


def test_box_of_a_room_that_few_see_to_its_end(np_rng):
    """A corner that few pixels see stays: leaving it out would not make the voxels much finer."""
    positions = np.concatenate([np_rng.random((9_990, 3)), 1.5 + np_rng.random((10, 3)) * 0.3])
    assert scene_box([scenes.samples_of(positions)])[1] > 1.7


def test_views_of_another_shard(folder):
    (folder / "views.json").write_text(json.dumps({"views": [{"name": "a", "height": 2, "width": 2}]}))
    with pytest.raises(FiptError, match="do not belong together"):
        read_samples(folder)


def test_box_of_the_scene(samples):
    """Around what is seen, wherever that is; not around the origin."""
    far = scenes.samples_of([(10, 20, 30), (12, 21, 30)])
    center, side = scene_box([far])
    np.testing.assert_allclose(center, (11, 20.5, 30))
    assert side == pytest.approx(2 * 1.05)
    center, side = scene_box([far, scenes.samples_of([(2, 20, 30)]), scenes.samples_of(np.zeros((0, 3)), counts=[0])])
    np.testing.assert_allclose(center, (7, 20.5, 30))
    assert side == pytest.approx(10 * 1.05)
    assert scene_box([scenes.samples_of([(1, 1, 1)])])[1] > 0


def test_pixels_of_views_in_their_order(samples):
    class Data:
        def image(self, view):
            shape = {"b": (2, 3), "a": (1, 2)}[view]
            return np.full((*shape, 3), ord(view)), np.arange(np.prod(shape)).reshape(shape)

        def clipped(self, view):
            return np.full({"b": (2, 3), "a": (1, 2)}[view], view == "a")

    radiance, weight = pixels_of(Data(), samples)
    np.testing.assert_array_equal(radiance, np.repeat([ord("b"), ord("a")], [6, 2])[:, None] * np.ones(3))
    np.testing.assert_array_equal(weight, [0, 1, 2, 3, 4, 5, 0, 1])
    one_by_one = list(view_pixels(Data(), [samples, samples]))
    assert len(one_by_one) == 4
    np.testing.assert_array_equal(np.concatenate([image for image, _, _ in one_by_one[2:]]), radiance)
    np.testing.assert_array_equal(np.concatenate([valid for _, valid, _ in one_by_one[:2]]), weight)
    assert [above.tolist() for _, _, above in one_by_one[2:]] == [[False] * 6, [True] * 2]


def test_segments_of_views_in_their_order(samples):
    class Data:
        def segments(self, view, kind):
            assert kind == "part"
            return {"b": np.arange(6).reshape(2, 3), "a": np.array([[65535, 7]])}[view]

    np.testing.assert_array_equal(segments_of(Data(), samples, "part"), [0, 1, 2, 3, 4, 5, 65535, 7])


def test_clipped_pixels_of_views_in_their_order(samples):
    class Data:
        def clipped(self, view):
            return np.array([[0, 1, 0], [1, 0, 0]], bool) if view == "b" else np.array([[1, 0]], bool)

    made = []

    def empty(shape, dtype):
        made.append(np.ones(shape, dtype))
        return made[-1]

    clipped = clipped_of(Data(), samples, empty)
    assert clipped is made[0]
    np.testing.assert_array_equal(clipped, [0, 1, 0, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(clipped_of(Data(), samples), clipped)


def test_a_triangle_beside_all_centres_is_of_the_nearest_surface():
    """Three pixels in a row. Of triangles 2, 3 and 5 no pixel shows the centre; 4 is shown, and has no id."""
    place = {0: (0.0, 0, 2), 1: (0.1, 0, 5), 2: (0.04, 0, 2), 3: (0.1, 0, 3), 5: (0.19, 0, 2), 4: (0.2, 0, 2)}
    position = np.array(list(place.values()), np.float32)
    seen = scenes.samples_of(position, list(place), np.ones(6), [1, 4, 1], shapes=[(1, 3)], footprint=np.full(6, 0.1))
    largest, found = segments_of_triangles([seen], [np.array([5, 7, 0], np.uint16)])
    assert largest == 7
    assert found.tolist() == [5, 7, 5, 0, 0, 0]


def test_the_median_footprint_does_not_depend_on_shards(monkeypatch):
    monkeypatch.setattr("fipt.scene.samples._COUNTED", 4)
    widths = np.float32([1, 9, 2, 9, 4, 9, 8, 9, 5])  # every third tells
    parts = [[widths], np.split(widths, [2]), np.split(widths, [1, 5, 6])]
    shards = [[SimpleNamespace(footprint=own) for own in each] for each in parts]
    assert [median_footprint(each) for each in shards] == [8.0] * 3
    assert median_footprint([SimpleNamespace(footprint=widths[:0])]) == 0.0


def test_the_largest_id_is_that_of_any_pixel():
    """A poster of two pixels on a wall of one triangle; the fit has rows for it."""
    seen = scenes.samples_of(np.zeros((5, 3)), 0)
    largest, found = segments_of_triangles([seen], [np.array([5, 5, 5, 9, 9], np.uint16)])
    assert (largest, found.tolist()) == (9, [5])
