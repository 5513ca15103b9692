"""Which sides of emitters shine: rooms of one emitter, of which pixels see what is said."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters
from fipt.scene.mesh import Mesh
from fipt.stages.emitters.sides import emitting_sides, faces
from tests import scenes

L = np.float32([4, 3, 2])
"""Radiance of the emitters."""


def pane(cells=4, y=2.0) -> Mesh:
    """A square metre of small triangles that faces down."""
    step = 1 / cells
    return scenes.joined(
        *(
            scenes.emitter_quad((a * step, (a + 1) * step), y, (b * step, (b + 1) * step))
            for a, b in np.ndindex(cells, cells)
        )
    )


def of(trimesh_mesh) -> Mesh:
    return Mesh(np.float32(trimesh_mesh.vertices), np.int32(trimesh_mesh.faces))


def looks(mesh, side, triangle=None, radiance=L, weight=1.0, footprint=0.1):
    """A pixel on each of these triangles (all), from one side, and what it shows."""
    triangle = np.arange(len(mesh.triangles)) if triangle is None else np.asarray(triangle)
    normal = mesh.normals[triangle] * (1 if side == FRONT else -1)
    image = np.tile(np.float32(radiance), (len(triangle), 1))
    return triangle, normal, image, np.full((len(triangle), 2), (weight, footprint))


def sides(mesh, *pixels, triangles=None):
    """Sides of an emitter of all triangles, or of these, that the pixels tell."""
    triangle, normal, image, size = (np.concatenate(rows) for rows in zip(*pixels, strict=True))
    position, (weight, footprint) = mesh.corners[triangle].mean(axis=1), np.float32(size).T
    samples = scenes.samples_of(position, triangle, weight, normal=normal, footprint=footprint)
    shading = np.zeros((len(triangle), SHADING_OUTPUTS, 3), np.float16)
    shards = scenes.observed([samples], [shading], [(image, np.ones(len(triangle), np.float32))])
    own = np.arange(len(mesh.triangles)) if triangles is None else np.asarray(triangles)
    found = Emitters.plain(mesh, own, np.tile(L, (len(own), 1)), 0 * own)
    result = emitting_sides(mesh, found, shards)
    assert result.dtype == np.int8
    return result


@pytest.mark.parametrize("side", [FRONT, BACK])
def test_a_pane_shines_to_where_it_is_seen_from(side):
    mesh = pane()
    np.testing.assert_array_equal(sides(mesh, looks(mesh, side)), side)
    # the winding may change from triangle to triangle, and half of the pane be hidden behind a plant
    odd = replace(mesh, triangles=np.where(np.arange(32)[:, None] % 3 == 0, mesh.triangles[:, ::-1], mesh.triangles))
    pixels = looks(mesh, side, np.arange(16))
    same = (odd.normals * mesh.normals).sum(axis=1) > 0
    np.testing.assert_array_equal(sides(odd, pixels), np.where(same, side, BACK + FRONT - side))


def test_a_pane_that_is_seen_from_both_sides():
    mesh = pane()
    front = looks(mesh, FRONT)
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK)), BOTH)
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK, radiance=0.6 * L)), BOTH)
    # a screen has a housing; a few pixels that see the back are enough
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK, np.arange(4), radiance=0.3 * L)), FRONT)
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK, np.arange(4))), BOTH)
    # what is dimmer than the rest of its emitter shines all the same
    np.testing.assert_array_equal(sides(mesh, looks(mesh, FRONT, radiance=0.3 * L)), FRONT)


def test_noise_of_a_scan_is_no_other_side(np_rng):
    """A triangle in fifty is turned over, and so is what grazing views see of some more, in slivers of pixels."""
    mesh = pane(16)
    noise = np_rng.choice(512, 10, replace=False)
    front = looks(mesh, FRONT, np.setdiff1d(np.arange(512), noise))
    grazing = looks(mesh, BACK, np_rng.choice(512, 60, replace=False), footprint=0.005)
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK, noise), grazing), FRONT)


def test_the_far_side_of_a_globe_shines():
    globe = of(trimesh.creation.icosphere(2, 0.3))
    near = np.flatnonzero(globe.normals[:, 0] > 0.1)
    np.testing.assert_array_equal(sides(globe, looks(globe, FRONT, near)), FRONT)
    np.testing.assert_array_equal(sides(scenes.turned(globe), looks(scenes.turned(globe), BACK, near)), BACK)
    # one whose far half has vertices of its own, between the others': no edge joins the halves
    cut = globe.vertices + np.where(globe.vertices[:, :1] < 0, np.float32([-1e-3, 0, 0]), 0)
    far = np.flatnonzero(globe.corners[:, :, 0].mean(axis=1) < 0)
    halves = scenes.joined(
        Mesh(globe.vertices, np.delete(globe.triangles, far, axis=0)), Mesh(cut, globe.triangles[far])
    )
    seen = np.flatnonzero(halves.normals[:, 0] > 0.1)
    np.testing.assert_array_equal(sides(halves, looks(halves, FRONT, seen)), FRONT)


def test_a_lampshade_shines_inside_where_that_is_seen():
    whole = of(trimesh.creation.cylinder(0.2, 0.3, sections=24).subdivide())
    shade = Mesh(whole.vertices, whole.triangles[np.abs(whole.normals[:, 2]) < 0.5])
    outside = looks(shade, FRONT, np.flatnonzero(shade.normals[:, 0] > 0.1))
    np.testing.assert_array_equal(sides(shade, outside), FRONT)
    inside = looks(shade, BACK, np.flatnonzero(shade.normals[:, 0] < -0.8))
    np.testing.assert_array_equal(sides(shade, outside, inside), BOTH)


@pytest.mark.parametrize("turned", [False, True])
def test_of_two_panes_back_to_back_the_far_one_is_dark(turned):
    """They lie in one place, and share their rims."""
    near = pane()
    mesh = scenes.joined(near, scenes.turned(near) if turned else near)
    result = sides(mesh, looks(mesh, FRONT, np.arange(32)))
    np.testing.assert_array_equal(result, np.repeat([FRONT, BACK if turned else FRONT], 32))
    # rays meet now one, now the other
    both = sides(mesh, looks(mesh, FRONT, np.arange(32)), looks(mesh, BACK if turned else FRONT, np.arange(32, 64)))
    np.testing.assert_array_equal(both, result)


def test_the_housing_of_a_flat_box_is_not_folded():
    box = scenes.turned(scenes.box((0, 0, 0), (0.6, 0.05, 0.6)))
    assert len(np.unique(faces(box, np.arange(12)))) == 2
    np.testing.assert_array_equal(sides(box, looks(box, FRONT, [4, 5])), FRONT)


def test_what_fills_no_pixel_shines_to_where_it_is_seen_from():
    mesh = pane()
    np.testing.assert_array_equal(sides(mesh, looks(mesh, FRONT, weight=0.2, radiance=0.1 * L)), FRONT)


def test_edges_of_three_triangles_end_a_face():
    """A shelf that stands on a pane joins neither of its sides."""
    floor, shelf = scenes.quad((0, 0, 0), (1, 0, 0), (0, 0, 1)), scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    more = scenes.quad((0, 0, 0), (1, 0, 0), (0, 0, -1))
    numbers = faces(scenes.joined(floor, shelf, more), np.arange(6))
    assert len(np.unique(numbers)) == 6


def test_no_emitter_has_no_side():
    mesh = pane()
    assert sides(mesh, looks(mesh, FRONT), triangles=np.zeros(0, int)).shape == (0,)
