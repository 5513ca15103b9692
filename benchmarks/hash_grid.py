"""Our hash encoding against Dr.Jit's own grid (`drjit.hashgrid`): one forward and one backward pass of a fit's step.

    python -m benchmarks.hash_grid [threads]

Dr.Jit's grid knows no footprints; the weights that fade its levels are multiplied to its output, in the same kernel.
"""

import sys
import time
from collections.abc import Callable

import drjit as dr
import numpy as np
import torch
from drjit.hashgrid import HashGridEncoding
from drjit.llvm import ad

from fipt.model.hash_encoding import HashEncoding
from fipt.render.variant import set_variant

_REPEATS = 15
_POINTS = 8192
_SIZES = {"default": (16, 18, 1.45), "paper": (32, 19, 1.3)}
"""Levels, log2 of the entries of a level, growth."""


def ours(size: tuple[int, int, float], points: torch.Tensor, footprint: torch.Tensor) -> Callable[[], object]:
    """A step of our encoding, the gradient of the sum of its features."""
    encoding = HashEncoding(size[0], size[1], growth=size[2], backend="drjit")

    def step() -> object:
        encoding.table.grad = None
        encoding(points, footprint).sum().backward()
        return encoding.table.grad

    return step


def theirs(
    size: tuple[int, int, float], points: torch.Tensor, footprint: torch.Tensor, frozen: bool
) -> Callable[[], object]:
    """A step of Dr.Jit's grid under torch, with or without a frozen kernel (`drjit.freeze`)."""
    levels, table_log2, growth = size
    grid = HashGridEncoding(
        ad.Float, 3, n_levels=levels, hashmap_size=2**table_log2, base_resolution=16, per_level_scale=growth
    )
    cells = [16 * growth**level - 1 for level in range(levels)]

    def forward(table: ad.Float, place: ad.Array3f, width: ad.Float) -> ad.ArrayXf:
        setattr(grid, "data", table)  # noqa: B010 - Dr.Jit's stubs do not know it
        features = grid(place)
        fade = [dr.erf(1 / (8**0.5 * dr.maximum(0.5 * width, 1e-12) * cell)) for cell in cells]
        return ad.ArrayXf([feature * fade[number // 2] for number, feature in enumerate(features)])

    def passes(table: ad.Float, place: ad.Array3f, width: ad.Float) -> ad.Float:
        dr.enable_grad(table)
        dr.backward(dr.sum(dr.sum(forward(table, place, width))))
        return dr.grad(table)

    both = dr.freeze(passes) if frozen else passes
    table = torch.from_numpy(np.array(grid.params))

    def step() -> object:
        gradient = both(ad.Float(table), ad.Array3f(points.T.contiguous()), ad.Float(footprint))
        dr.eval(gradient)
        dr.sync_thread()
        return gradient

    return step


def milliseconds(steps: dict[str, Callable[[], object]]) -> dict[str, tuple[float, float]]:
    """Processor time of each step, all threads: the first (it compiles) and the median; taken in turn."""
    times: dict[str, list[float]] = {label: [] for label in steps}
    for _ in range(_REPEATS + 3):
        for label, step in steps.items():
            start = time.process_time()
            step()
            times[label].append(1000 * (time.process_time() - start))
    return {label: (values[0], float(np.median(values[3:]))) for label, values in times.items()}


def main(threads: int) -> None:
    """Print a table."""
    set_variant(threads=threads or None)
    rng = np.random.default_rng(0)
    points = torch.from_numpy(rng.random((_POINTS, 3), np.float32))
    footprint = torch.from_numpy(rng.uniform(1e-4, 1e-2, _POINTS).astype(np.float32))
    for name, size in _SIZES.items():
        steps = {"ours": ours(size, points, footprint), "drjit.hashgrid": theirs(size, points, footprint, False)}
        steps["drjit.hashgrid, frozen"] = theirs(size, points, footprint, True)
        print(
            name,
            {label: f"first {first:.0f}, then {later:.1f} ms" for label, (first, later) in milliseconds(steps).items()},
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
