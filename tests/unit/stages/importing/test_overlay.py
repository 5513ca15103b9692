"""What an overlay sees of a mesh, and edges where a box has them."""

import numpy as np

from fipt.render.scene import RayScene
from fipt.render.variant import Backend
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.stages.importing.overlay import edges, overlay, visible_triangles
from tests.layouts import POSES, matrix, room


def camera(width: int = 40, height: int = 30, focal: float = 20.0, index: int = 0) -> Camera:
    transform = np.array(matrix(POSES[index], (1, 1, 1)))
    return Camera("v", "train", width, height, focal, 1.1 * focal, 21.0, 14.0, transform)


def test_depth_is_along_the_view_axis(backend: Backend) -> None:
    view = camera()
    triangle, depth = visible_triangles(RayScene(room()), view)
    rows, columns = np.mgrid[: view.height, : view.width] + 0.5
    ahead = np.stack([(columns - view.cx) / view.fx, (view.cy - rows) / view.fy, -np.ones_like(rows)], -1)
    points = (ahead * depth[..., None]) @ view.world_from_camera[:3, :3].T + view.center
    corners = room().corners[triangle].astype(np.float64)
    off = np.einsum("hwk,hwk->hw", points - corners[:, :, 0], room().normals[triangle])
    assert np.abs(off).max() < 1e-5


def test_a_closed_room_covers_every_pixel(backend: Backend) -> None:
    for index in range(len(POSES)):
        triangle, depth = visible_triangles(RayScene(room()), camera(index=index))
        assert (triangle >= 0).all()
        assert np.isfinite(depth).all()


def test_nothing_behind_the_camera_shows(backend: Backend) -> None:
    view = camera()
    behind = room().vertices - np.float32(6) * POSES[0].forward.astype(np.float32)
    triangle, depth = visible_triangles(RayScene(Mesh(behind, room().triangles)), view)
    assert (triangle == -1).all()
    assert np.isinf(depth).all()


def test_edges_lie_where_walls_meet(backend: Backend) -> None:
    view = camera(400, 300, 200.0)
    triangle, depth = visible_triangles(RayScene(room()), view)
    marked = edges(room(), view, triangle, depth)
    # The edge between the back wall (z = 0) and the right wall (x = 4), and nothing on the wall.
    points, ahead = view.project(np.array([[4.0, 1.5, 0.0], [2.5, 1.5, 0.0]]))
    assert (ahead > 0).all()
    (column, row), (inner, inner_row) = points.astype(int)
    assert marked[row, column - 1 : column + 2].any()
    assert not marked[inner_row - 5 : inner_row + 5, inner - 5 : inner + 5].any()
    assert marked.mean() < 0.03


def test_an_overlay_is_drawn_at_a_size_for_eyes(backend: Backend) -> None:
    view = camera()
    drawn = overlay(room(), view, np.full((30, 40, 3), 0.5, np.float32))
    assert drawn.shape == (720, 960, 3)
    assert drawn.dtype == np.uint8
    assert 0.001 < (drawn == [255, 0, 200]).all(axis=-1).mean() < 0.1
