"""Round lamps that a mesh lacks: a room of six walls, in which a ball hangs that its mesh has, or has not."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fipt.meshing.bright_spots import Spots, bright_spots
from fipt.meshing.missing_emitters import MissingEmitter, _Meeting, missing_emitters, with_spheres
from fipt.meshing.spot_meetings import meetings
from fipt.render.scene import RayScene
from fipt.scene.mesh import Mesh
from tests.lit_ball import (
    CENTER,
    HEIGHT,
    OVER,
    PLACES,
    RADIUS,
    WALLS,
    WIDTH,
    ball,
    box,
    cameras,
    of,
    shown,
    with_shining,
)

pytestmark = pytest.mark.usefixtures("backend")


@pytest.mark.parametrize("radius", [0.12, 0.06, 0.02])
def test_a_ball_that_the_mesh_lacks_is_found(radius: float) -> None:
    true, shining = with_shining(WALLS, ball(radius=radius))
    views = cameras()
    (found,) = missing_emitters(WALLS, views, shown(true, shining, views))
    np.testing.assert_allclose(found.center, CENTER, atol=0.01)
    assert found.views >= 4  # in the nearest view the largest one is no spot any more
    # a ball that fills less than a pixel seems larger and dimmer; that of a few is measured
    assert radius * 0.9 < found.radius < (radius * 1.1 if radius > 0.03 else radius * 1.5)


def test_what_the_mesh_has_is_not_added() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras()
    assert missing_emitters(true, views, shown(true, shining, views)) == []


def test_two_views_are_too_few() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras(places=PLACES[:2])
    assert missing_emitters(WALLS, views, shown(true, shining, views)) == []


def test_a_ball_that_only_reflects_is_none() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras()
    radiance = shown(true, shining, views, level=2.4)  # eight times the walls: white before dark paint
    assert missing_emitters(WALLS, views, radiance) == []


def test_an_opening_through_which_light_is_seen_is_none() -> None:
    lamp = box((0.3, 0.3, 0.3), (2.1, 1.6, 1.1))
    hood = trimesh.creation.annulus(0.06, 0.4, 0.02)
    hood.apply_translation((2.1, 1.6, 1.4))
    mesh, shining = with_shining(WALLS, of(hood), lamp)
    views = cameras(places=[(1.2, 1.2, 2.7), (3.0, 1.5, 2.6), (2.0, 2.2, 2.8), (2.3, 1.0, 2.8)])
    radiance = shown(mesh, shining, views)
    assert max(radiance(view.name)[0].max() for view in views) > 10  # it is seen
    assert missing_emitters(mesh, views, radiance) == []


GAP = np.array([2.1, 1.6, 1.0])
BEFORE = [(1.8, 1.4, 2.8), (2.5, 1.5, 2.8), (2.0, 1.9, 2.8), (2.3, 1.3, 2.8), (2.1, 1.6, 2.0)]


def screen(hole: float, outer: float) -> Mesh:
    """An upright ring around a place before the wall that the cameras face."""
    made = trimesh.creation.annulus(hole, outer, 0.01)
    made.apply_translation(GAP)
    return of(made)


@pytest.mark.parametrize("hole", [0.06, 0.1])
def test_a_gap_in_something_that_the_mesh_lacks_before_a_window_is_none(hole: float) -> None:
    window = box((1.6, 1.6, 0.02), (2.1, 1.6, 0.02))
    true, shining = with_shining(WALLS, screen(hole, 0.99), window)
    views = cameras(toward=GAP, places=BEFORE)
    # two views from beside the screen show the window, and not the gap
    others = cameras(toward=np.array([2.1, 1.6, -0.9]), places=[(0.3, 1.6, 0.5), (3.8, 1.5, 0.5)])
    others = [replace(view, name=f"side_{view.name}") for view in others]
    radiance = shown(true, shining, [*views, *others])
    assert missing_emitters(with_shining(WALLS, window)[0], [*views, *others], radiance) == []


def test_a_hole_of_the_mesh_through_which_a_lamp_is_seen_is_none() -> None:
    # nobody else sees what lies behind: the rim alone tells
    lamp = box((1.6, 1.6, 0.02), (2.1, 1.6, 0.02))
    mesh, shining = with_shining(WALLS, screen(0.06, 0.99), lamp)
    views = cameras(toward=GAP, places=BEFORE)
    assert missing_emitters(mesh, views, shown(mesh, shining, views)) == []


def test_a_thing_in_the_sun_that_the_mesh_lacks_is_none() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.08))
    views = cameras()
    scene = RayScene(true)
    sun = np.array([0.3, 0.9, 0.3]) / np.linalg.norm([0.3, 0.9, 0.3])
    images = {}
    for view in views:
        rows, columns = (np.mgrid[: HEIGHT * OVER, : WIDTH * OVER] + 0.5) / OVER
        _, triangle = scene.intersect(view.center.astype(np.float32), view.directions(columns, rows).reshape(-1, 3))
        lit = 0.5 + 20 * np.maximum(scene.normals[triangle] @ sun, 0)
        fine = np.where(shining[triangle], lit, 0.3).reshape(HEIGHT, OVER, WIDTH, OVER).mean(axis=(1, 3))
        images[view.name] = np.repeat(fine[..., None], 3, axis=2), np.ones((HEIGHT, WIDTH))
    assert missing_emitters(WALLS, views, images.__getitem__) == []


def test_intensities_in_two_groups_are_no_lamp() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras(places=[*PLACES, (3.4, 0.8, 1.5)])
    radiance = shown(true, shining, views)
    brighter = {view.name for view in views[::2]}
    assert len(missing_emitters(WALLS, views, radiance)) == 1
    found = missing_emitters(
        WALLS, views, lambda name: (radiance(name)[0] * (1.7 if name in brighter else 1.0), radiance(name)[1])
    )
    assert found == []


def test_a_lamp_that_hardly_lights_the_room_is_none() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.012))
    views = cameras()
    assert len(missing_emitters(WALLS, views, shown(true, shining, views, level=300.0))) == 1
    assert missing_emitters(WALLS, views, shown(true, shining, views, level=9.0)) == []


def test_no_camera_stands_in_a_lamp() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.12))
    views = cameras()
    within = replace(views[0], name="train_9", world_from_camera=views[0].world_from_camera.copy())
    within.world_from_camera[:3, 3] = CENTER + 0.02
    radiance = shown(true, shining, views)
    dark = np.full((HEIGHT, WIDTH, 3), 0.3), np.ones((HEIGHT, WIDTH))
    found = missing_emitters(WALLS, [*views, within], lambda name: dark if name == "train_9" else radiance(name))
    assert found == []


def test_masked_pixels_show_no_spots() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras()
    radiance = shown(true, shining, views)

    def masked(name: str):
        image, valid = radiance(name)
        around = image[..., 0] < 0.9 * image.max()
        return image, np.where(around & (np.random.default_rng(0).random(valid.shape) < 0.5), 0.0, valid)

    assert missing_emitters(WALLS, views, masked) == []


def test_the_sky_through_a_hole_of_the_mesh_is_none() -> None:
    hole = np.arange(len(WALLS.triangles)) == 0
    mesh = Mesh(WALLS.vertices, WALLS.triangles[~hole])
    # what shines hangs before the hole, in all views
    middle = WALLS.corners[0].mean(axis=0)
    views = cameras(toward=middle, places=[(2.0, 1.5, 1.5), (1.6, 1.2, 1.3), (2.2, 1.8, 1.7), (1.9, 1.0, 1.9)])
    assert missing_emitters(mesh, views, shown(mesh, np.zeros(len(mesh.triangles), bool), views)) == []


def test_a_lamp_that_other_views_deny_is_none() -> None:
    true, shining = with_shining(WALLS, ball())
    views = cameras()
    lit, dark = shown(true, shining, views), shown(WALLS, np.zeros(12, bool), views)
    seen = {view.name for view in views[:3]}
    assert missing_emitters(WALLS, views, lambda name: lit(name) if name in seen else dark(name)) == []


BLUR = 0.04


def scraps(radius: float, blur: float = BLUR) -> Mesh:
    """What fusion leaves of a ball: half of its triangles, displaced by up to half of ``blur``."""
    whole = ball(radius=radius)
    rng = np.random.default_rng(3)
    kept = whole.triangles[rng.random(len(whole.triangles)) < 0.5]
    away = 1 + rng.uniform(-0.5, 0.5, (len(whole.vertices), 1)) * blur / radius
    return Mesh((CENTER + (whole.vertices - CENTER) * away).astype(np.float32), kept)


@pytest.mark.parametrize("radius", [0.02, 0.05])
def test_scraps_of_a_lamp_are_replaced(radius: float) -> None:
    true, shining = with_shining(WALLS, ball(radius=radius))
    views, mesh = cameras(), with_shining(WALLS, scraps(radius))[0]
    radiance = shown(true, shining, views)
    assert missing_emitters(mesh, views, radiance) == [], "a modeller has a lamp whole, or not at all"
    (found,) = missing_emitters(mesh, views, radiance, BLUR)
    np.testing.assert_allclose(found.center, CENTER, atol=0.01)
    done = with_spheres(mesh, [found])
    np.testing.assert_array_equal(done.triangles[:12], WALLS.triangles)
    assert len(done.triangles) == 12 + 320


def test_a_lamp_that_fusion_resolves_stays() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.12))
    views, mesh = cameras(), with_shining(WALLS, scraps(0.12))[0]
    assert missing_emitters(mesh, views, shown(true, shining, views), BLUR) == []


def test_scraps_on_a_board_stay() -> None:
    """What is round about them is as near: a spot in a ceiling, or a highlight."""
    board = trimesh.creation.box((0.5, 0.5, 0.01)).subdivide_to_size(0.03)
    board = of(board.apply_translation(CENTER + np.array([0, 0, 0.05])))
    true, shining = with_shining(WALLS, board, ball(radius=0.03))
    views = [view for view in cameras() if view.center[2] < CENTER[2]]
    mesh = with_shining(WALLS, board, scraps(0.03))[0]
    assert len(views) >= 3
    assert missing_emitters(mesh, views, shown(true, shining, views), 0.1) == []


def test_scraps_in_a_wide_shade_stay() -> None:
    """What seems to be a bulb may be the lit inside of the shade."""
    shade = trimesh.creation.cylinder(0.11, 0.12, sections=64)
    shade.update_faces(np.abs(shade.face_normals[:, 2]) < 0.5)
    shade.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    shade = of(shade.apply_translation(CENTER))
    true, shining = with_shining(WALLS, shade, ball(radius=0.03))
    below = [(1.4, 0.4, 1.0), (2.8, 0.4, 1.1), (1.6, 0.3, 1.9), (2.6, 0.3, 1.9), (2.1, 0.3, 1.4)]
    views, mesh = cameras(places=below), with_shining(WALLS, shade, scraps(0.03))[0]
    assert missing_emitters(mesh, views, shown(true, shining, views), BLUR) == []


def test_a_shade_is_no_scrap() -> None:
    """It is larger than what shines in it, and hides it from above."""
    shade = trimesh.creation.icosphere(4, 0.08)
    shade.update_faces(shade.triangles_center[:, 1] > 0)
    shade.apply_translation(CENTER)
    true, shining = with_shining(WALLS, of(shade), ball(radius=0.02))
    below = [(0.4, 0.5, 0.4), (3.6, 0.6, 0.5), (0.5, 0.4, 2.6), (3.5, 0.5, 2.5), (2.0, 0.3, 0.4)]
    views, mesh = cameras(places=below), with_shining(WALLS, of(shade), scraps(0.02))[0]
    for lamp in missing_emitters(mesh, views, shown(true, shining, views), 0.06):
        own = with_spheres(mesh, [lamp]).triangles[12 : 12 + len(shade.faces)]
        np.testing.assert_array_equal(own, mesh.triangles[12 : 12 + len(shade.faces)])


def test_few_scraps_before_which_rays_pass_are_taken_out_as_well() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.05))
    views, few = cameras(), scraps(0.05)
    mesh = with_shining(WALLS, Mesh(few.vertices, few.triangles[::5]))[0]
    (found,) = missing_emitters(mesh, views, shown(true, shining, views), BLUR)
    assert len(with_spheres(mesh, [found]).triangles) == 12 + 320


def test_scraps_keep_their_distance_to_what_reaches_farther() -> None:
    """A triangle of a wall has its middle near the lamp, and its corners do not."""
    corners = CENTER + np.array([[-1, 0.05, -1], [1, 0.05, -1], [0, 0.05, 2.0]])
    wall = Mesh(corners.astype(np.float32), np.array([[0, 1, 2]], np.int32))
    mesh = with_shining(WALLS, wall, scraps(0.05))[0]
    done = with_spheres(mesh, [MissingEmitter(CENTER, 0.05, 3, 0.09)])
    np.testing.assert_array_equal(done.triangles[:13], mesh.triangles[:13])
    assert len(done.triangles) == 13 + 320


def test_noise_of_the_brightest_pixel_makes_no_lamp_smaller() -> None:
    true, shining = with_shining(WALLS, ball(radius=0.12))
    views = cameras()
    radiance = shown(true, shining, views)

    def noisy(name: str):
        image, weight = radiance(name)
        if name == views[0].name:
            image = image.copy()
            image[np.unravel_index(image[..., 0].argmax(), image.shape[:2])] *= 1.5
        return image, weight

    (found,) = missing_emitters(WALLS, views, noisy)
    assert found.radius == pytest.approx(0.12, rel=0.1)


@pytest.mark.parametrize(
    ("radius", "known", "count"),
    [(0.06, 3, 4), (0.067, 3, 3), (0.06, 2, 2)],
    ids=["of their kind", "brighter by a quarter", "of two known ones"],
)
def test_two_views_are_enough_for_a_lamp_of_a_known_kind(radius: float, known: int, count: int) -> None:
    """Three lamps are seen by all views, a fourth by two: what the others show there has no weight."""
    others = [CENTER + np.array(offset) for offset in ((-0.5, 0.3, -0.2), (0.4, 0.4, 0.2), (0.1, -0.4, 0.3))[:known]]
    true, _ = with_shining(WALLS, *[ball(center) for center in others], ball(radius=radius))
    views = cameras()
    radiance = shown(true, np.arange(len(true.triangles)) >= 12, views)

    def masked(name: str):
        image, weight = radiance(name)
        view = next(view for view in views if view.name == name)
        (column, row), _ = (own[0] for own in view.project(CENTER[None]))
        rows, columns = np.mgrid[:HEIGHT, :WIDTH]
        near = (np.abs(rows - row) < 6) & (np.abs(columns - column) < 6)
        return image, weight * ~(near & (view not in views[:2]))

    found = missing_emitters(WALLS, views, masked)
    assert len(found) == count
    assert sum(own.views == 2 for own in found) == count - known


def test_lamps_of_one_kind_have_one_size() -> None:
    """Of one that fills no pixel the others tell how bright it is."""
    far = CENTER + np.array([0.5, 0.3, 0.2])
    true, _ = with_shining(WALLS, ball(radius=0.06), ball(far, 0.06))
    views = cameras()
    radiance = shown(true, np.arange(len(true.triangles)) >= 12, views)
    places = [_Meeting.of(own, RayScene(WALLS)) for own in meetings(Spots.joined(spots_of(views, radiance)))]
    blurred = replace(places[1], peak=0.5 * places[1].peak, resolved=False)
    assert len(places) == 2
    assert blurred.radius > 1.3 * places[1].radius
    assert blurred.like_others([places[0], blurred]).radius == pytest.approx(places[0].radius, rel=0.1)
    for other in (replace(blurred, intensity=0.5 * blurred.intensity), replace(blurred, peak=3 * places[1].peak)):
        assert other.like_others([places[0], other]) is other


def spots_of(views, radiance) -> list[Spots]:
    return [bright_spots(view, *radiance(view.name), index, 100) for index, view in enumerate(views)]


def test_part_of_a_lamp_is_no_other_lamp(monkeypatch: pytest.MonkeyPatch) -> None:
    true, shining = with_shining(WALLS, ball(radius=0.05))
    views = cameras()
    radiance = shown(true, shining, views)
    (whole,) = missing_emitters(WALLS, views, radiance)

    def twice(spots: Spots) -> list[Spots]:
        """Views of which something hides two fifths of the lamp meet in the same place."""
        met = meetings(spots)
        return [replace(own, irradiance=0.6 * own.irradiance) for own in met] + met

    monkeypatch.setattr("fipt.meshing.missing_emitters.meetings", twice)
    (found,) = missing_emitters(WALLS, views, radiance)
    assert found.radius == whole.radius


@pytest.mark.parametrize(("factor", "count"), [(0.5, 1), (3.0, 0)], ids=["something hides a part", "it differs"])
def test_where_scraps_are_a_view_may_show_less_light(factor: float, count: int) -> None:
    true, shining = with_shining(WALLS, ball(radius=0.05))
    views, mesh = cameras(), with_shining(WALLS, scraps(0.05))[0]
    radiance = shown(true, shining, views)

    def changed(name: str):
        image, weight = radiance(name)
        odd = name in {views[-1].name, views[-2].name}
        return np.where(odd & (image > 1), factor * image, image), weight

    found = missing_emitters(mesh, views, changed, BLUR)
    assert len(found) == count
    for own in found:
        np.testing.assert_allclose(own.center, CENTER, atol=0.01)


def test_spheres_have_the_cross_section_of_round_ones() -> None:
    mesh = with_spheres(WALLS, [MissingEmitter(CENTER, RADIUS, 3), MissingEmitter(CENTER + 1, 2 * RADIUS, 3)])
    added = mesh.areas[len(WALLS.triangles) :]
    assert added.sum() / 4 == pytest.approx(np.pi * 5 * RADIUS**2, rel=1e-4)
    outward = mesh.corners[len(WALLS.triangles) :].mean(axis=1)[:10] - CENTER
    assert ((outward * mesh.normals[len(WALLS.triangles) :][:10]).sum(axis=1) > 0).all()
