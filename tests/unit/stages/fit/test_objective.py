"""All terms of a batch with their weights, by hand on tiny tensors."""

import numpy as np
import pytest
import torch

from fipt.conventions import SHADING_OUTPUTS
from fipt.formats.images import srgb_encode
from fipt.model.networks import SceneBox
from fipt.model.reflectance import Brdf, exceeds_reflection, reflected
from fipt.stages.fit.batches import Batch
from fipt.stages.fit.objective import Objective
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.targets import PartTargets
from fipt.stages.fit.terms.base_color_smoothness import base_color_smoothness
from fipt.stages.fit.terms.part_propagation import part_propagation
from fipt.stages.fit.terms.semantic_propagation import semantic_propagation


@pytest.fixture
def rng():
    return torch.Generator().manual_seed(5)


def random(rng, *shape, dtype=torch.float32):
    return torch.rand(*shape, generator=rng, dtype=dtype)


class Known:
    """A field whose answers are given: K points for materials, H for emission."""

    def __init__(self, brdf, e, there=None):
        self.answer, self.e, self.there, self.box = brdf, e, there, SceneBox((0, 0, 0), 2.0)
        self.asked = {}

    def brdf(self, points, footprint):
        self.asked = {"points": points, "footprint": footprint}
        if len(points) == len(self.answer.roughness):
            return self.answer
        return Brdf(
            *(torch.cat(both) for both in zip(vars(self.answer).values(), vars(self.there).values(), strict=True))
        )

    def emission(self, points):
        assert self.e is None or len(points) == len(self.e)
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


def goals(surface, weight=1.0, base=(0.5, 0.5, 0.5), uniform=0.0, segments=5):
    """Targets of every segment alike: ``surface`` is roughness and metallic."""
    values = (*surface, weight, base, uniform)
    return PartTargets(*(torch.tensor(value).expand(segments, *np.shape(value)).clone() for value in values))


def test_terms_of_a_batch(rng):
    data = batch(rng)
    brdf = Brdf(random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6))
    e = torch.tensor([-0.5, 0.3, 1.2])
    field = Known(brdf, e)
    weights = {"color_weight": 2.0, "emission_weight": 3.0, "diffuse_weight": 5.0, "part_weight": 7.0}
    settings = FitSettings(emission_threshold=0, footprint=0.5, **weights)
    terms = Objective(settings, "part").terms(field, data)
    assert set(terms) == {"color", "emission", "diffuse", "part"}

    radiance, specular = reflected(brdf, data.shading, 2)
    alpha = 1 - np.exp(-np.maximum(e.numpy(), 0))
    assert alpha[0] == 0
    seen = data.radiance.numpy()
    each = (1 - alpha[:, None]) * radiance.numpy() + alpha[:, None] * seen[[0, 1, 1]]
    pixel = np.stack([each[0], 0.25 * each[1] + 0.75 * each[2]])
    error = ((srgb_encode(pixel) - srgb_encode(seen)) ** 2).mean(axis=1)
    assert terms["color"].item() == pytest.approx(2.0 * (error[0] + 0.5 * error[1]) / 2, rel=1e-4)
    assert terms["emission"].item() == pytest.approx(3.0 * (0.5 + 0.3 + 1.2) / 3, rel=1e-5)
    s, m = (v.view(3, 2).mean(1) for v in (brdf.roughness, brdf.metallic))
    assert terms["diffuse"].item() == pytest.approx(5.0 * ((1 - s).mean() + m.mean()).item(), rel=1e-5)
    part = part_propagation(s, m, specular, data.segment)
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
    objective = Objective(FitSettings(emission_threshold=0), None)
    radiance, _ = reflected(brdf, data.shading, 2)
    seen = data.radiance.numpy()
    each = radiance.numpy()
    pixel = np.stack([each[0], 0.15 * each[1] + 0.45 * each[2] + beyond[1].numpy()])
    error = ((srgb_encode(pixel) - srgb_encode(seen)) ** 2).mean(axis=1)
    dark = objective.terms(Known(brdf, torch.full((3,), -1.0)), data)["color"].item()
    assert dark == pytest.approx((error[0] + 0.5 * error[1]) / 2, rel=1e-4)
    masked = objective.terms(Known(brdf, torch.full((3,), 50.0)), data)["color"].item()
    assert masked == pytest.approx(0, abs=1e-9)  # the mask explains all of it


def test_confidence_draws_doubtful_samples_to_their_part_and_lets_the_others_decide_it(rng):
    data = batch(rng)
    data = Batch(**{**vars(data), "confidence": torch.tensor([1.0, 0.0, 0.5])})
    s = torch.tensor([0.2, 0.2, 0.8, 0.8, 0.5, 0.5])
    field = Known(Brdf(random(rng, 6, 3), s, 0 * s + 0.3), torch.zeros(3))
    goal = goals((0.6, 0.3), weight=2.0)
    terms = Objective(FitSettings(confidence_weights=True, part_weight=1.0), "part", goal).terms(field, data)
    logit = np.abs(np.log([0.25, 4.0, 1.0]) - np.log(1.5))
    away = np.where(logit < 0.5, logit**2, logit - 0.25)
    assert terms["target"].item() == pytest.approx(2 * np.mean([0.5, 1.5, 1.0] * away), rel=1e-4)
    _, specular = reflected(field.answer, data.shading, 2)
    evidence = specular * data.confidence + 1e-4
    mean = (evidence * torch.tensor([0.2, 0.8, 0.5])).sum() / evidence.sum()
    spread = (torch.tensor([0.2, 0.8, 0.5]) - mean).abs().mean()
    assert terms["part"].item() == pytest.approx(spread.item(), rel=1e-4)
    plain = Objective(FitSettings(confidence_weights=False), "part", goal).terms(field, data)["target"]
    assert plain.item() == pytest.approx(2 * np.mean(away), rel=1e-4)


def test_kind_of_segments_decides_the_propagation(rng):
    data = batch(rng)
    field = Known(Brdf(random(rng, 6, 3), random(rng, 6), random(rng, 6)), torch.zeros(3))
    assert set(Objective(FitSettings(), None).terms(field, data)) == {"color", "emission", "diffuse"}
    semantic = Objective(FitSettings(semantic_weight=2.0), "semantic").terms(field, data)["semantic"]
    s, m, base = (
        v.view(3, 2, -1).mean(1).squeeze(-1)
        for v in (field.answer.roughness, field.answer.metallic, field.answer.base_color)
    )
    expected = semantic_propagation(s, m, base, data.points[:, 0], data.segment)  # the box is [-1, 1]
    assert semantic.item() == pytest.approx(2 * expected.item(), rel=1e-5)


def test_no_mask_is_a_mask_that_is_shut(rng):
    data = batch(rng)
    brdf = Brdf(random(rng, 6, 3), 0.1 + 0.8 * random(rng, 6), random(rng, 6))
    objective = Objective(FitSettings(), None)
    terms = objective.terms(Known(brdf, None), data)
    shut = objective.terms(Known(brdf, torch.full((3,), -1.0)), data)
    assert set(terms) == {"color", "diffuse"} == set(shut) - {"emission"}
    assert terms["color"].item() == shut["color"].item() > 0


@pytest.mark.parametrize("what", ["emitter", "clipped"])
def test_without_a_mask_pixels_that_tell_no_reflectance_count_for_nothing(rng, what):
    data = batch(rng)
    bright = torch.tensor([[0.2, 0.3, 0.4], [90.0, 90.0, 90.0]])
    data = Batch(**{**vars(data), "radiance": bright, "clipped": torch.tensor([False, what == "clipped"])})
    base = random(rng, 6, 3).requires_grad_()
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), None)
    settings = FitSettings(emission_threshold=1.5 if what == "emitter" else 0)
    color = Objective(settings, None).terms(field, data)["color"]
    color.backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0
    unweighted = Batch(**{**vars(data), "valid": torch.tensor([1.0, 0.0])})
    assert color.item() == Objective(settings, None).terms(field, unweighted)["color"].item() > 0


def test_evident_emitters_teach_only_the_mask(rng):
    data = batch(rng)
    bright = torch.tensor([[0.2, 0.3, 0.4], [90.0, 90.0, 90.0]])
    data = Batch(**{**vars(data), "radiance": bright})
    base = random(rng, 6, 3).requires_grad_()
    e = torch.full((3,), 0.1, requires_grad=True)
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    Objective(FitSettings(emission_threshold=1.5, emission_weight=0), None).terms(field, data)["color"].backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0
    assert (e.grad[1:] < 0).all()  # opening the mask there helps


@pytest.mark.parametrize("sign", ["mask", "brightness"])
def test_a_pixel_that_shows_an_emitter_in_part_does_not_teach_its_other_half(rng, sign):
    """Pixel 1 shows samples 1 and 2; only sample 1 emits."""
    data = batch(rng)
    base = random(rng, 6, 3).requires_grad_()
    e = torch.tensor([-1.0, 0.0, -1.0])
    if sign == "mask":
        e[1] = 0.2  # alpha = 0.18
    else:
        data.shading[1] = 0.05
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), e)
    assert exceeds_reflection(data.radiance[data.owner], data.shading, 1.5).tolist() == [
        False,
        sign == "brightness",
        False,
    ]
    Objective(FitSettings(emission_threshold=1.5), None).terms(field, data)["color"].backward()
    assert base.grad[:2].abs().min() > 0
    assert base.grad[2:].abs().max() == 0


def test_a_mask_that_is_hardly_open_is_no_emitter(rng):
    data = batch(rng)
    base = random(rng, 6, 3).requires_grad_()
    field = Known(Brdf(base, 0.5 * torch.ones(6), torch.zeros(6)), torch.tensor([-1.0, 0.1, -1.0]))  # alpha = 0.095
    Objective(FitSettings(emission_threshold=1.5), None).terms(field, data)["color"].backward()
    assert base.grad.abs().min() > 0


# --- what parts are drawn to ----------------------------------------------------------------------


def test_samples_are_drawn_to_the_colour_of_uniform_parts(rng):
    data = batch(rng)
    data = Batch(**{**vars(data), "segment": torch.tensor([4, 2, 0])})
    base = random(rng, 6, 3)
    field = Known(Brdf(base, random(rng, 6), random(rng, 6)), torch.zeros(3))
    targets = goals((0.5, 0.5))
    targets.base_color[[4, 2, 0]] = torch.tensor([[0.9, 0.1, 0.2], [0.3, 0.3, 0.3], [0.5, 0.5, 0.5]])
    targets.uniform[[4, 2, 0]] = torch.tensor([2.0, 0.5, 0.0])
    settings = FitSettings(base_weight=10.0, base_smoothness_weight=2.0)
    terms = Objective(settings, "part", targets).terms(field, data)
    assert set(terms) == {"color", "emission", "target", "base", "smoothness", "part"}
    a = base.numpy().reshape(3, 2, 3)
    first = 2.0 * ((a[0] - [0.9, 0.1, 0.2]) ** 2).sum() / 6
    second = 0.5 * ((a[1] - 0.3) ** 2).sum() / 6
    assert terms["base"].item() == pytest.approx(10 * (first + second) / 3, rel=1e-5)
    assert terms["smoothness"].item() == pytest.approx(2 * base_color_smoothness(base, 2).item(), rel=1e-5)


def test_unseen_points_are_drawn_to_all_of_their_part(rng):
    """Each as a sample would be; colour with at least weight 1, for no photograph shows another one."""
    data = batch(rng)
    there = Brdf(random(rng, 2, 3), torch.tensor([0.5, 0.2]), torch.tensor([0.5, 0.1]))
    field = Known(Brdf(random(rng, 6, 3), random(rng, 6), random(rng, 6)), torch.zeros(3), there)
    targets = goals((0.5, 0.5))
    targets.base_color[[3, 1]] = torch.tensor([[0.1, 0.2, 0.3], [0.6, 0.6, 0.6]])
    targets.uniform[[3, 1]] = torch.tensor([0.0, 4.0])
    targets.roughness[1], targets.metallic[1], targets.weight[1] = 0.8, 0.3, 2.0
    points, size = random(rng, 2, 3), torch.tensor([0.05, 0.05])
    hidden = (points, torch.tensor([3, 1]), size)
    terms = Objective(FitSettings(base_weight=10.0), None, targets).terms(field, data, hidden)
    a = there.base_color.numpy()
    base = 1.0 * ((a[0] - [0.1, 0.2, 0.3]) ** 2).mean() + 4.0 * ((a[1] - 0.6) ** 2).mean()
    # the first point has the roughness and metallic of its part; the second is far off in both
    prior = 2.0 * (np.log(4.0) - np.log(0.25) - 0.25 + np.log(3 / 7) - np.log(1 / 9) - 0.25)
    assert terms["hidden"].item() == pytest.approx((10 * base + prior) / 3, rel=1e-4)  # three samples
    np.testing.assert_array_equal(field.asked["points"][6:], points)
    np.testing.assert_array_equal(field.asked["footprint"][6:], size)
    assert "hidden" not in Objective(FitSettings(), None).terms(Known(field.answer, field.e), data, hidden)


def test_photographs_teach_the_colour_of_uniform_parts_less(rng):
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
        color = Objective(FitSettings(emission_threshold=0), None, targets).terms(
            Known(Brdf(*leaves), torch.zeros(3)), data
        )["color"]
        color.backward()
        found.append((color.item(), *(x.grad for x in leaves)))
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
    settings = FitSettings(emission_threshold=0, emission_weight=0)

    def learnt(radiance):
        base.grad = e.grad = None
        pixels = torch.tensor([[0.2, 0.3, 0.4], [radiance] * 3])
        clipped = Batch(**{**vars(data), "radiance": pixels, "clipped": torch.tensor([False, True])})
        loss = Objective(settings, None).terms(field, clipped)["color"]
        loss.backward()
        assert base.grad[:2].abs().min() > 0
        assert base.grad[2:].abs().max() == 0
        return loss.item(), e.grad[1:]

    low, gradient = learnt(0.001)  # any shading is brighter: nothing is wrong
    assert (gradient == 0).all()
    first = Objective(settings, None).terms(field, Batch(**{**vars(data), "valid": torch.tensor([1.0, 0.0])}))["color"]
    assert low == pytest.approx(first.item(), rel=1e-5)
    high, gradient = learnt(50.0)
    assert high > low
    assert (gradient < 0).all()
