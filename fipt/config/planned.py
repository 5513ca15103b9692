"""What makes functions of the workflow quick to call."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any


def planned(function: Callable[..., Any]) -> Callable[..., Any]:
    """Note what a function takes: a plan asks before every call, a hundred thousand times of a thousand rooms."""
    function.__signature__ = inspect.signature(function)  # pyright: ignore[reportFunctionMemberAccess] - inspect reads it
    return function
