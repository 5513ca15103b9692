"""Surface that no pixel teaches: it belongs to the part of the surface that stands for it, or to what lies beside."""

import numpy as np
import pytest
import torch

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.voxels import facings, voxel_keys
from fipt.stages.fit.hidden import find_hidden
from tests import scenes

UP, DOWN = (0, 1, 0), (0, -1, 0)
SIDE, OTHER_SIDE = (1, 0, 0), (-1, 0, 0)
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


def cache_of(records):
    """Records in a box of side 4 with 4 voxels a side, sorted as in cache.npz."""
    point, normal, source = (np.array(column) for column in zip(*records, strict=True))
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
        "part": np.zeros(len(records), np.int32),
    }


@pytest.fixture
def cache():
    return cache_of(RECORDS)


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


def test_both_sides_of_unseen_surface_have_one_segment(pixels):
    unseen, seen = (-1.5, 0.5, 1.5), RECORDS[0][0]
    hidden = find_hidden(
        pixels,
        cache_of(
            [
                (seen, UP, 0),  # segment 3
                (RECORDS[2][0], UP, 1),  # segment 7
                (seen, DOWN, 1),  # the other side of what views see
                (unseen, UP, 0),  # faces as what stands for it does
                (unseen, DOWN, 1),
            ]
        ),
        np.ones(10, bool),
    )
    assert hidden.points.tolist() == [list(seen), list(unseen), list(unseen)]
    assert hidden.segment.tolist() == [3, 3, 3]


def test_of_two_unseen_sides_the_one_nearer_to_what_stands_for_it_decides(pixels):
    unseen = (1.5, 0.5, -1.5)
    for above, below in ((0, 1), (1, 0)):
        records = [(RECORDS[0][0], UP, 0), (RECORDS[2][0], UP, 1), (unseen, SIDE, above), (unseen, OTHER_SIDE, below)]
        assert find_hidden(pixels, cache_of(records), np.ones(10, bool)).segment.tolist() == [7, 7]


def test_two_unseen_sides_as_far_from_what_stands_for_them_have_one_segment(pixels):
    unseen = (-0.5, 0.5, -1.5)  # a metre from both
    records = [(RECORDS[0][0], UP, 0), (RECORDS[2][0], UP, 1), (unseen, SIDE, 0), (unseen, OTHER_SIDE, 1)]
    assert len(set(find_hidden(pixels, cache_of(records), np.ones(10, bool)).segment.tolist())) == 1


def test_another_part_of_the_mesh_is_not_the_other_side(pixels):
    """A picture before a wall: the wall's outside does not have the picture's material."""
    wall = (0.5, 0.5, -1.5)
    cache = cache_of([(RECORDS[0][0], UP, 0), (wall, UP, 1), (wall, DOWN, 0)])
    assert find_hidden(pixels, cache, np.ones(10, bool)).segment.tolist() == [7]
    outside = np.flatnonzero(cache["facing"] == facings(np.array([DOWN], float)))
    cache["part"][outside] = 1
    assert find_hidden(pixels, cache, np.ones(10, bool)).segment.tolist() == [3]


def test_the_back_of_what_nothing_is_known_of_takes_what_stands_for_it(pixels):
    known = np.ones(10, bool)
    known[7] = False
    cache = cache_of([(RECORDS[0][0], UP, 0), (RECORDS[2][0], UP, 1), (RECORDS[2][0], DOWN, 0)])
    assert find_hidden(pixels, cache, known).segment.tolist() == [3]


def strip(length):
    """A strip of seen voxels along x from the box's edge, of segment 3, the last of 7; then one that no view sees."""
    box = {"center": np.zeros(3), "side": np.float64(64.0), "resolution": np.int64(64)}
    place = np.float32([(x - 31.5, 0.5, 0.5) for x in range(length + 1)])
    seen = scenes.samples_of(place[:-1], normal=np.float32([UP] * length), views=("a",), shapes=[(1, length)])
    ids = np.full(length, 3, np.uint16)
    ids[-1] = 7
    shading = [np.zeros((length, SHADING_OUTPUTS, 3), np.float32)]
    pixels = scenes.training_pixels([seen], shading, [(np.ones((length, 3)), np.ones(length))], [ids])
    key, facing = voxel_keys(place, np.zeros(3), 64.0, 64), facings(np.float64([UP] * (length + 1)))
    source = np.append(np.arange(length), length - 1).astype(np.int32)
    parts = np.zeros(length + 1, np.int32)
    return pixels, box | {"key": key, "facing": facing, "point": place, "source": source, "part": parts}


def test_the_last_voxel_before_unseen_surface_does_not_tell_alone():
    pixels, cache = strip(6)
    assert find_hidden(pixels, cache, np.ones(10, bool)).segment.tolist() == [3]


def test_other_parts_of_the_mesh_have_no_vote():
    pixels, cache = strip(6)
    cache["part"][-2:] = 1
    assert find_hidden(pixels, cache, np.ones(10, bool)).segment.tolist() == [7]


def test_what_is_far_away_has_no_vote():
    pixels, cache = strip(6)
    cache["point"][-2:, 0] += 20
    pixels.shards[0].position[-1, 0] += 20
    cache["key"] = voxel_keys(cache["point"], np.zeros(3), 64.0, 64)
    assert find_hidden(pixels, cache, np.ones(10, bool)).segment.tolist() == [7]


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
