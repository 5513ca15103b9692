"""The data term: the sRGB curve, samples gathered into pixels."""

import numpy as np
import torch

from fipt.formats.images import srgb_encode
from fipt.stages.fit.terms.data import gathered, srgb


def test_srgb_is_the_curve_and_goes_on_above_one():
    values = torch.tensor([0.0, 0.001, 0.0031308, 0.0032, 0.2, 1.0, 7.5])
    np.testing.assert_allclose(srgb(values), srgb_encode(values.numpy()), rtol=1e-5, atol=1e-7)
    assert srgb(torch.tensor(7.5)) > 2


def test_srgb_has_a_gradient_everywhere():
    values = torch.tensor([0.0, 1e-6, 0.0031308, 0.5, 3.0], requires_grad=True)
    srgb(values).sum().backward()
    assert torch.isfinite(values.grad).all()
    np.testing.assert_allclose(values.grad[:2], 12.92)
    assert (values.grad > 0).all()


def test_samples_are_gathered_by_weight():
    values = torch.tensor([[1.0, 2, 3], [10, 0, 0], [4, 4, 4]])
    got = gathered(values, torch.tensor([2, 0, 2]), torch.tensor([0.25, 1.0, 0.75]), 3)
    np.testing.assert_allclose(got, [[10, 0, 0], [0, 0, 0], [3.25, 3.5, 3.75]])
