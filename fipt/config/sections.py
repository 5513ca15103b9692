"""The stage sections of the configuration, and the layers that they are merged from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field, create_model

from fipt.config.files import merge
from fipt.errors import FiptError
from fipt.formats.yaml import read_yaml
from fipt.registry import settings_classes
from fipt.settings import Settings, layer_of
from fipt.validation import checked

PRESETS = Path(__file__).resolve().parent / "presets"
"""Folder of the presets, one YAML file each."""

STAGES = settings_classes()
"""Section -> class of its settings, or a union of some."""

LAYERS = {section: layer_of(model) for section, model in STAGES.items()}
"""Section -> class of what one layer of the configuration may say about it."""

_FIELDS: dict[str, Any] = {
    section: (layer | None, Field(default=None, description=layer.__doc__)) for section, layer in LAYERS.items()
}

Sections = create_model(
    "Sections",
    __base__=Settings,
    __doc__="One optional section for each stage; absent keys keep what the layer before says.",
    **_FIELDS,
)


def preset(name: str, where: str) -> Settings:
    """Return a preset; ``where`` is the key that names it, for the error.

    Raises
    ------
    FiptError
        If there is no such preset.
    """
    known = _presets()
    if name not in known:
        raise FiptError(f"{where}: there is no preset {name!r}", f"presets: {', '.join(known)}")
    return _read_preset(name)


@cache
def _presets() -> list[str]:
    return sorted(path.stem for path in PRESETS.glob("*.yaml"))


@cache
def _read_preset(name: str) -> Settings:
    return checked(Sections, read_yaml(PRESETS / f"{name}.yaml"), f"preset {name}: ")


def resolved(layers: Iterable[BaseModel], where: str) -> dict[str, Any]:
    """Section -> settings: layers merged as plain values, later ones winning, then checked once.

    Raises
    ------
    FiptError
        If what the layers say together cannot be; the message starts with ``where``.
    """
    merged: dict[str, dict[str, Any]] = {section: {} for section in STAGES}
    for layer in layers:
        for section, values in merged.items():
            said = getattr(layer, section)
            if said is not None:
                merge(values, given(said))
    return {section: checked(STAGES[section], values, where, section) for section, values in merged.items()}


def given(model: BaseModel) -> Mapping[str, Any]:
    """What somebody said, as plain JSON types, without defaults."""
    return model.model_dump(mode="json", exclude_unset=True)
