"""The whole benchmark: scene, measurements, rows of the table."""

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks import fit_step, shading
from benchmarks.report import Row
from benchmarks.scene import Scene
from benchmarks.shading import OURS, SUPPLEMENT, THREE_LOBES, Contestants, Curve, scaled
from benchmarks.timing import Ratio
from fipt.render.points import Points
from fipt.stages.fit.settings import FitSettings


@dataclass(frozen=True)
class Size:
    """Amounts: samples, repeats of most measurements, of slow ones and of steps, scale of the reference."""

    samples: int
    repeats: int
    slow_repeats: int
    steps: int
    reference: float
    factors: Mapping[str, Sequence[float]]


FULL = Size(8192, 7, 5, 21, 1.0, {"ours": (0.1, 0.2, 0.5, 1, 2), "plain": (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1)})
QUICK = Size(1024, 3, 1, 3, 0.1, {"ours": (0.1, 0.5, 1), "plain": (1 / 16, 1 / 4, 1)})


def measure(scene: Scene, device: str, size: Size, say: Callable[[str], None]) -> tuple[list[Row], dict[str, Curve]]:
    """Run all measurements; ``say`` is told what comes next."""
    points = scene.some(size.samples)
    contestants = Contestants(scene, shading.paper_network(scene, device), device)
    say("stage 1: rays per second")
    rows = first_stage(contestants, points, size)
    say("stage 1: error against time")
    curves = shading.error_curves(contestants, points, size.factors, size.reference, size.repeats)
    error = float(curves["plain"].error[-1])
    ours, plain = (list(curves[who].seconds_at(error) / len(points.position)) for who in ("ours", "plain"))
    rows.append(_times(f"stage 1, us per sample for {error:.1%} error", ours, plain, 1e6, 15))
    say("stage 3: paths per second")
    rows += third_stage(contestants, points, size)
    say("fit: one step")
    for name, settings, target in (("our sizes", FitSettings(), None), ("the paper's sizes", fit_step.PAPER, 1.8)):
        times = fit_step.step_times(settings, device, size.steps)
        rows.append(_times(f"fit, ms per step, {name}", times["drjit"], times["torch"], 1e3, target))
    say("memory and disk")
    rows += memory(contestants, points, device)
    rows.append(_sizes("shading on disk, bytes per pixel", *shading.bytes_per_pixel(scene, contestants)))
    return rows, curves


def first_stage(contestants: Contestants, points: Points, size: Size) -> list[Row]:
    """Rays per second of stage 1."""
    three = scaled(THREE_LOBES, SUPPLEMENT[1])
    found = shading.rates(
        {
            "ours": shading.shade(contestants.bake, points, OURS),
            "plain": shading.shade(contestants.plain_bake, points, three),
            "published": shading.shade(contestants.published_bake, points, three),
            "bare": shading.bare_traversal(contestants, points, SUPPLEMENT[1]),
        },
        size.repeats,
    )
    return [
        _rates("stage 1, M rays/s", found["ours"], found["plain"], 4),
        _rates("stage 1, M rays/s, plain converts output by output", found["ours"], found["published"]),
        _rates("M rays/s of bare traversal, in place of ours", found["bare"], found["plain"]),
    ]


def third_stage(contestants: Contestants, points: Points, size: Size) -> list[Row]:
    """Paths per second of stage 3."""
    found = shading.rates(
        {
            "ours": shading.shade(contestants.paths, points, OURS),
            "lit": shading.shade(contestants.lit_paths, points, OURS),
            "cached": shading.shade(contestants.plain_paths, points, scaled(THREE_LOBES, 48)),
            "network": shading.shade(contestants.network_paths, points, scaled(THREE_LOBES, 8)),
            "bare": shading.bare_paths(contestants.paths, points, OURS),
        },
        size.slow_repeats,
    )
    return [
        _rates("stage 3, M paths/s, plain asks the network per vertex", found["ours"], found["network"], 30),
        _rates("stage 3, M paths/s, plain has cached materials", found["ours"], found["cached"], 5),
        _rates("the same, ours with light samples at the first hit", found["lit"], found["cached"]),
        _rates("M paths/s of bare traversal of the paths' rays, in place of ours", found["bare"], found["cached"]),
    ]


def memory(contestants: Contestants, points: Points, device: str) -> list[Row]:
    """Peak memory of the stages, where the system tells it."""
    shaded = shading.memory(contestants, points)
    steps = fit_step.step_memory(fit_step.PAPER, device)
    found = {
        "stage 1": (shaded["bake ours"], shaded["bake plain"]),
        "stage 3, cached materials": (shaded["refine ours"], shaded["refine plain"]),
        "fit, the paper's sizes": (steps["drjit"], steps["torch"]),
    }
    return [_sizes(f"peak memory added, MB, {name}", *pair) for name, pair in found.items() if None not in pair]


def _rates(what: str, ours: Sequence[float], plain: Sequence[float], target: float | None = None) -> Row:
    """A row of samples per second, in millions."""
    medians = (1e-6 * statistics.median(values) for values in (ours, plain))
    return Row(what, *medians, Ratio.of(ours, plain), target)


def _times(what: str, ours: Sequence[float], plain: Sequence[float], unit: float, target: float | None = None) -> Row:
    """A row of seconds, shown times ``unit``."""
    medians = (unit * statistics.median(values) for values in (ours, plain))
    return Row(what, *medians, Ratio.of(plain, ours), target)


def _sizes(what: str, ours: float, plain: float) -> Row:
    """A row of what was measured once."""
    ratio = plain / max(ours, 1e-9)
    return Row(what, ours, plain, Ratio(ratio, ratio, ratio))
