"""Multi-resolution hash encoding: one fused Dr.Jit kernel each way, and its plain-torch twin.

A point is looked up in grids of growing resolution; each grid returns the trilinear mean of the
learned features at the eight vertices around the point (Müller et al., *Instant Neural Graphics
Primitives*, 2022). Coarse grids are stored densely, finer ones share a table through a hash.

The kernels run one lane for each pair of level and point, level by level, so that the lanes that
run together read one level's table, which then stays in the processor's cache. On a CPU the adjoint
runs one packet of lanes for each level instead, which goes through the points: no two threads add
to one entry. On a GPU it adds integers. Either way sums repeat to the bit. Everything that differs
between levels or calls is data, so that nothing is compiled twice.
"""

import math
import re
import sys
from functools import cache
from types import ModuleType
from typing import Literal

import torch
from torch.autograd.function import once_differentiable

PRIMES = (2654435761, 805459861)
"""Factors of the spatial hash for y and z; that of x is 1 (as in Instant-NGP)."""

SIGMA_PER_FOOTPRINT = 0.5
"""Standard deviation of the Gaussian that stands for a footprint, in footprints."""

_MIN_SIGMA = 1e-12  # of the box side: far below any level's cell, so that its weight is exactly 1

Backend = Literal["auto", "drjit", "torch"]


class HashEncoding(torch.nn.Module):
    """Features of points in the unit cube, learned in hashed grids.

    Level l has ``base_resolution * growth**l - 1`` cells along a side; the grids are shifted by
    half a cell, so that their vertices do not coincide on the faces of the cube.

    Parameters
    ----------
    levels : int
        Number of grids.
    table_log2 : int
        Log2 of the largest number of vertices stored for a level.
    features : int
        Features of a vertex, 1 to 4.
    base_resolution : int
        Of the coarsest level, >= 2.
    growth : float
        Ratio of the resolutions of neighbouring levels.
    seed : int
        Of the initial table, uniform in ±1e-4.
    backend : {"auto", "drjit", "torch"}
        ``torch`` is the plain-torch twin. ``auto`` takes the Dr.Jit kernels if Mitsuba's variant
        is set and computes where the table is, else the twin. ``drjit`` insists on the kernels.

    Attributes
    ----------
    table : torch.nn.Parameter
        (entries, features) float32, level after level.
    """

    cells: torch.Tensor
    grid: torch.Tensor

    def __init__(
        self,
        levels: int,
        table_log2: int,
        features: int = 2,
        base_resolution: int = 16,
        growth: float = 1.45,
        seed: int = 0,
        backend: Backend = "auto",
    ) -> None:
        super().__init__()
        if not 1 <= features <= 4:
            raise ValueError(f"features must be 1 to 4, got {features}")
        if not 1 <= table_log2 <= 24:
            raise ValueError(f"table_log2 must be 1 to 24, got {table_log2}")
        self.levels, self.features, self.backend = levels, features, backend
        capacity = 1 << table_log2
        cells = torch.tensor([base_resolution * growth**level - 1 for level in range(levels)])
        rows, entries = [], 0
        # In float32, as the lookup computes it: a point at 1 falls into cell floor(cells + 0.5).
        for last in (cells + 0.5).int().tolist():
            side = last + 2
            dense = side**3 <= capacity
            strides = (side, side**2) if dense else PRIMES
            rows.append((last, *strides, entries, int(dense), -1 if dense else capacity - 1))
            entries += side**3 if dense else capacity
        # Kept in int32, which is what Dr.Jit reads; the strides are unsigned, hence the wrap.
        grid = torch.tensor(rows, dtype=torch.int64)
        self.register_buffer("cells", cells, persistent=False)
        self.register_buffer("grid", grid.T.to(torch.int32).contiguous(), persistent=False)
        generator = torch.Generator().manual_seed(seed)
        table = torch.empty(entries, features).uniform_(-1e-4, 1e-4, generator=generator)
        self.table = torch.nn.Parameter(table)

    def forward(self, points: torch.Tensor, footprint: torch.Tensor | None = None) -> torch.Tensor:
        """Encode points; gradients go to the table only.

        Parameters
        ----------
        points : torch.Tensor
            (N, 3) float32 in [0, 1]; outside, the nearest point of the cube counts.
        footprint : torch.Tensor, optional
            (N,) float32, size of the surface patch a point stands for, in sides of the cube. It
            fades the levels whose cells are finer, as in Zip-NeRF (Barron et al. 2023, Eq. 4).

        Returns
        -------
        torch.Tensor
            (N, levels * features), level after level.
        """
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points must have shape (N, 3), got {tuple(points.shape)}")
        if footprint is not None and footprint.shape != points.shape[:1]:
            raise ValueError(f"footprint must have shape ({len(points)},), got {tuple(footprint.shape)}")
        dtype = self.table.dtype
        points = points.detach().to(dtype)
        footprint = None if footprint is None else footprint.detach().to(dtype)
        dj = None
        if self.backend != "torch" and dtype == torch.float32:
            dj = _drjit_types(self.table.device)
        if self.backend == "drjit" and dj is None:
            raise RuntimeError(
                f"backend 'drjit' needs a float32 table on the device of Mitsuba's variant, "
                f"got {dtype} on {self.table.device}"
            )
        if dj is None or len(points) == 0:
            return encode_torch(self.table, points, footprint, self.cells, self.grid)
        return _Encode.apply(self.table, points, footprint, self.cells, self.grid, dj)

    def extra_repr(self) -> str:
        """Sizes, for ``print(module)``."""
        return f"levels={self.levels}, features={self.features}, entries={len(self.table)}"


def encode_torch(
    table: torch.Tensor,
    points: torch.Tensor,
    footprint: torch.Tensor | None,
    cells: torch.Tensor,
    grid: torch.Tensor,
) -> torch.Tensor:
    """Encode points with torch operations alone: the oracle of the kernels, and their fallback.

    Parameters
    ----------
    table : torch.Tensor
        (entries, features), float32 or float64.
    points : torch.Tensor
        (N, 3) of the table's dtype.
    footprint : torch.Tensor or None
        (N,) of the table's dtype.
    cells, grid : torch.Tensor
        Geometry of the levels, see `HashEncoding`: (L,) cells along a side; (6, L) int32: last
        cell, strides of y and z, first entry, whether dense, mask of the index.

    Returns
    -------
    torch.Tensor
        (N, L * features).
    """
    last, stride_y, stride_z, first, dense, mask = grid.long()  # (L,) each
    p = points.clamp(0, 1)[:, None, :] * cells[:, None] + 0.5  # (N, L, 3)
    corner = p.long().clamp(min=0).minimum(last[:, None])
    t = p - corner
    indices, weights = [], []
    for k in range(8):
        offset = torch.tensor([k & 1, k >> 1 & 1, k >> 2], device=points.device)
        x, y, z = (corner + offset).unbind(-1)
        y, z = y * stride_y, z * stride_z
        index = torch.where(dense.bool(), x + y + z, x ^ y ^ z) & mask
        indices.append(index + first)
        weights.append(torch.where(offset.bool(), t, 1 - t).prod(-1))
    found = torch.nn.functional.embedding_bag(
        torch.stack(indices, -1).reshape(-1, 8),
        table,
        mode="sum",
        per_sample_weights=torch.stack(weights, -1).reshape(-1, 8),
    ).view(len(points), len(cells), table.shape[1])  # (N, L, features)
    if footprint is not None:
        sigma = (SIGMA_PER_FOOTPRINT * footprint).clamp(min=_MIN_SIGMA)
        found = found * torch.erf(1 / (math.sqrt(8) * sigma[:, None] * cells))[..., None]
    return found.flatten(1)


def _drjit_types(device: torch.device) -> ModuleType | None:
    """Module with the Dr.Jit types that compute on ``device``; None if no variant is set for it."""
    # Looked up instead of imported: where nobody has chosen a variant there is nothing to use.
    mitsuba = sys.modules.get("mitsuba")
    variant = mitsuba.variant() if mitsuba else None
    backend = {"cpu": "llvm", "cuda": "cuda"}.get(device.type)
    if not variant or not backend or not variant.startswith(backend):
        return None
    import drjit

    return getattr(drjit, backend)


class _Encode(torch.autograd.Function):
    """The kernels as one differentiable operation.

    Tensors and Dr.Jit arrays share memory both ways. Torch must have finished writing before a
    kernel starts, and the kernel before torch reads: both queues are waited for.
    """

    @staticmethod
    def forward(ctx, table, points, footprint, cells, grid, dj):
        ctx.save_for_backward(points, footprint, cells, grid)
        ctx.table_shape, ctx.dj = table.shape, dj
        return _lookup(dj, table, points, footprint, cells, grid)

    @staticmethod
    @once_differentiable
    def backward(ctx, gradient):
        points, footprint, cells, grid = ctx.saved_tensors
        table = _spread(ctx.dj, ctx.table_shape, gradient, points, footprint, cells, grid)
        return table, None, None, None, None, None


def _lookup(dj, table, points, footprint, cells, grid) -> torch.Tensor:
    """Run the forward kernel: (N, L * features) from table (entries, features)."""
    import drjit as dr

    count, levels, features = len(points), len(cells), table.shape[1]
    vector = getattr(dj, f"Array{features}f")
    _finish_torch(table)
    values = _shared(dj.Float, table)
    level, point = _lanes(dj, count, levels)
    corners, fade = _corners(dj, level, point, points, footprint, cells, grid)
    total = vector(0)
    for index, weight in corners:
        total = dr.fma(dr.gather(vector, values, index), weight, total)
    output = dr.empty(dj.Float, count * levels * features)
    dr.scatter(output, total * fade, point * levels + level)
    return _to_torch(output).view(count, levels * features)


def _spread(dj, table_shape, gradient, points, footprint, cells, grid) -> torch.Tensor:
    """Run the adjoint kernel: add (N, L * features) gradients to the entries they came from, always in one way.

    On a CPU one packet of lanes, and so one thread, adds all that belongs to a level, in the order of the points. On
    CUDA lanes add in any order, so they add integers.
    """
    import drjit as dr

    count, levels = len(points), len(cells)
    if gradient.is_cuda:
        return _spread_integers(dj, table_shape, gradient, points, footprint, cells, grid)
    vector = getattr(dj, f"Array{table_shape[1]}f")
    incoming = _shared(dj.Float, gradient)
    # Memory of Dr.Jit's own pool: torch would ask the system for fresh pages at every step.
    output = dr.zeros(dj.Float, table_shape.numel())
    width, end = _packet_width(), dr.opaque(dj.UInt32, count)
    lane = dr.arange(dj.UInt32, levels * width)
    level = lane // width

    def step(point):
        corners, fade = _corners(dj, level, point, points, footprint, cells, grid)
        g = dr.gather(vector, incoming, point * levels + level) * fade
        for index, weight in corners:
            dr.scatter_reduce(dr.ReduceOp.Add, output, g * weight, index, mode=dr.ReduceMode.Direct)
        return (point + width,)

    dr.while_loop((lane - level * width,), lambda point: point < end, step, labels=("point",))
    return _to_torch(output).view(table_shape)


def _spread_integers(dj, table_shape, gradient, points, footprint, cells, grid) -> torch.Tensor:
    """`_spread` in 64-bit fixed point, whose sums do not depend on their order.

    The unit is a power of two, so small that the largest gradient is 2^38 units with a million points and no entry can
    overflow. What is smaller than a unit is lost.
    """
    import drjit as dr

    peak = float(gradient.abs().amax())
    if not math.isfinite(peak):
        return torch.full(table_shape, math.nan, device=gradient.device)
    count, levels, features = len(points), len(cells), table_shape[1]
    spare = 62 - (8 * count).bit_length() - math.frexp(peak)[1]  # bits above the largest gradient
    unit = dr.opaque(dj.Float64, math.ldexp(1.0, -spare))
    _finish_torch(gradient)
    incoming = _shared(dj.Float, gradient)
    total = dr.zeros(dj.UInt64, table_shape.numel())  # of two's complements: CUDA adds no signed ones
    level, point = _lanes(dj, count, levels)
    corners, fade = _corners(dj, level, point, points, footprint, cells, grid)
    for feature in range(features):
        g = dr.gather(dj.Float, incoming, (point * levels + level) * features + feature) * fade
        for index, weight in corners:
            units = dj.UInt64(dj.Int64(dj.Float64(g * weight) / unit))
            dr.scatter_reduce(dr.ReduceOp.Add, total, units, index * features + feature, mode=dr.ReduceMode.Direct)
    dr.eval(total)
    return _to_torch(dj.Float(dj.Float64(dj.Int64(total)) * unit)).view(table_shape)


def _lanes(dj, count: int, levels: int):
    """Level and point of one lane for each pair of them, level after level."""
    import drjit as dr

    size = dr.opaque(dj.UInt32, count)
    lane = dr.arange(dj.UInt32, count * levels)
    level = lane // size
    return level, lane - level * size


@cache
def _packet_width() -> int:
    """Lanes that a thread of the LLVM backend runs at once. Dr.Jit tells it in the code of its kernels alone."""
    import drjit as dr
    from drjit.llvm import Float

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.eval(dr.arange(Float, 2) + dr.opaque(Float, 1))
        code = dr.kernel_history()[-1]["ir"].getvalue()
    found = re.search(r"<(\d+) x float>", code)
    assert found is not None
    return int(found.group(1))


def _corners(dj, level, point, points, footprint, cells, grid):
    """Trace what both kernels share, for lanes with their levels and points.

    Returns
    -------
    corners
        Eight pairs of table index and trilinear weight.
    fade
        Weight of the level.
    """
    import drjit as dr

    rows = _shared(dj.Int32, grid)
    last, stride_y, stride_z, first, dense, mask = (
        dj.UInt32(dr.gather(dj.Int32, rows, level + k * len(cells))) for k in range(len(grid))
    )
    side = dr.gather(dj.Float, _shared(dj.Float, cells), level)

    p = dr.clip(dr.gather(dj.Array3f, _shared(dj.Float, points), point), 0, 1) * side + 0.5
    corner = dr.minimum(dj.Array3u(p), last)
    t = p - dj.Array3f(corner)
    xs = (corner.x, corner.x + 1)
    y, z = corner.y * stride_y, corner.z * stride_z
    ys, zs = (y, y + stride_y), (z, z + stride_z)
    corners = []
    for k in range(8):
        i, j, k_ = k & 1, k >> 1 & 1, k >> 2
        added, hashed = xs[i] + ys[j] + zs[k_], xs[i] ^ ys[j] ^ zs[k_]
        weights = (t.x if i else 1 - t.x, t.y if j else 1 - t.y, t.z if k_ else 1 - t.z)
        index = (dr.select(dense != 0, added, hashed) & mask) + first
        corners.append((index, weights[0] * weights[1] * weights[2]))

    if footprint is None:
        return corners, 1
    sigma = SIGMA_PER_FOOTPRINT * dr.gather(dj.Float, _shared(dj.Float, footprint), point)
    return corners, dr.erf(1 / (math.sqrt(8) * dr.maximum(sigma, _MIN_SIGMA) * side))


def _shared(kind, tensor: torch.Tensor):
    """Dr.Jit array over the tensor's memory (contiguous copies only of what is strided)."""
    return kind(tensor.detach().reshape(-1))


def _finish_torch(tensor: torch.Tensor) -> None:
    """Wait until torch has written everything that a kernel is about to read."""
    if tensor.is_cuda:
        torch.cuda.current_stream(tensor.device).synchronize()


def _to_torch(array) -> torch.Tensor:
    """Evaluate a Dr.Jit array and return a tensor over its memory."""
    import drjit as dr

    dr.eval(array)
    dr.sync_thread()
    return array.torch()
