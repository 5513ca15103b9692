"""From hits to pictures: sums over a pixel's pieces, layers for the denoiser, radiance by materials."""

import numpy as np
import pytest

from fipt.io.meshes import connected_parts
from fipt.model.albedo import specular_albedo
from fipt.settings import Hits as HitsSettings
from tests import scenes


def some_hits(counts, weight, shape):
    n = int(np.sum(counts))
    normal = np.tile(np.float32([0, 0, 1]), (n, 1))
    return scenes.hits_of(np.zeros((n, 3)), weight=weight, counts=counts, shapes=[shape], normal=normal)


def test_a_pixel_is_the_sum_of_its_hits_and_the_background(backend):
    from fipt.render.picture import pixels_of_hits

    hits = some_hits([1, 2, 0, 1], [1.0, 0.25, 0.75, 0.5], (2, 2))
    values = np.array([[1, 2, 3], [4, 0, 0], [8, 4, 0], [6, 6, 6]], float)
    picture = pixels_of_hits(values, hits, 0, np.array([2.0, 0.0, 1.0]))
    assert picture.dtype == np.float32
    np.testing.assert_allclose(picture, [[[1, 2, 3], [7, 3, 0]], [[2, 0, 1], [4, 3, 3.5]]])


def test_pictures_of_views_do_not_mix(backend):
    from fipt.render.picture import pixels_of_hits

    one = some_hits([1, 2], [1.0, 0.5, 0.5], (1, 2))
    both = scenes.hits_of(
        np.zeros((6, 3)), 0, np.tile(one.weight, 2), [1, 2, 1, 2], views=("a", "b"), shapes=[(1, 2), (1, 2)]
    )
    values = np.arange(9.0).reshape(3, 3)
    np.testing.assert_array_equal(
        pixels_of_hits(values, both, 1, np.zeros(3)), pixels_of_hits(values, one, 0, np.zeros(3))
    )


def test_layers_are_denoised_apart_and_complete(backend, monkeypatch):
    """The second layer shows second hits, and first ones where a pixel has no second."""
    from fipt.render import layers

    seen = []

    def record(image, normal, quality):
        seen.append((image.copy(), normal.copy()))
        return image + 100

    monkeypatch.setattr(layers, "denoise", record)
    hits = some_hits([1, 2, 0, 3], [1, 0.5, 0.5, 0.3, 0.3, 0.3], (2, 2))
    values = np.arange(6.0)[:, None, None] * np.ones((6, 2, 3)) + [[0.0], [0.5]]
    result = layers.denoise_hits(values, hits, 0)
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
    hits = some_hits(counts, np.ones(401), (20, 20))
    result = layers.denoise_hits(np.zeros((401, 1, 3)), hits, 0)
    assert result[8].max() == 0  # the second hit of pixel 7
    assert np.delete(result, 8, axis=0).min() == 100


@pytest.mark.parametrize("denoised", [False, True])
def test_radiance_in_a_furnace_is_the_reflectance(backend, denoised):
    """Every pixel of a shining room reflects kd + ks A0 + A1 of its own material."""
    from fipt.render.first_hits import joined, trace_view
    from fipt.render.picture import radiance_of_hits
    from fipt.render.scene import RayScene
    from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    box = scenes.box((-1, -1, -1), (1, 1, 1))
    scene, voxels = RayScene(box), scenes.grid()
    camera = scenes.look_at("a", (0.2, 0.1, 0.6), (0, 0, -1), width=12, height=8, focal=8.0)
    hits = joined([camera], [trace_view(scene, connected_parts(box), camera, HitsSettings(grid=2))])
    count = len(hits.position)
    left = hits.position[:, 0] < 0
    base = np.where(left[:, None], [[0.8, 0.4, 0.2]], [[0.1, 0.5, 0.9]])
    roughness, metallic = np.where(left, 0.4, 0.9).astype(np.float32), np.where(left, 1.0, 0.2)
    shader = Shader(
        scene,
        Triangles(box, EmitterSet(np.arange(12), np.ones((12, 3), np.float32))),
        SurfaceCache(voxels, voxels["radiance"], np.zeros(8, bool), scenes.sides(voxels, scenes.METAL, scenes.METAL)),
        PathSettings(2, 1.0, True),
    )
    steps = []
    got = radiance_of_hits(shader, hits, 0, camera, base, roughness, metallic, 256, denoised, 0, steps.append)
    assert sum(steps) == count * 256
    wo = camera.center - hits.position
    cos = (wo * hits.normal).sum(1) / np.linalg.norm(wo, axis=1)
    expected = np.empty((count, 3))
    for i in range(count):
        a0, a1 = specular_albedo(cos[i], roughness[i], 64)
        m = metallic[i]
        expected[i] = base[i] * (1 - m) + (0.04 * (1 - m) + base[i] * m) * a0 + a1
    assert np.abs(got / expected - 1).mean() < 0.03
    assert np.abs((got / expected).mean() - 1) < 0.01
