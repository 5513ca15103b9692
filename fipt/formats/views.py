"""views.json: which views are accepted, and why others are not."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED

T = TypeVar("T")


def read_rejected(path: str | Path) -> dict[str, str]:
    """Read views.json, or a check's file of its form; return rejected view -> reason. A missing file rejects none."""

    def reason(state: dict[str, Any]) -> str | None:
        if not isinstance(state["accepted"], bool):
            raise ValueError(f"accepted must be true or false, found {state['accepted']!r}")
        return None if state["accepted"] else str(state["reason"])

    return _of_views(path, reason)


def read_names(path: str | Path) -> list[str]:
    """Names of the views of such a file. A missing file has none."""
    return list(_of_views(path, lambda state: True))


def read_gains(path: str | Path) -> dict[str, float]:
    """Read a check's file; return view -> factor on its images, of those that have one. A missing file has none."""

    def gain(state: dict[str, Any]) -> float | None:
        value = state.get("gain", 1.0)
        if isinstance(value, bool) or not 0 < value < math.inf:
            raise ValueError(f"gain must be positive, found {value}")
        return None if value == 1 else value

    return _of_views(path, gain)


def _of_views(path: str | Path, value_of: Callable[[dict[str, Any]], T | None]) -> dict[str, T]:
    """What is told of views, of those of which something is."""
    path = Path(path)
    if not path.is_file():
        return {}
    try:
        views = json.loads(path.read_text(encoding="utf-8"))["views"]
        found = {name: value_of(state) for name, state in views.items()}
    except MALFORMED as error:
        raise FiptError(f"{path} is not a {path.name} ({error!r})", "run what wrote it again") from error
    return {name: value for name, value in found.items() if value is not None}
