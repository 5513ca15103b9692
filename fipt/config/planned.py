"""What makes functions of the workflow quick to call."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any


def planned(function: Callable[..., Any]) -> Callable[..., Any]:
    """Note what a function takes: a plan asks before every call, a hundred thousand times of a thousand rooms."""
    function.__signature__ = inspect.signature(function)  # pyright: ignore[reportFunctionMemberAccess] - inspect reads it
    return function


def look_up_once(index: type[Any]) -> None:
    """Let the workflow system's index of outputs remember which rules make a file: every job that reads it asks.

    Rules do not change while an index lives. An index asks some 250 patterns for each file otherwise.
    """
    search = index.match_producers
    if hasattr(search, "__wrapped__"):
        return

    @wraps(search)
    def match_producers(self: Any, targetfile: str) -> set[Any]:
        known = self.__dict__.setdefault("known_producers", {})
        if targetfile not in known:
            known[targetfile] = search(self, targetfile)
        return known[targetfile]

    index.match_producers = match_producers
