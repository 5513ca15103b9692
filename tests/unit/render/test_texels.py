"""Textures of many materials in one array, against SciPy's interpolation."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tests import scenes


@pytest.fixture
def mi(backend):
    import mitsuba

    return mitsuba


def expected(image, uv):
    """Bilinear values of an image that repeats, texel centres at half integers."""
    height, width = image.shape[:2]
    place = np.stack([uv[:, 1] * height - 0.5, uv[:, 0] * width - 0.5])
    channels = np.atleast_3d(image)
    found = [map_coordinates(channels[..., k], place, order=1, mode="grid-wrap") for k in range(channels.shape[2])]
    return np.stack(found, axis=1)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_lookups_are_those_of_scipy(mi, np_rng, channels):
    from fipt.render.texels import PackedMaps

    sizes = [(1, 1), (3, 5), (1, 7), (16, 2)]
    images = [np_rng.random((*size, *channels), np.float32) for size in sizes]
    texels, kind = PackedMaps(images), mi.Color3f if channels else mi.Float
    material = np_rng.integers(len(images), size=4000)
    uv = np_rng.uniform(-3, 3, (4000, 2)).astype(np.float32)
    uv[:6] = [(0, 0), (1, 1), (-1, 2), (0.5, 0.5), (-1e-9, 0), (1 - 1e-7, 0.3)]
    found = texels.lookup(kind, mi.UInt32(material.astype(np.uint32)), mi.Point2f(*(mi.Float(c) for c in uv.T)))
    found = np.array(found).reshape(-1, len(uv)).T
    for index, image in enumerate(images):
        mine = material == index
        np.testing.assert_allclose(found[mine], expected(image, uv[mine].astype(float)), atol=2e-5)


def test_lanes_that_are_switched_off_are_left_alone(mi):
    """Their material is whatever it is: nothing may be divided by its size."""
    from fipt.render.texels import PackedMaps

    texels = PackedMaps([np.ones((2, 2), np.float32)])
    found = texels.lookup(mi.Float, mi.UInt32([0, 99]), mi.Point2f([0.3, 0.3], [0.1, 0.1]), mi.Bool([True, False]))
    assert np.array(found)[0] == 1


def test_roughness_has_its_floor(mi):
    from fipt.conventions import ROUGHNESS_MIN
    from fipt.render.texels import DeviceMaps, MappedMesh, MappedSurface
    from tests.modelled import constant

    maps = DeviceMaps([constant("mirror", (0.9, 0.9, 0.9), 0.0, 1.0)])
    surface = MappedSurface(MappedMesh(scenes.floor(), np.zeros((4, 2), np.float32), maps, np.zeros(2, np.int32)))
    import drjit as dr

    si = dr.zeros(mi.SurfaceInteraction3f, 2)
    np.testing.assert_allclose(np.array(surface.roughness.eval_1(si)), ROUGHNESS_MIN)
    np.testing.assert_allclose(np.array(surface.metallic.eval_1(si)), 1)
