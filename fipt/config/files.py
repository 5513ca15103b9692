"""How later files of keys are laid on earlier ones."""

from collections.abc import Mapping
from typing import Any


def merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Lay ``values`` on ``into``, mapping by mapping."""
    for key, value in values.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            merge(into[key], value)
        else:
            into[key] = value
