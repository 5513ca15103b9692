"""What makes plans of many rooms quick: Snakemake's graph, rules and jobs with shorter ways to the same answers.

Snakemake asks the same things for every file of every job. What goes beyond what our rules say (flags of inputs,
checkpoints, errors) its own methods do. They hold for one workflow in a process at a time.
"""

from __future__ import annotations

import atexit
import gc
import inspect
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import snakemake.api  # noqa: F401 - the first: other modules import each other
from snakemake import dag, iocontainers, jobs, workflow
from snakemake.dag import DAG
from snakemake.io import IOFile, _IOFile
from snakemake.iocontainers import AttributeGuard, InputFiles, Wildcards
from snakemake.jobs import Job
from snakemake.resources import Resource
from snakemake.rules import Rule


def planned(function: Callable[..., Any]) -> Callable[..., Any]:
    """Note what a function takes: a plan asks before every call, a hundred thousand times of a thousand rooms."""
    function._overwrite_params = inspect.signature(function).parameters  # pyright: ignore[reportFunctionMemberAccess]
    return function


def plan_quickly() -> None:
    """Let the workflow that is being read use what is here."""
    # A plan is made of objects that stay: to look for what may go takes an eighth of its time, a quarter at the end.
    gc.set_threshold(50_000, 50, 1000)
    atexit.register(gc.freeze)
    RoomRule.files.clear()
    workflow.DAG, workflow.Rule, jobs.Job = RoomGraph, RoomRule, RoomJob
    dag.OutputIndex = FilesByEnding
    planned(Resource.evaluate)
    iocontainers.AttributeGuard = OneGuard
    _IOFile.clone_flags = _clone_flags


class FilesByEnding:
    """Which rules make a file, looked up by how its name ends: before the first wildcard all ours say ``results/``.

    Takes the place of Snakemake's index, which looks at the beginning.

    Parameters
    ----------
    rules : iterable of rules
        Each with the patterns of what it makes.
    """

    def __init__(self, rules: Iterable[Any]) -> None:
        self._known: dict[str, list[tuple[str, Any, Any]]] = defaultdict(list)
        for rule in rules:
            for product in rule.products():
                entry = str(product.constant_prefix()), product, rule
                self._known[str(product.constant_suffix())].append(entry)
        self._lengths = {len(ending) for ending in self._known}

    def match_producers(self, targetfile: str) -> set[Any]:
        """Rules that make this file."""
        endings = [targetfile[len(targetfile) - length :] for length in self._lengths if length <= len(targetfile)]
        return {
            rule
            for ending in endings
            for prefix, product, rule in self._known.get(ending, ())
            if targetfile.startswith(prefix) and product.match(targetfile)
        }


class RoomGraph(DAG):
    """A graph that remembers which job makes a file: a room has some 70 that jobs read, and they are read 500 times."""

    async def update(
        self, jobs: Any, file: Any = None, visited: Any = None, known_producers: Any = None, **named: Any
    ) -> Any:
        """Add jobs; return the one of them that makes the file."""
        found = await super().update(jobs, file=file, visited=visited, known_producers=known_producers, **named)
        if file is not None and known_producers is not None:
            known_producers[file] = [found]
        return found

    def cache_job(self, job: Any) -> None:
        """Remember a job by its outputs: no job reads logs and benchmarks."""
        for file in job.output:
            self.job_cache[job.rule, file] = job

    def check_directory_outputs(self) -> None:
        """Check that no output lies in one that is a folder: as paths only where names look so."""
        outputs = sorted((f"{file}/", id(job)) for job in self.jobs for file in job.output)
        if any(below.startswith(folder) for (folder, _), (below, _) in pairwise(outputs)):
            super().check_directory_outputs()


class RoomRule(Rule):
    """A rule of whose inputs each is one object, however many jobs read it."""

    files: ClassVar[dict[Any, Any]] = {}
    """Path, with what Snakemake may put before it -> the file that jobs read."""

    @cached_property
    def _inputs(self) -> list[Any] | None:
        """Name, and pattern or function of every input; None where they are flagged or outputs of a certain rule."""
        plain = not self.dependencies and not any(getattr(item, "flags", None) for item in self.input)
        return list(self.input._allitems()) if plain else None

    @cached_property
    def _namings(self) -> dict[Any, Any]:
        """Which inputs are called what: the same of most jobs, so one object of them."""
        return {}

    def expand_input(self, wildcards: Any, groupid: Any = None) -> tuple[Any, Any, Any, bool]:
        """Files that a job reads."""
        if self._inputs is None:
            return super().expand_input(wildcards, groupid)
        files, asked = InputFiles(), Wildcards(fromdict=wildcards)
        for name, item in self._inputs:
            try:
                read, single = self._read(item, asked, wildcards)
            except Exception:  # noqa: BLE001 - Snakemake says what is wrong, or knows what to do
                return super().expand_input(wildcards, groupid)
            files.extend(read)
            if name:
                files._set_name(name, len(files) - len(read), end=None if single else len(files))
        files._names = self._namings.setdefault(tuple(files._names.items()), files._names)
        return files, {}, {}, False

    def _read(self, item: Any, asked: Any, wildcards: Any) -> tuple[list[Any], bool]:
        """Files of an input, and whether it is one alone."""
        if not callable(item):
            return [item.apply_wildcards(wildcards)], True
        found: Any = item(asked)
        single = isinstance(found, str)
        return list(map(self._file, [found] if single else found)), single

    def _file(self, path: Any) -> Any:
        if type(path) is not str or "{" in path:
            raise TypeError("paths with flags and wildcards are Snakemake's")
        file = self.files.get((path, self.input_modifier))
        if file is None:
            modified = self.apply_path_modifier(path, self.input_modifier, property="input")
            file = self.workflow.modifier.default_input_flags.apply(IOFile(modified, rule=self))
            file.check()
            self.files[path, self.input_modifier] = file
        return file


class RoomJob(Job):
    """A job that takes shorter ways to what it says of itself."""

    conda_env_spec = None  # no rule names an environment; parameters would be expanded to learn that

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        for kind in ("temp_output", "protected_output", "touch_output", "pipe_or_service_output", "_queue_input"):
            setattr(self, kind, getattr(self, kind) or _NONE)

    @property
    async def output_mintime(self) -> float | None:
        """When the oldest of its outputs was written; no task is made for each."""
        files = [*self.output, *filter(None, [self.benchmark])]
        return min([(await file.mtime()).local_or_storage() for file in files if await file.exists()], default=None)

    def is_valid(self) -> None:
        """Do nothing: that logs and benchmarks have the wildcards of outputs is seen when rules are read."""

    def log_info(self, *args: Any, **named: Any) -> None:
        """Tell of the job; its command is put together once, though it is told three times."""
        self._command = super().shellcmd
        super().log_info(*args, **named)
        del self._command

    @property
    def shellcmd(self) -> str | None:
        """Its command."""
        return self._command if hasattr(self, "_command") else super().shellcmd


_NONE: frozenset[Any] = frozenset()


class OneGuard(AttributeGuard):
    """What stands in every list of files against its methods ``index`` and ``sort``: one object for each name."""

    _known: ClassVar[dict[str, OneGuard]] = {}

    def __new__(cls, name: str) -> OneGuard:
        """Return that of a name."""
        return cls._known.setdefault(name, super().__new__(cls))


_copy_flags = _IOFile.clone_flags


def _clone_flags(file: Any, other: Any, skip_storage_object: bool = False) -> None:
    """Copy the flags of a file, if it has any: the copy would be a third of the memory of a plan's files."""
    if other.flags:
        _copy_flags(file, other, skip_storage_object)
