"""YAML: one reader, whose failures are one line with the file's name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from fipt.errors import FiptError
from fipt.formats.text import read_text

_MOST_NODES = 1_000_000
"""Keys and values of a file with its aliases written out: a thousand times those of a large configuration."""


class _Loader(yaml.SafeLoader):
    """Reads ``1e-3`` as a number; YAML 1.1 wants ``1.0e-3`` and would give a string.

    Refuses equal keys, and numbers that mean something else than they seem to: to YAML 1.1 010 is 8 and 1:30 is 90.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return the mapping; PyYAML alone would keep the last of equal keys."""
        own = [key for key, _ in node.value if key.tag != "tag:yaml.org,2002:merge"]
        seen: dict[Any, yaml.Node] = {}
        for key in own:
            if key.value in seen and key.tag == seen[key.value].tag and isinstance(key.value, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key.value!r} of line {_line(seen[key.value])} is there again",
                    key.start_mark,
                )  # fmt: skip
            if isinstance(key.value, str):
                seen[key.value] = key
        return super().construct_mapping(node, deep)

    def construct_plain_number(self, node: yaml.ScalarNode) -> Any:
        """Return a number that is written as people write it."""
        digits = node.value.lstrip("+-")
        if ":" in digits or (digits[:1] == "0" and digits[1:2].isdigit() and "." not in digits):
            raise yaml.constructor.ConstructorError(
                None,
                None,
                f"{node.value} means another number to YAML: write it plainly, or in quotes",
                node.start_mark,
            )
        kind = node.tag.rpartition(":")[2]
        return self.construct_yaml_int(node) if kind == "int" else self.construct_yaml_float(node)


def _line(node: yaml.Node) -> int:
    return node.start_mark.line + 1


for _kind in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _Loader.construct_plain_number)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+"),
    list("-+.0123456789"),
)


def parse_yaml(text: str) -> Any:
    """Read YAML; raises yaml.YAMLError, whatever is wrong with it."""
    try:
        values = yaml.load(text, _Loader)
        _size(values, {}, ())
    except (ValueError, TypeError, OverflowError, KeyError, IndexError, AttributeError) as error:
        raise yaml.YAMLError(str(error)) from error  # a number or date that cannot be
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply") from error
    return values


def _size(values: Any, known: dict[int, int], above: tuple[int, ...]) -> int:
    """Count keys and values with aliases written out; refuse what holds itself, and what is too much."""
    if not isinstance(values, dict | list):
        return 1
    if id(values) in above:
        raise yaml.YAMLError("an alias refers to what holds it")
    if id(values) not in known:
        inner = values.values() if isinstance(values, dict) else values
        known[id(values)] = 1 + sum(_size(value, known, (*above, id(values))) for value in inner)
    if known[id(values)] > _MOST_NODES:
        raise yaml.YAMLError("its aliases make it too large")
    return known[id(values)]


def read_yaml(path: str | Path, what: str = "the config file", remedy: str = "see config/README.md") -> dict[str, Any]:
    """Read a YAML file of keys at the top level; an empty one gives {}.

    Raises
    ------
    FiptError
        If it is not there, or is something else.
    """
    try:
        values = parse_yaml(read_text(path, what))
    except yaml.YAMLError as error:
        said = str(error).replace('in "<unicode string>", ', "in ")
        raise FiptError(f"{path} is not YAML ({said})", "correct the line it names") from error
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise FiptError(f"{path} must hold keys at its top level", remedy)
    return values
