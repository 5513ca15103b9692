"""The rasteriser of the overlay against rays, and edges where a box has them."""

import numpy as np

from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.stages.importing.overlay import edges, overlay, resized, visible_triangles
from tests.layouts import POSES, matrix, room


def camera(width: int = 40, height: int = 30, focal: float = 20.0, index: int = 0) -> Camera:
    transform = np.array(matrix(POSES[index], (1, 1, 1)))
    return Camera("v", "train", width, height, focal, 1.1 * focal, 21.0, 14.0, transform)


def nearest_samples(mesh: Mesh, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Triangle and distance along every pixel's ray, by Moeller and Trumbore's test."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    d = camera.directions(columns, rows).astype(np.float64)
    best, owner = np.full(rows.shape, np.inf), np.full(rows.shape, -1)
    for index, (a, b, c) in enumerate(mesh.corners.astype(np.float64)):
        p = np.cross(d, c - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / (p @ (b - a))
            u = (p @ (camera.center - a)) * inverse
            q = np.cross(camera.center - a, b - a)
            v = (d @ q) * inverse
            t = q @ (c - a) * inverse
            hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < best)
        best[hit], owner[hit] = t[hit], index
    return owner, best


def test_rasteriser_agrees_with_rays(np_rng: np.random.Generator) -> None:
    # Triangles of all sizes around the camera: many reach behind it.
    centers = POSES[0].origin + np_rng.normal(size=(300, 1, 3)) * 3
    sizes = 10 ** np_rng.uniform(-2, 0.7, (300, 1, 1))
    corners = (centers + np_rng.normal(size=(300, 3, 3)) * sizes).reshape(-1, 3)
    mesh = Mesh(corners.astype(np.float32), np.arange(900, dtype=np.int32).reshape(-1, 3))
    view = camera()
    triangle, depth = visible_triangles(mesh, view)
    expected, distance = nearest_samples(mesh, view)
    assert (triangle == expected).mean() > 0.999
    same = (triangle == expected) & (triangle >= 0)
    rows, columns = np.nonzero(same)
    along = view.directions(columns + 0.5, rows + 0.5) @ -view.world_from_camera[:3, 2]
    np.testing.assert_allclose(depth[same], distance[same] * along, rtol=1e-5)


def test_a_closed_room_covers_every_pixel() -> None:
    for index in range(len(POSES)):
        triangle, depth = visible_triangles(room(), camera(index=index))
        assert (triangle >= 0).all()
        assert np.isfinite(depth).all()


def test_nothing_behind_the_camera_shows() -> None:
    view = camera()
    behind = room().vertices - np.float32(6) * POSES[0].forward.astype(np.float32)
    triangle, depth = visible_triangles(Mesh(behind, room().triangles), view)
    assert (triangle == -1).all()
    assert np.isinf(depth).all()


def test_edges_lie_where_walls_meet() -> None:
    view = camera(400, 300, 200.0)
    triangle, depth = visible_triangles(room(), view)
    marked = edges(room(), view, triangle, depth)
    # The edge between the back wall (z = 0) and the right wall (x = 4), and nothing on the wall.
    points, ahead = view.project(np.array([[4.0, 1.5, 0.0], [2.5, 1.5, 0.0]]))
    assert (ahead > 0).all()
    (column, row), (inner, inner_row) = points.astype(int)
    assert marked[row, column - 1 : column + 2].any()
    assert not marked[inner_row - 5 : inner_row + 5, inner - 5 : inner + 5].any()
    assert marked.mean() < 0.03


def test_an_overlay_is_drawn_at_a_size_for_eyes() -> None:
    view = camera()
    picture = overlay(room(), view, np.full((30, 40, 3), 0.5, np.float32))
    assert picture.shape == (720, 960, 3)
    assert picture.dtype == np.uint8
    assert 0.001 < (picture == [255, 0, 200]).all(axis=-1).mean() < 0.1


def test_resizing_keeps_the_view() -> None:
    view, point = camera(), np.array([[2.5, 1.5, 0.5]])
    before, _ = view.project(point)
    after, _ = resized(view, 80, 90).project(point)
    np.testing.assert_allclose(after, before * [2, 3])
