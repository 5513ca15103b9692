"""Keys and values that were renamed: one clear line for each. The table is removed at 1.0."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from fipt.errors import FiptError

_SECTIONS = {
    "hits": "samples",
    "hits.max_hits": "samples.max_samples",
    "samples.max_hits": "samples.max_samples",
    "background": "environment",
    "lamps": "olat",
    "emitters.two_sided": "emitters.sides",
    "fuse.colour": "fuse.color",
    "fit.colour_weight": "fit.color_weight",
    "fit.evidence": "fit.emission_threshold",
    "fit.confidence": "fit.confidence_weights",
}
"""Old stage section, or key of one -> new one; in the config, and in the settings of a scene."""

_VALUES = {
    "emitters.two_sided": ": true is both, and false (one side, by winding) is gone",
}
"""Old key -> what became of its values, where they changed."""

_SETUPS = {"*.background": "environment"}
"""Old key of a relight setup -> its new name."""


_EMITTER = re.compile(r"lamp-(\d+)")
"""Name that every emitter had; it is emitter-N now."""


def refuse_renamed(values: Mapping[str, Any]) -> None:
    """Raise FiptError if a configuration says something by an old name; the message has all of them.

    Parameters
    ----------
    values
        The configuration as read, before it is checked.
    """
    found = list(dict.fromkeys(_renamed(values)))
    if found:
        raise FiptError("; ".join(found), "rename it (old names are told until 1.0)")


def _renamed(values: Mapping[str, Any]) -> Iterator[str]:
    places: list[tuple[str, Any]] = [("", values)]
    scenes = values.get("scenes")
    for name, scene in scenes.items() if isinstance(scenes, Mapping) else ():
        if isinstance(scene, Mapping):
            places += [(f"scenes.{name}.settings.", scene.get("settings")), (f"scenes.{name}.", scene)]
    methods = values.get("methods")
    for name, method in methods.items() if isinstance(methods, Mapping) else ():
        if isinstance(method, Mapping):
            places.append((f"methods.{name}.settings.", method.get("settings")))
    for where, place in places:
        for old, new in _SECTIONS.items():
            if not where.startswith("scenes.") or where.endswith("settings."):
                said = f"is {where}{new} now{_VALUES.get(old, '')}"
                yield from (f"{where}{path} {said}" for path in _paths(place, old.split(".")))
        setups = place.get("setups") if isinstance(place, Mapping) else None
        for old, new in _SETUPS.items():
            for path in _paths(setups, old.split(".")):
                yield f"{where}setups.{path} is called {new} now"
        yield from _emitters(setups, f"{where}setups")


def _emitters(setups: Any, where: str) -> Iterator[str]:
    """Old names of emitters in edits."""
    for name, setup in setups.items() if isinstance(setups, Mapping) else ():
        edits = setup.get("emitters") if isinstance(setup, Mapping) else None
        for edit in edits if isinstance(edits, list) else ():
            if not isinstance(edit, Mapping):
                continue
            names = edit.get("names")
            for called in [edit.get("name"), *(names if isinstance(names, list) else [])]:
                if isinstance(called, str) and (number := _EMITTER.fullmatch(called)):
                    yield f"{where}.{name}.emitters: {called} is emitter-{number[1]} now"


def _paths(values: Any, keys: list[str]) -> Iterator[str]:
    """Where a path of keys, ``*`` for any, is in plain values."""
    if not keys:
        yield ""
    elif isinstance(values, Mapping):
        for key in values if keys[0] == "*" else [keys[0]]:
            if key in values:
                yield from (f"{key}.{rest}".rstrip(".") for rest in _paths(values[key], keys[1:]))
