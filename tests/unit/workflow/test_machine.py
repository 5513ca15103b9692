"""What a job asks of its machine."""

from types import SimpleNamespace

import pytest

from fipt.render.variant import CudaDriver
from fipt.workflow import machine


@pytest.mark.parametrize(
    ("cores", "backend", "usable", "asked"),
    [(2, None, False, 0), (2, None, True, 1), (2, "llvm", True, 0), (None, None, False, 1), (None, "llvm", False, 0)],
    ids=["no GPU", "a GPU", "it is not used", "a cluster may have some", "nodes without any"],
)
def test_jobs_ask_for_a_gpu_that_is_used(monkeypatch, cores, backend, usable, asked):
    monkeypatch.delenv("FIPT_BACKEND", raising=False)
    if backend:
        monkeypatch.setenv("FIPT_BACKEND", backend)
    monkeypatch.setattr(machine, "find_cuda", lambda: CudaDriver(("H100",) if usable else (), "" if usable else "none"))
    workflow = SimpleNamespace(resource_settings=SimpleNamespace(cores=cores))
    assert machine.asked_gpus(workflow) == asked


@pytest.mark.parametrize(("cores", "main", "asked"), [(1, True, 1), (5, True, 3), (4, False, 4), (None, True, 6)])
def test_two_jobs_share_the_processors_of_one_machine(monkeypatch, cores, main, asked):
    monkeypatch.setenv("FIPT_THREADS", "6")
    workflow = SimpleNamespace(
        resource_settings=SimpleNamespace(cores=cores),
        dag_settings=SimpleNamespace(targets={"report"}),
        is_main_process=main,
    )
    assert machine.asked_processors(workflow, {}) == asked
