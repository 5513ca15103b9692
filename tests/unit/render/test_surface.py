"""Lookups of the surface: voxels, triangles, emitters; and rays against the mesh."""

import numpy as np
import pytest

from fipt.scene.emitters import BACK, BOTH, FRONT
from tests import scenes


@pytest.fixture
def mi(backend):
    import mitsuba

    return mitsuba


def points_of(mi, array):
    return mi.Point3f(*(mi.Float(np.ascontiguousarray(c, np.float32)) for c in np.asarray(array).T))


def test_a_point_finds_its_voxel(mi, np_rng):
    from fipt.render.surface import SurfaceCache
    from fipt.stages.cache.build import voxel_keys

    voxels = scenes.grid(np_rng.random((512, 3)), resolution=8, side=4.0, center=(50.0, -3.0, 7.0))
    surface = SurfaceCache(voxels, voxels["radiance"], voxels["key"] % 3 > 0)
    p = np_rng.uniform(-2.6, 2.6, (2000, 3)) + voxels["center"]  # some outside: they take the nearest voxel
    record = surface.find(points_of(mi, p), mi.Vector3f(0, 0, 1), mi.Bool(True))
    keys = voxel_keys(np.float32(p), voxels["center"], 4.0, 8)
    np.testing.assert_array_equal(np.array(record), keys)
    radiance, rough, known = surface.lookup_radiance(record, mi.Bool(True))
    np.testing.assert_array_equal(np.array(radiance).T, voxels["radiance"][keys])
    np.testing.assert_array_equal(np.array(rough), 1)
    np.testing.assert_array_equal(np.array(known), keys % 3 > 0)


def test_a_point_finds_the_record_that_faces_its_way(mi, np_rng):
    """Where its voxel has none that does, it takes another."""
    from fipt.render.surface import SurfaceCache
    from fipt.stages.cache.build import facings

    voxels = scenes.grid()
    both = np.sort(np_rng.choice(8 * 6, 25, replace=False))
    voxels["key"], voxels["facing"] = both // 6, (both % 6).astype(np.uint8)
    surface = SurfaceCache(voxels, np.zeros((25, 3)), np.ones(25, bool))
    cell, normal = np_rng.integers(0, 8, 3000), np_rng.standard_normal((3000, 3)).astype(np.float32)
    record = np.array(
        surface.find(points_of(mi, voxels["point"][cell]), mi.Vector3f(points_of(mi, normal)), mi.Bool(True))
    )
    wanted = 6 * cell + facings(normal)
    there = np.isin(wanted, both)
    assert 0.3 < there.mean() < 0.7
    np.testing.assert_array_equal(both[record[there]], wanted[there])
    empty = ~np.isin(cell, both // 6)
    np.testing.assert_array_equal(record == 25, empty)
    np.testing.assert_array_equal(both[record[~empty]] // 6, cell[~empty])


def test_voxels_without_record_are_unknown_and_black(mi):
    from fipt.render.surface import SurfaceCache

    voxels = scenes.grid(5.0)
    voxels["key"], voxels["facing"] = voxels["key"][[2, 5]], voxels["facing"][[2, 5]]
    surface = SurfaceCache(voxels, voxels["radiance"][:2], np.array([True, True]))
    centers = scenes.grid()["point"]
    record = surface.find(points_of(mi, centers), mi.Vector3f(0, 0, 1), mi.Bool(True))
    radiance, _, known = surface.lookup_radiance(record, mi.Bool(True))
    np.testing.assert_array_equal(np.array(known), np.isin(np.arange(8), [2, 5]))
    np.testing.assert_array_equal(np.array(radiance)[0], np.where(np.isin(np.arange(8), [2, 5]), 5.0, 0.0))


def test_materials_of_voxels(mi):
    from fipt.render.surface import SurfaceCache

    voxels = scenes.grid()
    known = np.arange(8) < 4
    surface = SurfaceCache(voxels, voxels["radiance"], known, scenes.sides(voxels, scenes.METAL, scenes.GLOSSY))
    record = surface.find(points_of(mi, voxels["point"]), mi.Vector3f(0, 1, 0), mi.Bool(True))
    base, metallic = surface.lookup_material(record, mi.Bool(True))
    _, rough, is_known = surface.lookup_radiance(record, mi.Bool(True))
    left = voxels["point"][:, 0] < 0
    np.testing.assert_allclose(np.array(base).T[left], np.tile(scenes.METAL.base_color, (4, 1)))
    np.testing.assert_allclose(np.array(base).T[~left], np.tile(scenes.GLOSSY.base_color, (4, 1)))
    np.testing.assert_allclose(np.array(metallic), left)
    # the roughness is the same whether the radiance is known or not
    np.testing.assert_allclose(np.array(rough), np.where(left, scenes.METAL.roughness, scenes.GLOSSY.roughness))
    np.testing.assert_array_equal(np.array(is_known), known)


def test_triangles_know_their_normal_and_emitter(mi):
    from fipt.render.surface import EmitterSet, Triangles

    mesh = scenes.box((0, 0, 0), (1, 2, 3))
    colors = np.array([[1, 2, 3], [0, 0, 0], [4, 0, 0]], np.float32)
    triangles = Triangles(mesh, EmitterSet(np.array([7, 2, 11]), colors))
    assert triangles.has_emitters
    normal, number = triangles.lookup(mi.UInt32(np.arange(12)), mi.Bool(True))
    np.testing.assert_array_equal(np.array(normal).T, mesh.normals)
    number = np.array(number)
    assert np.flatnonzero(number).tolist() == [2, 7, 11]
    radiance, pdf = triangles.radiance(mi.UInt32(number[[7, 2, 11]] - 1), mi.Bool(True))
    np.testing.assert_array_equal(np.array(radiance).T, colors)  # triangle 2 is off, but an emitter
    power = mesh.areas[[7, 2, 11]] * colors.mean(axis=1)
    np.testing.assert_allclose(np.array(pdf), power / power.sum() / mesh.areas[[7, 2, 11]], rtol=1e-6)


def test_sides_of_emitters(mi):
    from fipt.render.surface import EmitterSet, Triangles

    lamps, sides = np.array([4, 2, 9, 7]), np.int8([FRONT, BACK, BOTH, BOTH])
    lit = EmitterSet(lamps, np.ones((4, 3), np.float32) * [[1], [1], [1], [0]], sides)
    triangles = Triangles(scenes.box((0, 0, 0), (1, 2, 3)), lit)
    _, number = triangles.lookup(mi.UInt32(np.repeat(lamps, 2)), mi.Bool(True))
    got = np.array(triangles.emits(number - 1, mi.Float([0.5, -0.5] * 4), mi.Bool(True)))
    np.testing.assert_array_equal(got, [1, 0, 0, 1, 1, 1, 0, 0])  # the last is off
    shown = lit.emitted(np.repeat(lamps, 2), np.arange(8) % 2 == 0)
    np.testing.assert_array_equal(shown[:, 0], got)
    np.testing.assert_array_equal(EmitterSet(lamps, lit.radiance).sides, BOTH)
    with pytest.raises(ValueError, match="sides is of 3 triangles, not of 4"):
        EmitterSet(lamps, lit.radiance, sides[:3])


@pytest.mark.parametrize("radiance", [np.zeros((0, 3)), np.zeros((2, 3))])
def test_without_light_there_are_no_emitters(backend, radiance):
    from fipt.render.surface import EmitterSet, Triangles

    mesh = scenes.box((0, 0, 0), (1, 1, 1))
    assert not Triangles(mesh, None).has_emitters
    assert not Triangles(mesh, EmitterSet(np.arange(len(radiance)), radiance)).has_emitters


# --- rays -----------------------------------------------------------------------------------------


def test_rays_find_distance_and_triangle(backend, np_rng):
    from fipt.render.scene import RayScene

    mesh = scenes.box((0, 0, 0), (1, 2, 3))
    d = np_rng.standard_normal((500, 3))
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    eye = np.array([0.4, 0.7, 1.1])
    distance, triangle = RayScene(mesh).intersect(eye, d)
    with np.errstate(divide="ignore"):
        t = np.where(d > 0, ([1, 2, 3] - eye) / d, -eye / d)
    np.testing.assert_allclose(distance, t.min(axis=1), rtol=1e-4)
    np.testing.assert_array_equal(triangle // 2, 2 * t.argmin(axis=1) + (d[np.arange(500), t.argmin(axis=1)] > 0))
    each, same = RayScene(mesh).intersect(np.tile(np.float32(eye), (500, 1)), d)
    np.testing.assert_array_equal(each, distance)
    np.testing.assert_array_equal(same, triangle)


def test_rays_that_miss(backend):
    from fipt.render.scene import RayScene

    distance, triangle = RayScene(scenes.floor()).intersect(np.array([0.0, 1, 0]), np.float32([[0, 1, 0], [0, -1, 0]]))
    np.testing.assert_array_equal(triangle >= 0, [False, True])
    assert np.isinf(distance[0])
    assert distance[1] == pytest.approx(1)


def test_epsilon_follows_the_size_of_the_scene(backend):
    from fipt.render.scene import RayScene

    small, large = (RayScene(scenes.box((5, 5, 5), (5 + s, 5 + s, 5 + s))).epsilon for s in (1.0, 10.0))
    assert large == pytest.approx(10 * small, rel=1e-5)


def test_arrays_of_another_shape_are_refused(backend):
    import mitsuba as mi

    from fipt.render.scene import vectors

    for wrong in (np.zeros(3), np.zeros((2, 4))):
        with pytest.raises(ValueError, match=r"must have shape \(N, 3\)"):
            vectors(wrong, mi.Vector3f)


def test_triangles_of_objects_have_records_of_their_own(backend):
    """Whatever voxel they lie in; the room's triangles go by voxel as before."""
    import mitsuba as mi

    from fipt.render.surface import SurfaceCache

    voxels = scenes.grid()
    room, things = (
        scenes.sides(voxels, scenes.METAL, scenes.GLOSSY),
        scenes.Records(
            np.float32([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]), np.float32([0.7, 0.8]), np.float32([0.25, 0.75])
        ),
    )
    known = np.ones(len(voxels["key"]), bool)
    plain = SurfaceCache(voxels, voxels["radiance"], known, room)
    surface = SurfaceCache(voxels, voxels["radiance"], known, room, things, first_object=12)
    p, n, active = mi.Point3f(0.5, [0.5, -0.5, 0.5, 0.5], 0.5), mi.Vector3f(0, 1, 0), mi.Bool(True)
    triangle = mi.UInt32([3, 11, 12, 13])
    record = surface.find(p, n, active, triangle)
    color, metallic = surface.lookup_material(record, active)
    _, roughness, is_known = surface.lookup_radiance(record, active)
    np.testing.assert_allclose(np.array(color).T[2:], things.base_color)
    np.testing.assert_allclose(np.array(metallic)[2:], things.metallic)
    np.testing.assert_allclose(np.array(roughness)[2:], things.roughness)
    np.testing.assert_array_equal(np.array(is_known), [True, True, False, False])
    np.testing.assert_array_equal(np.array(record)[:2], np.array(plain.find(p, n, active))[:2])


def test_emission_by_triangle(mi):
    from fipt.render.surface import EmitterSet

    emitters = np.array([9, 2, 5])
    lit = EmitterSet(emitters.astype(np.int32), np.float32(emitters[:, None] * [1, 2, 3]))
    seen = np.array([0, 2, 5, 9, 9, 100, 3])
    got = lit.emitted(seen, np.arange(7) > 3)
    np.testing.assert_array_equal(got, np.where(np.isin(seen, emitters), seen, 0)[:, None] * [1, 2, 3])
    assert got.dtype == np.float32
    nothing = EmitterSet(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))
    np.testing.assert_array_equal(nothing.emitted(seen, seen > 3), np.zeros((7, 3)))


def test_no_rays_meet_nothing(backend):
    from fipt.render.scene import RayScene

    distance, triangle = RayScene(scenes.floor()).intersect(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    assert len(distance) == len(triangle) == 0
