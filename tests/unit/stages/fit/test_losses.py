"""Every term of the loss, by hand on tiny tensors."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.formats.images import srgb_encode
from fipt.model.networks import Brdf, EmissionNetwork, SceneBox
from fipt.stages.fit import losses
from fipt.stages.fit.batches import Batch
from fipt.stages.fit.loop import evident_emitters
from fipt.stages.fit.loop import losses as all_terms
from fipt.stages.fit.parts import PartTargets
from fipt.stages.fit.settings import FitSettings

LEVELS = len(ROUGHNESS_LEVELS)


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


def interpolated(shading, s):
    """Ls0 and Ls1 of one hit (outputs, 3) at roughnesses (Q,), by NumPy."""
    ends = np.split(shading[1:].numpy(), 2)
    return [np.stack([np.interp(s.numpy(), ROUGHNESS_LEVELS, each[:, c]) for c in range(3)], axis=-1) for each in ends]


def test_levels_are_met_exactly(rng):
    shading = random(rng, LEVELS, SHADING_OUTPUTS, 3)
    ls0, ls1 = losses.specular_at(shading, torch.tensor(ROUGHNESS_LEVELS)[:, None])
    number = torch.arange(LEVELS)
    np.testing.assert_allclose(ls0[:, 0], shading[number, 1 + number], rtol=1e-5)
    np.testing.assert_allclose(ls1[:, 0], shading[number, 1 + LEVELS + number], rtol=1e-5)


def test_between_levels_it_is_a_straight_line(rng):
    """However the levels are spaced: three roughnesses in every gap."""
    assert np.ptp(np.diff(ROUGHNESS_LEVELS)) > 0.05  # they are not even
    low, high = torch.tensor(ROUGHNESS_LEVELS)[:-1], torch.tensor(ROUGHNESS_LEVELS)[1:]
    s = low + torch.tensor([[0.1], [0.5], [0.85]]) * (high - low)
    shading = random(rng, 3, SHADING_OUTPUTS, 3)
    ls0, ls1 = losses.specular_at(shading, s)
    for hit in range(3):
        expected = interpolated(shading[hit], s[hit])
        np.testing.assert_allclose(ls0[hit], expected[0], rtol=1e-4)
        np.testing.assert_allclose(ls1[hit], expected[1], rtol=1e-4)


def test_reflected_radiance_by_hand(rng):
    shading = random(rng, 2, SHADING_OUTPUTS, 3)
    base = random(rng, 4, 3)
    roughness, metallic = torch.tensor([0.02, 0.216, 1.0, 0.314]), torch.tensor([0.0, 1.0, 0.25, 0.5])
    radiance, specular = losses.reflected(Brdf(base, roughness, metallic), shading, 2)
    for hit in range(2):
        each, gloss = [], []
        for q in (2 * hit, 2 * hit + 1):
            m = metallic[q]
            kd, ks = base[q] * (1 - m), 0.04 * (1 - m) + base[q] * m
            ls0, ls1 = (torch.from_numpy(x[0]) for x in interpolated(shading[hit], roughness[q : q + 1]))
            gloss.append((ks * ls0 + ls1).mean())
            each.append(kd * shading[hit, 0] + ks * ls0 + ls1)
        np.testing.assert_allclose(radiance[hit], (each[0] + each[1]) / 2, rtol=1e-4)
        np.testing.assert_allclose(specular[hit], (gloss[0] + gloss[1]) / 2, rtol=1e-4)


def test_gradients_of_reflected_radiance(rng):
    """Against finite differences in float64, away from the levels where the line bends."""
    shading = random(rng, 3, SHADING_OUTPUTS, 3, dtype=torch.float64)
    base = random(rng, 6, 3, dtype=torch.float64).requires_grad_()
    roughness = torch.tensor([0.1, 0.3, 0.5, 0.7, 0.9, 0.25], dtype=torch.float64, requires_grad=True)
    metallic = random(rng, 6, dtype=torch.float64).requires_grad_()

    def f(base, roughness, metallic):
        return losses.reflected(Brdf(base, roughness, metallic), shading, 2)

    assert torch.autograd.gradcheck(f, (base, roughness, metallic), eps=1e-6, atol=1e-7)


def test_samples_are_gathered_by_weight():
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
        expected += np.abs(values - (w * values).sum() / w.sum()).sum() / 4  # four samples are of a part
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


def test_alike_samples_cost_nothing_and_neither_do_unknown_ones():
    segment = torch.tensor([1, 1, 2])
    s, m = torch.tensor([0.4, 0.4, 0.9]), torch.tensor([0.1, 0.1, 1.0])
    assert losses.part_propagation(s, m, torch.ones(3), segment).item() == pytest.approx(0, abs=1e-6)
    assert losses.part_propagation(s, m, torch.ones(3), 0 * segment).item() == 0
    assert losses.semantic_propagation(s, m, torch.rand(3, 3), torch.zeros(3, 3), 0 * segment).item() == 0


def test_semantic_means_are_of_alike_and_nearby_samples(rng):
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

    def __init__(self, brdf, e, there=None):
        self.answer, self.e, self.there, self.box = brdf, e, there, SceneBox((0, 0, 0), 2.0)
        self.emission_network = EmissionNetwork
        self.asked = {}

    def brdf(self, points, footprint):
        if len(points) != len(self.answer.roughness):
            self.hidden = {"points": points, "footprint": footprint}
            return self.there
        self.asked = {"points": points, "footprint": footprint}
        return self.answer

    def emission(self, points):
        assert len(points) == len(self.e)
        return self.e


def batch(rng, samples=3, queries=2):
    return Batch(
        radiance=torch.tensor([[0.2, 0.3, 0.4], [0.5, 0.1, 0.6]]),
        valid=torch.tensor([1.0, 0.5]),
        clipped=torch.tensor([False, False]),
        owner=torch.tensor([0, 1, 1])[:samples],
        weight=torch.tensor([1.0, 0.25, 0.75])[:samples],
        points=random(rng, samples, queries, 3),
        footprint=torch.tensor([0.1, 0.2, 0.3])[:samples],
        shading=0.5 + random(rng, samples, SHADING_OUTPUTS, 3),
        segment=torch.tensor([4, 4, 4])[:samples],
        confidence=torch.ones(samples),
    )


def goals(surface, pull=1.0, base=(0.5, 0.5, 0.5), uniform=0.0, segments=5):
    """Targets of every segment alike: ``surface`` is roughness and metallic."""
    values = (*surface, pull, base, uniform)
    return PartTargets(*(torch.tensor(value).expand(segments, *np.shape(value)).clone() for value in values))


def test_terms_of_a_batch(rng):
    data = batch(rng)
    brdf = Brdf(random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6))
    e = torch.tensor([-0.5, 0.3, 1.2])
    field = Known(brdf, e)
    weights = {"colour_weight": 2.0, "emission_weight": 3.0, "diffuse_weight": 5.0, "part_weight": 7.0}
    settings = FitSettings(evidence=0, footprint=0.5, **weights)
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


def test_pixels_at_the_edge_of_an_opening_show_the_outside_too(rng):
    """Their error is that of the whole pixel; what lies outside is no emission."""
    data = batch(rng)
    brdf = Brdf(random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6))
    beyond = torch.tensor([[0.0, 0.0, 0.0], [0.3, 0.0, 0.2]])
    weight = torch.tensor([1.0, 0.15, 0.45])
    data = Batch(**{**vars(data), "weight": weight, "beyond": beyond, "share": torch.tensor([1.0, 0.6])})
    settings = FitSettings(evidence=0)
    radiance, _ = losses.reflected(brdf, data.shading, 2)
    seen = data.radiance.numpy()
    each = radiance.numpy()
    pixel = np.stack([each[0], 0.15 * each[1] + 0.45 * each[2] + beyond[1].numpy()])
    error = ((srgb_encode(pixel) - srgb_encode(seen)) ** 2).mean(axis=1)
    dark = all_terms(Known(brdf, torch.full((3,), -1.0)), data, None, settings)["colour"].item()
    assert dark == pytest.approx((error[0] + 0.5 * error[1]) / 2, rel=1e-4)
    masked = all_terms(Known(brdf, torch.full((3,), 50.0)), data, None, settings)["colour"].item()
    assert masked == pytest.approx(0, abs=1e-9)  # the mask explains all of it


def test_confidence_draws_the_unsure_to_their_part_and_lets_the_sure_decide_it(rng):
    data = batch(rng)
    data = Batch(**{**vars(data), "confidence": torch.tensor([1.0, 0.0, 0.5])})
    s = torch.tensor([0.2, 0.2, 0.8, 0.8, 0.5, 0.5])
    field = Known(Brdf(random(rng, 6, 3), s, 0 * s + 0.3), torch.zeros(3))
    goal = goals((0.6, 0.3), pull=2.0)
    terms = all_terms(field, data, "part", FitSettings(confidence=True, part_weight=1.0), goal)
    logit = np.abs(np.log([0.25, 4.0, 1.0]) - np.log(1.5))
    away = np.where(logit < 0.5, logit**2, logit - 0.25)
    assert terms["target"].item() == pytest.approx(2 * np.mean([0.5, 1.5, 1.0] * away), rel=1e-4)
    _, specular = losses.reflected(field.answer, data.shading, 2)
    evidence = specular * data.confidence + 1e-4
    mean = (evidence * torch.tensor([0.2, 0.8, 0.5])).sum() / evidence.sum()
    spread = (torch.tensor([0.2, 0.8, 0.5]) - mean).abs().mean()
    assert terms["part"].item() == pytest.approx(spread.item(), rel=1e-4)
    plain = all_terms(field, data, "part", FitSettings(confidence=False), goal)["target"]
    assert plain.item() == pytest.approx(2 * np.mean(away), rel=1e-4)


def test_kind_of_segments_decides_the_propagation(rng):
    data = batch(rng)
    field = Known(Brdf(random(rng, 6, 3), random(rng, 6), random(rng, 6)), torch.zeros(3))
    assert set(all_terms(field, data, None, FitSettings())) == {"colour", "emission", "diffuse"}
    semantic = all_terms(field, data, "semantic", FitSettings(semantic_weight=2.0))["semantic"]
    s, m, base = (
        v.view(3, 2, -1).mean(1).squeeze(-1)
        for v in (field.answer.roughness, field.answer.metallic, field.answer.base_color)
    )
    expected = losses.semantic_propagation(s, m, base, data.points[:, 0], data.segment)  # the box is [-1, 1]
    assert semantic.item() == pytest.approx(2 * expected.item(), rel=1e-5)


def test_pixels_brighter_than_any_reflection_are_evident(rng):
    data = batch(rng)
    shading = torch.zeros(3, SHADING_OUTPUTS, 3)
    shading[0, 0] = 1.0  # a white wall
    shading[1, [3, 3 + LEVELS]] = 0.5  # a mirror: Ls0 and Ls1 of one level add up
    shading[2] = 0.2
    radiance = torch.tensor([[1.4, 1.4, 1.4], [1.6, 1.6, 1.6]])
    evident = evident_emitters(SimpleNamespace(shading=shading, on_mesh=radiance, owner=data.owner), 1.5)
    assert evident.tolist() == [False, True, True]


def test_evident_lamps_teach_only_the_mask(rng):
    data = batch(rng)
    bright = torch.tensor([[0.2, 0.3, 0.4], [90.0, 90.0, 90.0]])
    data = Batch(**{**vars(data), "radiance": bright})
    base = random(rng, 6, 3).requires_grad_()
    e = torch.full((3,), 0.1, requires_grad=True)
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    all_terms(field, data, None, FitSettings(evidence=1.5, emission_weight=0))["colour"].backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0
    assert (e.grad[1:] < 0).all()  # opening the mask there helps


@pytest.mark.parametrize("sign", ["mask", "brightness"])
def test_a_pixel_that_shows_a_lamp_in_part_does_not_teach_its_other_half(rng, sign):
    """Pixel 1 shows samples 1 and 2; only hit 1 is a lamp."""
    data = batch(rng)
    base = random(rng, 6, 3).requires_grad_()
    e = torch.tensor([-1.0, 0.0, -1.0])
    if sign == "mask":
        e[1] = 0.2  # alpha = 0.18
    else:
        data.shading[1] = 0.05
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    dark = SimpleNamespace(shading=data.shading, on_mesh=data.radiance, owner=data.owner)
    assert evident_emitters(dark, 1.5).tolist() == [False, sign == "brightness", False]
    all_terms(field, data, None, FitSettings(evidence=1.5))["colour"].backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0


def test_a_mask_that_is_hardly_open_is_no_lamp(rng):
    data = batch(rng)
    base = random(rng, 6, 3).requires_grad_()
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), torch.tensor([-1.0, 0.1, -1.0]))  # alpha = 0.095
    all_terms(field, data, None, FitSettings(evidence=1.5))["colour"].backward()
    assert base.grad.abs().min() > 0


# --- what parts are drawn to ----------------------------------------------------------------------


def test_distance_of_logits_is_squared_near_the_goal_and_linear_far_away():
    goal = torch.full((5,), 0.3)
    logit = float(np.log(0.3 / 0.7))
    x = (logit + torch.tensor([0.0, 0.25, -0.25, 2.0, -3.0])).requires_grad_()
    distance = losses.apart(torch.sigmoid(x), goal)
    np.testing.assert_allclose(distance.detach(), [0, 0.0625, 0.0625, 1.75, 2.75], atol=1e-5)
    distance.sum().backward()
    np.testing.assert_allclose(x.grad, [0, 0.5, -0.5, 1, -1], atol=1e-4)


def test_goals_keep_off_the_ends_of_the_sigmoid():
    """One can be reached, and a saturated value still feels the pull."""
    ends = torch.tensor([0.0, 1.0])
    assert losses.apart(torch.tensor([0.004, 0.996]), ends).tolist() == pytest.approx([0, 0], abs=1e-6)
    x = torch.tensor([-8.0, 8.0], requires_grad=True)
    losses.apart(torch.sigmoid(x), torch.tensor([0.5, 0.5])).sum().backward()
    np.testing.assert_allclose(x.grad, [-1, 1], rtol=0.02)


def test_samples_are_drawn_to_the_colour_of_uniform_parts(rng):
    data = batch(rng)
    data = Batch(**{**vars(data), "segment": torch.tensor([4, 2, 0])})
    base = random(rng, 6, 3)
    field = Known(Brdf(base, random(rng, 6), random(rng, 6)), torch.zeros(3))
    targets = goals((0.5, 0.5))
    targets.base_color[[4, 2, 0]] = torch.tensor([[0.9, 0.1, 0.2], [0.3, 0.3, 0.3], [0.5, 0.5, 0.5]])
    targets.uniform[[4, 2, 0]] = torch.tensor([2.0, 0.5, 0.0])
    terms = all_terms(field, data, "part", FitSettings(base_weight=10.0), targets)
    assert set(terms) == {"colour", "emission", "target", "base", "part"}
    a = base.numpy().reshape(3, 2, 3)
    first = 2.0 * ((a[0] - [0.9, 0.1, 0.2]) ** 2).sum() / 6
    second = 0.5 * ((a[1] - 0.3) ** 2).sum() / 6
    assert terms["base"].item() == pytest.approx(10 * (first + second) / 3, rel=1e-5)


def test_unseen_points_are_drawn_to_all_of_their_part(rng):
    """Each as a hit would be; colour with at least weight 1, for no picture tells another one."""
    data = batch(rng)
    there = Brdf(random(rng, 2, 3), torch.tensor([0.5, 0.2]), torch.tensor([0.5, 0.1]))
    field = Known(Brdf(random(rng, 6, 3), random(rng, 6), random(rng, 6)), torch.zeros(3), there)
    targets = goals((0.5, 0.5))
    targets.base_color[[3, 1]] = torch.tensor([[0.1, 0.2, 0.3], [0.6, 0.6, 0.6]])
    targets.uniform[[3, 1]] = torch.tensor([0.0, 4.0])
    targets.roughness[1], targets.metallic[1], targets.pull[1] = 0.8, 0.3, 2.0
    points, size = random(rng, 2, 3), torch.tensor([0.05, 0.05])
    hidden = (points, torch.tensor([3, 1]), size)
    terms = all_terms(field, data, None, FitSettings(base_weight=10.0), targets, hidden)
    a = there.base_color.numpy()
    base = 1.0 * ((a[0] - [0.1, 0.2, 0.3]) ** 2).mean() + 4.0 * ((a[1] - 0.6) ** 2).mean()
    # the first point has the roughness and metallic of its part; the second is far off in both
    pull = 2.0 * (np.log(4.0) - np.log(0.25) - 0.25 + np.log(3 / 7) - np.log(1 / 9) - 0.25)
    assert terms["hidden"].item() == pytest.approx((10 * base + pull) / 3, rel=1e-4)  # three samples
    np.testing.assert_array_equal(field.hidden["points"], points)
    np.testing.assert_array_equal(field.hidden["footprint"], size)
    assert "hidden" not in all_terms(Known(field.answer, field.e), data, None, FitSettings(), None, hidden)


def test_pictures_teach_the_colour_of_uniform_parts_less(rng):
    """By 1 / (1 + uniform); all else as before."""
    data = batch(rng)
    data = Batch(**{**vars(data), "segment": torch.tensor([4, 2, 0])})
    uniform = torch.tensor([3.0, 0.5, 0.0])
    base, roughness, metallic = random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6)
    found = []
    for values in (torch.zeros(3), uniform):
        targets = goals((0.5, 0.5))
        targets.uniform[[4, 2, 0]] = values
        leaves = [x.clone().requires_grad_() for x in (base, roughness, metallic)]
        colour = all_terms(Known(Brdf(*leaves), torch.zeros(3)), data, None, FitSettings(evidence=0), targets)["colour"]
        colour.backward()
        found.append((colour.item(), *(x.grad for x in leaves)))
    (plain, *before), (weakened, *after) = found
    assert weakened == pytest.approx(plain, rel=1e-6)
    assert before[0].abs().min() > 0
    np.testing.assert_allclose(after[0], before[0] / (1 + uniform).repeat_interleave(2)[:, None], rtol=1e-4)
    for own, other in zip(before[1:], after[1:], strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-4)


def test_clipped_pixels_are_lower_bounds(rng):
    """They never teach the BRDF; the mask learns from them only where the model stays below."""
    base, e = random(rng, 6, 3).requires_grad_(), torch.full((3,), 0.1, requires_grad=True)
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    data = batch(rng)
    settings = FitSettings(evidence=0, emission_weight=0)

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
