"""What makes plans of many rooms quick."""

import asyncio

from snakemake.io import IOFile

from fipt.config.planned import FilesByEnding, plan_once


class MakingRule:
    """Stands in for a rule that makes files."""

    def __init__(self, *patterns):
        self.patterns = patterns

    def products(self):
        return [IOFile(pattern) for pattern in self.patterns]


def test_rules_are_found_by_the_ends_of_names():
    samples = MakingRule("results/{scene}/samples/{shard,val-0}", "results/{scene}/samples/{shard}.json")
    other = MakingRule("results/{scene}/cache.npz", "results/all.json", "elsewhere/{scene}.json")
    index = FilesByEnding([samples, other])
    for name, found in {
        "results/room/samples/val-0": [samples],
        "results/room/samples/val-1": [],  # its wildcard may not be that
        "results/room/samples/val-1.json": [samples],
        "results/room/cache.npz": [other],
        "results/all.json": [other],
        "elsewhere/room.json": [other],
        "nowhere/room.json": [],
        "z": [],
    }.items():
        assert index.match_producers(name) == set(found), name


class Graph:
    """Stands in for the workflow system's: each file is made by a job that is called so."""

    def __init__(self):
        self.asked = []

    async def update(self, jobs, file=None, visited=None, known_producers=None):
        self.asked.append(file)
        return f"job of {file}"


class Job:
    """Stands in for the workflow system's."""

    @property
    def conda_env_spec(self):
        raise AssertionError("parameters would be expanded")


def test_the_job_of_a_file_is_known_once_it_is_found():
    plan_once(Graph, Job)
    plan_once(Graph, Job)  # a second workflow in the process
    graph, known = Graph(), {"missing": None}
    asyncio.run(graph.update(["job"], "file", known_producers=known))
    asyncio.run(graph.update(["job of a target"]))
    assert known == {"missing": None, "file": ["job of file"]}
    assert graph.asked == ["file", None]
    assert Job().conda_env_spec is None
