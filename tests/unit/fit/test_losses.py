"""Every term of the loss, by hand on tiny tensors."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_LEVELS
from fipt.fit import losses
from fipt.fit.batches import Batch
from fipt.fit.loop import evident_emitters
from fipt.fit.loop import losses as all_terms
from fipt.io.images import srgb_encode
from fipt.model.networks import Brdf, EmissionNetwork, SceneBox
from fipt.settings import Fit


@pytest.fixture
def rng():
    return torch.Generator().manual_seed(5)


def random(rng, *shape, dtype=torch.float32):
    return torch.rand(*shape, generator=rng, dtype=dtype)


def test_srgb_is_the_curve_and_goes_on_above_one():
    values = torch.tensor([0.0, 0.001, 0.0031308, 0.0032, 0.2, 1.0, 7.5])
    np.testing.assert_allclose(losses.srgb(values), srgb_encode(values.numpy()), rtol=1e-5, atol=1e-7)
    assert losses.srgb(torch.tensor(7.5)) > 2


def test_srgb_has_a_gradient_everywhere():
    values = torch.tensor([0.0, 1e-6, 0.0031308, 0.5, 3.0], requires_grad=True)
    losses.srgb(values).sum().backward()
    assert torch.isfinite(values.grad).all()
    np.testing.assert_allclose(values.grad[:2], 12.92)
    assert (values.grad > 0).all()


# --- reflected radiance ---------------------------------------------------------------------------


def test_levels_are_met_exactly(rng):
    shading = random(rng, 6, 13, 3)
    ls0, ls1 = losses.specular_at(shading, torch.tensor(ROUGHNESS_LEVELS)[:, None])
    number = torch.arange(6)
    np.testing.assert_allclose(ls0[:, 0], shading[number, 1 + number], rtol=1e-5)
    np.testing.assert_allclose(ls1[:, 0], shading[number, 7 + number], rtol=1e-5)


def test_between_levels_it_is_a_straight_line(rng):
    shading = random(rng, 1, 13, 3)
    s = torch.tensor([[0.412 + 0.196 * 0.3, 0.02 + 0.196 * 0.5, 1.0 - 0.196 * 0.1]])
    ls0, ls1 = losses.specular_at(shading, s)
    for q, (level, t) in enumerate([(2, 0.3), (0, 0.5), (4, 0.9)]):
        for got, first in ((ls0, 1), (ls1, 7)):
            a, b = shading[0, first + level], shading[0, first + level + 1]
            np.testing.assert_allclose(got[0, q], a + t * (b - a), rtol=1e-4)


def test_reflected_radiance_by_hand(rng):
    shading = random(rng, 2, 13, 3)
    base = random(rng, 4, 3)
    roughness, metallic = torch.tensor([0.02, 0.216, 1.0, 0.314]), torch.tensor([0.0, 1.0, 0.25, 0.5])
    radiance, specular = losses.reflected(Brdf(base, roughness, metallic), shading, 2)
    for hit in range(2):
        each, gloss = [], []
        for q in (2 * hit, 2 * hit + 1):
            m = metallic[q]
            kd, ks = base[q] * (1 - m), 0.04 * (1 - m) + base[q] * m
            x = (roughness[q] - 0.02) / 0.196
            low = min(int(x + 1e-4), 4)
            t = x - low
            ls0, ls1 = ((1 - t) * shading[hit, k + low] + t * shading[hit, k + low + 1] for k in (1, 7))
            gloss.append((ks * ls0 + ls1).mean())
            each.append(kd * shading[hit, 0] + ks * ls0 + ls1)
        np.testing.assert_allclose(radiance[hit], (each[0] + each[1]) / 2, rtol=1e-4)
        np.testing.assert_allclose(specular[hit], (gloss[0] + gloss[1]) / 2, rtol=1e-4)


def test_gradients_of_reflected_radiance(rng):
    """Against finite differences in float64, away from the levels where the line bends."""
    shading = random(rng, 3, 13, 3, dtype=torch.float64)
    base = random(rng, 6, 3, dtype=torch.float64).requires_grad_()
    roughness = torch.tensor([0.1, 0.3, 0.5, 0.7, 0.9, 0.25], dtype=torch.float64, requires_grad=True)
    metallic = random(rng, 6, dtype=torch.float64).requires_grad_()

    def f(base, roughness, metallic):
        return losses.reflected(Brdf(base, roughness, metallic), shading, 2)

    assert torch.autograd.gradcheck(f, (base, roughness, metallic), eps=1e-6, atol=1e-7)


def test_hits_are_gathered_by_weight():
    values = torch.tensor([[1.0, 2, 3], [10, 0, 0], [4, 4, 4]])
    got = losses.gathered(values, torch.tensor([2, 0, 2]), torch.tensor([0.25, 1.0, 0.75]), 3)
    np.testing.assert_allclose(got, [[10, 0, 0], [0, 0, 0], [3.25, 3.5, 3.75]])


# --- propagation ----------------------------------------------------------------------------------


def test_part_means_are_weighted_by_specular_radiance():
    s, m = torch.tensor([0.2, 0.8, 0.3, 0.5, 0.9]), torch.tensor([0.0, 1.0, 0.4, 0.3, 0.7])
    specular, segment = torch.tensor([3.0, 1.0, 0.5, 2.0, 5.0]), torch.tensor([7, 7, 7, 65535, 0])
    w = np.array([3.0, 1.0, 0.5]) + 1e-4
    expected = 0.0
    for values in (np.array([0.2, 0.8, 0.3]), np.array([0.0, 1.0, 0.4])):
        expected += np.abs(values - (w * values).sum() / w.sum()).sum() / 4  # four hits are of a part
    assert losses.part_propagation(s, m, specular, segment).item() == pytest.approx(expected, rel=1e-5)


def test_gradients_of_part_propagation(rng):
    """Through the mean too; but nobody dims a highlight to please the mean."""
    s, m = (random(rng, 8, dtype=torch.float64).requires_grad_() for _ in range(2))
    specular = random(rng, 8, dtype=torch.float64).requires_grad_()
    segment = torch.tensor([1, 1, 1, 2, 2, 2, 2, 0])
    assert torch.autograd.gradcheck(lambda s, m: losses.part_propagation(s, m, specular, segment), (s, m))
    losses.part_propagation(s, m, specular, segment).backward()
    assert specular.grad is None
    assert s.grad[-1] == 0


def test_alike_hits_cost_nothing_and_neither_do_unknown_ones():
    segment = torch.tensor([1, 1, 2])
    s, m = torch.tensor([0.4, 0.4, 0.9]), torch.tensor([0.1, 0.1, 1.0])
    assert losses.part_propagation(s, m, torch.ones(3), segment).item() == pytest.approx(0, abs=1e-6)
    assert losses.part_propagation(s, m, torch.ones(3), 0 * segment).item() == 0
    assert losses.semantic_propagation(s, m, torch.rand(3, 3), torch.zeros(3, 3), 0 * segment).item() == 0


def test_semantic_means_are_of_alike_and_nearby_hits(rng):
    count = 12
    s, m = random(rng, count), random(rng, count)
    color, x = 0.5 + 0.02 * random(rng, count, 3), 0.1 * random(rng, count, 3)
    segment = torch.tensor([1] * 5 + [0] * 2 + [9] * 5)
    expected = 0.0
    for own in (range(5), range(7, 12)):
        own = list(own)
        dc, dx = (v[own].numpy().astype(float) for v in (color, x))
        w = np.exp(
            -((dc[:, None] - dc) ** 2).sum(-1) / 2 / (0.05 / 3) ** 2
            - ((dx[:, None] - dx) ** 2).sum(-1) / 2 / (0.3 / 3) ** 2
        )
        w /= w.sum(axis=1, keepdims=True)
        assert w.max() < 0.9  # the case is not trivial
        for v in (s[own].numpy(), m[own].numpy()):
            expected += np.abs(v - w @ v).mean()
    got = losses.semantic_propagation(s, m, color, x, segment)
    assert got.item() == pytest.approx(expected, rel=1e-4)


def test_semantic_weights_pass_no_gradient(rng):
    s = random(rng, 6).requires_grad_()
    color = (0.01 * random(rng, 6, 3)).requires_grad_()
    segment = torch.ones(6, dtype=torch.int64)
    losses.semantic_propagation(s, random(rng, 6), color, torch.zeros(6, 3), segment).backward()
    assert color.grad is None
    assert s.grad.abs().sum() > 0


# --- all terms of a batch -------------------------------------------------------------------------


class Known:
    """A field whose answers are given: K points for materials, H for emission."""

    def __init__(self, brdf, e):
        self.answer, self.e, self.box = brdf, e, SceneBox((0, 0, 0), 2.0)
        self.emission_network = EmissionNetwork
        self.asked = {}

    def brdf(self, points, footprint):
        self.asked = {"points": points, "footprint": footprint}
        return self.answer

    def emission(self, points):
        assert len(points) == len(self.e)
        return self.e


def batch(rng, hits=3, queries=2):
    return Batch(
        radiance=torch.tensor([[0.2, 0.3, 0.4], [0.5, 0.1, 0.6]]),
        valid=torch.tensor([1.0, 0.5]),
        clipped=torch.tensor([False, False]),
        owner=torch.tensor([0, 1, 1])[:hits],
        weight=torch.tensor([1.0, 0.25, 0.75])[:hits],
        points=random(rng, hits, queries, 3),
        footprint=torch.tensor([0.1, 0.2, 0.3])[:hits],
        shading=0.5 + random(rng, hits, 13, 3),
        segment=torch.tensor([4, 4, 4])[:hits],
    )


def test_terms_of_a_batch(rng):
    data = batch(rng)
    brdf = Brdf(random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6))
    e = torch.tensor([-0.5, 0.3, 1.2])
    field = Known(brdf, e)
    weights = {"colour_weight": 2.0, "emission_weight": 3.0, "diffuse_weight": 5.0, "part_weight": 7.0}
    settings = Fit(evidence=0, footprint=0.5, **weights)
    terms = all_terms(field, data, "part", settings)
    assert set(terms) == {"colour", "emission", "diffuse", "part"}

    radiance, specular = losses.reflected(brdf, data.shading, 2)
    alpha = 1 - np.exp(-np.maximum(e.numpy(), 0))
    assert alpha[0] == 0
    seen = data.radiance.numpy()
    each = (1 - alpha[:, None]) * radiance.numpy() + alpha[:, None] * seen[[0, 1, 1]]
    pixel = np.stack([each[0], 0.25 * each[1] + 0.75 * each[2]])
    error = ((srgb_encode(pixel) - srgb_encode(seen)) ** 2).mean(axis=1)
    assert terms["colour"].item() == pytest.approx(2.0 * (error[0] + 0.5 * error[1]) / 2, rel=1e-4)
    assert terms["emission"].item() == pytest.approx(3.0 * (0.5 + 0.3 + 1.2) / 3, rel=1e-5)
    s, m = (v.view(3, 2).mean(1) for v in (brdf.roughness, brdf.metallic))
    assert terms["diffuse"].item() == pytest.approx(5.0 * ((1 - s).mean() + m.mean()).item(), rel=1e-5)
    part = losses.part_propagation(s, m, specular, data.segment)
    assert terms["part"].item() == pytest.approx(7.0 * part.item(), rel=1e-5)
    np.testing.assert_allclose(field.asked["footprint"], [0.05, 0.05, 0.1, 0.1, 0.15, 0.15])
    np.testing.assert_array_equal(field.asked["points"], data.points.reshape(6, 3))


def test_kind_of_segments_decides_the_propagation(rng):
    data = batch(rng)
    field = Known(Brdf(random(rng, 6, 3), random(rng, 6), random(rng, 6)), torch.zeros(3))
    assert set(all_terms(field, data, None, Fit())) == {"colour", "emission", "diffuse"}
    semantic = all_terms(field, data, "semantic", Fit(semantic_weight=2.0))["semantic"]
    s, m, base = (
        v.view(3, 2, -1).mean(1).squeeze(-1)
        for v in (field.answer.roughness, field.answer.metallic, field.answer.base_color)
    )
    expected = losses.semantic_propagation(s, m, base, data.points[:, 0], data.segment)  # the box is [-1, 1]
    assert semantic.item() == pytest.approx(2 * expected.item(), rel=1e-5)


def test_pixels_brighter_than_any_reflection_are_evident(rng):
    data = batch(rng)
    shading = torch.zeros(3, 13, 3)
    shading[0, 0], shading[1, 3] = 1.0, 0.5  # a white wall; a mirror: Ls0 and Ls1 of one level add up
    shading[1, 9] = 0.5
    shading[2] = 0.2
    radiance = torch.tensor([[1.4, 1.4, 1.4], [1.6, 1.6, 1.6]])
    evident = evident_emitters(SimpleNamespace(shading=shading, radiance=radiance, owner=data.owner), 1.5)
    assert evident.tolist() == [False, True, True]


def test_evident_lamps_teach_only_the_mask(rng):
    data = batch(rng)
    bright = torch.tensor([[0.2, 0.3, 0.4], [90.0, 90.0, 90.0]])
    data = Batch(**{**vars(data), "radiance": bright})
    base = random(rng, 6, 3).requires_grad_()
    e = torch.full((3,), 0.1, requires_grad=True)
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    all_terms(field, data, None, Fit(evidence=1.5, emission_weight=0))["colour"].backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0
    assert (e.grad[1:] < 0).all()  # opening the mask there helps


def test_clipped_pixels_are_lower_bounds(rng):
    """They never teach the BRDF; the mask learns from them only where the model stays below."""
    base, e = random(rng, 6, 3).requires_grad_(), torch.full((3,), 0.1, requires_grad=True)
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    data = batch(rng)
    settings = Fit(evidence=0, emission_weight=0)

    def learnt(radiance):
        base.grad = e.grad = None
        pixels = torch.tensor([[0.2, 0.3, 0.4], [radiance] * 3])
        clipped = Batch(**{**vars(data), "radiance": pixels, "clipped": torch.tensor([False, True])})
        loss = all_terms(field, clipped, None, settings)["colour"]
        loss.backward()
        assert base.grad[:2].abs().min() > 0
        assert base.grad[2:].abs().max() == 0
        return loss.item(), e.grad[1:]

    low, gradient = learnt(0.001)  # any shading is brighter: nothing is wrong
    assert (gradient == 0).all()
    first = all_terms(field, Batch(**{**vars(data), "valid": torch.tensor([1.0, 0.0])}), None, settings)["colour"]
    assert low == pytest.approx(first.item(), rel=1e-5)
    high, gradient = learnt(50.0)
    assert high > low
    assert (gradient < 0).all()
