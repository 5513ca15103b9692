"""Directions that no pixel looks along, but from which light comes: what they send is told by what it does in the room.

The radiance C_i of a block of seen surface is rho_g E_i, with one reflectance rho_g for all blocks of a group, and

    E_i = I_i + sum over seen directions of w_it S_t + sum over unseen directions of w_it exp(u_t)

with the irradiance over pi I_i that seen surface gives (the radiance cache has it, whatever lights it), the share w_it
of a block's cosine lobe that leaves the mesh along a texel of the map, and the radiance S_t of texels that pixels see.
The logarithms u of the others minimise

    (1 / tau) sum_i student((ln C_i - ln rho_g - ln E_i) / sigma) + prior of the reflectances
        + 1/2 sum over neighbouring texels of (difference of u)^2

for all reflectances, too. The last term is a membrane: without light in the room the map is continued smoothly. Its
weight of 1 says that the log radiance of places of the sky 45 degrees apart differs by about 1: the variance of a
membrane's difference over r texels is about (ln r + 1.6) / pi, with r = 8 for a map of 32 rows. Sigma, the spread of
what is left, and tau, how many neighbouring blocks err alike, are measured. No fit of materials is needed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize
from scipy.sparse import csr_matrix

from fipt.render.directions import even_cosine_directions
from fipt.render.scene import RayScene
from fipt.robust import deviation
from fipt.scene.environment import EnvironmentMap
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
from fipt.scene.voxels import SeenRadiance

_SMOOTH = 1.0, 3.0
"""Weights of differences between neighbouring texels: of the mean of the channels, and of each channel about it."""
_RAYS = 256
"""Rays from each of a block's four samples: the error of its light is then 3 % of the spread of what it sees."""
_COLORED = 0.3
"""Standard deviation of the log reflectance of a channel about the mean of all three."""
_LEAN = 0.15
"""The same of the mean over all surfaces of a room."""
_DIM = 1e-3
"""Radiance that a texel has at least, in means of the seen ones or medians of the room: night is no logarithm's end."""
_START = 0.1
"""Radiance of an unseen texel at which the search begins at least, in medians of the room: from 0 it finds no slope."""
_BRIGHT = np.log(4.0)
"""Log radiance over light, about its median over the blocks, above which a block emits: a white wall has 2.3 times what
grey ones have, and light is not wrong by as much again."""
_PASSES = 3
"""Fits, each with the errors that the one before measured."""
_LIMIT = 20.0
"""Log radiance that the search does not leave."""


@dataclass(frozen=True)
class RoomLight:
    """Where the light of N blocks comes from.

    Attributes
    ----------
    inside
        (N, 3) irradiance over pi of seen surface.
    outside
        (N, T) share of each block's cosine lobe that leaves the mesh along each texel of the map.
    """

    inside: np.ndarray
    outside: csr_matrix

    def under(self, radiance: np.ndarray) -> np.ndarray:
        """(N, 3) irradiance over pi with a map of radiance (h, w, 3) around the room."""
        return self.inside + self.outside @ radiance.reshape(-1, 3).astype(np.float64)


@dataclass(frozen=True)
class _SkyProblem:
    """N matte blocks in G groups, and the map around their room; ``light`` is that of surface and of seen texels.

    ``free`` (F,) numbers of the unseen texels, ``given`` (N, F) their share of the blocks' lobes, ``fixed`` (T, 3) log
    radiance where texels are seen, ``edges`` two texels and their weight, each (E,).
    """

    log_color: np.ndarray
    light: np.ndarray
    group: np.ndarray
    given: csr_matrix
    free: np.ndarray
    fixed: np.ndarray
    edges: tuple[np.ndarray, np.ndarray, np.ndarray]
    sigma: float = 0.15
    tau: float = 1.0

    @property
    def groups(self) -> int:
        return int(self.group.max(initial=-1)) + 1

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Log radiance (F, 3), log reflectances (G, 3) and the room's mean of these (3,)."""
        rows = x.reshape(-1, 3)
        return rows[: len(self.free)], rows[len(self.free) : -1], rows[-1]

    def residual(self, x: np.ndarray) -> np.ndarray:
        """(N, 3) log residual."""
        u, rho, _ = self.split(x)
        return self.log_color - rho[self.group] - np.log(self.light + self.given @ np.exp(u))


def room_light(
    blocks: Blocks,
    scene: RayScene,
    cache: Mapping[str, np.ndarray],
    empty: EnvironmentMap,
    rays: int = _RAYS,
) -> RoomLight:
    """Trace where the light of the blocks comes from, by rays of each of their samples.

    ``empty`` is a map of the size and the axes that are wanted.
    """
    seen, rng = SeenRadiance(cache), np.random.default_rng(0)
    rows, points = blocks.position.shape[:2]
    height, width = empty.radiance.shape[:2]
    inside, row_out, texel_out = np.zeros((rows, 3)), [], []
    row, shift = np.repeat(np.arange(rows), rays), np.repeat(rng.random((rows, 2)), rays, axis=0)
    for k in range(points):
        normal = blocks.normal[row, k]
        direction = even_cosine_directions(normal, np.tile(k * rays + np.arange(rays), rows), shift)
        origin = (blocks.position[row, k] + scene.epsilon * normal).astype(np.float32)
        distance, triangle = scene.intersect(origin, direction)
        met = triangle >= 0
        facing = scene.normals[triangle[met]]
        facing = np.where((facing * direction[met]).sum(axis=1, keepdims=True) > 0, -facing, facing)
        found = seen.at(origin[met] + distance[met, None] * direction[met], facing)
        for c in range(3):
            inside[:, c] += np.bincount(row[met], found[:, c], rows)
        place = np.floor(empty.texels(direction[~met].astype(np.float64))).astype(np.int64)
        row_out.append(row[~met])
        texel_out.append(np.minimum(place[:, 0], height - 1) * width + place[:, 1] % width)
    row, texel = np.concatenate(row_out), np.concatenate(texel_out)
    count = rays * points
    outside = csr_matrix((np.full(len(row), 1 / count), (row, texel)), shape=(rows, height * width))
    outside.sum_duplicates()
    return RoomLight(inside / count, outside)


def lit_from_outside(
    radiance: np.ndarray, seen: np.ndarray, continued: np.ndarray, blocks: Blocks, light: RoomLight
) -> tuple[np.ndarray, dict[str, float]]:
    """Find the radiance of unseen texels that explains the light in the room.

    Parameters
    ----------
    radiance, seen
        (h, w, 3) mean radiance of the texels that pixels look along, and (h, w) bool which ones these are.
    continued
        (h, w, 3) the same with all texels filled: where the search begins.

    Returns
    -------
    radiance
        (h, w, 3) float32, unchanged where it is seen.
    figures
        ``unseen_light``: share of the light from outside that comes from unseen directions; ``residual_before`` and
        ``residual``: 1.48 times the median absolute log residual with the continued map, and with this one.
    """
    problem, place, start = _problem(radiance, seen, continued, blocks, light)
    x, before = start, 0.0
    for number in range(_PASSES):
        held = x if number else _with_reflectances(problem, x)
        if number == 0:
            before = _spread(problem.residual(held))
        x = _minimum(problem, held)
        left = problem.residual(x)
        sigma = max(_spread(left), LEAST_SIGMA)
        problem = replace(problem, sigma=sigma, tau=errors_alike(left.mean(axis=1) / sigma, place))
    result = radiance.reshape(-1, 3).astype(np.float64).copy()
    result[problem.free] = np.exp(problem.split(x)[0])
    unseen, whole = problem.given @ result[problem.free], light.outside @ result
    figures = {
        "unseen_light": float(unseen.sum() / max(whole.sum(), 1e-12)),
        "residual_before": before,
        "residual": _spread(problem.residual(x)),
    }
    return result.reshape(radiance.shape).astype(np.float32), figures


def _problem(
    radiance: np.ndarray, seen: np.ndarray, continued: np.ndarray, blocks: Blocks, light: RoomLight
) -> tuple[_SkyProblem, np.ndarray, np.ndarray]:
    """What is to be explained, the places of its blocks (N, 3), and where the search begins."""
    known, level = seen.ravel(), float(np.median(blocks.radiance)) if len(blocks.radiance) else 0.0
    dim = _DIM * max(float(radiance[seen].mean()), level)
    whole = light.under(continued)
    color = np.maximum(blocks.radiance, 1e-6)
    bright = np.log(color.mean(axis=1)) - np.log(np.maximum(whole.mean(axis=1), 1e-12))
    use = (blocks.spread < GLOSSY) & (whole.min(axis=1) > 0)
    use &= bright < np.median(bright[use]) + _BRIGHT if use.any() else use
    free = np.flatnonzero(~known)
    fixed = np.log(np.maximum(radiance.reshape(-1, 3), dim))
    seen_light = light.inside[use] + light.outside[use] @ (radiance.reshape(-1, 3) * known[:, None])
    group = np.unique(blocks.group[use], return_inverse=True)[1]
    problem = _SkyProblem(
        np.log(color[use]), np.maximum(seen_light, 1e-9), group, light.outside[use][:, free].tocsr(), free, fixed,
        sphere_edges(*seen.shape),
    )  # fmt: skip
    groups = np.full((problem.groups + 1, 3), MIDDLE)
    start = np.concatenate([np.log(np.maximum(continued.reshape(-1, 3)[free], _START * level)), groups]).ravel()
    return problem, blocks.position[use, 0], start


def _with_reflectances(problem: _SkyProblem, x: np.ndarray) -> np.ndarray:
    """The start with the reflectances that its light asks for."""
    x = x.copy()
    _, rho, middle = problem.split(x)
    left = problem.residual(x)
    for c in range(3):
        mean = np.bincount(problem.group, left[:, c], problem.groups) / np.bincount(problem.group)
        rho[:, c] += mean
    middle[:] = rho.mean(axis=0)
    return x


def _spread(left: np.ndarray) -> float:
    """Spread of residuals, by their median."""
    return float(deviation(left)) if left.size else 0.0


def _minimum(problem: _SkyProblem, start: np.ndarray) -> np.ndarray:
    """Minimise the cost over the radiance of unseen texels and all reflectances."""

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        slope = np.zeros_like(x)
        of_sky, of_rho, of_middle = problem.split(slope)
        u, rho, middle = problem.split(x)
        value, by_sky, by_rho = _misfit(problem, x)
        of_sky += by_sky
        of_rho += by_rho
        added, by_rho, by_middle = _reflectance_prior(rho, middle)
        of_rho += by_rho
        of_middle += by_middle
        smooth, by_sky = _roughness(problem, u)
        of_sky += by_sky
        return value + added + smooth, slope

    bounds = [(-_LIMIT, _LIMIT)] * len(start)
    return minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 400, "ftol": 1e-8}).x


def _misfit(problem: _SkyProblem, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost of the residuals, its slope by the log radiance (F, 3) and by the log reflectances (G, 3).

    The channels of a block err alike, so that they count as one.
    """
    sky = np.exp(problem.split(x)[0])
    r = problem.residual(x) / problem.sigma
    q = 1 + r * r / FREEDOM
    weight = 1 / (3 * problem.tau)
    slope = weight * (FREEDOM + 1) / FREEDOM * r / q / problem.sigma
    by_sky = -(problem.given.T @ (slope / (problem.light + problem.given @ sky))) * sky
    by_rho = -np.stack([np.bincount(problem.group, slope[:, c], problem.groups) for c in range(3)], axis=1)
    return float(weight * 0.5 * (FREEDOM + 1) * np.log(q).sum()), by_sky, by_rho


def _reflectance_prior(rho: np.ndarray, middle: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost of log reflectances (G, 3) and of their mean over the room (3,), and its slopes by both.

    Rooms are grey on the mean, and nothing is brighter than white.
    """
    level, own = middle.mean(), rho.mean(axis=1)
    z = (own - level) / WITHIN
    tint = rho - own[:, None] - (middle - level)
    lean = middle - level
    above = np.maximum(rho - WHITE, 0) / ABOVE
    value = 0.5 * (z @ z + (tint**2).sum() / (2 * _COLORED**2) + (above**2).sum() / 3)
    value += 0.5 * (((level - MIDDLE) / MIDDLE_SPREAD) ** 2 + lean @ lean / (2 * _LEAN**2))
    by_tint = tint / (2 * _COLORED**2)
    by_rho = (z / WITHIN / 3)[:, None] + by_tint - by_tint.mean(axis=1, keepdims=True) + above / ABOVE / 3
    by_middle = (level - MIDDLE) / MIDDLE_SPREAD**2 / 3 - z.sum() / WITHIN / 3 + lean / (2 * _LEAN**2)
    by_middle -= (by_tint - by_tint.mean(axis=1, keepdims=True)).sum(axis=0)
    return float(value), by_rho, by_middle


def _roughness(problem: _SkyProblem, u: np.ndarray) -> tuple[float, np.ndarray]:
    """Cost of differences between neighbouring texels, and its slope by the log radiance (F, 3) of the unseen ones."""
    field = problem.fixed.copy()
    field[problem.free] = u
    a, b, weight = problem.edges
    step = field[a] - field[b]
    level = step.mean(axis=1, keepdims=True)
    slope = weight[:, None] * (_SMOOTH[0] * level / 3 + _SMOOTH[1] * (step - level))
    cost = 0.5 * weight @ (_SMOOTH[0] * level[:, 0] ** 2 + _SMOOTH[1] * ((step - level) ** 2).sum(axis=1))
    count = len(field)
    whole = [np.bincount(a, slope[:, c], count) - np.bincount(b, slope[:, c], count) for c in range(3)]
    return float(cost), np.stack(whole, axis=1)[problem.free]


def sphere_edges(height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Neighbouring texels of an equirectangular map, and how much light would flow between them: each (E,).

    The weights are those of Laplace's equation on the sphere: length of the border over distance of the centres.
    """
    number = np.arange(height * width).reshape(height, width)
    theta = (np.arange(height) + 0.5) / height * np.pi
    ratio = (np.pi / height) / (2 * np.pi / width)
    beside = np.broadcast_to((ratio / np.sin(theta))[:, None], (height, width))
    below = np.broadcast_to((np.sin(theta[:-1] + np.pi / height / 2) / ratio)[:, None], (height - 1, width))
    a = np.concatenate([number.ravel(), number[:-1].ravel()])
    b = np.concatenate([np.roll(number, -1, axis=1).ravel(), number[1:].ravel()])
    return a, b, np.concatenate([beside.ravel(), below.ravel()])
