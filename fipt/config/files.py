"""YAML files of keys, and how later ones are laid on earlier ones."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from fipt.errors import FiptError


class _Loader(yaml.SafeLoader):
    """Reads ``1e-3`` as a number; YAML 1.1 wants ``1.0e-3`` and would give a string."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+"),
    list("-+.0123456789"),
)


def parse_yaml(text: str) -> Any:
    """Read YAML; raises yaml.YAMLError."""
    return yaml.load(text, _Loader)


def read_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML file of keys at the top level; an empty one gives {}.

    Raises
    ------
    FiptError
        If it is not there, or is something else.
    """
    try:
        values = parse_yaml(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FiptError(f"config file {path} does not exist", "check the path") from None
    except yaml.YAMLError as error:
        raise FiptError(f"{path} is not YAML ({error})", "correct the line it names") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise FiptError(f"{path} must hold keys at its top level", "see config/README.md")
    return values


def merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    """Lay ``values`` on ``into``, mapping by mapping."""
    for key, value in values.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            merge(into[key], value)
        else:
            into[key] = value
