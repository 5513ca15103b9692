"""Images of a model: what each pixel's rays meet, light that changes within a pixel; layers for the denoiser."""

import numpy as np
import pytest

from fipt.model.albedo import reflectance
from fipt.model.networks import Brdf
from fipt.scene.emitters import BACK, BOTH, FRONT
from fipt.scene.environment import NOTHING, constant
from fipt.scene.mesh import Mesh
from tests import scenes

PIXEL = 0.25
"""Width of a pixel at distance 1 of the camera below, metres."""


def ahead(width=6, height=4):
    """The origin, looking along -z; a pixel spans 0.25 at distance 1."""
    return scenes.look_at("a", (0, 0, 0), (0, 0, -1), width=width, height=height, focal=4.0)


def wall(x0, x1, z, y=(-9, 9)):
    """A wall across the view that faces the camera."""
    return scenes.quad((x0, y[0], z), (x1 - x0, 0, 0), (0, y[1] - y[0], 0))


def of_one_material(base, roughness, metallic):
    def materials(si):
        n = len(si.pixel)
        return Brdf(np.tile(np.float32(base), (n, 1)), np.full(n, roughness, np.float32), np.full(n, metallic, "f4"))

    return materials


@pytest.fixture
def light(backend):
    from fipt.render.environment import sky_of
    from fipt.render.image import LitRoom
    from fipt.render.scene import RayScene
    from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    def light(mesh, emitters=(), radiance=(0, 0, 0), outside=NOTHING, sides=BOTH, albedo=0.0):
        emitted = np.broadcast_to(np.float32(radiance), (len(emitters), 3))
        lit = EmitterSet(np.array(emitters, np.int32), emitted, np.full(len(emitters), sides, np.int8))
        voxels = scenes.grid()
        around = scenes.Surface((albedo,) * 3, 1.0, 0.0)
        cache = SurfaceCache(voxels, voxels["radiance"], np.zeros(8, bool), scenes.sides(voxels, around, around))
        path = PathSettings(2, 1.0, True)
        return LitRoom(mesh, lit, outside, Shader(RayScene(mesh), Triangles(mesh, lit), cache, path, sky_of(outside)))

    return light


def see(lights, camera=None, materials=None, grid=2, spp=8, denoised=False, seed=0, advance=lambda paths: None):
    from fipt.render.image import ImageSampling, render_images

    materials = materials or of_one_material((0.5, 0.5, 0.5), 1.0, 0.0)
    sampling = ImageSampling(grid, spp, denoised, seed)
    return render_images(lights, camera or ahead(), materials, sampling, advance)


@pytest.mark.parametrize("denoised", [False, True])
def test_under_a_white_sky_a_wall_shows_its_reflectance(light, denoised):
    """Half of it metal; above it the sky itself is seen."""
    white = constant((1, 1, 1))
    mesh, first = wall(-9, 9, -2, y=(-9, 9 if denoised else 0)), 0 if denoised else 4

    def materials(si):
        left = si.position[:, 0] < 0
        base = np.where(left[:, None], [[0.8, 0.4, 0.2]], [[0.1, 0.5, 0.9]]).astype(np.float32)
        return Brdf(base, np.where(left, 0.4, 0.9).astype("f4"), np.where(left, 1.0, 0.2).astype("f4"))

    steps, camera = [], ahead(12, 8)
    (got,) = see([light(mesh, outside=white)], camera, materials, 2, 1024, denoised, advance=steps.append)
    assert sum(steps) == 12 * (8 - first) * 1024  # rays that leave the mesh have no paths
    assert got.dtype == np.float32
    np.testing.assert_allclose(got[:first], 1, rtol=1e-6)
    rows, columns = np.indices((8, 12))[:, first:].reshape(2, -1)
    rays = camera.directions(columns + 0.5, rows + 0.5)
    left = (columns < 6)[:, None]
    base = np.where(left, [[0.8, 0.4, 0.2]], [[0.1, 0.5, 0.9]])
    expected = reflectance(base, np.where(left, 0.4, 0.9)[:, 0], np.where(left, 1.0, 0.2)[:, 0], -rays[:, 2])
    ratio = got[first:].reshape(-1, 3) / expected
    assert np.abs(ratio - 1).mean() < 0.03
    assert abs(ratio.mean() - 1) < 0.01


@pytest.mark.parametrize("share", [0.2, 0.65])
def test_an_emitter_flush_with_the_wall_has_its_share_of_a_pixel(light, share):
    """Emitter and wall are one connected part in one plane: a piece of a pixel would be all of one of them."""
    edge = share * PIXEL
    mesh = scenes.joined(wall(-9, edge, -1), wall(edge, 9, -1))
    emitted = np.array([4.0, 2.0, 1.0])
    (got,) = see([light(mesh, (0, 1), emitted)], grid=4)
    expected = np.array([1, 1, 1, share, 0, 0])[:, None] * emitted
    np.testing.assert_allclose(got, np.broadcast_to(expected, got.shape), atol=4 * 1.2 / 16)
    np.testing.assert_array_equal(got[:, 4:], 0)


def test_the_edge_of_an_emitter_in_a_mirror_has_its_share_of_a_pixel(light):
    """An emitter behind the camera, seen in a smooth metal: light changes within a piece of surface."""
    share = 0.4
    emitter_edge = 3 * share * PIXEL  # twice the mirror's distance and the emitter's own away
    mesh = scenes.joined(wall(-9, 9, -1), scenes.turned(wall(-40, emitter_edge, 1, y=(-40, 40))))
    (got,) = see([light(mesh, (2, 3), (2, 2, 2))], materials=of_one_material((1, 1, 1), 0.02, 1.0), grid=4, spp=512)
    row = got[..., 0].mean(axis=0)
    np.testing.assert_allclose(row[:3], 2, rtol=0.08)  # the highlight loses some at its slant
    np.testing.assert_allclose(row[3], 2 * share, atol=0.2)
    np.testing.assert_allclose(row[4:], 0, atol=0.02)


def test_emitters_are_seen_from_the_sides_that_shine(light):
    for mesh, shines in ((wall(-9, 9, -1), FRONT), (scenes.turned(wall(-9, 9, -1)), BACK)):
        for sides in (FRONT, BACK, BOTH):
            (got,) = see([light(mesh, (0, 1), (3, 3, 3), sides=sides)])
            np.testing.assert_array_equal(got, np.float32(3.0 if sides in (shines, BOTH) else 0.0))


def test_lights_of_one_room_are_seen_at_once(light):
    mesh = scenes.joined(wall(-9, 9, -2), scenes.emitter_quad((-1, 1), 1.5, (-1.5, -0.5)))
    lights = [light(mesh, (2, 3), np.array([5.0, 4.0, 3.0]) * gain) for gain in (1, 0, 2)]
    one, dark, two = see(lights)
    np.testing.assert_array_equal(one, see(lights[:1])[0])
    np.testing.assert_allclose(two, 2 * one, rtol=1e-5)
    assert one.max() > 0.05
    assert not dark.any()


def test_light_adds_up_emitter_by_emitter(light):
    """An emitter that is off is as black at bounces as it is for the camera."""
    emitters = wall(-9, 9, 1), scenes.quad((-1, -9, -9), (0, 18, 0), (0, 0, 18))  # behind the camera, and on its left
    mesh = scenes.joined(wall(-9, 9, -2), *emitters)
    emitted = np.float32([[4, 1, 2], [4, 1, 2], [1, 3, 2], [1, 3, 2]])
    switched = [emitted, emitted * [[1], [1], [0], [0]], emitted * [[0], [0], [1], [1]], 0 * emitted]
    both, first, second, none = see([light(mesh, (2, 3, 4, 5), each, albedo=0.9) for each in switched], spp=512)
    np.testing.assert_allclose((first + second).mean(axis=(0, 1)), both.mean(axis=(0, 1)), rtol=0.01)
    assert not none.any()


def test_the_same_seed_gives_the_same_image(light):
    room = light(wall(-9, 9, -2), outside=constant((1, 1, 1)))
    first, again, other = (see([room], seed=seed)[0] for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_every_ray_has_a_path_of_each_lobe(backend):
    from fipt.render.image import ImageSampling

    def paths_of_ray(rays_per_side, spp):
        return ImageSampling(rays_per_side, spp, denoise=False, seed=0).paths_of_ray

    assert [paths_of_ray(4, spp) for spp in (1, 32, 33, 128)] == [2, 2, 3, 8]
    assert paths_of_ray(1, 128) == 128


def test_emitters_keep_their_edge_where_images_are_denoised(light):
    mesh = scenes.joined(wall(-9, 0, -1), wall(0, 9, -1))
    room = light(mesh, (0, 1), (4, 0, 0), outside=constant((0.0, 0.3, 0.0)))
    (got,) = see([room], ahead(24, 16), denoised=True)
    np.testing.assert_array_equal(got[:, :12], np.broadcast_to(np.float32([4, 0, 0]), (16, 12, 3)))
    assert not got[:, 12:, [0, 2]].any()  # no colour that nothing sends
    assert got[:, 12:, 1].min() > 0


def some_samples(counts, weight, shape):
    n = int(np.sum(counts))
    normal = np.tile(np.float32([0, 0, 1]), (n, 1))
    return scenes.samples_of(np.zeros((n, 3)), weight=weight, counts=counts, shapes=[shape], normal=normal)


def test_layers_are_denoised_singly_and_complete(backend, monkeypatch):
    """The second layer shows second samples, and first ones where a pixel has no second."""
    from fipt.render import layers

    seen = []

    def record(image, normal, quality):
        seen.append((image.copy(), normal.copy()))
        return image + 100

    monkeypatch.setattr(layers, "denoise", record)
    samples = some_samples([1, 2, 0, 3], [1, 0.5, 0.5, 0.3, 0.3, 0.3], (2, 2))
    values = np.arange(6.0)[:, None, None] * np.ones((6, 2, 3)) + [[0.0], [0.5]]
    result = layers.denoise_samples(values, samples, 0)
    np.testing.assert_array_equal(result, values + 100)
    first, second, third = (image[..., 0].ravel() for image, _ in seen[::2])
    np.testing.assert_array_equal(first, [0, 1, 0, 3])
    np.testing.assert_array_equal(second, [0, 2, 0, 4])
    np.testing.assert_array_equal(third, [0, 2, 0, 5])
    np.testing.assert_array_equal(seen[0][1][..., 2].ravel(), [1, 1, 0, 1])
    np.testing.assert_array_equal(seen[1][0][..., 0].ravel(), [0.5, 1.5, 0, 3.5])


def test_sparse_layers_stay_as_they_are(backend, monkeypatch):
    from fipt.render import layers

    monkeypatch.setattr(layers, "denoise", lambda image, normal, quality: image + 100)
    counts = np.ones(400, int)
    counts[7] = 2
    samples = some_samples(counts, np.ones(401), (20, 20))
    result = layers.denoise_samples(np.zeros((401, 1, 3)), samples, 0)
    assert result[8].max() == 0  # the second hit of pixel 7
    assert np.delete(result, 8, axis=0).min() == 100


def test_pixels_that_are_black_by_chance_keep_their_share_of_the_light(light):
    """A room lit through a hole in the wall behind the camera: most of few paths miss it."""
    room = scenes.box((-2, -2, -3), (2, 2, 2))
    behind = [(-2, 0.5, -2, 2), (1.2, 2, -2, 2), (0.5, 1.2, -2, 0), (0.5, 1.2, 0.7, 2)]  # x and y around the hole
    walls = [scenes.quad((a, c, 2), (0, d - c, 0), (b - a, 0, 0)) for a, b, c, d in behind]
    lit = light(scenes.joined(Mesh(room.vertices, room.triangles[:-2]), *walls), outside=constant((5, 5, 5)))
    camera = ahead(32, 24)
    (raw,), (clean,) = (see([lit], camera, spp=32, denoised=denoised) for denoised in (False, True))
    (true,) = see([lit], camera, spp=512)
    assert (raw.max(axis=-1) == 0).mean() > 0.3
    assert clean.mean() == pytest.approx(raw.mean(), rel=0.1)
    assert clean.mean() == pytest.approx(true.mean(), rel=0.2)
    assert (clean.max(axis=-1) > 0).all()
