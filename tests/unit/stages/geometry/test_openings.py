"""Openings of a known room, told by pictures that stand still as the camera moves."""

from collections.abc import Callable

import numpy as np
import pytest

from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.depth_views import DepthView
from fipt.stages.geometry.openings import _openings, _Samples, find_openings
from fipt.stages.geometry.room_box import RoomBox
from fipt.stages.geometry.shell import shell_behind, with_shell

HALF = 1.5
"""Half of the side of the room, a cube around the origin."""
WIDE = 0.7
"""Half of the side of a window in its wall z = -HALF."""
NOTHING = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))

Picture = Callable[[np.ndarray, np.ndarray], np.ndarray]


def cube(half: float, voxel: float = 0.01) -> Mesh:
    """A cube of small triangles that face inwards."""
    far = np.full(3, half - 2 * voxel)
    return with_shell(NOTHING, RoomBox(np.eye(3), -far, far, np.array([-far, far])), voxel)


def clouds(way: np.ndarray) -> np.ndarray:
    """(N,) log radiance of (N, 3) directions or places: changes within a few degrees or centimetres."""
    x, y, z = 1.3 * way.T
    return 2 + 0.5 * np.sin(17 * x + 3 * z) + 0.5 * np.sin(23 * y - 7 * x) + 0.3 * np.sin(41 * y + 11 * x)


def seen(mesh: Mesh, picture: Picture) -> list[DepthView]:
    """Views of a grey room whose window shows a picture, log radiance of places and directions."""
    scene, views = RayScene(mesh), []
    for number, (x, z) in enumerate([(-0.9, 0.8), (-0.5, 0.2), (0.0, 1.1), (0.4, 0.0), (0.8, 0.9), (0.2, 0.5)]):
        pose = np.eye(4)
        pose[:3, 3] = x, 0.1 * (number % 3), z
        camera = Camera(f"v{number}", "train", 160, 120, 90.0, 90.0, 80.0, 60.0, pose)
        nothing = np.zeros((120, 160, 3), np.float32)
        empty = DepthMap(nothing[..., 0], nothing[..., 0], nothing)
        view = DepthView(camera, empty, np.ones((120, 160, 3), np.float32))
        way = view.rays.reshape(-1, 3) / np.linalg.norm(view.rays.reshape(-1, 3), axis=1, keepdims=True)
        distance, _ = scene.intersect(camera.center, way.astype(np.float32))
        place = camera.center + np.where(np.isfinite(distance), distance, 9.0)[:, None] * way  # seams let rays through
        light = np.where(window(place), picture(place, way), np.log(0.2))
        picture_ = np.repeat(np.exp(light).reshape(120, 160, 1), 3, axis=2).astype(np.float32)
        views.append(DepthView(camera, empty, picture_))
    return views


def window(place: np.ndarray) -> np.ndarray:
    """(N,) bool: places of the window without its bars, which are a tenth of a metre wide."""
    inside = (np.abs(place[:, :2]) < WIDE).all(axis=1) & (place[:, 2] < 0.01 - HALF)
    return inside & (np.abs(place[:, 0]) > 0.05)


def test_what_stands_still_is_outside_and_bars_stay(backend):
    mesh = cube(HALF)
    open_ = find_openings(mesh, seen(mesh, lambda _, way: clouds(way)))
    middle = mesh.corners.mean(axis=1)
    clear = (np.abs(middle[:, :2]) < WIDE - 0.05).all(axis=1) & (middle[:, 2] < 0.01 - HALF)
    clear &= np.abs(middle[:, 0]) > 0.1
    assert open_[clear].mean() > 0.7  # the darkest tenth may be bars
    assert window(middle[open_]).mean() > 0.9
    assert not open_[np.abs(middle[:, 0]) < 0.03].any()


@pytest.mark.parametrize(
    "picture",
    [
        lambda place, _: clouds(place),
        lambda place, _: np.full(len(place), 2.0),
        lambda place, way: 2.0 + 0.3 * way[:, 2] ** 2 + 0 * place[:, 0],
    ],
    ids=["a screen", "a pane that shines", "a lamp that is darker aside"],
)
def test_what_shines_in_its_place_is_no_opening(backend, picture):
    mesh = cube(HALF)
    assert not find_openings(mesh, seen(mesh, picture)).any()


def test_a_lamp_in_the_wall_of_a_window_stays(backend):
    mesh = cube(HALF)

    def picture(place: np.ndarray, way: np.ndarray) -> np.ndarray:
        return np.where(place[:, 0] > 0.45, 3.5, np.where(place[:, 0] < 0, clouds(way), np.log(0.2)))

    open_ = find_openings(mesh, seen(mesh, picture))
    middle = mesh.corners.mean(axis=1)
    assert open_[window(middle) & (middle[:, 0] < -0.1)].mean() > 0.7
    assert not open_[middle[:, 0] > 0.4].any()


def test_a_window_without_contrast_below_is_open_as_far_as_it_touches(backend):
    mesh = cube(HALF)
    sea = 1.7  # as bright as what is darkest in the sky

    def picture(place: np.ndarray, way: np.ndarray) -> np.ndarray:
        return np.where(way[:, 1] > -0.1, np.maximum(clouds(way), sea), sea)

    open_ = find_openings(mesh, seen(mesh, picture))
    middle = mesh.corners.mean(axis=1)
    below = window(middle) & (np.abs(middle[:, 0]) > 0.1) & (middle[:, 1] < -0.4) & (middle[:, 1] > 0.05 - WIDE)
    assert open_[below].mean() > 0.9


def test_blocks_in_a_row_and_blocks_without_chance_are_no_opening():
    place = np.array([[0.1, 0.1, 0.1], [0.3, 0.1, 0.1], [0.5, 0.1, 0.1]]).repeat(40, axis=0)
    counts = np.array([[20, 0]]).repeat(120, axis=0)
    assert _openings(_Samples(place, np.zeros(120), counts, np.array([[20, 20]]).repeat(120, axis=0))) == []
    apart = (
        place
        + np.random.default_rng(0).uniform(-0.09, 0.09, place.shape) * [1, 1, 0]
        + [[0, 0.2, 0]] * np.arange(3).repeat(40)[:, None]
    )
    assert _openings(_Samples(apart, np.zeros(120), counts, counts)) == []
    assert len(_openings(_Samples(apart, np.zeros(120), counts, np.array([[20, 20]]).repeat(120, axis=0)))) == 1


def test_nothing_bright_is_no_opening(backend):
    mesh = cube(HALF)
    assert not find_openings(mesh, seen(mesh, lambda place, _: np.full(len(place), -1.0))).any()


def test_what_lies_behind_goes_too_and_light_passes_the_shell(backend):
    inner = cube(HALF)
    away = np.full(3, HALF + 0.1)
    mesh = with_shell(inner, RoomBox(np.eye(3), -away, away, np.array([-away, away])), 0.01)
    first = len(inner.triangles)
    open_ = find_openings(mesh, seen(inner, lambda _, way: clouds(way)))
    assert open_[:first].any()
    assert open_[first:].any()
    behind = shell_behind(mesh, first, open_, 0.01)
    assert not behind[:first].any()
    middle = mesh.corners.mean(axis=1)
    assert (middle[behind, 2] < -HALF).all()  # no other side of the shell
    assert (np.abs(middle[behind, :2]) < WIDE + 0.6).all()
    gone = open_ | behind
    left = RayScene(Mesh(mesh.vertices, mesh.triangles[~gone]))
    # from close by, far to the side: 60 degrees
    way = np.array([[0.0, np.sin(1.0), -np.cos(1.0)]], np.float32)
    assert np.isinf(left.intersect(np.array([0.3, 0.0, 0.1 - HALF]), way)[0]).all()
    assert not shell_behind(mesh, first, np.zeros_like(open_), 0.01).any()


def test_large_panes_open_the_shell_behind_all_of_them():
    away = np.full(3, HALF)
    corners = np.array([[-1, -0.7, 0.1], [1, -0.7, 0.1], [1, 0.7, 0.1], [-1, 0.7, 0.1]], np.float32) - [0, 0, HALF]
    pane = Mesh(corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    mesh = with_shell(pane, RoomBox(np.eye(3), -away, away, np.array([-away, away])), 0.01)
    behind = shell_behind(mesh, 2, np.arange(len(mesh.triangles)) < 2, 0.01)
    middle = mesh.corners.mean(axis=1)
    facing = (np.abs(middle[:, :2]) < [1, 0.7]).all(axis=1) & (middle[:, 2] < -HALF)
    assert behind[facing].all()
    assert not behind[middle[:, 2] > 0.2 - HALF].any()
