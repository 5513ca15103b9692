"""The path tracer against closed forms, white furnaces and Mitsuba's own integrator.

An estimate is repeated at many copies of one point, each with its own random numbers: their spread says how far the
mean may be off. With at most some hundred comparisons in a test, 4.5 standard errors leave a chance below 1e-3 that a
right program fails; seeds are fixed.
"""

from dataclasses import replace

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.model.albedo import specular_albedo
from fipt.scene.emitters import BACK, BOTH, FRONT
from fipt.scene.environment import NOTHING, EnvironmentMap, constant
from fipt.scene.sun import with_sun
from fipt.stages.shade.settings import BakeSettings
from fipt.synthetic.material import RoomMaterial
from tests import scenes

SIGMAS = 4.5
UP = (0.0, 1.0, 0.0)


def unit(v):
    return np.asarray(v, float) / np.linalg.norm(v)


def copies(position, normal, to_viewer, count, seed=0):
    """``count`` copies of a point to shade; or (count, 3) different ones."""
    from fipt.render.points import Points, random_keys

    arrays = [np.broadcast_to(np.float32(a), (count, 3)).copy() for a in (position, normal, to_viewer)]
    number = np.arange(count)
    return Points(*arrays, random_keys("test", number, np.zeros(count, int), seed))


def bake_shader(mesh, voxels, environment=NOTHING):
    from fipt.stages.shade.bake import cache_shader

    return cache_shader(mesh, voxels, True, environment)


def shader(lit, light_at_first=True, depth=1, sides=FRONT, environment=NOTHING, cache=None, surface=None):
    """A shader of paths through a scene; without ``cache`` no path ends in cached radiance."""
    from fipt.render.environment import sky_of
    from fipt.render.scene import RayScene
    from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    emitters = None
    if lit.triangle is not None:
        emitters = EmitterSet(lit.triangle, lit.radiance, np.broadcast_to(np.int8(sides), len(lit.triangle)))
    voxels = scenes.grid() if cache is None else cache
    known = np.full(len(voxels["key"]), cache is not None)
    materials = scenes.sides(voxels, *(surface or (scenes.DIFFUSE, scenes.DIFFUSE)))
    return Shader(
        RayScene(lit.mesh),
        Triangles(lit.mesh, emitters),
        SurfaceCache(voxels, voxels["radiance"], known, materials),
        PathSettings(depth, 0.6, light_at_first),
        sky_of(environment),
    )


def assert_mean(samples, expected, slack=0.0):
    """``samples`` (N, ...) have the mean ``expected`` within their standard error (and a share of slack)."""
    assert np.isfinite(samples).all()
    samples = samples.astype(np.float64)
    error = samples.std(axis=0) / np.sqrt(len(samples))
    away = np.abs(samples.mean(axis=0) - expected)
    assert (away <= SIGMAS * error + slack * np.abs(expected) + 1e-7).all(), (samples.mean(axis=0), expected, error)
    return error


def assert_same_mean(a, b):
    """Two estimators agree within their standard errors."""
    assert np.isfinite(a).all()
    assert np.isfinite(b).all()
    error = np.sqrt(a.var(axis=0, dtype=float) / len(a) + b.var(axis=0, dtype=float) / len(b))
    away = np.abs(a.mean(axis=0, dtype=float) - b.mean(axis=0, dtype=float))
    assert (away <= SIGMAS * error + 1e-5).all(), (away / error).max()
    return error / np.maximum(np.abs(a.mean(axis=0)), 1e-9)


# --- white furnace --------------------------------------------------------------------------------

LEVELS = len(ROUGHNESS_LEVELS)
COUNTS = [8] + [4] * LEVELS


def furnace_shading(cos, radiance=1.0):
    """(outputs, 3) that shading must be under constant light; Ls0 and Ls1 are their quadrature, not 1."""
    terms = np.array([specular_albedo(cos, s) for s in ROUGHNESS_LEVELS])
    return radiance * np.concatenate([[1.0], terms[:, 0], terms[:, 1]])[:, None] * np.ones(3)


def slanted(cos, normal=UP):
    """A direction at an angle to the normal."""
    side = unit(np.cross(normal, (0.3, 0.2, 0.9)))
    return cos * np.asarray(normal, float) + np.sqrt(1 - cos**2) * side


@pytest.mark.parametrize("cos", [0.95, 0.5, 0.2])
def test_furnace_of_the_bake(backend, cos):
    box = scenes.box((-1, -1, -1), (1, 1, 1))
    shade = bake_shader(box, scenes.grid()).shade
    got = shade(copies((0.2, -1, 0.3), UP, slanted(cos), 4000), ROUGHNESS_LEVELS, COUNTS)
    error = assert_mean(got, furnace_shading(cos), slack=1e-3)
    assert error[: 1 + LEVELS].max() < 0.02


@pytest.mark.parametrize("light_at_first", [True, False])
@pytest.mark.parametrize("sides", [FRONT, BOTH, [FRONT, BOTH] * 6, [BACK, FRONT] * 6])
def test_furnace_of_the_refinement_in_a_room_that_emits(backend, light_at_first, sides):
    """Walls that shine from their backs are wound the other way: the room is as bright."""
    box = scenes.box((-1, -1, -1), (1, 1, 1))
    back = np.broadcast_to(sides, 12) == BACK
    box = replace(box, triangles=np.where(back[:, None], box.triangles[:, ::-1], box.triangles))
    walls = scenes.Lit(box, np.arange(12), np.full((12, 3), 2.0, np.float32))
    shade = shader(walls, light_at_first, depth=3, sides=sides).shade
    got = shade(copies((0.2, -1, 0.3), UP, slanted(0.5), 4000), ROUGHNESS_LEVELS, COUNTS)
    error = assert_mean(got, furnace_shading(0.5, 2.0), slack=1e-3)
    assert error[: 1 + LEVELS].max() < 0.06


def test_furnace_of_the_refinement_that_ends_in_the_cache(backend):
    """Rough walls end in the cache at once, so that the light is the cache's."""
    walls = scenes.Lit(scenes.box((-1, -1, -1), (1, 1, 1)), None, None)
    shade = shader(walls, depth=5, cache=scenes.grid(1.0)).shade
    got = shade(copies((0.2, -1, 0.3), UP, slanted(0.7), 4000), ROUGHNESS_LEVELS, COUNTS)
    assert_mean(got, furnace_shading(0.7), slack=1e-3)


@pytest.mark.parametrize("surface", [scenes.GLOSSY, scenes.METAL])
def test_furnace_of_walls_that_reflect_once(backend, surface):
    """From the centre of a globe every wall is seen from its front: it reflects its albedo at normal incidence."""
    import trimesh

    globe = trimesh.creation.icosphere(4, 1.0)
    walls = scenes.Lit(scenes.Mesh(np.float32(globe.vertices), np.int32(globe.faces)), None, None)
    shade = shader(walls, depth=2, cache=scenes.grid(1.0), surface=(surface, surface)).shade
    got = shade(copies((0, 0, 0), UP, slanted(0.7), 6000), [0.5], [8, 8])
    a0, a1 = specular_albedo(1.0, surface.roughness)
    m, base = surface.metallic, np.array(surface.base_color)
    light = base * (1 - m) + (0.04 * (1 - m) + base * m) * a0 + a1
    terms = np.array([1.0, *specular_albedo(0.7, 0.5)])
    assert_mean(got, terms[:, None] * light, slack=2e-3)


# --- closed forms ---------------------------------------------------------------------------------

WEAK = ((-1.5, 1.0), (-1.0, 2.0))
TINY = ((1.6, 1.64), (0.5, 0.53))
"""Ranges in x and z of emitters; the tiny one, at a height of 0.9, hides nothing of the weak one at 1.2."""


@pytest.mark.parametrize("light_at_first", [True, False])
def test_rectangle_above_a_floor(backend, light_at_first):
    lit = scenes.two_planes((scenes.emitter_quad(WEAK[0], 1.2, WEAK[1]), (3.0, 2.0, 1.0)))
    expected = scenes.form_factor(WEAK[0], 1.2, WEAK[1]) * np.array([3.0, 2.0, 1.0])
    got = shader(lit, light_at_first).shade(copies((0, 0, 0), UP, slanted(0.8), 6000), [0.5], [8, 8])
    error = assert_mean(got[:, 0], expected, slack=2e-4)
    assert (error < 0.01 * expected).all()


def test_very_unequal_emitters(backend):
    """A tiny strong emitter beside a large weak one; each gives about as much light as the other."""
    strong, weak = np.array([20000.0, 15000.0, 5000.0]), np.array([0.5, 1.0, 2.0])
    emitters = [
        (scenes.emitter_quad(TINY[0], 0.9, TINY[1]), strong),
        (scenes.emitter_quad(WEAK[0], 1.2, WEAK[1]), weak),
    ]
    parts = [scenes.form_factor(TINY[0], 0.9, TINY[1]) * strong, scenes.form_factor(WEAK[0], 1.2, WEAK[1]) * weak]
    assert 0.2 < parts[0].mean() / parts[1].mean() < 5  # so that losing either would show
    got = shader(scenes.two_planes(*emitters)).shade(copies((0, 0, 0), UP, slanted(0.8), 8000), [0.5], [8, 8])
    error = assert_mean(got[:, 0], sum(parts), slack=5e-4)
    assert (error < 0.02 * sum(parts)).all()


@pytest.mark.parametrize("light_at_first", [True, False])
def test_back_of_an_emitter(backend, light_at_first):
    """An emitter that faces away is dark where its front alone shines, and shines where its back does."""
    above = scenes.turned(scenes.emitter_quad(WEAK[0], 1.2, WEAK[1]))
    lit = scenes.two_planes((above, (3.0, 2.0, 1.0)))
    points = copies((0, 0, 0), UP, slanted(0.8), 4000)
    assert not shader(lit, light_at_first).shade(points, [0.5], [8, 8]).any()
    expected = scenes.form_factor(WEAK[0], 1.2, WEAK[1]) * np.array([3.0, 2.0, 1.0])
    for sides in (BACK, BOTH):
        assert_mean(shader(lit, light_at_first, sides=sides).shade(points, [0.5], [8, 8])[:, 0], expected, slack=2e-4)


@pytest.mark.parametrize("light_at_first", [True, False])
def test_every_emitter_has_sides_of_its_own(backend, light_at_first):
    """Of two that face down one shines up, where nothing is: the other alone lights the floor."""
    strong, weak = np.array([20000.0, 15000.0, 5000.0]), np.array([0.5, 1.0, 2.0])
    up, down = scenes.emitter_quad(TINY[0], 0.9, TINY[1]), scenes.emitter_quad(WEAK[0], 1.2, WEAK[1])
    tracer = shader(scenes.two_planes((up, strong), (down, weak)), light_at_first, sides=[BACK, BACK, FRONT, FRONT])
    got = tracer.shade(copies((0, 0, 0), UP, slanted(0.8), 20000), [0.5], [8, 8])
    assert_mean(got[:, 0], scenes.form_factor(WEAK[0], 1.2, WEAK[1]) * weak, slack=5e-4)


def test_emitters_of_two_sides_are_emitters_of_either_side_together(backend):
    emitter = scenes.emitter_quad(WEAK[0], 1.2, WEAK[1])
    ceiling = scenes.turned(scenes.floor())
    dark = scenes.joined(scenes.floor(), scenes.Mesh(ceiling.vertices + np.float32([0, 2, 0]), ceiling.triangles))
    points = copies((2.0, 0, 0.1), UP, slanted(0.6), 6000)
    voxels, white = scenes.grid(side=20.0), (scenes.DIFFUSE, scenes.DIFFUSE)
    results = []
    for shape, sides in ((emitter, FRONT), (scenes.turned(emitter), FRONT), (emitter, BOTH)):
        lit = scenes.lit(dark, (shape, (3.0, 2.0, 1.0)))
        tracer = shader(lit, depth=2, sides=sides)
        tracer.cache = _unknown(voxels, white)
        results.append(tracer.shade(points, [0.5], [8, 8]))
    down, up, both = results
    assert up[:, 0].mean() > 0.02
    assert_same_mean(down + up, both)


def _unknown(voxels, surface):
    from fipt.render.surface import SurfaceCache

    return SurfaceCache(voxels, voxels["radiance"], np.zeros(len(voxels["key"]), bool), scenes.sides(voxels, *surface))


def test_rays_that_leave_the_mesh(backend):
    plain = scenes.Lit(scenes.floor(), None, None)
    points = copies((0, 0, 0), UP, slanted(0.5), 2000)
    assert not bake_shader(plain.mesh, scenes.grid()).shade(points, [0.5], [4, 4]).any()
    assert not shader(plain, depth=3).shade(points, [0.5], [4, 4]).any()
    sky = np.array([0.5, 1.0, 2.0])
    a0, a1 = specular_albedo(0.5, 0.5)
    for tracer in (
        shader(plain, depth=3, environment=constant(sky)),
        bake_shader(plain.mesh, scenes.grid(), constant(sky)),
    ):
        assert_mean(tracer.shade(points, [0.5], [4, 4]), np.array([1.0, a0, a1])[:, None] * sky, slack=1e-3)


def test_a_convex_object_under_constant_light_is_a_furnace(backend):
    """Whatever its material, nothing of it sees itself: Ld is the light, in maps of one texel and of many."""
    import trimesh

    ball = trimesh.creation.icosphere(3, 1.0)
    mesh = scenes.Mesh(np.float32(ball.vertices), np.int32(ball.faces))
    normal = unit((0.3, 0.5, -0.2))
    points = copies(normal, normal, unit(np.add(normal, (0.2, 0.1, 0.4))), 2000)
    light = np.array([0.5, 0.0, 2.0])
    many = EnvironmentMap("map", np.broadcast_to(np.float32(light), (8, 16, 3)).copy(), "z", 30.0)
    for sky in (constant(light), many):
        got = shader(scenes.Lit(mesh, None, None), depth=3, environment=sky).shade(points, [0.5], [8, 8])
        assert_mean(got[:, 0], light, slack=1e-3)


@pytest.mark.parametrize(("axis", "normal"), [("y", (0, 1, 0)), ("z", (0, 0, 1))])
def test_a_cap_of_the_sky_has_its_closed_form(backend, axis, normal):
    """Light from within 45 degrees of the zenith is half of all light on level ground."""
    radiance = np.zeros((512, 1024, 3), np.float32)
    radiance[:128] = [1, 2, 0]
    ground = scenes.floor() if axis == "y" else scenes.quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))
    sky = EnvironmentMap("given", radiance, axis)
    points = copies((0, 0, 0), normal, unit(np.add(normal, (0.3, 0.2, 0.1))), 4000)
    got = bake_shader(ground, scenes.grid(), sky).shade(points, [0.5], [16, 8])
    assert_mean(got[:, 0], np.array([0.5, 1, 0]), slack=4e-3)


def test_a_bright_texel_lights_what_faces_it(backend):
    """To the right of an unturned camera is the map's right half."""
    radiance = np.zeros((16, 32, 3), np.float32)
    radiance[7:9, 23:25] = 1  # on the horizon, along +x
    sky = EnvironmentMap("given", radiance)
    walls = scenes.Lit(scenes.floor(0.01), None, None)
    got = {
        normal: shader(walls, environment=sky).shade(copies((0, 1, 0), normal, normal, 4000), [0.5], [16, 8])[:, 0]
        for normal in ((1, 0, 0), (-1, 0, 0), (0, 0, -1))
    }
    # bilinear: the light is that of the texels' values times their solid angles, over pi
    light = 2 * 2 * (np.pi / 16) ** 2 / np.pi
    assert_mean(got[1, 0, 0], light, slack=0.03)
    assert not got[-1, 0, 0].any()
    assert got[0, 0, -1].mean() < 0.2 * light


@pytest.mark.parametrize("paths", [False, True])
def test_a_small_sun_is_found_by_few_rays(backend, paths):
    """Half a degree wide, it has a 30,000th of the directions, and most of the light."""
    toward, power = unit((0.5, 0.8, 0.2)), np.array([8.0, 4.0, 0.0])
    lit = with_sun(constant((0.2, 0.2, 0.2)), toward, power, np.radians(0.27), 512)
    points = copies((0, 0, 0), UP, unit((0.3, 1, 0.2)), 400)
    ground = scenes.floor()
    tracer = (
        shader(scenes.Lit(ground, None, None), environment=lit) if paths else bake_shader(ground, scenes.grid(), lit)
    )
    got = tracer.shade(points, [0.5], [16, 8])
    assert_mean(got[:, 0], 0.2 + power * toward[1] / np.pi, slack=4e-3)
    assert got[:, 0].std(axis=0).max() < 0.02
    glossy = got[:, 1] + got[:, 2]
    sunny = glossy - glossy[:, 2:]  # the sky alone is blue
    assert sunny[:, 0].mean() > 0.02 * power[0]
    np.testing.assert_allclose(sunny[:, 0], 2 * sunny[:, 1], rtol=1e-2)
    assert sunny[:, 0].std() < 0.02 * sunny[:, 0].mean()


@pytest.mark.parametrize("paths", [False, True])
@pytest.mark.parametrize(("radius", "roughness"), [(1.5, 0.02), (4.0, 0.02), (4.0, 0.12)])
def test_a_mirror_shows_the_sun_without_noise(backend, paths, radius, roughness):
    """Its lobe finds what rays to the sun hardly ever hit; a disc larger than the lobe is an even light."""
    toward = unit((0.5, 0.8, 0.2))
    lit = with_sun(constant((0.0, 0.0, 0.0)), toward, np.full(3, 50.0), np.radians(radius), 512)
    disc = lit.lookup(toward[None])[0]
    points = copies((0, 0, 0), UP, toward * (-1, 1, -1), 300)
    ground = scenes.floor()
    tracer = (
        shader(scenes.Lit(ground, None, None), environment=lit) if paths else bake_shader(ground, scenes.grid(), lit)
    )
    got = tracer.shade(points, [roughness], [16, 32])[:, 1:].sum(axis=1)
    assert (got.std(axis=0) < 0.15 * got.mean(axis=0)).all()
    if roughness < 0.1:
        expected = np.sum(specular_albedo(toward[1], roughness)) * disc
        np.testing.assert_allclose(got.mean(axis=0), expected, rtol=0.03)


def test_points_of_one_sample_share_its_directions(backend):
    """Four times one point with a quarter of the directions each is that point with all of them."""
    from fipt.render.points import Points

    points = copies(SPOTS[1][0], UP, unit(SPOTS[1][2]), 50)
    tracer = bake_shader(scenes.cornell().mesh, scenes.grid())
    four = Points(*(np.repeat(array, 4, axis=0) for array in vars(points).values()))
    one = tracer.shade(points, [0.3, 0.6], [16, 8, 4])
    np.testing.assert_allclose(tracer.shade(four, [0.3, 0.6], [16, 8, 4], per_sample=4), one, rtol=2e-4, atol=1e-6)


def test_a_sample_has_the_mean_of_its_points(backend):
    """One of two points looks at a wall that shines, the other away from it."""
    from fipt.render.points import Points

    lit = scenes.two_planes((scenes.emitter_quad(WEAK[0], 1.2, WEAK[1]), (3.0, 2.0, 1.0)))
    toward = copies((0, 0, 0), UP, unit((0.6, 0.8, 0)), 3000)
    normal, wo = toward.normal.copy(), toward.wo.copy()
    normal[1::2], wo[1::2] = -normal[1::2], -wo[1::2]
    points = Points(toward.position, normal, wo, np.repeat(toward.key[::2], 2))
    tracer = shader(lit)
    single = tracer.shade(toward, [0.5], [8, 8])
    assert single[:, 0].mean() > 0.01
    assert_mean(tracer.shade(points, [0.5], [16, 16], per_sample=2), single.mean(axis=0) / 2, slack=0.02)


def test_light_that_is_zero_changes_no_bit(backend):
    from fipt.render.environment import Sky

    points = copies(SPOTS[1][0], UP, unit(SPOTS[1][2]), 500)
    tracer = shader(scenes.cornell(), depth=4, surface=(scenes.METAL, scenes.GLOSSY))
    assert tracer.sky is None
    without = tracer.shade(points, [0.3], [3, 3])
    tracer.sky = Sky(constant((0, 0, 0)))
    np.testing.assert_array_equal(tracer.shade(points, [0.3], [3, 3]), without)


def test_voxels_without_record_are_dark(backend):
    voxels = scenes.grid(resolution=4)
    keep = voxels["point"][:, 1] < 0.5  # no record in the upper quarter
    voxels |= {name: voxels[name][keep] for name in ("key", "facing", "point", "radiance", "count")}
    voxels["source"] = np.arange(keep.sum())
    box = scenes.box((-1, -1, -1), (1, 1, 1))
    got = bake_shader(box, voxels).shade(copies((0, 0, 0), UP, UP, 4000), [0.5], [8, 8])
    # records lie below y = 0.525: what is seen above that is dark
    z = (-1.0, 1.0)
    ceiling = scenes.form_factor(z, 1.0, z)
    opening = scenes.form_factor(z, 0.525, z)
    assert ceiling < opening < 0.9
    assert_mean(got[:, 0], (1 - opening) * np.ones(3), slack=2e-3)


# --- Mitsuba --------------------------------------------------------------------------------------

SPOTS = [
    # position on the mesh, normal, direction to the viewer
    ((-0.8, -1.0, 0.5), UP, (0.4, 1.0, -0.3)),
    ((0.5, -1.0, -0.2), UP, (-0.5, 0.6, 0.5)),
    ((0.55, 0.1, -1.0), (0.0, 0.0, 1.0), (-0.6, 0.1, 0.8)),
    ((-1.0, -0.3, 0.2), (1.0, 0.0, 0.0), (0.9, 0.4, 0.2)),
]
REPEATS = 12_000


@pytest.fixture(scope="module")
def room():
    return scenes.cornell()


def reference(room, surface, depth, environment=NOTHING):
    """(SPOTS, REPEATS, 3) radiance along the directions to the viewer by Mitsuba's path integrator."""
    import mitsuba as mi

    from fipt.render import reference as mitsuba_scene
    from fipt.render.texels import DeviceMaps, MappedMesh

    dark = np.setdiff1d(np.arange(len(room.mesh.triangles)), room.triangle)
    corners = room.mesh.corners[dark]
    left = corners[..., 0].mean(axis=1) < 0
    mesh = scenes.Mesh(corners.reshape(-1, 3), np.arange(3 * len(dark), dtype=np.int32).reshape(-1, 3))
    materials = [
        RoomMaterial("", np.float32([[s.base_color]]), np.float32([[s.roughness]]), np.float32([[s.metallic]]))
        for s in surface
    ]
    uv = np.zeros((3 * len(dark), 2), np.float32)
    lights = [
        mitsuba_scene.EmittingMesh(scenes.Mesh(room.mesh.vertices, room.mesh.triangles[[t]]), color)
        for t, color in zip(room.triangle, room.radiance, strict=True)
    ]
    mapped = MappedMesh(mesh, uv, DeviceMaps(materials), np.where(left, 0, 1))
    scene = mitsuba_scene.load_scene(mapped, lights, environment)
    path = mi.load_dict({"type": "path", "max_depth": depth + 1, "rr_depth": 100})
    spots = np.repeat(np.arange(len(SPOTS)), REPEATS)
    wo = np.array([unit(v) for _, _, v in SPOTS])[spots]
    eye = np.array([p for p, _, _ in SPOTS])[spots] + 0.05 * wo
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(3, len(spots))
    as_columns = [[mi.Float(np.float32(c)) for c in a.T] for a in (eye, -wo)]
    ray = mi.RayDifferential3f(mi.Point3f(*as_columns[0]), mi.Vector3f(*as_columns[1]))
    return np.array(path.sample(scene, sampler, ray)[0]).T.reshape(len(SPOTS), REPEATS, 3)


def spot_points():
    spots = np.repeat(np.arange(len(SPOTS)), REPEATS)
    position, normal, wo = (np.array([spot[k] for spot in SPOTS])[spots] for k in range(3))
    return copies(position, normal, wo / np.linalg.norm(wo, axis=1, keepdims=True), len(spots))


def combined(shading, surface):
    """(SPOTS, REPEATS, 3) radiance of the spots from their three integrals."""
    shading = shading.reshape(len(SPOTS), REPEATS, 3, 3)
    result = np.empty((len(SPOTS), REPEATS, 3))
    for number, (position, _, _) in enumerate(SPOTS):
        s = surface[int(position[0] > 0)]
        base, m = np.array(s.base_color), s.metallic
        kd, ks = base * (1 - m), 0.04 * (1 - m) + base * m
        result[number] = kd * shading[number, :, 0] + ks * shading[number, :, 1] + shading[number, :, 2]
    return result


@pytest.mark.parametrize("depth", [1, 2, 32])
@pytest.mark.parametrize(
    "surface",
    [(scenes.DIFFUSE, scenes.GLOSSY), (scenes.METAL, replace(scenes.DIFFUSE, base_color=(0.2, 0.8, 0.8)))],
    ids=["diffuse and glossy", "metal and diffuse"],
)
def test_radiance_is_that_of_mitsuba(backend, room, surface, depth):
    expected = reference(room, surface, depth)
    roughness = np.repeat([surface[int(p[0] > 0)].roughness for p, _, _ in SPOTS], REPEATS).astype(np.float32)
    got = combined(shader(room, depth=depth, surface=surface).shade(spot_points(), [roughness], [4, 4]), surface)
    for ours, theirs in zip(got, expected, strict=True):
        assert theirs.mean() > 0.005
        assert assert_same_mean(ours, theirs).max() < 0.05


def test_long_paths_that_end_by_chance_lose_no_light(backend, monkeypatch):
    from fipt.render import tracer

    white = replace(scenes.DIFFUSE, base_color=(0.9, 0.9, 0.9))
    lit = scenes.Lit(scenes.box((-1, -1, -1), (1, 1, 1)), np.arange(2), np.ones((2, 3), np.float32))
    at = copies((0.2, -1, 0.3), UP, slanted(0.7), 20_000)

    def shaded(depth, roulette):
        monkeypatch.setattr(tracer, "_ROULETTE", roulette)
        return shader(lit, depth=depth, surface=(white, white)).shade(at, [0.5], [4, 4])

    by_chance, every = shaded(32, tracer._ROULETTE), shaded(32, 32)
    assert assert_same_mean(by_chance, every).max() < 0.02
    assert (by_chance != every).any()
    assert shaded(6, 32)[:, 0].mean() < 0.9 * every[:, 0].mean()


@pytest.mark.parametrize("depth", [1, 4])
def test_light_from_outside_is_that_of_mitsuba(backend, np_rng, depth):
    """Without its ceiling, the room is lit by an uneven sky too."""
    room = scenes.cornell()
    ceiling = (room.mesh.corners[..., 1] == 1).all(axis=1)
    moved = np.cumsum(~ceiling) - 1
    open_ = scenes.Lit(
        scenes.Mesh(room.mesh.vertices, room.mesh.triangles[~ceiling]),
        moved[room.triangle].astype(np.int32),
        room.radiance,
    )
    sky = EnvironmentMap("given", np_rng.uniform(0, 4, (6, 12, 3)).astype(np.float32) * [1, 0.5, 0], "y", 40.0)
    surface = (scenes.DIFFUSE, scenes.GLOSSY)
    expected = reference(open_, surface, depth, sky)
    roughness = np.repeat([surface[int(p[0] > 0)].roughness for p, _, _ in SPOTS], REPEATS).astype(np.float32)
    tracer = shader(open_, depth=depth, surface=surface, environment=sky)
    got = combined(tracer.shade(spot_points(), [roughness], [4, 4]), surface)
    dark = combined(shader(open_, depth=depth, surface=surface).shade(spot_points(), [roughness], [4, 4]), surface)
    for ours, theirs, without in zip(got, expected, dark, strict=True):
        assert_same_mean(ours, theirs)
        assert (ours.mean(axis=0)[:2] > 1.1 * without.mean(axis=0)[:2]).all()
        assert_same_mean(ours[:, 2:], without[:, 2:])  # no blue comes from outside


def test_light_sampling_at_the_first_hit_changes_the_noise_only(backend, room):
    surface = (scenes.METAL, scenes.GLOSSY)
    points = spot_points()
    a, b = (
        shader(room, light_at_first=on, depth=3, surface=surface).shade(points, [0.3], [8, 8]).reshape(4, REPEATS, -1)
        for on in (True, False)
    )
    for first, second in zip(a, b, strict=True):
        assert_same_mean(first, second)
    assert a.var(axis=1)[:, 0].sum() < 0.5 * b.var(axis=1)[:, 0].sum()


# --- sampling plans, random numbers ---------------------------------------------------------------


def test_shared_and_separate_sampling_agree(backend, np_rng):
    from fipt.stages.shade.integrate import shade_chunk

    voxels = scenes.grid(np_rng.uniform(0, 2, (64, 3)), resolution=4)
    tracer = bake_shader(scenes.box((-1, -1, -1), (1, 1, 1)), voxels)
    points = copies((0.2, -0.3, 0.3), UP, slanted(0.6), 3000)
    few = BakeSettings(diffuse_spp=8, specular_spp=6, smooth_spp=4, denoise=False)
    shared = shade_chunk(tracer, points, few)
    separate = shade_chunk(tracer, points, few.model_copy(update={"sampling": "separate"}))
    assert shared.shape == (3000, SHADING_OUTPUTS, 3)
    error = assert_same_mean(shared, separate)
    assert error[: 1 + LEVELS].max() < 0.03


@pytest.fixture(scope="module")
def tracer(backend):
    return shader(scenes.cornell(), depth=3, surface=(scenes.METAL, scenes.GLOSSY))


def part(points, index):
    from fipt.render.points import Points

    return Points(points.position[index], points.normal[index], points.wo[index], points.key[index])


def test_results_do_not_depend_on_chunks(tracer):
    points = copies(np.tile(SPOTS[1][0], (700, 1)), UP, unit(SPOTS[1][2]), 700)
    whole = tracer.shade(points, [0.3], [3, 3])
    assert whole.std() > 0
    for cuts in ([1, 256], [699]):
        pieces = [tracer.shade(part(points, index), [0.3], [3, 3]) for index in np.split(np.arange(700), cuts)]
        np.testing.assert_array_equal(np.concatenate(pieces), whole)
    turned = np.arange(700)[::-1]
    np.testing.assert_array_equal(tracer.shade(part(points, turned), [0.3], [3, 3])[turned], whole)


def test_seed_decides_the_random_numbers(tracer):
    first, again, other = (
        tracer.shade(copies(SPOTS[1][0], UP, unit(SPOTS[1][2]), 300, seed), [0.3], [3, 3]) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=(1, 2)).mean() > 0.9
    # copies of one point differ among each other: each pixel has its own numbers
    assert len(np.unique(first[:, 0, 0])) > 200


def test_keys_name_view_pixel_piece_and_seed(backend):
    from fipt.render.points import random_keys

    pixel, piece = (a.ravel() for a in np.meshgrid(np.arange(5000), np.arange(16)))
    keys = [random_keys(view, pixel, piece, seed) for view in ("a", "b") for seed in (0, 1)]
    assert len(np.unique(np.concatenate(keys))) == 4 * len(pixel)
    np.testing.assert_array_equal(random_keys("a", pixel[7:9], piece[7:9], 0), keys[0][7:9])
