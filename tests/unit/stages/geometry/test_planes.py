"""Planes of a known room: found on textured pixels, and carried on over bare ones."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.closing import closed
from fipt.stages.geometry.completion import complete
from fipt.stages.geometry.depth_views import DepthNoise, DepthView, depth_noise
from fipt.stages.geometry.other_views import OtherViews
from fipt.stages.geometry.possible_planes import PossiblePlanes
from fipt.stages.geometry.room_box import RoomBox, find_box
from fipt.stages.geometry.room_directions import sharpened
from fipt.stages.geometry.room_planes import _leading, _mean_up, find_room_planes
from fipt.stages.geometry.shell import with_shell
from fipt.stages.geometry.superpixels import superpixels
from tests.unit.stages.geometry.test_fusing import HALF, around, cube_through, view_of_cube

NOISE = 0.002


def painted(view: DepthView, lamp: bool = False) -> DepthView:
    """The view with walls of different greys, and an emitter in the middle of one where asked for."""
    axis = np.abs(view.map.normal).argmax(axis=-1)
    side = np.take_along_axis(view.map.normal, axis[..., None], -1)[..., 0] > 0
    grey = 0.3 + 0.12 * axis + 0.05 * side
    if lamp:
        points = view.points
        grey = np.where((points[..., 2] < -HALF + 0.01) & (np.abs(points[..., :2]) < 0.25).all(axis=-1), 20.0, grey)
    return DepthView(view.camera, view.map, np.repeat(grey[..., None], 3, axis=-1).astype(np.float32))


def inner(view: DepthView) -> np.ndarray:
    """(H, W) bool: pixels farther than 30 cm from any edge of the cube, as bare walls are unknown."""
    return np.sort(np.abs(view.points), axis=-1)[..., 1] < HALF - 0.3


def test_the_walls_of_a_cube_are_found_and_along_its_directions():
    views = [painted(view) for view in around(NOISE)]
    planes = find_room_planes(views, [superpixels(view.radiance) for view in views], NOISE)
    walls = [k for k in range(len(planes)) if planes.area[k] > 0.5]
    assert len(walls) == 4  # floor and ceiling are in no view
    assert (planes.axis[walls] >= 0).all()
    np.testing.assert_allclose(planes.directions, np.eye(3), atol=0.003)
    np.testing.assert_allclose(planes.offset[walls], -HALF, atol=0.003)
    box = find_box(views, planes.directions)
    np.testing.assert_allclose(box.walls[:, [0, 2]], [[-HALF] * 2, [HALF] * 2], atol=0.01)
    np.testing.assert_allclose([box.low[[0, 2]], box.high[[0, 2]]], [[-HALF] * 2, [HALF] * 2], atol=0.01)


def turned_world(view: DepthView, turn: np.ndarray) -> DepthView:
    """The view in a world that is turned (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    camera = replace(view.camera, world_from_camera=pose @ view.camera.world_from_camera)
    found = view.map
    return DepthView(camera, DepthMap(found.depth, found.confidence, found.normal @ turn.T), view.radiance)


def turned_image(view: DepthView, quarters: int) -> DepthView:
    """The view of a camera that is rolled by quarters of a turn."""
    pose = view.camera.world_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("z", -90 * quarters, degrees=True).as_matrix()
    rows, columns = np.rot90(view.map.depth, quarters).shape
    camera = replace(view.camera, width=columns, height=rows, cx=columns / 2, cy=rows / 2, world_from_camera=pose)
    found, light = (np.rot90(x, quarters) for x in (view.map.depth, view.radiance))
    normal, weight = (np.rot90(x, quarters) for x in (view.map.normal, view.map.confidence))
    return DepthView(camera, DepthMap(found, weight, normal), light)


@pytest.mark.parametrize("degrees", [(0.0, 0.0, 0.0), (1.0, -0.8, 2.0)], ids=["along the world", "turned"])
def test_what_lies_along_walls_tells_the_directions_of_a_room_without_planes(degrees):
    # of each wall a skirting of 30 cm is known; the start is off by two degrees about each axis
    turn = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
    views = [turned_world(view.without(inner(view)), turn) for view in around(NOISE)]
    start = Rotation.from_euler("xyz", [2.0, -2.0, 1.5], degrees=True).as_matrix()
    np.testing.assert_allclose(sharpened(start @ turn.T, views), turn.T, atol=0.003)
    nothing = [view.without(np.ones((60, 80), bool)) for view in views]
    np.testing.assert_array_equal(sharpened(start, nothing), start)


def test_bare_walls_are_completed():
    true = [painted(view) for view in around()]
    noisy = [view.without(inner(view)) for view in around(NOISE)]
    views = [DepthView(view.camera, view.map, known.radiance) for view, known in zip(noisy, true, strict=True)]
    done = complete(views, depth_noise(views)).views
    bare = np.concatenate([inner(view).ravel() for view in true])
    found = np.concatenate([d.view.map.depth.ravel() for d in done])[bare]
    depth = np.concatenate([view.map.depth.ravel() for view in true])[bare]
    known = found > 0
    assert known.mean() > 0.95
    assert np.percentile(np.abs(found - depth)[known], 95) < 0.01
    assert np.concatenate([d.measured.ravel() for d in done])[bare].mean() < 0.02  # as noise moves the border


@pytest.mark.parametrize("degrees", [(0.0, 15.0, 0.0), (0.0, 30.0, 0.0), (20.0, 60.0, -40.0)])
def test_a_room_that_is_not_along_the_worlds_axes_has_its_walls(degrees):
    turn = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
    views = [turned_world(painted(view).without(inner(view)), turn) for view in around(NOISE)]
    done = complete(views, DepthNoise(NOISE, 0.0))
    nearest = np.abs(done.planes.directions @ turn).max(axis=1)
    assert np.degrees(np.arccos(np.clip(nearest.min(), 0, 1))) < 0.5
    assert np.isfinite(done.box.walls).sum() == 4  # floor and ceiling are in no view
    assert np.mean([d.view.map.known.mean() for d in done.views]) > 0.95
    np.testing.assert_allclose(np.linalg.det(done.planes.directions), 1)


def attic(noise: float) -> tuple[list[DepthView], list[np.ndarray]]:
    """Views of a room under a roof of 45 degrees whose slopes alone have depth, and (H, W) bool bare floor of each."""
    s = np.sqrt(0.5)
    normal = np.array([[0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1], [-s, -s, 0], [s, -s, 0]])
    offset = -np.array([0, 2, 2, 2.5, 2.5, 2.5 * s, 2.5 * s])
    rng, views, floors = np.random.default_rng(0), [], []
    for turn, pitch in product(range(0, 360, 45), (-15, 10)):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("yx", [turn, pitch], degrees=True).as_matrix()
        pose[:3, 3] = 0.5 * (turn // 45 % 3 - 1), 1.2, 0.8 * (turn // 45 % 2 - 0.5)
        camera = Camera(f"v{turn}_{pitch}", "train", 80, 60, 50.0, 50.0, 40.0, 30.0, pose)
        towards = DepthView(camera, around()[0].map, np.ones((60, 80, 3), np.float32)).rays @ normal.T
        far = np.where(towards < -1e-9, (offset - normal @ camera.center) / np.minimum(towards, -1e-9), np.inf)
        side, depth = far.argmin(axis=-1), far.min(axis=-1)
        depth += noise * depth**2 * rng.standard_normal(depth.shape)
        grey = np.repeat((0.3 + 0.05 * side)[..., None], 3, axis=-1).astype(np.float32)
        found = DepthMap(depth.astype(np.float32), np.ones((60, 80), np.float32), normal[side].astype(np.float32))
        view = DepthView(camera, found, grey)
        bare = (side < 5) & (np.sort(np.abs(view.points @ normal.T - offset), axis=-1)[..., 1] > 0.3)
        views.append(view.without(bare))
        floors.append(bare & (side == 0))
    return views, floors


def test_slopes_of_a_roof_are_not_the_rooms_directions():
    views, floors = attic(NOISE)
    done = complete(views, DepthNoise(NOISE, 0.0))
    np.testing.assert_allclose(done.planes.directions, np.eye(3), atol=0.02)
    known = [(each.view.map.known & ~each.closed)[bare] for each, bare in zip(done.views, floors, strict=True)]
    assert np.concatenate(known).mean() > 0.95


def test_cameras_that_are_held_in_many_ways_have_no_mean_up():
    turn = Rotation.from_euler("xyz", (20.0, 60.0, -40.0), degrees=True).as_matrix()
    views = [turned_world(painted(view).without(inner(view)), turn) for view in around(NOISE)]
    rolled = [turned_image(view, number % 3) for number, view in enumerate(views)]
    directions = complete(rolled, DepthNoise(NOISE, 0.0)).planes.directions
    np.testing.assert_allclose(np.sort(np.abs(directions @ turn), axis=1), [[0, 0, 1]] * 3, atol=0.02)


@pytest.mark.parametrize(
    ("pans", "pitch", "roll"),
    [((-60, 0, 60), -30, 0), ((-90, -30, 30, 90), -35, 0), ((50, 70, 90), -10, 90), ((30, 60, 90), 0, -90)],
)
def test_a_turned_room_has_its_directions_however_upright_cameras_are_held(pans, pitch, roll):
    """Views that look down from one side, and photographs in portrait: their y axes have a mean that is not upright."""
    poses = np.tile(np.eye(4), (len(pans), 1, 1))
    poses[:, :3, :3] = [Rotation.from_euler("YXZ", (pan, pitch, roll), degrees=True).as_matrix() for pan in pans]
    cameras = [Camera("v", "train", 80, 60, 50.0, 50.0, 40.0, 30.0, pose) for pose in poses]
    up = _mean_up([replace(around()[0], camera=camera) for camera in cameras])
    room = Rotation.from_euler("y", 30, degrees=True).as_matrix().T
    np.testing.assert_allclose(np.abs(_leading(room, np.array([4.0, 3.0, 4.0]), up)), np.abs(room), atol=1e-6)


def test_directions_far_from_the_worlds_axes_stay():
    turn = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    views = [turned_world(view, turn) for view in around(NOISE)]
    np.testing.assert_allclose(sharpened(turn.T, views), turn.T, atol=0.003)


def test_an_emitter_inherits_no_plane():
    true = [painted(view, lamp=True) for view in around()]
    views = [view.without(inner(view)) for view in true]
    done = complete(views, DepthNoise(NOISE, 0.0)).views
    bright = np.concatenate([(view.radiance[..., 0] > 1).ravel() for view in true])
    assert bright.sum() > 100
    assert np.concatenate([d.closed.ravel() for d in done])[bright].mean() > 0.95


def test_what_another_view_sees_through_is_not_completed():
    # two views from one place know the rim of a wall that is nearer than the room's: a plane that both show
    front = painted(view_of_cube("front", (0.0, 0.0, 0.0), 0.0))
    bare = np.zeros((60, 80), bool)
    bare[15:45, 20:60] = True
    depth = np.full((60, 80), 0.8, np.float32)
    normal = np.broadcast_to(np.float32([0, 0, 1]), (60, 80, 3)).copy()
    rim = front.with_map(DepthMap(depth, front.map.confidence, normal)).without(bare)
    grey = DepthView(rim.camera, rim.map, np.full((60, 80, 3), 0.4, np.float32))
    side = painted(view_of_cube("side", (1.2, 0.0, 0.6), 0.5))

    def filled(*others: DepthView) -> np.ndarray:
        done = complete([grey, grey, *others], DepthNoise(NOISE, 0.0)).views
        depth = done[0].view.map.depth[20:40, 25:55]  # beyond superpixels that hold some of the rim
        return np.abs(depth - 0.8) < 0.01

    assert filled(side.without(np.ones((60, 80), bool))).all()
    assert not filled(side).any()


@pytest.mark.parametrize(
    ("point", "holds"),
    [((0.0, 0.0, 0.0), True), ((1.05, 0.0, 0.0), True), ((1.2, 0.0, 0.0), False), ((0.0, 0.0, -3.2), False)],
    ids=["inside", "within tolerance", "outside", "below"],
)
def test_a_box_holds_what_lies_inside_along_its_directions(point, holds):
    turn = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    box = RoomBox(turn, np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0]), np.full((2, 3), np.nan))
    assert box.holds(np.array([point, (0.0, 0.0, 0.0)]) @ turn, 0.1) == holds


def test_a_wall_is_where_most_surface_faces_the_room_within_the_other_walls():
    # windows in the wall z = -HALF show a niche 0.3 m behind it, whose ceiling is lower than the room's
    def with_niche(view: DepthView) -> DepthView:
        points = view.points
        pane = (points[..., 2] < 0.01 - HALF) & (np.abs(points[..., :2]) < 0.8).all(axis=-1)
        depth = np.where(
            pane, view.map.depth * (HALF + 0.3 + view.camera.center[2]) / (HALF + view.camera.center[2]), 0
        )
        return view.with_map(DepthMap(np.where(pane, depth, view.map.depth), view.map.confidence, view.map.normal))

    found = find_box([with_niche(view) for view in around()], np.eye(3))
    assert found.walls[0, 2] == pytest.approx(-HALF, abs=0.01)
    assert found.low[2] == pytest.approx(-HALF - 0.3, abs=0.02)


def test_walls_that_no_plane_is_are_planes_too():
    views = [painted(view) for view in around(NOISE)]
    planes = find_room_planes(views, [superpixels(view.radiance) for view in views], NOISE)
    walls = [(0, 0, -HALF), (0, 1, -HALF), (1, 0, HALF), (1, 2, HALF)]  # the floor is in no view, four walls are
    more = planes.with_faces(walls, 0.02)
    assert len(more) == len(planes) + 1
    np.testing.assert_array_equal(more.normal[-1], planes.directions[1])
    assert (more.offset[-1], more.axis[-1]) == (-HALF, 1)
    assert more.with_faces(walls, 0.02) is more
    faces = more.among([(0, 1, -HALF), (1, 2, HALF + 0.1)], 0.02)
    np.testing.assert_array_equal(np.flatnonzero(faces), [len(planes)])


def test_panes_go_on_over_a_wall_only_where_another_view_knows_of_them():
    # the box ends at panes 0.3 m behind the wall z = -HALF
    half, behind = np.full(3, HALF), np.array([HALF, HALF, HALF + 0.3])
    box = RoomBox(np.eye(3), -behind, half, np.array([-half, half]))
    view = painted(view_of_cube("front", (0.0, 0.0, 0.0), 0.0))
    bare = view.without(np.ones((60, 80), bool))
    row, column = (values.ravel() for values in np.mgrid[25:35, 35:45])

    def possible(place: float, *others: DepthView) -> bool:
        slopes, alike = np.array([[0.0, 0.0, -1 / place]]), np.ones((1, 1), bool)
        seen = OtherViews.of([bare, *others])
        return PossiblePlanes(0, bare, slopes, [(row, column)], alike, seen, box, NOISE)(0, 0)

    deep = view.with_map(DepthMap(np.full((60, 80), HALF + 0.3, np.float32), view.map.confidence, view.map.normal))
    assert possible(HALF)
    assert not possible(HALF + 0.3)
    assert possible(HALF + 0.3, deep)
    assert not possible(HALF + 0.6, deep)  # outside the box


def test_what_nothing_tells_shows_the_nearest_wall_that_no_view_sees_through():
    true = around()[0]
    bare = true.without(np.ones((60, 80), bool))
    half = np.full(3, HALF)
    walls = np.array([-half, half])
    walls[0, 2] = -1.0  # nearer than the true one, which is the box's face
    box = RoomBox(np.eye(3), -half, half, walls)
    alone = closed(bare, 0, OtherViews.of([bare]), box, NOISE).map
    wall = true.points[..., 2] < 0.01 - HALF
    np.testing.assert_allclose((true.camera.center + true.rays * alone.depth[..., None])[wall][:, 2], -1.0, atol=1e-5)
    # two views that know what lies behind it
    found = closed(bare, 0, OtherViews.of([bare, true, true]), box, NOISE).map
    np.testing.assert_allclose(found.depth, true.map.depth, atol=0.01)
    np.testing.assert_allclose(found.normal, true.map.normal, atol=1e-6)
    assert 0 < found.confidence.max() < 0.01
    walls[0, 2] = np.nan  # the box ends there, but nobody saw a wall
    open_side = closed(bare, 0, OtherViews.of([bare, true, true]), RoomBox(np.eye(3), -half, half, walls), NOISE).map
    np.testing.assert_array_equal(open_side.known, ~wall)


def test_no_light_leaves_a_shell(backend):
    turn = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    box = RoomBox(turn, np.array([-1.0, -2.0, -3.0]), np.array([1.0, 2.0, 3.0]), np.full((2, 3), np.nan))
    mesh = with_shell(Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), box, 0.02)
    way = np.random.default_rng(0).standard_normal((500, 3))
    way = (way / np.linalg.norm(way, axis=1, keepdims=True)).astype(np.float32)
    far, triangle = RayScene(mesh).intersect(np.zeros(3), way)
    assert np.isfinite(far).all()
    assert ((mesh.normals[triangle] * way).sum(axis=1) < 0).all()
    away = np.abs((far[:, None] * way) @ turn.T) - [1.0, 2.0, 3.0]
    np.testing.assert_allclose(away.max(axis=1), 0.04, atol=1e-4)


def test_parts_of_a_wall_that_noise_turns_apart_are_joined_when_they_are_straight():
    front = painted(view_of_cube("front", (0.0, 0.0, 0.0), 0.0))
    # a ridge in the middle: each half errs by 5 mm, the plane of one lies 2 cm off the other
    depth = HALF - 0.012 * (np.abs(front.points[..., 0]) - 0.6)
    wall = front.without(front.points[..., 2] > 0.01 - HALF)
    bent = wall.with_map(DepthMap(np.where(wall.map.known, depth, 0), wall.map.confidence, wall.map.normal))
    planes = find_room_planes([bent, bent], [superpixels(front.radiance)] * 2, NOISE)
    assert len(planes) == 1
    assert planes.area[0] > 0.95 * 2.4 * 1.8
    np.testing.assert_allclose(planes.offset, -HALF, atol=0.003)


def test_confidence_that_means_nothing_is_told():
    good = around(0.001)
    doubtful = [
        view_of_cube(view.camera.name, tuple(view.camera.center), i * np.pi / 4, 0.02) for i, view in enumerate(good)
    ]
    views = []
    for view, other in zip(good, doubtful, strict=True):
        left = np.arange(80) < 40
        low = np.where(left[None, :], 0.3, 0.9) * np.ones((60, 80))
        depth = np.where(left, other.map.depth, view.map.depth)
        views.append(view.with_map(DepthMap(depth.astype(np.float32), low.astype(np.float32), view.map.normal)))
    noise = depth_noise(views)
    assert 0.3 < noise.confident <= 0.9
    assert noise.at_1m < 0.004


def test_superpixels_end_at_edges():
    image = np.full((60, 80, 3), 0.2, np.float32)
    image[:, 40:] = 0.3
    image[20:30, 10:20] = 5.0
    pieces = superpixels(image)
    for part in (np.s_[:, 40:], np.s_[20:30, 10:20]):
        inside = np.zeros((60, 80), bool)
        inside[part] = True
        count = np.bincount(pieces.label.ravel())
        share = np.bincount(pieces.label.ravel(), inside.ravel()) / count
        assert (np.minimum(share, 1 - share) * count).sum() < 0.05 * inside.sum()
    assert pieces.contrast.max() > 2


TABLE = 0.75 - HALF
"""Height of a table's top above the floor of the cube, which is at -HALF."""


def above_a_table(angle: float, floor: float) -> DepthView:
    """A view down onto a table in the cube; of the floor beside it a share of the pixels is known."""
    back = np.array([np.cos(angle), 0.9, np.sin(angle)])
    place = 0.9 * back / np.abs(back).max() * (HALF - 0.1)
    back /= np.linalg.norm(back)
    right = np.cross([0, 1, 0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.column_stack([right, np.cross(back, right), back]), place
    view = cube_through(Camera(f"d{angle:.2f}", "train", 80, 60, 50.0, 50.0, 40.0, 30.0, pose))
    points, normal = view.points, view.map.normal
    share = (TABLE - place[1]) / (points[..., 1] - place[1])
    crossing = place + share[..., None] * (points - place)
    top = (share > 0) & (share < 1) & (np.abs(crossing[..., [0, 2]]) < 0.6).all(axis=-1)
    lost = ~top & (np.random.default_rng(0).random(top.shape) > floor)
    found = DepthMap(
        np.where(top, view.map.depth * share, view.map.depth).astype(np.float32),
        view.map.confidence,
        np.where(top[..., None], [0.0, 1.0, 0.0], normal).astype(np.float32),
    )
    return view.with_map(found).without(lost & (normal[..., 1] > 0.9))


def test_a_table_is_no_floor_but_a_face_inside_the_room():
    views = [*around(), *(above_a_table(angle, 0.2) for angle in np.arange(6))]
    found = find_box(views, np.eye(3))
    assert found.walls[0, 1] == pytest.approx(-HALF, abs=0.01)
    ((side, axis, place),) = found.inner
    assert (side, axis) == (0, 1)
    assert place == pytest.approx(TABLE, abs=0.01)
    assert [place for side, axis, place in found.faces if (side, axis) == (0, 1)] == pytest.approx(
        [-HALF, TABLE], abs=0.01
    )


def test_a_table_is_no_floor_where_none_is_known():
    views = [*around(), *(above_a_table(angle, 0.0) for angle in np.arange(6))]
    found = find_box(views, np.eye(3))
    assert np.isnan(found.walls[0, 1])
    assert [place for _, _, place in found.inner] == pytest.approx([TABLE], abs=0.01)


def test_scatter_above_a_table_is_no_floor():
    def scattered(view: DepthView) -> DepthView:
        # patches of 5 x 5 pixels at heights of their own above the table, all facing up
        rng = np.random.default_rng(len(view.camera.name))
        depth, normal = view.map.depth.copy(), view.map.normal.copy()
        height = view.points[..., 1]
        for row, column in rng.integers(0, [55, 75], (30, 2)):
            own = (slice(row, row + 5), slice(column, column + 5))
            place = view.camera.center[1]
            good = view.map.known[own] & (height[own] < TABLE + 0.01)
            share = (rng.uniform(TABLE + 0.05, 0.0) - place) / np.where(good, height[own] - place, -1.0)
            depth[own] = np.where(good, depth[own] * share, depth[own])
            normal[own] = np.where(good[..., None], [0.0, 1.0, 0.0], normal[own])
        return view.with_map(DepthMap(depth, view.map.confidence, normal))

    views = [*around(), *(scattered(above_a_table(angle, 0.0)) for angle in np.arange(6))]
    found = find_box(views, np.eye(3))
    assert np.isnan(found.walls[0, 1])
    assert [place for _, _, place in found.inner] == pytest.approx([TABLE], abs=0.01)


def test_a_garden_behind_a_window_beside_a_corner_takes_no_wall():
    def with_garden(view: DepthView) -> DepthView:
        # a window in the wall x = -HALF, up to the corner with z = HALF: what it shows lies beyond that wall, too
        points, center = view.points, view.camera.center
        pane = (points[..., 0] < 0.01 - HALF) & (points[..., 2] > HALF - 0.8) & (np.abs(points[..., 1]) < 0.9)
        far = np.random.default_rng(len(view.camera.name)).uniform(1, 6, pane.shape)
        share = (HALF + far + center[0]) / (HALF + center[0])
        return view.with_map(
            DepthMap(
                np.where(pane, view.map.depth * share, view.map.depth).astype(np.float32),
                view.map.confidence,
                view.map.normal,
            )
        )

    views = [with_garden(view) for view in around()]
    outside = np.mean([(np.abs(view.points) > HALF + 0.1).any(axis=-1).mean() for view in views])
    assert outside > 0.06
    found = find_box(views, np.eye(3))
    np.testing.assert_allclose(found.walls[:, [0, 2]], [[-HALF] * 2, [HALF] * 2], atol=0.01)


def test_doubtful_depth_takes_a_face_of_the_room_s_box():
    views = [*around(), *(above_a_table(angle, 0.05) for angle in np.arange(6))]
    rng = np.random.default_rng(1)

    def doubted(view: DepthView) -> DepthView:
        top = np.abs(view.points[..., 1] - TABLE) < 0.01
        known = rng.random(top.shape) < 0.4  # half of these are anywhere
        depth = view.map.depth * np.where(rng.random(top.shape) < 0.5, 1.0, rng.uniform(0.7, 1.3, top.shape))
        some = DepthMap(
            np.where(top, depth, view.map.depth).astype(np.float32),
            np.where(top, 1e-6, view.map.confidence).astype(np.float32),
            view.map.normal,
        )
        return view.with_map(some).without(top & ~known)

    def bright(view: DepthView, top: np.ndarray) -> DepthView:
        shown = painted(view)
        return DepthView(view.camera, view.map, np.where(top[..., None], 0.9, shown.radiance).astype(np.float32))

    shown = [bright(doubted(view), np.abs(view.points[..., 1] - TABLE) < 0.01) for view in views]
    true = views[len(around()) :]
    done = complete(shown, DepthNoise(NOISE, 1e-4)).views[len(around()) :]
    right, count = 0, 0
    for before, after in zip(true, done, strict=True):
        top = np.abs(before.points[..., 1] - TABLE) < 0.01
        right += int((np.abs(after.view.map.depth - before.map.depth)[top] < 0.02).sum())
        count += int(top.sum())
    assert right > 0.7 * count  # without faces half of the known ones are, a fifth of all
