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


def sides(mesh, *pixels, triangles=None, emitter=0, clipped=False):
    """Sides of an emitter of all triangles, or of these, that the pixels tell; clipped are those that are dimmer."""
    triangle, normal, image, size = (np.concatenate(rows) for rows in zip(*pixels, strict=True))
    position, (weight, footprint) = mesh.corners[triangle].mean(axis=1), np.float32(size).T
    samples = scenes.samples_of(position, triangle, weight, normal=normal, footprint=footprint)
    shading = np.zeros((len(triangle), SHADING_OUTPUTS, 3), np.float16)
    dim = clipped & (image[:, 0] < L[0])
    shards = scenes.observed([samples], [shading], [(image, np.ones(len(triangle), np.float32))], [dim])
    own = np.arange(len(mesh.triangles)) if triangles is None else np.asarray(triangles)
    found = Emitters.plain(mesh, own, np.tile(L, (len(own), 1)), 0 * own + emitter)
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


def test_the_far_side_of_a_globe_shines(backend):
    globe = of(trimesh.creation.icosphere(2, 0.3))
    near = np.flatnonzero(globe.normals[:, 0] > 0.1)
    np.testing.assert_array_equal(sides(globe, looks(globe, FRONT, near)), FRONT)
    np.testing.assert_array_equal(sides(scenes.turned(globe), looks(scenes.turned(globe), BACK, near)), BACK)


@pytest.mark.parametrize("wound", [1, -1])
def test_the_far_part_of_a_globe_that_no_edge_joins_follows_as_a_whole(backend, wound, np_rng):
    """Of its triangles some face away from the nearest ones that are seen."""
    ball = trimesh.creation.icosphere(2, 0.3)
    whole = of(ball.apply_transform(trimesh.transformations.random_rotation_matrix(np_rng.random(3))))
    far = whole.corners[:, :, 0].mean(axis=1) < 0.1
    gap = np.float32([-1e-3, 0, 0])
    parts = Mesh(whole.vertices, whole.triangles[~far]), Mesh(whole.vertices + gap, whole.triangles[far][:, ::wound])
    globe, near = scenes.joined(*parts), np.arange(len(far)) < (~far).sum()
    assert len(np.unique(faces(globe, np.arange(len(far)), 0 * far))) == 4
    seen = looks(globe, FRONT, np.flatnonzero(near & (globe.normals[:, 0] > 0.5)))
    outside = np.where(near | (wound == 1), FRONT, BACK)
    np.testing.assert_array_equal(sides(globe, seen), outside)
    # slivers of it are seen beside a dark wall
    rim = looks(globe, FRONT if wound == 1 else BACK, np.flatnonzero(~near)[:20], weight=0.1, radiance=0.2 * L)
    np.testing.assert_array_equal(sides(globe, seen, rim), outside)


@pytest.mark.parametrize("wound", [1, -1])
def test_the_inside_of_a_globe_shines_through_its_hole(backend, wound):
    """A scan lacks its top; a bowl of less than a half of it is no globe, and a closed one has no hole."""
    whole = of(trimesh.creation.icosphere(3, 0.3))
    height = whole.corners[:, :, 2].mean(axis=1) / 0.3
    for top, expected in ((0.6, BOTH), (-0.1, FRONT), (1.1, FRONT)):
        globe = Mesh(whole.vertices, whole.triangles[height < top][:, ::wound])
        side = FRONT if wound == 1 else BACK
        result = sides(globe, looks(globe, side))
        np.testing.assert_array_equal(result, expected if expected == BOTH else side)


def test_the_inside_of_a_globe_is_dark_where_something_fills_its_hole(backend):
    """The base of a lamp, no part of the emitter, which lies within the box around it."""
    whole = of(trimesh.creation.icosphere(3, 0.3))
    globe = Mesh(whole.vertices, whole.triangles[whole.corners[:, :, 2].mean(axis=1) < 0.18])
    own = np.arange(len(globe.triangles))
    for height, expected in ((0.16, FRONT), (0.5, BOTH)):
        mesh = scenes.joined(globe, scenes.quad((-0.3, -0.3, height), (0.6, 0, 0), (0, 0.6, 0)))
        np.testing.assert_array_equal(sides(mesh, looks(mesh, FRONT, own), triangles=own), expected)


def test_a_lampshade_shines_inside_where_that_is_seen(backend):
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
    assert len(np.unique(faces(box, np.arange(12), np.zeros(12, int)))) == 2
    np.testing.assert_array_equal(sides(box, looks(box, FRONT, [4, 5])), FRONT)


def test_what_fills_no_pixel_shines_to_where_it_is_seen_from():
    mesh = pane()
    slats = looks(mesh, FRONT, weight=0.2, radiance=0.1 * L)
    np.testing.assert_array_equal(sides(mesh, slats), FRONT)
    np.testing.assert_array_equal(sides(mesh, slats, looks(mesh, BACK, weight=0.2, radiance=0.1 * L)), BOTH)


def test_a_housing_that_fills_no_pixel_is_dark():
    """Its front fills pixels: what little is seen of its back tells more than nothing."""
    mesh = pane()
    front = looks(mesh, FRONT)
    far = looks(mesh, BACK, weight=0.5, radiance=0.1 * L)
    np.testing.assert_array_equal(sides(mesh, front, far), FRONT)
    np.testing.assert_array_equal(sides(mesh, front, looks(mesh, BACK, weight=0.8, radiance=0.8 * L)), BOTH)
    # the less of a pixel it takes the less does that tell: a bright window stands beside it
    beside = looks(mesh, BACK, weight=0.1, radiance=2 * L)
    np.testing.assert_array_equal(sides(mesh, front, far, beside), FRONT)
    # where the housing fills pixels and the front does not, the front shines
    housing = looks(mesh, BACK, radiance=0.1 * L)
    np.testing.assert_array_equal(sides(mesh, housing, looks(mesh, FRONT, weight=0.3, radiance=0.3 * L)), FRONT)


def test_clipped_pixels_may_be_as_bright_as_the_emitter():
    mesh = pane()
    pixels = looks(mesh, FRONT), looks(mesh, BACK, radiance=0.4 * L)
    np.testing.assert_array_equal(sides(mesh, *pixels), FRONT)
    np.testing.assert_array_equal(sides(mesh, *pixels, clipped=True), BOTH)


def test_each_emitter_has_faces_of_its_own():
    """A small one beside a large one, with one edge in common, is seen from the other side."""
    large, small = scenes.emitter_quad((0, 1), 2, (0, 10)), scenes.emitter_quad((1, 1.03), 2, (0, 10))
    mesh = scenes.joined(large, small)
    pixels = looks(mesh, FRONT, [0, 1], footprint=2), looks(mesh, BACK, [2, 3])
    np.testing.assert_array_equal(sides(mesh, *pixels, emitter=np.array([0, 0, 1, 1])), [FRONT, FRONT, BACK, BACK])


def test_an_emitter_of_which_nothing_is_seen_shines_to_both_sides():
    mesh = scenes.joined(pane(1), pane(1, 2.5))
    result = sides(mesh, looks(mesh, FRONT, [0, 1]), emitter=np.array([0, 0, 1, 1]))
    np.testing.assert_array_equal(result, [FRONT, FRONT, BOTH, BOTH])


def test_edges_of_three_triangles_end_a_face():
    """A shelf that stands on a pane joins neither of its sides."""
    floor, shelf = scenes.quad((0, 0, 0), (1, 0, 0), (0, 0, 1)), scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    more = scenes.quad((0, 0, 0), (1, 0, 0), (0, 0, -1))
    numbers = faces(scenes.joined(floor, shelf, more), np.arange(6), np.zeros(6, int))
    assert len(np.unique(numbers)) == 6


def test_no_emitter_has_no_side():
    mesh = pane()
    assert sides(mesh, looks(mesh, FRONT), triangles=np.zeros(0, int)).shape == (0,)
