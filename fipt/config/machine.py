"""What a run needs of this machine, checked before its first job: a device that traces rays, and room on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fipt.config.layout import RESULTS
from fipt.config.resources import disk_bytes
from fipt.config.scene import SceneConfig
from fipt.formats.files import check_disk


@dataclass(frozen=True)
class PlannedJob:
    """A job that will run, as far as the machine matters.

    Attributes
    ----------
    rule
        Name of its rule.
    scene, shard
        What it works on.
    rays
        Whether it traces rays.
    fresh
        Whether nothing lies where it writes: what it replaces makes room.
    """

    rule: str
    scene: SceneConfig
    shard: str | None
    rays: bool
    fresh: bool


def check_machine(jobs: Sequence[PlannedJob], here: bool) -> None:
    """Refuse a run that cannot end well on this machine.

    Parameters
    ----------
    jobs
        All that will run.
    here
        Whether they run on this machine: nodes of a cluster may have what this one lacks.

    Raises
    ------
    FiptError
        If no device can trace the rays, or the disk is too small.
    """
    from fipt.render.variant import choose_backend

    if here and any(job.rays for job in jobs):
        choose_backend()
    needed = sum(disk_bytes(job.rule, job.scene.known_work(job.shard)) for job in jobs if job.fresh)
    if needed:
        check_disk(RESULTS, round(needed), f"a run of {len(jobs)} jobs")
