"""The atlas: every texel shows the surface that its neighbours in the textures belong to."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.meshing.atlas import filled, nearest_weights, texels, unwrap
from fipt.scene.mesh import connected_parts
from tests import planted, scenes


@pytest.fixture(scope="module")
def room():
    mesh = scenes.joined(
        scenes.box((0, 0, 0), (2, 1, 1.5)), scenes.turned(scenes.box((0.5, 0.025, 0.5), (0.8, 0.425, 0.9)))
    )
    return mesh, unwrap(mesh, connected_parts(mesh), 40.0, 2, 4096)


def positions(mesh, known):
    return np.einsum("nk,nkd->nd", known.weights, mesh.corners[known.triangle])


def test_triangles_keep_their_order_size_and_shape(room):
    mesh, atlas = room
    assert (atlas.vertex[atlas.triangles] == mesh.triangles).all() or np.allclose(
        mesh.vertices[atlas.vertex[atlas.triangles]], mesh.corners
    )
    corners = atlas.uv[atlas.triangles].astype(float) * [atlas.width, atlas.height]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    # flat walls: 40 texels along a metre, without distortion
    np.testing.assert_allclose(area, mesh.areas * 40**2, rtol=0.02)
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    true = np.linalg.norm(mesh.corners - np.roll(mesh.corners, 1, axis=1), axis=2)
    np.testing.assert_allclose(edges, 40 * true, rtol=0.02)


def test_texels_agree_with_a_brute_force_search(room):
    """Against every triangle for every texel: inside, or at most a texel away."""
    _, atlas = room
    known = texels(atlas)
    corners = atlas.uv[atlas.triangles].astype(float) * [atlas.width, atlas.height]
    rows, columns = np.indices((atlas.height, atlas.width)).reshape(2, -1)
    centre = np.column_stack([columns, rows]) + 0.5
    away = np.full(len(centre), np.inf)
    for triangle in corners:
        _, distance = nearest_weights(np.broadcast_to(triangle, (len(centre), 3, 2)), centre)
        away = np.minimum(away, distance)
    near = away <= 1
    assert set(known.index) == set(np.flatnonzero(near))
    placed = np.einsum("nk,nkd->nd", known.weights, corners[known.triangle])
    np.testing.assert_allclose(np.linalg.norm(placed - centre[known.index], axis=1), away[known.index], atol=1e-4)


def test_nearest_weights_against_a_dense_search():
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(20, 3, 2)), rng.normal(size=(20, 2)) * 2
    weights, distance = nearest_weights(corners, points)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert weights.min() >= 0
    grid = np.array([(i, j, 200 - i - j) for i in range(201) for j in range(201 - i)]) / 200
    dense = np.linalg.norm(np.einsum("gk,nkd->ngd", grid, corners) - points[:, None], axis=2).min(axis=1)
    assert (distance <= dense + 1e-6).all()
    np.testing.assert_allclose(distance, dense, atol=0.03)
    own = np.linalg.norm(np.einsum("nk,nkd->nd", weights, corners) - points, axis=1)
    np.testing.assert_allclose(distance, own, atol=1e-6)


def test_a_triangle_without_area_has_no_inside():
    line = np.array([[[0, 0], [1, 0], [3, 0]]], float)
    weights, distance = nearest_weights(line, np.array([[2.0, 1.0]]))
    np.testing.assert_allclose(distance, 1)
    np.testing.assert_allclose(np.einsum("nk,nkd->nd", weights, line), [[2, 0]], atol=1e-6)


def test_a_bilinear_lookup_on_the_surface_meets_its_own_chart_only(room):
    """A texture of positions, read like a renderer reads it, gives the position back, at edges as well."""
    mesh, atlas = room
    known = texels(atlas)
    texture = filled(positions(mesh, known), known, atlas.height, atlas.width)
    rng = np.random.default_rng(1)
    triangle = rng.integers(0, len(mesh.triangles), 4000)
    weights = rng.dirichlet([0.4, 0.4, 0.4], 4000)  # often near an edge
    place = np.einsum("nk,nkd->nd", weights, atlas.uv[atlas.triangles[triangle]])
    place = place * [atlas.width, atlas.height] - 0.5
    low = np.floor(place).astype(int)
    t = place - low
    x, y = (np.clip([low[:, k], low[:, k] + 1], 0, size - 1) for k, size in ((0, atlas.width), (1, atlas.height)))
    read = sum(
        texture[y[j], x[i]] * (t[:, :1] if i else 1 - t[:, :1]) * (t[:, 1:] if j else 1 - t[:, 1:])
        for i in (0, 1)
        for j in (0, 1)
    )
    true = np.einsum("nk,nkd->nd", weights, mesh.corners[triangle])
    assert np.linalg.norm(read - true, axis=1).max() < 1.5 / 40  # a texel and a half


def test_groups_share_no_chart():
    """Two halves of one wall, the second an emitter: no vertex of the atlas belongs to both."""
    mesh = scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    joined = unwrap(mesh, np.array([0, 0]), 20.0, 2, 4096)
    apart = unwrap(mesh, np.array([0, 1]), 20.0, 2, 4096)
    assert (joined.charts, len(joined.uv)) == (1, 4)
    assert (apart.charts, len(apart.uv)) == (2, 6)
    assert not set(apart.triangles[0]) & set(apart.triangles[1])


def test_the_resolution_has_a_limit(room):
    mesh, _ = room
    atlas = unwrap(mesh, connected_parts(mesh), 400.0, 2, 256)
    assert max(atlas.width, atlas.height) <= 256
    assert atlas.density < 400
    many = scenes.joined(*[scenes.quad((i, 0, 0), (0.5, 0, 0), (0, 0.5, 0)) for i in range(300)])
    with pytest.raises(FiptError, match="300 charts, too many for a texture of 64 texels"):
        unwrap(many, connected_parts(many), 10.0, 8, 64)


def test_unknown_texels_repeat_the_nearest():
    from fipt.meshing.atlas import AtlasTexels

    known = AtlasTexels(np.array([5, 10]), np.array([0, 1]), np.eye(3, dtype=np.float32)[:2])
    texture = filled(np.array([7.0, 9.0]), known, 4, 4)  # (1, 1) and (2, 2)
    np.testing.assert_array_equal(texture[0, :2], [7, 7])
    np.testing.assert_array_equal(texture[3, 2:], [9, 9])
    assert set(np.unique(texture)) == {7, 9}


@pytest.mark.parametrize(("failure", "fate"), [("hang", "did not end within 5 s"), ("crash", "SIGSEGV")])
def test_a_hang_and_a_crash_of_xatlas_are_survived_and_told(room, tmp_path, monkeypatch, caplog, failure, fate):
    mesh, expected = room
    monkeypatch.setattr("fipt.meshing.atlas.time_limit", lambda triangles: 5)
    monkeypatch.syspath_prepend(planted.plant_xatlas(tmp_path, failure, failures=1))
    atlas = unwrap(mesh, connected_parts(mesh), 40.0, 2, 4096)
    np.testing.assert_array_equal(atlas.uv, expected.uv)
    assert planted.attempts(tmp_path) == 2
    [told] = caplog.messages
    assert told.startswith("fipt.meshing.unwrap:lay_out")
    assert fate in told


def test_an_xatlas_that_always_crashes_is_one_clear_error(room, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(planted.plant_xatlas(tmp_path, "crash", failures=9))
    with pytest.raises(FiptError, match="lay_out was ended by SIGSEGV in each of 3 attempts"):
        unwrap(room[0], connected_parts(room[0]), 40.0, 2, 4096)
    assert planted.attempts(tmp_path) == 3
