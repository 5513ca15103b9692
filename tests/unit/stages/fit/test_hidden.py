"""Surface that no pixel teaches: it belongs to the part of the surface that stands for it, or to what lies beside."""

import numpy as np
import pytest
import torch

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.voxels import facings, voxel_keys
from fipt.stages.fit.hidden import find_hidden
from tests import scenes

UP, DOWN = (0, 1, 0), (0, -1, 0)
RECORDS = [
    # point, facing, number of the record that stands for it
    ((-1.5, 0.5, -1.5), UP, 0),  # seen, segment 3
    ((-0.5, 0.5, -1.5), UP, 0),
    ((0.5, 0.5, -1.5), UP, 2),  # seen, segment 7, by the second shard
    ((0.5, 0.5, -1.5), DOWN, 2),  # the other side of it
    ((1.5, 0.5, 1.5), UP, 4),  # seen, of no segment
    ((0.5, 0.5, 1.5), UP, 4),
    ((-1.5, 0.5, 1.5), UP, 0),
]


@pytest.fixture
def cache():
    """Records in a box of side 4 with 4 voxels a side, sorted as in cache.npz."""
    point, normal, source = (np.array(column) for column in zip(*RECORDS, strict=True))
    center = np.zeros(3)
    key, facing = voxel_keys(point, center, 4.0, 4), facings(normal.astype(float))
    order = np.lexsort((facing, key))
    place = np.argsort(order)
    return {
        "center": center,
        "side": np.float64(4.0),
        "resolution": np.int64(4),
        "key": key[order],
        "facing": facing[order],
        "point": point[order].astype(np.float32),
        "source": place[source[order]].astype(np.int32),
    }


@pytest.fixture
def pixels():
    """Two shards; the last pixel of the second sees a side of a voxel that the cache does not know."""

    def shard(position, normal, views):
        return scenes.samples_of(
            position, normal=np.float32(normal), views=views, shapes=[(1, len(position) // len(views))]
        )

    one = shard([(-1.4, 0.6, -1.6), (1.6, 0.4, 1.4)], [UP, UP], ("a",))
    two = shard([(0.4, 0.4, -1.4), (-0.5, 0.5, -1.5)], [UP, (1, 0, 0)], ("b",))
    ids = [np.array([3, 0], np.uint16), np.array([7, 9], np.uint16)]
    shading = [np.zeros((2, SHADING_OUTPUTS, 3), np.float32)] * 2
    return scenes.training_pixels([one, two], shading, [(np.ones((2, 3)), np.ones(2))] * 2, ids)


def test_unseen_surface_takes_the_segment_of_what_stands_for_it(pixels, cache):
    hidden = find_hidden(pixels, cache, np.ones(10, bool))
    found = {(*map(float, point), int(segment)) for point, segment in zip(hidden.points, hidden.segment, strict=True)}
    # seen records are not listed, nor those whose part is not known
    assert found == {(-0.5, 0.5, -1.5, 3), (0.5, 0.5, -1.5, 7), (-1.5, 0.5, 1.5, 3)}
    assert len(hidden) == 3
    assert hidden.size == 1.0


def test_places_lie_below_the_surface(pixels, cache):
    pixels.inset = 0.25
    hidden = find_hidden(pixels, cache, np.ones(10, bool))
    pixels.inset = 0.0
    on = find_hidden(pixels, cache, np.ones(10, bool))
    moved = on.points - hidden.points
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 0.25)
    records = {(*point, facing) for point, facing in zip(cache["point"], cache["facing"], strict=True)}
    assert {(*point, facing) for point, facing in zip(on.points, facings(moved), strict=True)} <= records


def test_nothing_is_hidden_where_all_is_seen(pixels, cache):
    everything = cache | {"source": np.arange(len(RECORDS), dtype=np.int32)}
    assert len(find_hidden(pixels, everything, np.ones(10, bool))) == 0


def test_surface_whose_pixels_teach_nothing_has_its_own_part_or_that_beside(pixels, cache):
    pixels.valid[0][:] = 0  # both pixels of the first view show an emitter
    known = np.ones(10, bool)

    def seen():
        hidden = find_hidden(pixels, cache, known)
        assert not hidden.seen[hidden.segment == 0].any()
        found = zip(hidden.points[hidden.seen].tolist(), hidden.segment[hidden.seen].tolist(), strict=True)
        return {(*point, part) for point, part in found}

    # of the last one the segment is not known; what lies beside is of segment 7
    assert seen() == {(-1.5, 0.5, -1.5, 3), (1.5, 0.5, 1.5, 7)}
    known[3] = False
    assert seen() == {(-1.5, 0.5, -1.5, 7), (1.5, 0.5, 1.5, 7)}


def test_half_of_a_draw_is_seen_surface(pixels, cache):
    pixels.valid[0][:] = 0
    hidden = find_hidden(pixels, cache, np.ones(10, bool))
    points, _, _ = hidden.drawn(301, np.random.default_rng(0))
    number = (points[:, None] == torch.from_numpy(hidden.points)).all(2).int().argmax(1).numpy()
    assert np.count_nonzero(hidden.seen[number]) == 151
    assert not hidden.seen.all()


def test_surface_of_parts_of_which_nothing_is_known_is_left_alone(pixels, cache):
    known = np.ones(10, bool)
    known[3] = False
    assert find_hidden(pixels, cache, known).segment.tolist() == [7]


def test_draws_are_seeded_and_even(pixels, cache):
    hidden = find_hidden(pixels, cache, np.ones(10, bool))
    first, again, other = (hidden.drawn(300, np.random.default_rng(seed)) for seed in (4, 4, 5))
    points, segment, size = first
    assert (points.shape, points.dtype) == ((300, 3), torch.float32)
    assert (segment.shape, segment.dtype) == ((300,), torch.int64)
    assert size.tolist() == [1.0] * 300
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(points, other[0])
    number = (points[:, None] == torch.from_numpy(hidden.points)).all(2).int().argmax(1).numpy()
    np.testing.assert_array_equal(segment, hidden.segment[number])
    assert np.bincount(number, minlength=3).min() > 70
