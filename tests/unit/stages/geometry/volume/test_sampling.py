"""Where rays are sampled: the bound on the error of opacity, and quantiles."""

import torch

from fipt.stages.geometry.volume.density import laplace_density
from fipt.stages.geometry.volume.rendering import weights
from fipt.stages.geometry.volume.sampling import bounded_width, error_bound, quantiles, spread


def towards_a_wall(samples: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Distances along two rays, straight and slanted, and those to a wall that they meet at 1."""
    t = torch.linspace(0, 1.5, samples, dtype=torch.float64).repeat(2, 1)
    return t, torch.tensor([[1.0], [0.4]], dtype=torch.float64) * (1 - t)


def opacity(t: torch.Tensor, distance: torch.Tensor, beta: torch.Tensor) -> torch.Tensor:
    return 1 - torch.exp(-(laplace_density(distance[:, :-1], beta) * t.diff(dim=1)).cumsum(dim=1))


def test_the_opacity_is_not_wrong_by_more_than_the_bound():
    few, many = towards_a_wall(31), towards_a_wall(30 * 200 + 1)
    for width in (0.05, 0.1, 0.3):
        beta = torch.full((2, 1), width, dtype=torch.float64)
        off = (opacity(*few, beta) - opacity(*many, beta)[:, 199::200]).abs()
        assert (off <= error_bound(*few, beta)).all()


def test_the_width_is_the_smallest_that_keeps_to_the_bound():
    t, distance = towards_a_wall(31)
    least = torch.full((2, 1), 1e-3, dtype=torch.float64)
    width = bounded_width(t, distance, least, 0.1)
    assert (width > least).all()
    assert (error_bound(t, distance, width).amax(dim=1) <= 0.1).all()
    assert (error_bound(t, distance, 0.98 * width).amax(dim=1) > 0.1).all()
    wide = torch.full_like(least, 1.0)
    torch.testing.assert_close(bounded_width(t, distance, wide, 0.1), wide)


def test_quantiles_follow_the_weights():
    edges = torch.tensor([[0.0, 1.0, 3.0, 4.0]])
    share = spread(torch.zeros(1), torch.ones(1), torch.full((1, 1000), 0.5))
    found = quantiles(edges, torch.tensor([[1.0, 0.0, 3.0]]), share)
    assert (found.diff(dim=1) >= 0).all()
    assert abs(float((found < 1).float().mean()) - 0.25) < 2e-3
    assert float(((found > 1.01) & (found < 2.99)).float().mean()) < 2e-3


def test_weights_of_a_ray_sum_to_one_and_gather_at_the_surface():
    t, distance = towards_a_wall(301)
    weight = weights(t, laplace_density(distance, torch.tensor(0.005)))
    torch.testing.assert_close(weight.sum(dim=1), torch.ones(2, dtype=torch.float64))
    assert ((weight * t).sum(dim=1) - 1).abs().max() < 0.03
