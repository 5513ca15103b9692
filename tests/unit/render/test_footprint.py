"""Footprint samples: which pieces of surface a pixel shows, and how much of each."""

import numpy as np
import pytest

from fipt.conventions import SUB_POSITIONS
from fipt.scene.mesh import connected_parts
from fipt.stages.samples.settings import SamplesSettings
from tests import scenes

PIXEL = 0.25
"""Width of a pixel at distance 1 of the camera below, metres."""


@pytest.fixture
def trace(backend):
    from fipt.render.footprint import trace_view
    from fipt.render.scene import RayScene

    def trace(mesh, grid=8, max_samples=4, camera=None, parts=None):
        parts = connected_parts(mesh) if parts is None else parts
        settings = SamplesSettings(grid=grid, max_samples=max_samples)
        return trace_view(RayScene(mesh), parts, camera or ahead(), settings)

    return trace


def ahead():
    """6 x 4 pixels at the origin, looking along -z; a pixel spans 0.25 at distance 1."""
    return scenes.look_at("a", (0, 0, 0), (0, 0, -1), width=6, height=4, focal=4.0)


def wall(x0, x1, z):
    """A wall across the view that faces the camera."""
    return scenes.quad((x0, -9, z), (x1 - x0, 0, 0), (0, 18, 0))


def pixel_of_sample(result):
    return np.repeat(np.arange(len(result["counts"])), result["counts"])


def edge(share):
    """A near wall that covers ``share`` of the pixels of column 3, before a far one."""
    return scenes.joined(wall(-9, share * PIXEL, -1), wall(-30, 30, -2))


@pytest.mark.parametrize("share", [0.2, 0.45, 0.85])
def test_a_pixel_on_an_edge_has_a_hit_of_each_side(trace, share):
    result = trace(edge(share))
    columns = np.arange(24) % 6
    np.testing.assert_array_equal(result["counts"], np.where(columns == 3, 2, 1))
    own = columns[pixel_of_sample(result)] == 3
    near = result["triangle"][own] < 2
    # 64 points of a low-discrepancy sequence
    np.testing.assert_allclose(result["weight"][own], np.where(near, share, 1 - share), atol=2.5 / 64)
    np.testing.assert_allclose(result["position"][own][:, 2], np.where(near, -1, -2), atol=1e-5)
    # the first hit of each pixel is the one its centre shows
    np.testing.assert_array_equal(near[::2], share > 0.5)
    np.testing.assert_array_equal(near[1::2], share < 0.5)


def test_inside_a_surface_a_pixel_has_one_whole_hit(trace):
    result = trace(wall(-9, 9, -2))
    np.testing.assert_array_equal(result["counts"], 1)
    np.testing.assert_array_equal(result["weight"], 1)
    np.testing.assert_array_equal(result["center"], 1)
    np.testing.assert_allclose(result["footprint"], np.linalg.norm(result["position"], axis=1) / 4, rtol=1e-5)
    np.testing.assert_array_equal(result["normal"], np.tile([0, 0, 1], (24, 1)))


def test_the_first_sample_is_at_the_centre(trace):
    result = trace(edge(0.8))
    first = np.cumsum(result["counts"]) - result["counts"]
    image, _ = ahead().project(result["position"][first])
    rows, columns = np.divmod(np.arange(24), 6)
    np.testing.assert_allclose(image, np.stack([columns + 0.5, rows + 0.5], axis=1), atol=1e-4)


def test_one_ray_a_pixel_is_its_centre(trace):
    result = trace(edge(0.8), grid=1)
    np.testing.assert_array_equal(result["counts"], 1)
    np.testing.assert_array_equal(result["weight"], 1)
    np.testing.assert_array_equal(result["triangle"].reshape(4, 6)[0] < 2, [True] * 4 + [False] * 2)
    np.testing.assert_array_equal(result["sub"], 0)


def test_weights_are_the_share_of_the_rays_that_hit(trace):
    result = trace(wall(-9, 0.3 * PIXEL, -1))
    covered = np.bincount(pixel_of_sample(result), result["weight"], 24).reshape(4, 6)
    np.testing.assert_allclose(covered, np.tile([1, 1, 1, 0.3, 0, 0], (4, 1)), atol=2.5 / 64)
    # column 3 is covered but not at its centre
    np.testing.assert_array_equal(result["center"].reshape(4, 6), np.tile([1, 1, 1, 0, 0, 0], (4, 1)))
    np.testing.assert_array_equal(result["counts"].reshape(4, 6), np.tile([1, 1, 1, 1, 0, 0], (4, 1)))


def test_sub_points_lie_on_their_piece_in_their_pixel(trace):
    result = trace(edge(0.4))
    assert result["sub"].shape == (len(result["position"]), SUB_POSITIONS, 3)
    assert result["sub"].dtype == np.float16
    points = result["position"][:, None] + result["sub"].astype(np.float32)
    near = result["triangle"] < 2
    np.testing.assert_allclose(points[..., 2], np.where(near, -1, -2)[:, None].repeat(4, 1), atol=1e-3)
    image, _ = ahead().project(points.reshape(-1, 3))
    pixel = np.repeat(pixel_of_sample(result), SUB_POSITIONS)
    inside = image - np.stack([pixel % 6, pixel // 6], axis=1)
    assert inside.min() > -0.01
    assert inside.max() < 1.01
    whole = inside[result["weight"][np.arange(len(pixel)) // SUB_POSITIONS] == 1].reshape(-1, SUB_POSITIONS, 2)
    np.testing.assert_allclose(whole.mean(axis=1), 0.5, atol=0.04)  # their mean is the pixel's centre
    across = inside[(pixel % 6 == 3) & np.repeat(near, SUB_POSITIONS), 0]
    assert across.max() < 0.41
    assert np.ptp(inside[pixel % 6 == 0]) > 0.5  # spread over the pixel, not four times one point


def test_sub_points_know_their_triangles(trace):
    """A wall of two triangles that meet along x = y: a pixel on the diagonal shows both."""
    result = trace(wall(-9, 9, -2))
    points = result["position"][:, None] + result["sub"].astype(np.float32)
    beside = np.abs(points[..., 0] - points[..., 1]) > 1e-3
    below = points[..., 1] < points[..., 0]
    assert 0 < below[beside].mean() < 1
    of_below = np.unique(result["sub_triangle"][beside & below])
    assert len(of_below) == 1
    assert of_below[0] not in result["sub_triangle"][beside & ~below]


def test_a_fold_of_one_part_is_two_pieces(trace):
    """Two walls that share an edge are one part; their normals tell them apart."""
    corner = scenes.joined(wall(-9, 0.5 * PIXEL, -1), scenes.quad((0.5 * PIXEL, -9, -1), (0, 0, 9), (0, 18, 0)))
    corner = scenes.Mesh(corner.vertices, corner.triangles)
    turned = scenes.look_at("a", (-1, 0, 0.5), (0.5 * PIXEL, 0, -1), width=5, height=3, focal=6.0)
    assert connected_parts(corner).max() == 0
    result = trace(corner, camera=turned)
    np.testing.assert_array_equal(result["counts"].reshape(3, 5)[:, 2], 2)


def test_flush_surfaces_of_two_parts_are_two_pieces(trace):
    flush = scenes.joined(wall(-9, 0.5 * PIXEL, -1), wall(0.5 * PIXEL, 9, -1))
    one, two = np.zeros(4, np.int32), np.array([0, 0, 1, 1], np.int32)
    np.testing.assert_array_equal(trace(flush, parts=one)["counts"], 1)
    np.testing.assert_array_equal(trace(flush, parts=two)["counts"].reshape(4, 6)[:, 3], 2)


def test_a_step_of_one_part_is_two_pieces(trace):
    parts = np.zeros(4, np.int32)
    np.testing.assert_array_equal(trace(edge(0.5), parts=parts)["counts"].reshape(4, 6)[:, 3], 2)


def test_pieces_beyond_the_most_join_the_last(trace):
    stripes = scenes.joined(*(wall(x * PIXEL / 4, (x + 1) * PIXEL / 4, -1 - 0.1 * x) for x in range(4)))
    full = trace(stripes)
    assert full["counts"].reshape(4, 6)[0, 3] == 4
    for most in (1, 2, 3):
        result = trace(stripes, max_samples=most)
        assert result["counts"].max() == most
        covered = np.bincount(pixel_of_sample(result), result["weight"], 24)
        np.testing.assert_allclose(covered, np.bincount(pixel_of_sample(full), full["weight"], 24), atol=1e-6)


def test_normals_are_turned_to_the_viewer(trace):
    result = trace(scenes.turned(wall(-9, 9, -2)))
    np.testing.assert_array_equal(result["normal"], np.tile([0, 0, 1], (24, 1)))


def test_a_view_beside_the_mesh_is_empty(trace):
    result = trace(wall(-9, 9, 5))
    assert not result["counts"].any()
    assert not result["center"].any()
    assert {len(result[name]) for name in result if name not in ("counts", "center")} == {0}
    assert result["sub"].shape == (0, SUB_POSITIONS, 3)
    assert result["sub_triangle"].shape == (0, SUB_POSITIONS)


def test_it_repeats_itself(trace):
    first, second = trace(edge(0.3)), trace(edge(0.3))
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name])


def test_views_are_joined_in_order(trace, backend):
    from fipt.render.footprint import joined

    other = scenes.look_at("b", (0, 0, 0), (0, 0, -1), width=2, height=3, focal=4.0)
    results = [trace(edge(0.5)), trace(edge(0.5), camera=other)]
    samples = joined([ahead(), other], results)
    assert samples.views == ("a", "b")
    assert samples.shapes == ((4, 6), (3, 2))
    assert len(samples.offsets) == 24 + 6 + 1
    np.testing.assert_array_equal(np.diff(samples.offsets), np.concatenate([r["counts"] for r in results]))
    np.testing.assert_array_equal(samples.position[samples.of_view(1)], results[1]["position"])
    np.testing.assert_array_equal(samples.pixel_of_sample(1), pixel_of_sample(results[1]))
    assert samples.offsets.dtype == np.int64
    assert samples.triangle.dtype == np.int32


def test_sub_pixel_points_start_at_the_centre_and_spread(backend):
    from fipt.render.footprint import sub_pixel_points

    np.testing.assert_array_equal(sub_pixel_points(1), [[0.5, 0.5]])
    for count in (4, 9, 16, 64, 256):
        points = sub_pixel_points(count)
        np.testing.assert_array_equal(points[0], [0.5, 0.5])
        assert points.min() >= 0
        assert points.max() < 1
        assert len(np.unique(points, axis=0)) == count
        quarters = np.bincount((points[1:] > 0.5) @ [1, 2], minlength=4)
        assert quarters.min() >= (count - 1) // 6
        # three of the first four lie in different quarters
        assert len(np.unique((points[1:4] > 0.5) @ [1, 2])) >= 2
        if count > SUB_POSITIONS:  # the next four stand for the pixel
            four = points[1 : 1 + SUB_POSITIONS]
            assert len(np.unique((four > 0.5) @ [1, 2])) == 4
            assert np.abs(four.mean(axis=0) - 0.5).max() < 0.04
            assert np.abs(four.var(axis=0) - 1 / 12).max() < 0.04


def test_sub_pixel_points_look_at_the_centre_on_average(backend, np_rng):
    """Else images are moved; and the share of a half-plane is right whatever its direction and place."""
    from fipt.render.footprint import sub_pixel_points

    x = (np.arange(200) + 0.5) / 200 - 0.5
    inside = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    angle = np_rng.uniform(0, 2 * np.pi, 500)
    edges = np.stack([np.cos(angle), np.sin(angle)]), np_rng.uniform(-0.5, 0.5, 500)
    true = (inside @ edges[0] > edges[1]).mean(axis=0)
    for grid, error in ((3, 0.1), (4, 0.055), (8, 0.018), (16, 0.008)):
        points = sub_pixel_points(grid**2) - 0.5
        assert np.abs(points.mean(axis=0)).max() < 0.25 / grid**2 + 0.0625 * (grid == 3) / 2
        share = (points @ edges[0] > edges[1]).mean(axis=0)
        assert np.sqrt(((share - true) ** 2).mean()) < error
