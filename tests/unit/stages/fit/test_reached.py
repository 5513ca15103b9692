"""Networks that have not come to what the search found are named."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fipt.model.reflectance import Brdf
from fipt.stages.fit.reached import metallic_missed, said_of

PARTS = np.array([0.0, 1.0, 0.0])
"""Metallic of no segment, of a metal and of paint."""


class _Batch(SimpleNamespace):
    """What is asked of a batch, once it is where the field is."""

    def to(self, device):
        assert device == torch.device("cpu")
        return SimpleNamespace(**self.there)


class _Pixels:
    """100 pixels of one sample each: 20 of a metal, 70 of paint, 10 of no segment."""

    def __len__(self):
        return 100

    def batch(self, chosen, queries, rng):
        segment = torch.tensor([1] * 20 + [2] * 70 + [0] * 10)[chosen]
        ones = torch.ones(len(chosen))
        there = {"points": torch.zeros(len(chosen), 1, 3), "footprint": ones, "weight": ones, "segment": segment}
        return _Batch(there=there)


def _field(metal, paint):
    metallic = torch.tensor([metal] * 20 + [paint] * 70 + [0.5] * 10)
    return SimpleNamespace(
        device=torch.device("cpu"),
        brdf=lambda points, footprint: Brdf(torch.zeros(100, 3), torch.ones(100), metallic),
    )


@pytest.mark.parametrize(("metal", "paint", "share"), [(0.98, 0.0, 0.0), (0.5, 0.0, 0.2), (0.9, 0.4, 0.7)])
def test_pixels_that_are_not_what_their_part_is(metal, paint, share):
    missed = metallic_missed(_field(metal, paint), _Pixels(), PARTS, 0.5)
    assert missed == pytest.approx(share)
    assert bool(said_of(missed)) == (share > 0)
