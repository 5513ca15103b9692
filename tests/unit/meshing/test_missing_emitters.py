"""Round lamps that a mesh lacks: a room of six walls, in which a ball hangs that its mesh has, or has not."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fipt.meshing.missing_emitters import MissingEmitter, missing_emitters, with_spheres
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


def test_spheres_have_the_cross_section_of_round_ones() -> None:
    mesh = with_spheres(WALLS, [MissingEmitter(CENTER, RADIUS, 3), MissingEmitter(CENTER + 1, 2 * RADIUS, 3)])
    added = mesh.areas[len(WALLS.triangles) :]
    assert added.sum() / 4 == pytest.approx(np.pi * 5 * RADIUS**2, rel=1e-4)
    outward = mesh.corners[len(WALLS.triangles) :].mean(axis=1)[:10] - CENTER
    assert ((outward * mesh.normals[len(WALLS.triangles) :][:10]).sum(axis=1) > 0).all()
