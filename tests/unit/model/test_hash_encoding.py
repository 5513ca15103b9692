"""The hash encoding: kernels against the twin, the twin against finite differences and by hand."""

import itertools
import math

import drjit
import numpy as np
import pytest
import torch

from fipt.model.hash_encoding import PRIMES, HashEncoding, _spread_integers, encode_torch

SMALL = {"levels": 6, "table_log2": 10, "growth": 1.9, "base_resolution": 4}  # 2 dense, 4 hashed


def encoding(device: str = "cpu", **changes) -> HashEncoding:
    """A small encoding whose features are of the order of 1."""
    made = HashEncoding(**(SMALL | changes)).to(device)
    with torch.no_grad():
        made.table *= 1e4
    return made


def points(count: int = 500, device: str = "cpu") -> torch.Tensor:
    """Points in the cube, on its corners and outside."""
    inside = torch.rand(count, 3, generator=torch.Generator().manual_seed(1))
    corners = torch.tensor(list(itertools.product((0.0, 1.0), repeat=3)))
    outside = torch.tensor([[-1.0, 0.5, 2.0], [0.2, 1.5, 0.3], [7.0, -7.0, 1.0]])
    return torch.cat([inside, corners, outside]).to(device)


def footprints(count: int, device: str = "cpu") -> torch.Tensor:
    values = torch.rand(count, generator=torch.Generator().manual_seed(2)) * 0.2
    values[::5] = 0
    return values.to(device)


@pytest.mark.parametrize("faded", [False, True])
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"features": 1},
        {"features": 3},
        {"features": 4},
        {"table_log2": 20, "levels": 4},
        {"table_log2": 5},
    ],
    ids=["dense+hashed", "1 feature", "3 features", "4 features", "all dense", "all hashed"],
)
def test_kernels_equal_twin(backend, changes, faded):
    device = backend.torch_device
    subject = encoding(device, **changes)
    x = points(device=device)
    footprint = footprints(len(x), device) if faded else None
    seen = {}
    for name in ("drjit", "torch"):
        subject.backend, subject.table.grad = name, None
        output = subject(x, footprint)
        mixed = torch.linspace(-1, 1, output.numel(), device=device).view_as(output)
        (output * mixed).sum().backward()
        seen[name] = output.detach(), subject.table.grad.clone()
    fused = backend.name == "cuda"  # which multiplies and adds without rounding between
    torch.testing.assert_close(seen["drjit"][0], seen["torch"][0], rtol=1e-5, atol=1e-5 if fused else 1e-6)
    torch.testing.assert_close(seen["drjit"][1], seen["torch"][1], rtol=1e-5, atol=2e-5)
    assert seen["torch"][1].abs().max() > 0.1


def test_the_adjoint_of_a_gpu_does_not_depend_on_the_order_of_points(backend):
    """It adds integers; here with the kernels of any backend, against the twin."""
    device = backend.torch_device
    types = getattr(drjit, backend.name)
    subject = encoding(device)
    x, footprint = points(device=device), footprints(511, device)
    gradient = torch.linspace(-1, 1, 511 * 12, device=device).view(511, 12) * 1e-3
    other = torch.randperm(511, generator=torch.Generator().manual_seed(3)).to(device)
    first, second = (
        _spread_integers(
            types, subject.table.shape, gradient[order], x[order], footprint[order], subject.cells, subject.grid
        )
        for order in (torch.arange(511, device=device), other)
    )
    assert torch.equal(first, second)
    subject.backend = "torch"
    (subject(x, footprint) * gradient).sum().backward()
    torch.testing.assert_close(first, subject.table.grad, rtol=1e-4, atol=2e-8)
    same = x[:1].expand(511, 3).contiguous()  # all add to the same entries, with one sign: the largest sums there are
    ones = torch.full_like(gradient, 1e30)
    largest = _spread_integers(types, subject.table.shape, ones, same, None, subject.cells, subject.grid)
    assert largest.double().sum().item() == pytest.approx(511 * 12 * 1e30, rel=1e-4)
    nothing = _spread_integers(types, subject.table.shape, 0 * ones, same, None, subject.cells, subject.grid)
    assert not nothing.any()
    gradient[3, 4] = torch.inf
    wrong = _spread_integers(types, subject.table.shape, gradient, x, footprint, subject.cells, subject.grid)
    assert wrong.isnan().all()


def test_in_double_precision_the_twin_is_used(backend):
    subject = encoding()
    single = subject(points())
    torch.testing.assert_close(subject.double()(points()).float(), single, rtol=1e-5, atol=1e-4)


def test_twin_gradient_by_finite_differences():
    subject = encoding(levels=3, table_log2=7).double()
    x = points(20).double()
    footprint = footprints(len(x)).double()
    geometry = subject.cells, subject.grid
    assert torch.autograd.gradcheck(lambda table: encode_torch(table, x, footprint, *geometry), (subject.table,))


def test_kernel_gradient_by_finite_differences(backend):
    device = backend.torch_device
    subject = encoding(device, backend="drjit")
    x, generator = points(device=device), torch.Generator().manual_seed(3)
    footprint = footprints(len(x), device)
    output = subject(x, footprint)
    mixed = torch.randn(output.shape, generator=generator).to(device)
    (gradient,) = torch.autograd.grad((output * mixed).sum(), subject.table)
    direction = torch.randn(subject.table.shape, generator=generator).to(device)
    with torch.no_grad():
        # The encoding is linear in its table: a difference of any width is exact.
        subject.table += direction
        upper = (subject(x, footprint).double() * mixed).sum()
        subject.table -= 2 * direction
        lower = (subject(x, footprint).double() * mixed).sum()
    expected = (gradient.double() * direction).sum()
    assert (upper - lower).item() / 2 == pytest.approx(expected.item(), rel=1e-4, abs=1e-3)


def test_dense_level_reproduces_a_linear_function():
    subject = HashEncoding(1, 12, base_resolution=8, features=1)
    side = 9  # vertices: floor(7 + 0.5) + 2
    z, y, x = np.meshgrid(*[np.arange(side)] * 3, indexing="ij")
    plane = (x + 2 * y - 3 * z).ravel()
    with torch.no_grad():
        subject.table[:] = torch.tensor(plane, dtype=torch.float32)[:, None]
    p = points()
    grid = p.clamp(0, 1) * 7 + 0.5
    expected = grid @ torch.tensor([1.0, 2.0, -3.0])
    torch.testing.assert_close(subject(p).detach()[:, 0], expected, rtol=0, atol=1e-5)


def test_hashed_level_finds_the_published_hash():
    subject = HashEncoding(1, 8, base_resolution=100, features=1)
    with torch.no_grad():
        subject.table[:] = torch.arange(256.0)[:, None]
    cell = np.array([31, 67, 90])
    vertex = torch.tensor((cell - 0.5) / 99, dtype=torch.float32)[None]  # exactly on a vertex
    x, y, z = (int(v) for v in cell)
    entry = (x ^ (y * PRIMES[0]) ^ (z * PRIMES[1])) % 256
    assert subject(vertex).item() == pytest.approx(entry, abs=0.05)


def test_footprint_fades_fine_levels_first():
    subject = encoding(backend="torch")
    x = points(1)[:1]
    full = subject(x).detach()
    same = subject(x, torch.zeros(1)).detach()
    assert torch.equal(full, same)
    footprint = 0.1
    weight = (subject(x, torch.full((1,), footprint)).detach() / full)[0, ::2].numpy()
    cells = subject.cells.numpy()
    expected = [math.erf(1 / math.sqrt(8 * (0.5 * footprint) ** 2 * n**2)) for n in cells]
    np.testing.assert_allclose(weight, expected, rtol=1e-4)
    assert np.all(np.diff(weight) < 0)


def test_kernels_see_updates_in_place(backend):
    device = backend.torch_device
    subject = encoding(device, backend="drjit")
    x = points(50, device)
    before = subject(x).detach()
    with torch.no_grad():
        subject.table.mul_(2)
    torch.testing.assert_close(subject(x).detach(), 2 * before)


def test_nothing_is_compiled_from_step_to_step(backend):
    import drjit as dr

    device = backend.torch_device
    first, second = encoding(device, backend="drjit"), encoding(device, levels=4, backend="drjit")

    def step(subject, x):
        subject(x, footprints(len(x), device)).sum().backward()

    step(first, points(100, device))
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        for count in (100, 333, 2000):
            step(first, points(count, device))
        step(second, points(64, device))
        kernels = [k for k in dr.kernel_history() if k["type"] == dr.KernelType.JIT]
    assert kernels
    assert all(k["cache_hit"] for k in kernels)


def test_threads_do_not_change_the_gradient(backend, threads):
    """An odd number of points, which does not divide among threads: a level is split if anything is."""
    device = backend.torch_device
    subject = encoding(device, levels=7, backend="drjit")
    x = torch.rand(10001, 3, generator=torch.Generator().manual_seed(1)).to(device)
    mixed = torch.randn(len(x), 14, generator=torch.Generator().manual_seed(2)).to(device)
    seen = []
    for count in (1, 2, 4, 2):
        threads(count)
        subject.table.grad = None
        (subject(x, footprints(len(x), device)) * mixed).sum().backward()
        seen.append(subject.table.grad.clone())
    assert all(torch.equal(seen[0], other) for other in seen[1:])


def test_seed_decides_the_table():
    first, again, other = (HashEncoding(**SMALL, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(first.table, again.table)
    assert not torch.equal(first.table, other.table)
    assert first.table.abs().max() <= 1e-4
    assert first.table.std().item() == pytest.approx(1e-4 / math.sqrt(3), rel=0.05)


@pytest.mark.parametrize("name", ["drjit", "torch"])
def test_awkward_points_stay_in_the_table(backend, name):
    subject = encoding(backend.torch_device, backend=name)
    x = torch.tensor([[math.nan, 0.5, 0.5], [math.inf, -math.inf, 1.0]])
    output = subject(x.to(backend.torch_device))
    assert torch.isnan(output[0]).all()
    assert torch.isfinite(output[1]).all()
    assert subject(x[:0].to(backend.torch_device)).shape == (0, 12)


def test_strided_points_and_gradients(backend):
    device = backend.torch_device
    subject = encoding(device, backend="drjit")
    x = points(device=device)
    strided = x.T.contiguous().T
    torch.testing.assert_close(subject(strided), subject(x))
    subject(x).sum().backward()  # its gradient is an expanded scalar
    expected = subject.table.grad.clone()
    subject.table.grad = None
    subject.backend = "torch"
    subject(x).sum().backward()
    torch.testing.assert_close(subject.table.grad, expected, rtol=1e-5, atol=2e-5)


def test_gradients_accumulate(backend):
    device = backend.torch_device
    subject = encoding(device, backend="drjit")
    x = points(device=device)
    subject(x).sum().backward()
    once = subject.table.grad.clone()
    subject(x).sum().backward()
    torch.testing.assert_close(subject.table.grad, 2 * once, rtol=1e-5, atol=1e-4)


def test_wrong_use_is_refused():
    subject = encoding()
    with pytest.raises(ValueError, match=r"shape \(N, 3\), got \(4, 2\)"):
        subject(torch.zeros(4, 2))
    with pytest.raises(ValueError, match=r"footprint must have shape \(4,\)"):
        subject(torch.zeros(4, 3), torch.zeros(4, 1))
    with pytest.raises(ValueError, match="features"):
        HashEncoding(4, 8, features=5)
    with pytest.raises(ValueError, match="table_log2"):
        HashEncoding(4, 30)


def test_without_a_variant_the_twin_is_used(monkeypatch):
    monkeypatch.setattr("fipt.model.hash_encoding._drjit_types", lambda device: None)
    assert encoding()(points()).shape == (511, 12)
    with pytest.raises(RuntimeError, match="Mitsuba's variant"):
        encoding(backend="drjit")(points())
