"""Fixtures and rules that every test shares.

* `backend`: Mitsuba's variant, chosen once for the run. Tests run on LLVM, so that results are the
  same with and without a GPU; ``FIPT_BACKEND=cuda pytest`` runs the same tests on CUDA.
* `threads`: sets the number of threads for a test.
* `np_rng`: a random generator with a fixed seed. No test seeds anything globally.
* `living_room`: the folder of the optional real-size scene, named by ``FIPT_LIVING_ROOM``.
* `open3d`: skips where it cannot be imported.
* `fake_llvm`: writes files that look like libraries; by their names they are some version of LLVM.
* ``gpu``: tests with this mark need a CUDA device and a CUDA run, and are skipped with a reason
  otherwise.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

# Before numpy and torch are imported. Two processes of tests share the processors: their threads would wait for each
# other by spinning. Results do not depend on the number of threads; tests of that set it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from fipt.render import variant
from fipt.stages.geometry.library import tried


def gpu_skip_reason() -> str:
    """Return why tests marked ``gpu`` cannot run in this process; empty if they can."""
    cuda = variant.find_cuda()
    if not cuda.usable:
        return f"needs a CUDA device: {cuda.problem}"
    if os.environ.get("FIPT_BACKEND") != "cuda":
        return "this run is on LLVM; FIPT_BACKEND=cuda pytest -m gpu runs it"
    return ""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the long files of tests/workflow first, so that no process waits for one; skip ``gpu`` tests."""
    items.sort(key=lambda item: "tests/workflow/" not in item.path.as_posix())
    marked = [item for item in items if item.get_closest_marker("gpu")]
    if not marked:
        return
    reason = gpu_skip_reason()
    if reason:
        for item in marked:
            item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def backend() -> variant.Backend:
    """Set Mitsuba's variant and return what was chosen."""
    preference = "cuda" if os.environ.get("FIPT_BACKEND") == "cuda" else "llvm"
    return variant.set_variant(variant.choose_backend(preference))


@pytest.fixture
def threads() -> Iterator[Callable[[int], None]]:
    """A function that sets the threads of Dr.Jit and torch; after the test they are what they were."""
    import drjit
    import torch

    before = drjit.thread_count(), torch.get_num_threads()
    yield lambda count: variant.set_variant(threads=count)
    drjit.set_thread_count(before[0])
    torch.set_num_threads(before[1])


@pytest.fixture
def np_rng() -> np.random.Generator:
    """A NumPy generator with a fixed seed, fresh for every test."""
    return np.random.default_rng(20231002)


@pytest.fixture(scope="session")
def open3d() -> None:
    """Skip where open3d cannot be imported: it is an extra, and expects libraries of the system."""
    works, said = tried()
    if not works:
        pytest.skip(f"open3d cannot be imported: {said}")


@pytest.fixture(scope="session")
def living_room() -> Path:
    """Folder that holds the living room's ``dataset/``; skips where it is absent."""
    named = os.environ.get("FIPT_LIVING_ROOM")
    if not named:
        pytest.skip("set FIPT_LIVING_ROOM to the folder of the living room scene")
    folder = Path(named)
    if not (folder / "dataset").is_dir():
        pytest.skip(f"FIPT_LIVING_ROOM={named} has no folder dataset/")
    return folder


@pytest.fixture
def fake_llvm() -> Callable[..., Path]:
    """A function that writes a file that begins like a library of this machine, or of ``another``, without code."""
    head = Path(sys.executable).read_bytes()[:64]
    if not head.startswith(b"\x7fELF"):
        pytest.skip("tells libraries of other architectures apart: Linux and BSD only")

    def write(path: Path, another: bool = False) -> Path:
        path.write_bytes(head[:18] + b"\xff\xff" + head[20:] if another else head)
        return path

    return write
