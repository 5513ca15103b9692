"""Light and reflectances that explain the radiance of blocks of seen surface: the cost, and its minimum."""

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize

from fipt.robust import deviation
from fipt.scene.surface_blocks import ABOVE, FREEDOM, MIDDLE, MIDDLE_SPREAD, WHITE, WITHIN

_LEAST_LIGHT = 0.1
"""Share of its light that a cluster gives at least."""


@dataclass(frozen=True)
class Problem:
    """N blocks in G groups, P patches, K clusters of emitters the size of which is not sure; one channel.

    ``log_color`` (N,), ``seen`` (N,), ``unseen`` (N, P), ``group`` (N,), ``sigma``, ``tau``; ``clusters`` (N, K) what
    of the seen light comes straight from each, ``unsure`` (K,) their relative standard deviation beforehand.
    ``odds`` (P,) are the logarithms of those against each patch.
    """

    log_color: np.ndarray
    seen: np.ndarray
    unseen: np.ndarray
    group: np.ndarray
    sigma: float = 0.15
    tau: float = 1.0
    clusters: np.ndarray | None = None
    unsure: np.ndarray = field(default_factory=lambda: np.zeros(0))
    odds: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def groups(self) -> int:
        """G."""
        return int(self.group.max(initial=-1)) + 1

    def light(self, given: np.ndarray, more: np.ndarray) -> np.ndarray:
        """(N,) irradiance over pi, with what patches have ``given`` (N,) and clusters give beyond their light (K,)."""
        return self.seen + given + (0 if self.clusters is None else self.clusters @ more)


@dataclass(frozen=True)
class Minimum:
    """A minimum: radiance of the patches in ``support``, log reflectances, the room's mean of these, the cost.

    ``more`` (K,) is the share of their light that clusters give beyond it.
    """

    support: tuple[int, ...]
    radiance: np.ndarray
    log_rho: np.ndarray
    middle: float
    cost: float
    more: np.ndarray

    def light(self, problem: Problem) -> np.ndarray:
        """(N,) irradiance over pi."""
        return problem.light(problem.unseen[:, list(self.support)] @ self.radiance, self.more)

    def residual(self, problem: Problem) -> np.ndarray:
        """(N,) log residual."""
        return problem.log_color - self.log_rho[problem.group] - np.log(self.light(problem))

    def cost_of_blocks(self, problem: Problem) -> np.ndarray:
        """(N,) what each block's residual costs."""
        r = self.residual(problem) / problem.sigma
        return 0.5 * (FREEDOM + 1) * np.log1p(r * r / FREEDOM) / problem.tau

    def scale(self, problem: Problem) -> float:
        """Spread of the residuals, by their median."""
        return float(deviation(self.residual(problem)))


def minimum(problem: Problem, support: tuple[int, ...], start: Minimum | None = None) -> Minimum:
    """Minimise the cost over the radiance of some patches, what clusters give beyond, and all reflectances."""
    count, groups = len(support), problem.groups
    given, own = problem.unseen[:, list(support)], count + len(problem.unsure)
    begin = np.concatenate([np.zeros(own), np.full(groups, MIDDLE), [MIDDLE]])
    unit = np.ones(count)
    if count:  # a unit of radiance doubles the light of the blocks that a patch lights most
        unit = float(np.median(problem.seen)) / most_given(given)
    if start is not None:
        begin[count:] = np.concatenate([start.more / problem.unsure, start.log_rho, [start.middle]])
        begin[: len(start.radiance)] = start.radiance / unit[: len(start.radiance)]
        begin[len(start.radiance) : count] = 0.3

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        beyond, g, middle = x[count:own], x[own:-1], x[-1]  # in standard deviations
        light = problem.light(given @ (x[:count] * unit), beyond * problem.unsure)
        r = (problem.log_color - g[problem.group] - np.log(light)) / problem.sigma
        q = 1 + r * r / FREEDOM
        slope = (FREEDOM + 1) * r / FREEDOM / q / problem.sigma / problem.tau
        z, above = (g - middle) / WITHIN, np.maximum(g - WHITE, 0) / ABOVE
        value = 0.5 * (FREEDOM + 1) * np.log(q).sum() / problem.tau + 0.5 * (z @ z + above @ above + beyond @ beyond)
        value += 0.5 * ((middle - MIDDLE) / MIDDLE_SPREAD) ** 2
        of_clusters = 0 if problem.clusters is None else problem.clusters.T @ (slope / light)
        of_g = z / WITHIN + above / ABOVE - np.bincount(problem.group, slope, groups)
        of_middle = (middle - MIDDLE) / MIDDLE_SPREAD**2 - z.sum() / WITHIN
        return float(value), np.concatenate(
            [-(given.T @ (slope / light)) * unit, beyond - of_clusters * problem.unsure, of_g, [of_middle]]
        )

    least = [((_LEAST_LIGHT - 1) / unsure, None) for unsure in problem.unsure]
    bounds = [(0, None)] * count + least + [(None, None)] * (groups + 1)
    options = {"maxiter": 300, "ftol": 1e-7}
    found = minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    x = found.x
    return Minimum(support, x[:count] * unit, x[own:-1], float(x[-1]), float(found.fun), x[count:own] * problem.unsure)


def most_given(given: np.ndarray) -> np.ndarray:
    """(P,) what patches of unit radiance give to the blocks that they light most, of all that they light (N, P).

    Blocks that get less than a hundredth of the most do not count: a lamp behind a door lights few of a room's.
    """
    lit = given >= 0.01 * given.max(axis=0)
    return np.maximum(np.nanquantile(np.where(lit, given, np.nan), 0.95, axis=0), 1e-6)
