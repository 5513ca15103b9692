"""What a job asks of the machine that it shares with other jobs of a run."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from fipt.formats.files import total_memory
from fipt.render.variant import find_cuda

if TYPE_CHECKING:
    from snakemake.workflow import Workflow


def all_processors(workflow: Workflow) -> int:
    """Processors of the machine that runs all jobs; of a job on a cluster, where nobody says how many there are."""
    return workflow.resource_settings.cores or int(os.environ.get("FIPT_THREADS", "4"))


def asked_processors(workflow: Workflow, wildcards: Any) -> int:
    """Processors that a job asks for; it uses all of its machine.

    Compilers, files and single threads leave a third of them idle, so two jobs share a machine without a GPU; but those
    of a comparison run one by one, since their times are compared.
    """
    del wildcards  # all jobs ask alike; Snakemake calls this when it knows the targets
    processors = all_processors(workflow)
    alone = any("compare" in target for target in workflow.dag_settings.targets)
    if not workflow.resource_settings.cores or alone or asked_gpus(workflow) or not workflow.is_main_process:
        return processors
    return -(-processors // 2)


def asked_gpus(workflow: Workflow) -> int:
    """GPUs that a job asks for which traces rays: none where none is used; nodes of a cluster may have some."""
    here = bool(workflow.resource_settings.cores)
    return int(os.environ.get("FIPT_BACKEND") != "llvm" and (not here or find_cuda().usable))


def bound_memory(workflow: Workflow) -> None:
    """Let jobs of this machine ask for no more memory than it has, all together; what one asks beyond is cut."""
    if workflow.resource_settings.cores and "mem_mb" not in workflow.global_resources:
        workflow.register_resource("mem_mb", total_memory() // 1_000_000)
