"""Milliseconds of one training step: Dr.Jit kernels against the plain-torch twin, in one run.

    python benchmarks/fit_step.py [--threads 2] [--steps 20]

A step is what the fit does without its losses: 8,192 material queries and 2,048 emission queries,
forward and backward through both networks, one step of fused Adam on all parameters.
"""

import argparse
import itertools
import statistics
import time
from collections.abc import Callable

import torch

from fipt.model.networks import Field, SceneBox
from fipt.render import variant
from fipt.settings import Fit

MATERIAL_QUERIES = 8192
EMISSION_QUERIES = 2048
CONFIGURATIONS = {
    "16 levels, 2^18, growth 1.45": Fit(levels=16, table_log2=18, growth=1.45),
    "32 levels, 2^19, growth 1.30 (paper)": Fit(levels=32, table_log2=19, growth=1.3),
}
PARTS = ("forward", "backward", "Adam")


def stepper(settings: Fit, backend: str, device: str) -> Callable[[], list[float]]:
    """Return a function that runs one step and returns the milliseconds of its parts."""
    field = Field(settings, SceneBox((0.0, 0.0, 0.0), 8.0), backend).to(device)
    optimizer = torch.optim.Adam(field.parameters(), lr=1e-3, fused=True)
    generator = torch.Generator().manual_seed(0)

    def clock() -> float:
        if device == "cuda":
            torch.cuda.synchronize()
        return time.perf_counter() * 1e3

    def step() -> list[float]:
        points = (torch.rand(MATERIAL_QUERIES, 3, generator=generator) * 8 - 4).to(device)
        footprint = (torch.rand(MATERIAL_QUERIES, generator=generator) * 0.02).to(device)
        times = [clock()]
        brdf = field.brdf(points, footprint)
        e = field.emission(points[:EMISSION_QUERIES])
        target = points.sin().abs()
        loss = (brdf.kd + brdf.ks * brdf.roughness[:, None] - target).square().mean()
        loss = loss + e.abs().mean() + brdf.metallic.mean()
        times.append(clock())
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        times.append(clock())
        optimizer.step()
        times.append(clock())
        return [after - before for before, after in itertools.pairwise(times)]

    return step


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--steps", type=int, default=20)
    arguments = parser.parse_args()
    backend = variant.set_variant(threads=arguments.threads)
    torch.set_num_threads(arguments.threads)
    print(f"{backend.device_name}, {arguments.threads} threads, median of {arguments.steps} steps")
    for name, settings in CONFIGURATIONS.items():
        steppers = {b: stepper(settings, b, backend.torch_device) for b in ("drjit", "torch")}
        times = {b: [] for b in steppers}
        # Taken in turns, so that whatever else the machine does slows both down alike.
        for i in range(arguments.steps + 3):
            for b, step in steppers.items():
                parts = step()
                if i >= 3:
                    times[b].append(parts)
        totals = {}
        for b, rows in times.items():
            totals[b] = statistics.median(map(sum, rows))
            parts = ", ".join(
                f"{part} {statistics.median(column):.1f}"
                for part, column in zip(PARTS, zip(*rows, strict=True), strict=True)
            )
            print(f"{name}: {b:5} {totals[b]:7.1f} ms ({parts}); least {min(map(sum, rows)):.1f}")
        print(f"{name}: drjit takes {totals['drjit'] / totals['torch']:.2f} of torch's time")


if __name__ == "__main__":
    main()
