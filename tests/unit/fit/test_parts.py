"""The search for roughness and metallic of parts: planted ones are found, nothing is claimed without evidence."""

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS
from fipt.fit.batches import Pixels
from fipt.fit.losses import specular_at
from fipt.fit.parts import estimate_parts, part_targets
from fipt.settings import Fit
from tests import scenes

LEVELS = len(ROUGHNESS_LEVELS)
PER_PART = 600
PIECES = 30


def light(rng, count, varied):
    """Shading whose specular outputs differ from pixel to pixel (highlights) or, not ``varied``, are all alike."""
    shading = np.full((count, 1 + 2 * LEVELS, 3), 0.5, np.float32)
    if varied:
        for level in range(LEVELS):
            shading[:, 1 + level] = rng.gamma(0.3, 2.0, (count, 1)) * (1 - 0.1 * level)
            shading[:, 1 + LEVELS + level] = 0.1 * shading[:, 1 + level]
    return shading


def pixels(rng, materials, varied=True, noise=0.01):
    """One shard whose segment k + 1 has materials[k] = (base colour, roughness, metallic), seen over and over."""
    import torch

    shading = light(rng, PER_PART * len(materials), varied)
    radiance = np.empty((len(shading), 3), np.float32)
    for k, (base, s, m) in enumerate(materials):
        own = slice(k * PER_PART, (k + 1) * PER_PART)
        ls0, ls1 = specular_at(torch.from_numpy(shading[own]), torch.full((PER_PART, 1), s))
        kd, ks = np.array(base) * (1 - m), 0.04 * (1 - m) + np.array(base) * m
        radiance[own] = kd * shading[own, 0] + ks * ls0[:, 0].numpy() + ls1[:, 0].numpy()
    radiance *= 1 + noise * rng.standard_normal(radiance.shape)
    segment = np.repeat(np.arange(1, len(materials) + 1), PER_PART).astype(np.uint16)
    place = np.stack([np.arange(len(shading)) % PIECES, 3 * segment, np.zeros(len(shading))], axis=1) * 0.1
    hits = scenes.hits_of(place, segment)
    return Pixels([hits], [shading.astype(np.float16)], [(np.maximum(radiance, 0), np.ones(len(shading)))], [segment])


def found(data):
    return estimate_parts(data, np.array([1.5, 1.5, 1.5]), 3.3, lamp_gain=1e9)


def test_planted_materials_are_found(np_rng):
    """A matte wall, a lacquered table and a copper vase."""
    planted = [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.5, 0.1, 0.1), 0.2, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)]
    parts = found(pixels(np_rng, planted))
    np.testing.assert_allclose(parts.roughness[1:], [1.0, 0.2, 0.3], atol=0.06)
    np.testing.assert_array_equal(parts.metallic[1:], [0, 0, 1])
    assert parts.gain[3] > 0.5 > 0.05 > parts.gain[1]


def test_without_evidence_a_part_is_matte(np_rng):
    """Even light shows no difference between materials: neither smoothness nor metal may be claimed."""
    parts = found(pixels(np_rng, [((0.5, 0.1, 0.1), 0.2, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)], varied=False))
    np.testing.assert_array_equal(parts.roughness[1:], [1, 1])
    np.testing.assert_array_equal(parts.metallic[1:], [0, 0])


def test_pull_grows_with_evidence(np_rng):
    settings = Fit()
    parts = found(pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)]))
    targets = part_targets(parts, settings)
    assert targets[0].tolist() == pytest.approx([1, 0, settings.diffuse_weight])
    assert targets[2, 2] > 3 * targets[1, 2] >= 3 * settings.target_weight


def test_lamps_do_not_count(np_rng):
    """Pixels brighter than any reflection say nothing about a part's reflectance."""
    data = pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0)])
    data.radiance[0][::2] *= 1000
    parts = estimate_parts(data, np.array([1.5, 1.5, 1.5]), 3.3, lamp_gain=1.5)
    assert 0 < parts.pixels[1] <= PER_PART / 2
    assert parts.roughness[1] == 1


def test_clipped_pixels_do_not_count(np_rng):
    data = pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0)])
    data.clipped[0][: PER_PART // 2] = True
    assert 0 < found(data).pixels[1] <= PER_PART / 2
