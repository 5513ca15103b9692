"""What jobs share of their machine."""

from types import SimpleNamespace

import pytest

from fipt.render.variant import CudaDriver
from fipt.workflow import machine


def workflow_of(cores, nodes, rules=("fit",)):
    """What is read of Snakemake's workflow; ``registered`` has the resources that were set."""
    registered = {}
    jobs = [SimpleNamespace(rule=SimpleNamespace(name=name)) for name in rules]
    return SimpleNamespace(
        resource_settings=SimpleNamespace(cores=cores, nodes=nodes),
        global_resources={},
        dag=SimpleNamespace(needrun_jobs=lambda: jobs),
        registered=registered,
        register_resource=registered.__setitem__,
    )


@pytest.fixture
def gpu(monkeypatch):
    """A function that sets whether this machine has a GPU, and the backend that somebody asked for."""

    def give(usable, backend):
        monkeypatch.delenv("FIPT_BACKEND", raising=False)
        if backend:
            monkeypatch.setenv("FIPT_BACKEND", backend)
        found = CudaDriver(("H100",)) if usable else CudaDriver(problem="none")
        monkeypatch.setattr(machine, "find_cuda", lambda: found)

    return give


@pytest.mark.parametrize(
    ("cores", "nodes", "backend", "usable", "asked"),
    [
        (2, None, None, False, 0),
        (2, None, None, True, 1),
        (2, None, "llvm", True, 0),
        (None, 100, None, False, 1),
        (8, 100, None, False, 1),
        (None, 100, "llvm", False, 0),
    ],
    ids=["no GPU", "a GPU", "it is not used", "a cluster", "a cluster, cores given", "nodes without any"],
)
def test_jobs_ask_for_a_gpu_that_is_used(gpu, cores, nodes, backend, usable, asked):
    gpu(usable, backend)
    assert machine.asked_gpus(workflow_of(cores, nodes)) == asked


@pytest.mark.parametrize(
    ("cores", "nodes", "usable", "rules", "registered"),
    [
        (1, None, False, ["fit"], {"_cores": 2}),
        (5, None, False, ["fit"], {"_cores": 10}),
        (5, None, True, ["fit"], {}),
        (5, None, False, ["fit", "score_method"], {}),
        (None, 100, False, ["fit"], {}),
        (5, 100, False, ["fit"], {}),
    ],
    ids=["one core", "an odd number", "a GPU", "times are compared", "a cluster", "a cluster, cores given"],
)
def test_two_jobs_share_the_processors_of_one_machine(gpu, cores, nodes, usable, rules, registered):
    gpu(usable, None)
    workflow = workflow_of(cores, nodes, rules)
    machine.share_processors(workflow)
    assert workflow.registered == registered


def test_memory_is_bound_where_nobody_has_bound_it(monkeypatch):
    monkeypatch.setattr(machine, "total_memory", lambda: 24_000_000_000)
    here, cluster, given = workflow_of(2, None), workflow_of(None, 100), workflow_of(2, None)
    given.global_resources["mem_mb"] = 1000
    for workflow in (here, cluster, given):
        machine.bound_memory(workflow)
    assert (here.registered, cluster.registered, given.registered) == ({"mem_mb": 24_000}, {}, {})
