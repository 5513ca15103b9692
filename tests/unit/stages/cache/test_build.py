"""Radiance cache: means in voxels, what stands for unseen ones, and where the room stands in the world."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene.mesh import Mesh, connected_parts
from fipt.scene.voxels import facing_normals
from fipt.stages.cache import build as cache
from fipt.stages.cache.settings import CacheSettings
from tests import scenes

SETTINGS = CacheSettings(resolution=16)


def built(mesh, samples, radiance, valid=1.0):
    image = np.broadcast_to(np.float32(radiance), (len(samples.offsets) - 1, 3))
    valid = np.broadcast_to(np.float32(valid), len(image))
    views = [samples.pixels(index) for index in range(len(samples.views))]
    return cache.build(
        mesh, [samples], ((image[own], valid[own], np.zeros(len(image[own]), bool)) for own in views), SETTINGS
    )


DOWN, UP = 2, 3
"""Facings along y."""


def record_at(result, point, facing=UP):
    key = cache.voxel_keys(np.float32([point]), result["center"], result["side"], result["resolution"])
    (found,) = np.flatnonzero((result["key"] == key[0]) & (result["facing"] == facing))
    return found


CORNERS = [(-2, 0, -2), (2, 0, 2)]
"""Pixels at the ends, so that the box is the same in every test: side 4.2, voxels of 0.2625."""


def test_a_voxel_holds_the_mean_of_its_pixels(np_rng):
    at = [(0.01, 0, 0.01), (0.02, 0, 0.05), (0.11, 0, 0.11), (0.5, 0, 0.01)]
    values = np_rng.random((6, 3)).astype(np.float32)
    result = built(scenes.floor(), scenes.samples_of([*CORNERS, *at]), values)
    own = record_at(result, at[0])
    np.testing.assert_allclose(result["radiance"][own], values[2:5].mean(axis=0), rtol=1e-6)
    assert result["count"][own] == 3
    np.testing.assert_allclose(result["radiance"][record_at(result, at[3])], values[5], rtol=1e-6)
    assert (np.diff(result["key"] * 6 + result["facing"]) > 0).all()


def test_weights_of_pixels_count(np_rng):
    at = [(0.01, 0, 0.01), (0.02, 0, 0.05), (0.1, 0, 0.1)]
    values = np_rng.random((5, 3)).astype(np.float32)
    result = built(scenes.floor(), scenes.samples_of([*CORNERS, *at]), values, [1, 1, 0.5, 1.0, 0.0])
    own = record_at(result, at[0])
    np.testing.assert_allclose(result["radiance"][own], (0.5 * values[2] + values[3]) / 1.5, rtol=1e-6)
    assert result["count"][own] == pytest.approx(1.5)


def test_edge_pixels_count_only_where_nothing_better_is_known():
    at = [(0.01, 0, 0.01), (0.1, 0, 0.1), (1.01, 0, 1.01)]
    samples = scenes.samples_of([*CORNERS, *at], weight=[1, 1, 1, 0.5, 0.5])
    result = built(scenes.floor(), samples, [[0] * 3, [0] * 3, [1] * 3, [100] * 3, [7] * 3])
    np.testing.assert_allclose(result["radiance"][record_at(result, at[0])], 1 + 99e-3, rtol=1e-3)
    mixed = record_at(result, at[2])
    np.testing.assert_allclose(result["radiance"][mixed], 7, rtol=1e-6)
    assert result["count"][mixed] == 0
    assert result["source"][mixed] == mixed


def test_a_lamp_that_the_mesh_lacks_does_not_light_what_is_behind_it():
    """Three views show the place; one of them shows a lamp before it."""
    at = [(0.01, 0, 0.01), (0.02, 0, 0.05), (0.1, 0, 0.1)]
    place = np.float32([[*CORNERS, each] for each in at]).reshape(-1, 3)
    samples = scenes.samples_of(place, views=("a", "b", "c"), shapes=[(1, 3)] * 3)
    values = np.ones((9, 3), np.float32)
    values[8] = 100
    result = built(scenes.floor(), samples, values)
    np.testing.assert_allclose(result["radiance"][record_at(result, at[0])], 7 / 3, rtol=1e-6)


def two_floors():
    """A floor and a smaller plate 0.3 above it: two parts."""
    plate = scenes.floor(1.5)
    return scenes.joined(scenes.floor(2.0), Mesh(plate.vertices + np.float32([0, 0.3, 0]), plate.triangles))


def test_the_sides_of_a_thin_plate_do_not_lend_each_other_light():
    at = [(0.5, 0, 0.5), (0.51, 0, 0.52)]
    normal = np.float32([[0, 1, 0], [0, 1, 0], [0, 1, 0], [0, -1, 0]])
    result = built(
        scenes.floor(2.0), scenes.samples_of([*CORNERS, *at], normal=normal), [[1] * 3, [1] * 3, [2] * 3, [8] * 3]
    )
    above, below = record_at(result, at[0], UP), record_at(result, at[1], DOWN)
    np.testing.assert_array_equal(result["radiance"][[above, below], 0], [2, 8])
    # what is unseen takes after the nearest that faces the same way
    assert result["source"][record_at(result, (0.8, 0, 0.5), UP)] == above
    assert result["source"][record_at(result, (0.8, 0, 0.5), DOWN)] == below


def test_facings():
    normals = np.float32([[-1, 0, 0], [0.6, 0.5, -0.5], [0, -0.9, 0.4], [0.3, 0.8, 0], [0.1, 0, -1], [0.5, 0.5, 0.7]])
    np.testing.assert_array_equal(cache.facings(normals), np.arange(6))
    np.testing.assert_array_equal(cache.facings(facing_normals(np.arange(6))), np.arange(6))


def test_unseen_voxels_take_the_nearest_seen_one_of_their_part():
    mesh = two_floors()
    seen = [(-1.9, 0, -1.9), (1.9, 0, 1.9), (-1.4, 0.3, -1.4)]
    samples = scenes.samples_of(seen, triangle=[0, 0, 2])
    result = built(mesh, samples, [[1] * 3, [2] * 3, [3] * 3])
    seen_records = [record_at(result, p) for p in seen]
    np.testing.assert_array_equal(result["source"][seen_records], seen_records)
    # the plate's far corner is nearest to the floor's pixel, but belongs to the plate
    assert result["source"][record_at(result, (1.4, 0.3, 1.4))] == seen_records[2]
    assert result["source"][record_at(result, (1.6, 0, 1.2))] == seen_records[1]
    assert result["source"][record_at(result, (-1.2, 0, -1.6))] == seen_records[0]
    assert set(result["source"]) == set(seen_records)


def test_what_mixed_pixels_show_is_not_spread():
    """A pixel that shows the floor and a lamp says nothing of the floor around it."""
    at = [(0.5, 0, 0.5), (-1.5, 0, -1.5)]
    samples = scenes.samples_of([*CORNERS, *at], weight=[1, 1, 0.5, 1])
    result = built(scenes.floor(2), samples, [[1] * 3, [1] * 3, [60] * 3, [1] * 3])
    mixed = record_at(result, at[0])
    assert result["source"][mixed] == mixed
    assert result["source"][record_at(result, (0.8, 0, 0.5))] != mixed
    assert (result["source"] == mixed).sum() == 1


def test_a_ceiling_goes_on_where_a_lamp_hangs_below_it():
    """Of one part, as in a scan: the lamp's underside is nearer to the unseen ceiling than what is seen of that."""
    ceiling = scenes.quad((-2, 0.8, -2), (4, 0, 0), (0, 0, 4))
    lamp = scenes.quad((-0.2, 0.3, -0.2), (0.4, 0, 0), (0, 0, 0.4))
    stem = scenes.quad((0, 0.3, 0), (0, 0.5, 0), (0.1, 0, 0))
    mesh = scenes.joined(ceiling, lamp, stem)
    mesh = Mesh(mesh.vertices, np.concatenate([mesh.triangles, np.int32([[0, 4, 8]])]))
    seen = [(-1, 0.8, 0), (1, 0.8, 1), (0, 0.3, 0)]
    down = np.tile(np.float32([0, -1, 0]), (3, 1))
    samples = scenes.samples_of(seen, triangle=[0, 0, 2], normal=down)
    result = built(mesh, samples, [[1] * 3, [1] * 3, [90] * 3])
    above = record_at(result, (-0.1, 0.8, 0.1), DOWN)
    assert result["radiance"][result["source"][above], 0] == 1


def test_parts_that_no_view_sees_take_the_nearest_of_any():
    seen = [(-1.9, 0, -1.9), (1.9, 0, 1.9)]
    result = built(two_floors(), scenes.samples_of(seen), [[1] * 3, [2] * 3])
    assert result["source"][record_at(result, (1.4, 0.3, 1.4))] == record_at(result, seen[1])


def test_pixels_without_weight_see_nothing():
    """A voxel whose pixels all lost their value is as good as unseen; it must not shine black."""
    at = [(0.5, 0, 0.5), (0.9, 0, 0.5)]
    result = built(scenes.floor(2), scenes.samples_of([*CORNERS, *at]), 3.0, [1, 1, 1, 0])
    lost = record_at(result, at[1])
    assert result["count"][lost] == 0
    assert result["source"][lost] == record_at(result, at[0])
    np.testing.assert_allclose(result["radiance"][result["source"]], 3.0, rtol=1e-6)


def test_shards_of_one_view_give_the_same_cache_to_the_bit(np_rng):
    counts = [40, 30, 50]
    place = np.float32([*CORNERS, *(np_rng.random((118, 3)) * [1, 0, 1])])
    image, valid = np_rng.random((120, 3)).astype(np.float32), np_rng.random(120).astype(np.float32)
    weight = np_rng.choice([0.3, 1.0], 120)
    ends = np.cumsum(counts)
    cuts = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
    above = np_rng.random(120) < 0.3
    images = [(image[cut], valid[cut], above[cut]) for cut in cuts]
    whole = scenes.samples_of(place, weight=weight, views="abc", shapes=[(1, count) for count in counts])
    single = [scenes.samples_of(place[cut], weight=weight[cut]) for cut in cuts]
    one, many = (cache.build(scenes.floor(), shards, images, SETTINGS) for shards in ([whole], single))
    for name, values in one.items():
        np.testing.assert_array_equal(values, many[name], err_msg=name)


@pytest.mark.parametrize("shift", [(64, 32, 128), (-64, -32, -128), (0, 512, 0)])
def test_it_does_not_matter_where_the_room_stands(np_rng, shift):
    """Also where all coordinates have one sign. Positions are multiples of 1/256: exact in float32."""
    corners = np_rng.integers(0, 12, 300)
    mesh = scenes.box((0, 0, 0), (4, 3, 5))
    a = mesh.corners[corners]
    u = np_rng.random((300, 2))
    u = np.where(u.sum(axis=1, keepdims=True) > 1, 1 - u, u)
    p = a[:, 0] + u[:, :1] * (a[:, 1] - a[:, 0]) + u[:, 1:] * (a[:, 2] - a[:, 0])
    p = np.round(p * 256) / 256
    values = np_rng.random((300, 3))
    moved = Mesh(mesh.vertices + np.float32(shift), mesh.triangles)
    normal = mesh.normals[corners]
    here = built(mesh, scenes.samples_of(p, corners, normal=normal), values)
    there = built(moved, scenes.samples_of(p + shift, corners, normal=normal), values)
    np.testing.assert_allclose(there["center"], here["center"] + shift)
    assert there["side"] == here["side"]
    for result, points in ((here, p), (there, p + shift)):
        # the box holds every hit with room to spare, and each lies in the voxel of its key
        own = cache.voxel_keys(np.float32(points), result["center"], result["side"], 16)
        cell = np.stack([own % 16, own // 16 % 16, own // 256], axis=1)
        low = result["center"] - result["side"] / 2 + cell * result["side"] / 16
        assert (points >= low - 1e-4).all()
        assert (points <= low + result["side"] / 16 + 1e-4).all()
    seen = [result["count"] > 0 for result in (here, there)]
    for name in ("key", "facing"):
        np.testing.assert_array_equal(here[name][seen[0]], there[name][seen[1]])
    np.testing.assert_allclose(here["radiance"][seen[0]], there["radiance"][seen[1]], rtol=1e-6)


def test_every_voxel_on_the_surface_has_a_record(np_rng):
    mesh = scenes.box((0, 0, 0), (4, 3, 5))
    result = built(mesh, scenes.samples_of([(0, 0, 0), (4, 3, 5)]), 1.0)
    points, owner = cache.surface_points(mesh, 0.01, result["center"] - 3, result["center"] + 3, seed=1)
    keys = 6 * cache.voxel_keys(points, result["center"], result["side"], 16) + cache.facings(mesh.normals[owner])
    assert (
        np.isin(keys, 6 * result["key"] + result["facing"]).mean() > 0.94
    )  # random points leave out some corners of voxels
    assert len(connected_parts(mesh)) == 12
    on_box = np.abs(points[:, None] - mesh.corners[owner][:, 0, None]).min(axis=-1)
    assert on_box.max() < 1e-4


def test_points_are_spread_evenly_and_every_triangle_has_one():
    mesh = scenes.joined(scenes.floor(2.0), scenes.emitter_quad((0, 0.001), 1.0, (0, 0.001)))
    points, owner = cache.surface_points(mesh, 0.1, np.full(3, -3.0), np.full(3, 3.0), seed=0)
    np.testing.assert_allclose(np.bincount(owner, minlength=4), [801, 801, 1, 1], atol=1)
    assert abs((points[owner < 2][:, 0] > 0).mean() - 0.5) < 0.06
    inside, _ = cache.surface_points(mesh, 0.1, np.full(3, -1.0), np.full(3, 1.5), seed=0)
    assert inside.min() > -1
    assert inside.max() < 1.5


def test_without_samples_there_is_no_cache():
    with pytest.raises(FiptError, match="no camera ray hits the mesh"):
        built(scenes.floor(), scenes.samples_of(np.zeros((0, 3)), counts=[0, 0]), 1.0)


# --- clipped pixels -------------------------------------------------------------------------------


def with_bounds(values, clipped, valid=None):
    """The record of pixels at one place, some of them clipped."""
    samples = scenes.samples_of([*CORNERS, *[(0.01 + 0.02 * k, 0, 0.01) for k in range(len(values))]])
    image = np.float32([1, 1, *values])[:, None] * np.ones(3, np.float32)
    weight = np.float32([1, 1, *(valid or [1] * len(values))])
    bound = np.array([False, False, *clipped])
    result = cache.build(scenes.floor(), [samples], [(image, weight, bound)], SETTINGS)
    own = record_at(result, (0.01, 0, 0.01))
    return result["radiance"][own], result["count"][own]


@pytest.mark.parametrize(
    ("values", "clipped", "expected"),
    [
        ([4, 6, 2], [False, False, True], 5),  # the bound is no news: it counts as the others
        ([4, 6, 8], [False, False, True], 6),  # brighter than the others, at least 8
        ([3, 7, 5], [True, True, True], 7),  # one surface: as bright as the highest bound
        ([3, 7, 5], [False, False, False], 5),
    ],
)
def test_clipped_pixels_never_darken_a_record(values, clipped, expected):
    radiance, count = with_bounds(values, clipped)
    np.testing.assert_allclose(radiance, expected, rtol=1e-6)
    assert count == 3


def test_masked_pixels_are_no_bounds_either():
    radiance, count = with_bounds([3, 7, 50], [True, True, True], [1, 1, 0])
    np.testing.assert_allclose(radiance, 7, rtol=1e-6)
    assert count == 2


def test_a_window_behind_slats_has_its_own_radiance(np_rng):
    """Every pixel shows both; their shares tell 6 and 1, where all records would hold the mixture."""
    side = 32
    mesh = scenes.joined(scenes.quad((0, 0, 0), (0, 2, 0), (2, 0, 0)), scenes.quad((0, 1, 1), (2, 0, 0), (0, 0, 1)))
    share = np_rng.integers(3, 13, side * side) / 16
    place = np_rng.uniform(0, 2, (side * side, 2, 2))
    window = np.column_stack([place[:, 0], np.zeros(len(share))])
    slat = np.column_stack([place[:, 1, 0], np.ones(len(share)), 1 + place[:, 1, 1] / 2])
    samples = scenes.samples_of(
        np.stack([window, slat], axis=1),
        np.tile([0, 2], len(share)),
        np.stack([share, 1 - share], axis=1).reshape(-1),
        np.full(len(share), 2),
        shapes=[(side, side)],
        normal=np.tile(np.float32([[0, 0, 1], [0, 1, 0]]), (len(share), 1)),
    )
    result = built(mesh, samples, (share * 6 + (1 - share))[:, None] * np.ones(3))
    seen = result["radiance"][:, 0] > 0
    for facing, expected in ((5, 6.0), (3, 1.0)):
        own = seen & (result["facing"] == facing)
        assert own.sum() > 10
        np.testing.assert_allclose(result["radiance"][own], expected, atol=0.5)  # the mixture is 3.3
        assert (result["count"][own] == 0).all()
