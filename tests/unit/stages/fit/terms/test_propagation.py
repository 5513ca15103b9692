"""Both propagations, by hand on tiny tensors."""

import numpy as np
import pytest
import torch

from fipt.stages.fit.terms.part_propagation import part_propagation
from fipt.stages.fit.terms.semantic_propagation import semantic_propagation


@pytest.fixture
def rng():
    return torch.Generator().manual_seed(5)


def random(rng, *shape, dtype=torch.float32):
    return torch.rand(*shape, generator=rng, dtype=dtype)


def test_part_means_are_weighted_by_specular_radiance():
    s, m = torch.tensor([0.2, 0.8, 0.3, 0.5, 0.9]), torch.tensor([0.0, 1.0, 0.4, 0.3, 0.7])
    specular, segment = torch.tensor([3.0, 1.0, 0.5, 2.0, 5.0]), torch.tensor([7, 7, 7, 65535, 0])
    w = np.array([3.0, 1.0, 0.5]) + 1e-4
    expected = 0.0
    for values in (np.array([0.2, 0.8, 0.3]), np.array([0.0, 1.0, 0.4])):
        expected += np.abs(values - (w * values).sum() / w.sum()).sum() / 4  # four samples are of a part
    assert part_propagation(s, m, specular, segment).item() == pytest.approx(expected, rel=1e-5)


def test_gradients_of_part_propagation(rng):
    """Through the mean too; but nobody dims a highlight to please the mean."""
    s, m = (random(rng, 8, dtype=torch.float64).requires_grad_() for _ in range(2))
    specular = random(rng, 8, dtype=torch.float64).requires_grad_()
    segment = torch.tensor([1, 1, 1, 2, 2, 2, 2, 0])
    assert torch.autograd.gradcheck(lambda s, m: part_propagation(s, m, specular, segment), (s, m))
    part_propagation(s, m, specular, segment).backward()
    assert specular.grad is None
    assert s.grad[-1] == 0


def test_alike_samples_cost_nothing_and_neither_do_unknown_ones():
    segment = torch.tensor([1, 1, 2])
    s, m = torch.tensor([0.4, 0.4, 0.9]), torch.tensor([0.1, 0.1, 1.0])
    assert part_propagation(s, m, torch.ones(3), segment).item() == pytest.approx(0, abs=1e-6)
    assert part_propagation(s, m, torch.ones(3), 0 * segment).item() == 0
    assert semantic_propagation(s, m, torch.rand(3, 3), torch.zeros(3, 3), 0 * segment).item() == 0


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
    got = semantic_propagation(s, m, color, x, segment)
    assert got.item() == pytest.approx(expected, rel=1e-4)


def test_semantic_weights_pass_no_gradient(rng):
    s = random(rng, 6).requires_grad_()
    color = (0.01 * random(rng, 6, 3)).requires_grad_()
    segment = torch.ones(6, dtype=torch.int64)
    semantic_propagation(s, random(rng, 6), color, torch.zeros(6, 3), segment).backward()
    assert color.grad is None
    assert s.grad.abs().sum() > 0
