"""What the jobs of a run share of the machine that they run on."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from fipt.formats.files import total_memory
from fipt.render.variant import find_cuda

if TYPE_CHECKING:
    from snakemake.workflow import Workflow

_JUDGES = "score_method"
"""The rule that reads how long jobs of a comparison took."""


def _on_one_machine(workflow: Workflow) -> bool:
    """Whether all jobs run on this machine. A cluster has nodes; somebody may state cores beside them."""
    asked = workflow.resource_settings
    return asked.cores is not None and asked.nodes is None


def asked_gpus(workflow: Workflow) -> int:
    """GPUs that a job asks for which traces rays: none where none is used; nodes of a cluster may have some."""
    used = not _on_one_machine(workflow) or find_cuda().usable
    return int(used and os.environ.get("FIPT_BACKEND") != "llvm")


def bound_memory(workflow: Workflow) -> None:
    """Let jobs that run together ask for no more memory than this machine has; one that asks for more runs alone."""
    if _on_one_machine(workflow) and "mem_mb" not in workflow.global_resources:
        workflow.register_resource("mem_mb", total_memory() // 1_000_000)


def share_processors(workflow: Workflow) -> None:
    """Let two jobs run at a time on one machine without a GPU, each on all its processors.

    One alone leaves a third of them idle: compilers, files and single threads do. Where times are compared, jobs run
    one by one.
    """
    compares = any(job.rule.name == _JUDGES for job in workflow.dag.needrun_jobs())
    if _on_one_machine(workflow) and not asked_gpus(workflow) and not compares:
        workflow.register_resource("_cores", 2 * workflow.resource_settings.cores)
