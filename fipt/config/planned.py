"""What makes plans of many rooms quick: the workflow system asks the same things for every file of every job."""

from __future__ import annotations

import inspect
from collections import defaultdict
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any


def planned(function: Callable[..., Any]) -> Callable[..., Any]:
    """Note what a function takes: a plan asks before every call, a hundred thousand times of a thousand rooms."""
    function._overwrite_params = inspect.signature(function).parameters  # pyright: ignore[reportFunctionMemberAccess]
    return function


class FilesByEnding:
    """Which rules make a file, looked up by how its name ends: before the first wildcard all ours say ``results/``.

    Takes the place of the workflow system's index, which looks at the beginning.

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


def plan_once(graph: type[Any], job: type[Any]) -> None:
    """Let the workflow system's graph remember which job makes a file, and jobs have no environment of their own.

    A room has some 70 files that jobs read, and they are read 500 times: the graph would go through the job of each
    every time. It would also expand the parameters of all jobs, to learn that no rule names an environment.
    """
    search = graph.update
    if hasattr(search, "__wrapped__"):
        return

    @wraps(search)
    async def update(
        self: Any, jobs: Any, file: Any = None, visited: Any = None, known_producers: Any = None, **named: Any
    ) -> Any:
        found = await search(self, jobs, file=file, visited=visited, known_producers=known_producers, **named)
        if file is not None and known_producers is not None:
            known_producers[file] = [found]
        return found

    graph.update = update
    job.conda_env_spec = None
