"""Light that no view shows, second half: which unseen patches emit, and whether the photographs tell at all.

The radiance C_i of a block of seen surface is rho_g E_i, with one reflectance rho_g for all blocks of a group and
E = E_seen + T e (`fipt.stages.emitters.unseen`). What is minimised, in logarithms, is

    (1 / tau) sum_i student((ln C_i - ln rho_g - ln E_i) / sigma) + prior of the reflectances

over e >= 0 and ln rho. Patches are added one by one, the best first, as long as the gain pays for them: each costs
ln(sqrt(N / tau) / p), the extended Bayesian information criterion (Chen and Chen 2008), p being how likely it was
beforehand: half of that is the same for all patches to choose from, half goes by the area of cells. sigma is measured:
the spread of what is left. tau says how many neighbouring blocks err alike, so that N / tau of them count; it is
measured, too. Rooms whose shading is merely 5 to 15 % off therefore have no guess.

With no emitter in any view the scale of the light hangs on what seen surface gives to seen surface, which is measured,
and on the prior of the reflectances.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse import csr_matrix

from fipt.scene.surface_blocks import (
    ABOVE,
    FREEDOM,
    GLOSSY,
    LEAST_SIGMA,
    MIDDLE,
    MIDDLE_SPREAD,
    WHITE,
    WITHIN,
    Blocks,
    errors_alike,
)
from fipt.stages.emitters.reflectance_fit import Minimum, Problem, minimum, most_given
from fipt.stages.emitters.unseen import Transport
from fipt.stages.emitters.unseen_surface import Patches

_COLOR, _LEAN = 0.2, 0.15
"""Standard deviation of the log of a channel about grey: of lights, and of the mean reflectance of a room."""
_ERROR = 0.15
"""Relative error of the light in rooms whose emitters are all seen (docs/measurements/accuracy.md)."""
_UNSURE = 0.5
"""Relative standard deviation of the power above which nothing is guessed: 0 is then within two of them.

With `_ERROR` it says that without other evidence less than 30 % of the light is never guessed.
"""
_TRIED = 16
"""Patches that are tried at several brightnesses before one is added."""
_NEVER = 1e6
"""Nats that no patch could make up for: those that can only add to the cost come last."""
_AMPLITUDES = np.geomspace(0.02, 50, 14)
"""Of one patch's share, relative to the light that there is."""


@dataclass(frozen=True)
class SearchSpace:
    """Where a guess was searched.

    Attributes
    ----------
    choices
        Among how many patches and joins of patches.
    area
        Of all of them, square metres.
    """

    choices: int = 1
    area: float = 0.0

    def with_patches(self, patches: Patches, choices: int) -> "SearchSpace":
        """The larger of this and the space of some patches that are, alone or joined, so many ``choices``."""
        return SearchSpace(max(self.choices, choices), max(self.area, float(patches.area.sum())))

    def odds(self, patches: Patches, members: np.ndarray) -> np.ndarray:
        """(Q,) logarithms of the odds against candidates of which ``members`` (P, Q) has the patches.

        Half of how likely a cell is goes by number, half by its area: a lamp may be anywhere, so that a whole cell
        holds it rather than a scrap of one. Small parts, and what is joined, are things: as likely as any.
        """
        any_ = 1 / self.choices
        cell = ((members > 0).sum(axis=0) == 1) & (members * patches.of_small_parts[:, None] == 0).all(axis=0)
        by_area = np.where(cell, patches.area @ members / max(self.area, 1e-12), any_)
        return -np.log(0.5 * any_ + 0.5 * by_area)


@dataclass(frozen=True)
class Guess:
    """What unseen surface emits.

    Attributes
    ----------
    radiance
        (P, 3) of each patch; zero where nothing is guessed.
    spread
        Relative standard deviation of the whole power.
    share
        Median share of the light of the blocks that is guessed.
    gain
        Gain of the criterion over the room without it, in nats; nothing is guessed below 0.
    left, before
        Median absolute log residual times 1.48: with the guess, and without; 0 where too few blocks tell.
    determined
        Whether the guess is to be used.
    errors
        sigma (relative error of a block's light) and tau (blocks that err alike) of what is left.
    space
        Where it was searched.
    """

    radiance: np.ndarray
    spread: float = 0.0
    share: float = 0.0
    gain: float = 0.0
    left: float = 0.0
    before: float = 0.0
    determined: bool = False
    errors: tuple[float, float] = (0.15, 1.0)
    space: SearchSpace = field(default_factory=SearchSpace)

    @property
    def even_before(self) -> bool:
        """Whether the light without the guess is known, and wrong by no more than in rooms where none is missing."""
        return 0 < self.before <= _ERROR


@dataclass(frozen=True)
class Start:
    """Where a search begins: with what a search before it found, as a rule among larger patches.

    Attributes
    ----------
    columns
        Columns of `Patches.candidates` that emitted there.
    errors
        sigma and tau there: only gains of the same are compared.
    measured
        Whether light from them is known by many rays: then none stays that few blocks alone tell.
    """

    columns: tuple[int, ...]
    errors: tuple[float, float]
    measured: bool = False

    @classmethod
    def of_all(cls, patches: Patches, guess: Guess) -> "Start":
        """All ``patches``, which are those that a ``guess`` found."""
        return cls(tuple(range(patches.candidates.shape[1])), guess.errors, True)


def explained(blocks: Blocks, transport: Transport) -> bool:
    """Whether seen light explains the radiance of the blocks: evenly, and by reflectances that rooms have.

    ``transport`` is without patches.
    """
    light = transport.seen.mean(axis=1)
    use = np.flatnonzero((blocks.spread < GLOSSY) & (light > 1e-3 * np.median(light)))
    if len(use) == 0:
        return True
    _, group = np.unique(blocks.group[use], return_inverse=True)
    problem = Problem(np.log(blocks.radiance[use].mean(axis=1)), light[use], np.zeros((len(use), 0)), group)
    state = minimum(problem, ())
    return state.scale(problem) <= _ERROR and state.middle <= MIDDLE + 2 * MIDDLE_SPREAD


def explain(
    blocks: Blocks,
    patches: Patches,
    transport: Transport,
    asked: bool = False,
    start: Start | None = None,
    space: SearchSpace | None = None,
) -> Guess:
    """Find the emission of unseen patches that explains the radiance of the blocks best, if any does.

    Light may be local if ``asked``: something else says that light is missing. Then light is wrong by `_ERROR` from
    place to place. Else it may be so as a whole, and a guess must matter in half of the room. Without ``start``
    the search begins with nothing, and measures its errors. Patches that were found in a larger ``space`` than they are
    now pay for all of that search.
    """
    nothing = Guess(np.zeros((len(patches.area), 3)))
    light = transport.seen.mean(axis=1)
    lit = light > 1e-3 * np.median(light) if len(light) else np.zeros(0, bool)
    use = np.flatnonzero((blocks.spread < GLOSSY) & (lit | (transport.unseen.sum(axis=1) > 0)))
    members = patches.candidates
    if len(use) < max(2 * len(np.unique(blocks.group[use])), 1):
        return nothing
    _, group = np.unique(blocks.group[use], return_inverse=True)
    floor = 1e-3 * max(float(np.median(light[use])), 1e-9)
    given = transport.unseen[use] @ members
    log_color = np.log(blocks.radiance[use].mean(axis=1))
    space = (space or SearchSpace()).with_patches(patches, given.shape[1])
    problem = Problem(log_color, np.maximum(light[use], floor), given, group, odds=space.odds(patches, members))
    if start is None:
        before, after, problem = searched(problem, blocks.position[use, 0])
    else:
        problem = replace(problem, sigma=start.errors[0], tau=start.errors[1])
        before, after = minimum(problem, ()), _best(problem, start.columns)
    after = _joined(problem, after, members)
    if start is not None and start.measured:
        after = _without_local_errors(problem, after)
    gain = before.cost - _criterion(after, problem) if after.support else 0.0
    if not after.support or gain <= 0:
        left = before.scale(problem)
        return replace(nothing, gain=float(min(gain, 0.0)), left=left, before=left, space=space)
    chosen = members[:, list(after.support)]
    whole = chosen @ after.radiance
    share = float(np.median(1 - problem.seen / after.light(problem)))
    spread = _power_spread(after, problem, patches.area @ chosen)
    if asked:
        spread *= max(1.0, _ERROR / problem.sigma)
    else:  # the guess would make up for light that is off as in rooms without unseen emitters
        spread = float(np.hypot(spread, _ERROR / max(share, 1e-9)))
    color = _color(blocks.radiance[use], transport.seen[use], problem, after)
    return Guess(
        whole[:, None] * color,
        spread=spread,
        share=share,
        gain=float(gain),
        left=after.scale(problem),
        before=before.scale(problem),
        determined=bool(spread < _UNSURE and after.middle >= _darkest(before)),
        errors=(problem.sigma, problem.tau),
        space=space,
    )


def _darkest(before: Minimum) -> float:
    """Least mean log reflectance that a guess may leave: that of rooms, or of this one without it, less an error.

    Much more light than is seen makes its errors small, and all surface black.
    """
    return min(MIDDLE - 2 * MIDDLE_SPREAD, before.middle) - _ERROR


def witnessed(guess: Guess, blocks: Blocks, patches: Patches, transport: Transport, asks: np.ndarray) -> Guess:
    """The guess, if more tells of it than how bright the blocks are that ask for light, (N,) bool; else none.

    What asks may emit, or be lit by a lamp: its brightness cannot say which. How that changes from place to place can,
    and so can other surface. So each group of it is as bright as is usual under the light that is seen.
    """
    if not guess.determined:
        return guess
    group, level = blocks.group + asks * (blocks.group.max() + 1), np.log(blocks.radiance.mean(axis=1))
    level -= np.log(np.maximum(transport.seen.mean(axis=1), 1e-12))
    factor = np.ones(len(asks))
    for k in np.unique(group[asks]):
        factor[group == k] = np.exp(MIDDLE - np.median(level[group == k]))
    usual = replace(blocks, group=group, radiance=blocks.radiance * factor[:, None])
    found = explain(usual, patches, transport, True, Start.of_all(patches, guess), guess.space)
    return guess if found.determined else found


def searched(problem: Problem, place: np.ndarray) -> tuple[Minimum, Minimum, Problem]:
    """The minimum without any patch, that with the best patches, and the problem with its measured errors."""
    for _ in range(2):  # the errors are known when the light is
        state = _best(problem, ())
        left = state.residual(problem)
        sigma = max(state.scale(problem), LEAST_SIGMA)
        problem = replace(problem, sigma=sigma, tau=errors_alike(left / sigma, place))
    start, state = minimum(problem, ()), minimum(problem, state.support, state)
    return start, state, problem


def _best(problem: Problem, first: tuple[int, ...]) -> Minimum:
    """Add patches to the ``first`` ones as long as they are worth their price, then leave out or exchange each."""
    state = minimum(problem, first)
    while len(state.support) < problem.unseen.shape[1]:
        wider = minimum(problem, (*state.support, _next(problem, state)), state)
        if _criterion(wider, problem) >= _criterion(state, problem):
            break
        state = wider
    for patch in state.support:
        fewer = minimum(problem, tuple(k for k in state.support if k != patch))
        other = minimum(problem, (*fewer.support, _next(problem, fewer)), fewer)
        state = min((fewer, state, other), key=lambda each: _criterion(each, problem))
    return state


def _joined(problem: Problem, state: Minimum, members: np.ndarray) -> Minimum:
    """Put pieces in the place of their patches where that costs less; patches were added one by one."""
    for piece in range(len(members), members.shape[1]):
        rest = tuple(k for k in state.support if not members[:, piece] @ members[:, k] or k == piece)
        if piece in rest or len(rest) == len(state.support):
            continue
        whole = minimum(problem, (*rest, piece))
        if _criterion(whole, problem) <= _criterion(state, problem):
            state = whole
    return state


def _without_local_errors(problem: Problem, state: Minimum) -> Minimum:
    """Leave out patches, one by one, that are worth their price by few blocks alone.

    A single error of the light is that of `Problem.tau` blocks: without as many, those that gain most, a patch must
    still be worth it.
    """
    alike = round(problem.tau)
    while state.support:
        fewer = [minimum(problem, tuple(k for k in state.support if k != patch)) for patch in state.support]
        gains = [each.cost_of_blocks(problem) - state.cost_of_blocks(problem) for each in fewer]
        most = np.array([np.maximum(np.sort(gain)[-alike:], 0).sum() for gain in gains])
        worth = np.array([each.cost for each in fewer]) - state.cost - most
        worth -= _prices(problem)[list(state.support)]
        if worth.min() >= 0:
            break
        state = fewer[int(worth.argmin())]
    return state


def _criterion(state: Minimum, problem: Problem) -> float:
    """Cost of a minimum and of its patches."""
    return state.cost + float(_prices(problem)[list(state.support)].sum())


def _prices(problem: Problem) -> np.ndarray:
    """(P,) what each patch must gain."""
    return 0.5 * np.log(len(problem.seen) / problem.tau) + problem.odds


def _next(problem: Problem, state: Minimum) -> int:
    """The patch that gains most beyond its price when it is added alone, reflectances following.

    The most promising ones by slope and curvature where they are dark are tried at several brightnesses.
    """
    light, groups = state.light(problem), problem.groups
    members = csr_matrix((np.ones(len(light)), (problem.group, np.arange(len(light)))), shape=(groups, len(light)))
    noise = problem.sigma**2 * problem.tau
    size = np.bincount(problem.group, minlength=groups) / noise
    r = state.residual(problem) / problem.sigma
    weight = (FREEDOM + 1) / (FREEDOM + r * r) / noise
    change = problem.unseen / light[:, None]
    mean = (members @ (weight[:, None] * change)) / ((members @ weight) + 1 / WITHIN**2)[:, None]
    change -= mean[problem.group]
    slope = (weight * r * problem.sigma) @ change
    # a group that is brighter than white asks for light by itself
    slope += (np.maximum(state.log_rho - WHITE, 0) / ABOVE**2) @ mean
    promise = np.where(slope > 0, 0.5 * slope**2 / np.maximum(weight @ change**2, 1e-12) - problem.odds, -_NEVER)
    promise[list(state.support)] = -2 * _NEVER
    best, chosen = np.inf, int(np.argmax(promise))
    for patch in np.argsort(-promise)[: min(_TRIED, len(promise) - len(state.support))]:
        given = problem.unseen[:, patch]
        unit = float(np.median(light)) / float(most_given(given))
        y = problem.log_color[:, None] - np.log(light[:, None] + given[:, None] * (unit * _AMPLITUDES))
        g = state.log_rho[:, None] + 0 * _AMPLITUDES
        for _ in range(2):  # towards each group's mean, outliers counting less
            own = 1 / (1 + ((y - g[problem.group]) / problem.sigma) ** 2 / FREEDOM) / noise
            g = (members @ (own * y)) + state.middle / WITHIN**2
            g /= (members @ own) + 1 / WITHIN**2
            g = np.minimum(g, WHITE + ABOVE / np.sqrt(np.maximum(size, 1e-9))[:, None])
        left = (y - g[problem.group]) / problem.sigma
        cost = 0.5 * (FREEDOM + 1) * np.log1p(left * left / FREEDOM).sum(axis=0) / problem.tau
        cost += 0.5 * (((g - state.middle) / WITHIN) ** 2).sum(axis=0)
        least = float(cost.min()) + problem.odds[patch]
        if least < best:
            best, chosen = least, int(patch)
    return chosen


def _power_spread(state: Minimum, problem: Problem, area: np.ndarray) -> float:
    """Relative standard deviation of the whole power: Laplace's approximation, the reflectances being free."""
    light, count, groups = state.light(problem), len(state.support), problem.groups
    jacobian = np.zeros((len(light), count + groups + 1))
    jacobian[:, :count] = problem.unseen[:, list(state.support)] / light[:, None]
    jacobian[np.arange(len(light)), count + problem.group] = 1
    r = state.residual(problem) / problem.sigma
    weight = (FREEDOM + 1) / (FREEDOM + r * r) / problem.sigma**2 / problem.tau
    normal = (jacobian * weight[:, None]).T @ jacobian
    diagonal = np.arange(count, count + groups)
    normal[diagonal, diagonal] += 1 / WITHIN**2 + (state.log_rho > WHITE) / ABOVE**2
    normal[diagonal, -1] -= 1 / WITHIN**2
    normal[-1, diagonal] -= 1 / WITHIN**2
    normal[-1, -1] += groups / WITHIN**2 + 1 / MIDDLE_SPREAD**2
    power = np.concatenate([area, np.zeros(groups + 1)])
    variance = float(power @ np.linalg.pinv(normal, hermitian=True) @ power)
    return float(np.sqrt(max(variance, 0.0)) / max(float(area @ state.radiance), 1e-12))


def _color(radiance: np.ndarray, seen: np.ndarray, problem: Problem, state: Minimum) -> np.ndarray:
    """(3,) colour of what is guessed, of mean 1.

    It is told by surface of one colour that guessed light reaches unevenly. Beyond that, reflectances of a room are
    grey on the mean within `_LEAN`, and so are lights within `_COLOR`.
    """
    given = state.light(problem) - problem.seen
    scales, groups = np.geomspace(0.4, 2.5, 61), problem.groups
    size = np.bincount(problem.group, minlength=groups)
    found = np.ones(3)
    for c in range(3):
        cost = 0.5 * (np.log(scales) / _COLOR) ** 2
        for k, scale in enumerate(scales):
            light = np.maximum(seen[:, c], 1e-3 * np.median(problem.seen)) + scale * given
            y = np.log(np.maximum(radiance[:, c], 1e-6)) - np.log(light) - state.log_rho[problem.group]
            tint = np.bincount(problem.group, y, groups) / size
            left = (y - tint[problem.group]) / problem.sigma
            cost[k] += 0.5 * (tint.mean() / _LEAN) ** 2
            cost[k] += 0.5 * (FREEDOM + 1) * np.log1p(left**2 / FREEDOM).sum() / problem.tau
        found[c] = scales[int(np.argmin(cost))]
    return found / found.mean()
