"""Materials and radiance of parts by Adam, L1 loss and gradients of path tracing.

Base colour, roughness and metallic are logistic functions of what is optimised, radiance is an exponential. At first
everything emits a little, so that no emitter has to be known. Halfway, what emits less than it reflects is dark, and so
is what no pixel shows.
"""

import logging
from collections.abc import Callable, Mapping

import numpy as np
from scipy.special import expit, logit

from fipt.conventions import ROUGHNESS_MIN
from fipt.progress import progress
from fipt.render.replay import ReplayScene
from fipt.stages.inverse_trace.rays import TrainingPixels
from fipt.stages.inverse_trace.settings import InverseTraceSettings

log = logging.getLogger(__name__)

_START = {"base_color": 0.5, "roughness": 0.7, "metallic": 0.05}
_FIRST_EMISSION = 0.05
"""Of every part, over the median radiance of the pixels."""
_DECAY = 0.1
"""Of the learning rates, from the middle to the last step."""
_MOMENTS = (0.9, 0.99)


class Adam:
    """Adam over named arrays."""

    def __init__(self, values: Mapping[str, np.ndarray]) -> None:
        self.values = {name: np.array(value, np.float64) for name, value in values.items()}
        self._mean = {name: np.zeros_like(value) for name, value in self.values.items()}
        self._square = {name: np.zeros_like(value) for name, value in self.values.items()}
        self._steps = 0

    def step(self, gradient: Mapping[str, np.ndarray], rates: Mapping[str, float]) -> None:
        """One step down the gradient."""
        self._steps += 1
        first, second = _MOMENTS
        for name, slope in gradient.items():
            self._mean[name] = first * self._mean[name] + (1 - first) * slope
            self._square[name] = second * self._square[name] + (1 - second) * slope**2
            mean = self._mean[name] / (1 - first**self._steps)
            square = self._square[name] / (1 - second**self._steps)
            self.values[name] -= rates[name] * mean / (np.sqrt(square) + 1e-12)


class PartOptimiser:
    """The values of G groups, as they are optimised and as the tracer takes them."""

    def __init__(self, count: int, level: float) -> None:
        self._adam = Adam(self._start(count, level))
        self.emits = np.ones(count, bool)

    def _start(self, count: int, level: float) -> dict[str, np.ndarray]:
        shapes: dict[str, tuple[int, ...]] = {"base_color": (count, 3), "roughness": (count,), "metallic": (count,)}
        start = {name: np.full(shapes[name], float(logit(_START[name]))) for name in _START}
        return start | {"emission": np.full((count, 3), np.log(_FIRST_EMISSION * level))}

    def values(self) -> dict[str, np.ndarray]:
        """Base colour (R, 3), roughness and metallic (R,) of rows, which are the groups here; emission (G, 3)."""
        found = self._materials()
        found["emission"] = np.where(self.emits[:, None], np.exp(self._adam.values["emission"]), 0.0)
        return found

    def _materials(self) -> dict[str, np.ndarray]:
        found = {name: expit(value) for name, value in self._adam.values.items() if name != "emission"}
        found["roughness"] = np.maximum(found["roughness"], ROUGHNESS_MIN)
        return found

    def _slopes(self, slopes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Derivatives by what is optimised, from those by the arguments of the logistic functions, row by row."""
        return dict(slopes)

    @staticmethod
    def fading(done: float) -> float:
        """Factor of learning rates when this share of the steps is done."""
        return _DECAY ** max(2 * done - 1, 0)

    def step(self, gradient: Mapping[str, np.ndarray], settings: InverseTraceSettings, done: float) -> None:
        """One step, by the gradient with respect to `values`; ``done`` is the share of steps that are done."""
        now = self.values()
        slopes = {name: gradient[name] * now[name] * (1 - now[name]) for name in gradient if name != "emission"}
        slopes = self._slopes(slopes)
        slopes["emission"] = gradient["emission"] * now["emission"]
        material, emission = (rate * self.fading(done) for rate in (settings.learning_rate, settings.emission_rate))
        rates = {name: emission if name == "emission" else material for name in slopes}
        self._adam.step(slopes, rates)


def optimise(
    scene: ReplayScene,
    pixels: TrainingPixels,
    seen: np.ndarray,
    settings: InverseTraceSettings,
    made: Callable[[int, float], PartOptimiser] = PartOptimiser,
) -> PartOptimiser:
    """Fit the values of all groups, or texels, to the pixels.

    Parameters
    ----------
    scene
        Whose groups they are.
    seen
        (G,) median radiance that pixels show of each group; 0 where none does.
    made
        Makes what is optimised, of the number of groups and the median radiance.
    """
    rng = np.random.default_rng(settings.seed)
    found = made(scene.count, max(float(np.median(pixels.radiance)), 1e-6))
    with progress("inverse trace", settings.steps, " steps") as bar:
        for step in range(settings.steps):
            if step == settings.steps // 2:
                found.emits &= (seen > 0) & (found.values()["emission"].mean(axis=1) > 0.5 * seen)
                log.info("%d of %d parts emit", found.emits.sum(), scene.count)
            scene.assign(found.values())
            chosen = rng.integers(0, len(pixels.view), settings.pixels)
            slope = _loss_slope(scene, pixels, chosen, settings, rng)
            rays = pixels.rays(chosen, settings.spp, rng)
            gradient = scene.gradient(rays, int(rng.integers(2**31)), np.repeat(slope / settings.spp, settings.spp, 0))
            found.step(gradient, settings, step / settings.steps)
            bar.advance()
    return found


def _loss_slope(
    scene: ReplayScene,
    pixels: TrainingPixels,
    chosen: np.ndarray,
    settings: InverseTraceSettings,
    rng: np.random.Generator,
) -> np.ndarray:
    """(N, 3) float32 derivative of the mean L1 loss by the pixels, from paths of its own."""
    rays = pixels.rays(chosen, settings.spp, rng)
    traced = scene.radiance(rays, int(rng.integers(2**31)))
    traced = traced.reshape(len(chosen), settings.spp, 3).mean(axis=1)
    over = traced - pixels.radiance[chosen]
    slope = np.where(pixels.clipped[chosen, None] & (over > 0), 0, np.sign(over))
    return (slope / (3 * len(chosen))).astype(np.float32)
