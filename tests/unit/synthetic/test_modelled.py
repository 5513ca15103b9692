"""A modelled room: one mesh, tiled textures, cameras in open space only, light from lamps and from outside."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.scene.cameras import Camera
from fipt.scene.environment import constant
from fipt.scene.setup import RelightSetup
from fipt.synthetic import poses
from fipt.synthetic.room import assemble
from fipt.synthetic.settings import SynthesizeSettings
from tests import modelled as scene

SETTINGS = SynthesizeSettings(train_views=5, val_views=2, width=32, height=24, spp=16, max_depth=4, denoise=False)


@pytest.fixture(scope="module")
def modelled(backend):
    from fipt.synthetic import modelled

    return modelled


@pytest.fixture(scope="module")
def views(backend):
    from fipt.synthetic import views

    return views


@pytest.fixture(scope="module")
def room(modelled):
    return modelled.room_of(scene.content(), "room.xml")


@pytest.fixture(scope="module")
def space(room, views):
    return poses.OpenSpace(room, views.Truth(room).intersect, 0)


@pytest.fixture(scope="module")
def cameras(space):
    return poses.sample_cameras(space, SETTINGS)


def down(places):
    origins = np.float32(places)
    return origins, np.tile(np.float32([0, -1, 0]), (len(origins), 1))


def test_a_part_for_each_surface_and_a_semantic_id_for_each_material(room):
    content = scene.content()
    assert list(room.parts) == [s.name for s in content.surfaces]
    assert list(room.semantics) == ["paint", "tiles", "steel"]
    start = 0
    for index, s in enumerate(content.surfaces):
        mine = slice(start, start + len(s.triangles))
        np.testing.assert_array_equal(room.mesh.corners[mine], s.vertices[s.triangles])
        np.testing.assert_array_equal(room.uv[room.mesh.triangles[mine]], s.uv[s.triangles])
        assert set(room.part[mine]) == {index + 1}
        assert set(room.semantic[mine]) == {s.material + 1}
        start = mine.stop
    assert start == len(room.mesh.triangles)
    described = room.description()
    assert described["notes"] == ["made in code"]
    assert described["materials"][1]["base_color"] == "texture of 2x2"
    assert described["materials"][2]["roughness"] == pytest.approx(0.3)
    (lamp,) = described["emitters"]
    assert (lamp["part"], lamp["area"]) == ("lamp", pytest.approx(0.16))
    np.testing.assert_array_equal(lamp["triangles"], np.flatnonzero(room.emits))


def test_lamps_are_told_apart_by_their_part():
    """Two lamps side by side, a dark piece between others: indices by increasing triangle."""
    from fipt.synthetic.room import RoomPiece

    triangle = {"vertices": np.eye(3), "triangles": np.array([[0, 1, 2]]), "uv": np.zeros((3, 2))}
    light = [None, (1, 1, 1), (1, 1, 1), None, (0, 0, 2)]
    pieces = [RoomPiece(f"p{k}", **triangle, material=0, semantic=0, radiance=value) for k, value in enumerate(light)]
    room = assemble(pieces, [scene.constant("a", (0.5, 0.5, 0.5))], ["a"], np.array([[0, 0, 0], [1, 1, 1]]))
    assert [lamp.tolist() for lamp in room.emitters] == [[1], [2], [4]]
    with pytest.raises(FiptError, match="65535 parts"):
        assemble(pieces[:1] * 65_536, [], ["a"], room.box)


def test_textures_repeat(room, views):
    """The floor's colour and roughness, looked up by hand, are the same a tile further."""
    tile = scene.TILE
    places = [
        (2.0 + tile * (u + i), 0.5, 2.0 + tile * (v + i)) for i in (0, 1) for u in (0.25, 0.5) for v in (0.25, 0.75)
    ]
    found = views.Truth(room).trace(*down(places))
    assert {room.parts[i - 1] for i in found["part"]} == {"floor"}
    color, roughness = scene.checks().base_color, scene.checks().roughness
    by_hand = [color[0, 0], color[1, 0], (color[0, 0] + color[0, 1]) / 2, (color[1, 0] + color[1, 1]) / 2]
    np.testing.assert_allclose(found["base_color"], by_hand * 2, atol=1e-4)
    np.testing.assert_allclose(
        found["roughness"], [roughness[0, 0]] * 2 + [0.4] * 2 + [roughness[0, 0]] * 2 + [0.4] * 2, atol=1e-4
    )


def test_truth_of_a_pixel_is_the_mean_over_it(room, views):
    """A pixel that holds one whole tile has the tile's mean colour and roughness."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]  # looking down
    pose[:3, 3] = (2.6, 2.2, 2.4)
    step = scene.TILE / 2.2
    camera = Camera("down", "val", 1, 1, 1 / step, 1 / step, 0.5, 0.5, pose)
    layers = views.view_truth(views.Truth(room), camera).layers
    np.testing.assert_allclose(layers["base_color"][0, 0], scene.checks().base_color.mean(axis=(0, 1)), atol=1e-3)
    np.testing.assert_allclose(layers["roughness.Y"][0, 0], 0.4, atol=1e-3)


def test_lamps_shine_to_their_front_only(room, views):
    truth = views.Truth(room)
    below, above = np.float32([[2.0, 1.5, 2.0]]), np.float32([[2.0, 2.5, 2.0]])
    up = np.float32([[0, 1, 0]])
    front, back = truth.trace(below, up), truth.trace(above, -up)
    lamp = room.parts.index("lamp") + 1
    assert (front["part"][0], back["part"][0]) == (lamp, lamp)
    np.testing.assert_allclose(front["emission"][0], scene.LAMP)
    for found in (front, back):
        assert not found["base_color"].any()
        assert (found["roughness"][0], found["metallic"][0]) == (1, 0)
    assert not back["emission"].any()


# --- cameras ----------------------------------------------------------------------------------


def test_cameras_stand_in_the_room_and_not_in_its_hollows(cameras, space):
    """The house around the room and the cupboard are free space of their own: nobody stands there."""
    places = np.concatenate([[c.center for c in cameras], space.places])
    assert (places > poses.CLEARANCE - 0.04).all()
    assert (places < scene.SIZE - poses.CLEARANCE + 0.04).all()
    low, high = scene.CUPBOARD
    assert not ((places > low) & (places < high)).all(axis=1).any()
    for hollow in (scene.CUPBOARD.mean(axis=0), (-0.5, 1.3, 1.7)):
        assert not space.holds(np.array(hollow))
    assert space.holds(np.array([2.5, 1.2, 2.0]))
    assert all(0.5 <= c.center[1] <= 2.3 for c in cameras)


def test_no_view_stares_at_a_wall(cameras, space):
    for camera in cameras:
        assert np.median(poses.scan(camera, space.intersect)[0]) >= space.depth


def test_small_rooms_have_shorter_views(views, modelled):
    content = scene.content()
    small = [replace(s, vertices=s.vertices * np.float32([0.5, 1, 0.5])) for s in content.surfaces]
    room = modelled.room_of(replace(content, surfaces=small, box=content.box * np.float32([0.5, 1, 0.5])), "small.xml")
    narrow = poses.OpenSpace(room, views.Truth(room).intersect, 0)
    assert narrow.depth == pytest.approx(0.3 * np.hypot(3.0, 2.75))
    assert len(poses.sample_cameras(narrow, SETTINGS)) == 7


def test_coverage_in_a_convex_room_is_the_share_in_the_frame(views, modelled, np_rng):
    """Nothing hides anything there: a place is seen where it projects into the picture."""
    content = scene.content()
    shell = replace(content, surfaces=content.surfaces[:6], box=np.float32([np.zeros(3), scene.SIZE]))
    room = modelled.room_of(shell, "shell.xml")
    empty = poses.OpenSpace(room, views.Truth(room).intersect, 0)
    cameras = poses.sample_cameras(empty, SETTINGS)[:2]
    x, y, z = scene.SIZE
    points = np_rng.random((60_000, 3)) * scene.SIZE
    axis = np_rng.choice(3, len(points), p=np.array([y * z, x * z, x * y]) / (y * z + x * z + x * y))
    points[np.arange(len(points)), axis] = np_rng.integers(2, size=len(points)) * scene.SIZE[axis]
    seen = np.zeros(len(points), int)
    for camera in cameras:
        image, depth = camera.project(points)
        seen += (depth > 0) & (np.abs(image / (camera.width, camera.height) - 0.5) < 0.5).all(axis=1)
    shown = poses.coverage(empty, cameras)
    assert shown["points"] > 19_900  # all of it is visible
    assert shown["seen"] == pytest.approx((seen >= 1).mean(), abs=0.012)
    assert shown["seen_twice"] == pytest.approx((seen == 2).mean(), abs=0.012)


def test_coverage_counts_what_open_space_sees(cameras, space):
    """The house's walls and the inside of the cupboard are not asked for."""
    shown = poses.coverage(space, cameras)
    assert 0 < shown["seen_twice"] < shown["seen"] <= 1
    assert 0.2 < shown["points"] / 20_000 < 0.7


def test_far_and_large_surfaces_cost_nothing(room, modelled):
    """A landscape of a kilometre around the room: as many points as without it."""
    from fipt.synthetic.shapes import panel

    content = scene.content()
    ground = scene.surface("landscape", panel((-500, -0.5, -500), (0, 0, 1000), (1000, 0, 0)), 0)
    wide = modelled.room_of(replace(content, surfaces=[*content.surfaces, ground]), "wide.xml")
    assert len(poses.surface_points(wide, 0)) == len(poses.surface_points(room, 0))


def test_a_room_in_a_wrong_unit_is_too_small(views, modelled):
    content = scene.content()
    small = [replace(s, vertices=s.vertices * np.float32(0.1)) for s in content.surfaces]
    room = modelled.room_of(replace(content, surfaces=small, box=content.box * np.float32(0.1)), "dm.xml")
    with pytest.raises(FiptError, match=r"interior is 0.60 x 0.26 x 0.55 m: too small for cameras"):
        poses.OpenSpace(room, views.Truth(room).intersect, 0)


def test_a_full_room_has_no_free_space(views, modelled):
    from fipt.synthetic.shapes import panel

    content = scene.content(window=True)
    boards = [
        scene.surface(f"board {k}", panel((0, 0.5 * k, 0), (0, 0, 3.5), (4, 0, 0)), 0) for k in range(1, 6)
    ]  # fmt: skip
    room = modelled.room_of(replace(content, surfaces=[*content.surfaces, *boards]), "store.xml")
    with pytest.raises(FiptError, match="no free space for cameras: of 8192 places"):
        poses.OpenSpace(room, views.Truth(room).intersect, 0)


def test_outdoors_is_said_in_one_line(views, modelled):
    content = scene.content()
    room = modelled.room_of(replace(content, surfaces=content.surfaces[:1]), "garden.xml")
    with pytest.raises(FiptError, match="is indoors"):
        poses.OpenSpace(room, views.Truth(room).intersect, 0)


# --- light ------------------------------------------------------------------------------------


def test_exposure_brings_the_median_to_where_it_belongs(room, cameras, modelled, views):
    factor = modelled.exposure_of(room, cameras[:5], SETTINGS)
    assert factor == modelled.exposure_of(room, cameras[:5], SETTINGS), "seeded"
    lit = room.exposed(factor)
    assert lit.exposure == factor
    np.testing.assert_allclose(lit.radiance[lit.emits], np.float32(scene.LAMP) * np.ones((2, 1)) * factor, rtol=1e-5)
    medians = [np.median(image @ np.array(LUMINANCE)) for _, image, _ in views.render_views(lit, cameras[:5], SETTINGS)]
    assert np.median(medians) == pytest.approx(modelled.MIDDLE, rel=0.15)


def test_a_room_that_no_light_reaches_is_refused(cameras, modelled):
    dark = modelled.room_of(scene.content(lamp=False), "dark.xml")
    with pytest.raises(FiptError, match="no light reaches"):
        modelled.exposure_of(dark, cameras[:2], SETTINGS)


def test_light_from_outside_enters_through_the_window(views, modelled):
    content = scene.content(window=True, environment=constant((3.0, 2.0, 1.0)), lamp=False)
    room = modelled.room_of(content, "open.xml").exposed(2.0)
    pose = np.eye(4)
    pose[:3, 3] = (2.0, 1.3, 2.5)  # towards the missing wall
    camera = Camera("out", "val", 32, 24, 24.0, 24.0, 16, 12, pose)
    ((_, image, known),) = views.render_views(room, [camera], SETTINGS)
    outside = known.ids["part"] == 0
    inner = np.zeros_like(outside)
    inner[8:16, 12:20] = True
    assert outside[inner].all()
    np.testing.assert_allclose(image[inner], np.broadcast_to((6.0, 4.0, 2.0), image[inner].shape), rtol=1e-5)
    assert (image[~outside].mean(axis=0) > 0.05).all()
    setup = RelightSetup(environment={"scale": 0.5})
    ((_, dim, _),) = views.render_views(room, [camera], SETTINGS, setup)
    np.testing.assert_allclose(dim, 0.5 * image, rtol=1e-4, atol=1e-6)
