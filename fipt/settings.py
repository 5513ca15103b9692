"""Base of all settings: frozen models whose defaults are the preset ``default``; unknown keys are errors."""

import json
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Optional, get_args

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, create_model, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import PydanticCustomError, PydanticUndefined

from fipt.validation import checked, kinds_of, of_another_kind

_MOST = 2**32 - 1
"""Largest number of things, and largest seed: samplers take 32 bits, and a machine of today computes no more."""


def _countable(value: int) -> int:
    if value > _MOST:
        raise ValueError(f"must be at most {_MOST}; found {str(value)[:30]}")
    return value


Positive = Annotated[int, Field(ge=1), AfterValidator(_countable)]
Count = Annotated[int, Field(ge=0), AfterValidator(_countable)]
Rounds = Annotated[int, Field(ge=0, le=20), AfterValidator(_countable)]
Weight = Annotated[float, Field(ge=0, le=1e12)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Length = Annotated[float, Field(ge=1e-6, le=1e6)]
Rgb = Annotated[tuple[Weight, Weight, Weight], Field(description="linear RGB")]
Angle = Annotated[float, Field(ge=-360, le=360)]
_Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Point = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], Field(description="world position, metres")]


class Settings(BaseModel):
    """Base of all settings: frozen, unknown keys refused, NaN refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    of_plans: ClassVar[frozenset[str]] = frozenset()
    """Keys that say which jobs there are; no job reads them."""

    @model_validator(mode="before")
    @classmethod
    def _numbers_are_no_truth_values(cls, values: Any) -> Any:
        """Refuse yes and no where a number or text is wanted; pydantic takes them for 1 and 0."""
        if isinstance(values, Mapping):
            for name, field in cls.model_fields.items():
                if name in values and _holds_truth(values[name]) and not _admits_truth(field.annotation):
                    said = "yes" if values[name] is True else "no" if values[name] is False else "yes or no"
                    raise PydanticCustomError("truth_value", "{key} must be no truth value; found {said}",
                                              {"key": name, "said": said})  # fmt: skip
        return values


def _holds_truth(value: Any) -> bool:
    """Whether a value is true or false, or a list with one of these."""
    return isinstance(value, bool) or (isinstance(value, list | tuple) and any(map(_holds_truth, value)))


def _admits_truth(annotation: Any) -> bool:
    """Whether bool is among the types of an annotation, at any depth."""
    return annotation in (bool, Any) or any(_admits_truth(part) for part in get_args(annotation))


Turn = Annotated[tuple[Angle, Angle, Angle], Field(description="degrees about x, then y, then z of the world")]
Reflectance = Annotated[tuple[Fraction, Fraction, Fraction], Field(description="linear RGB, 0 to 1")]
Roughness = Annotated[float, Field(ge=0.02, le=1)]


def dumped(settings: Settings) -> dict[str, Any]:
    """Settings that jobs read, as plain JSON types: what only plans read makes nothing anew."""
    return json.loads(settings.model_dump_json(exclude=set(settings.of_plans)))


def validate(model: Any, section: str, values: Mapping[str, Any]) -> Any:
    """Return ``values`` as ``model``.

    Raises
    ------
    FiptError
        One line that names the key's path below ``section`` and what is allowed.
    """
    return checked(model, values, root=section)


def by_mode(union: Any) -> BeforeValidator:
    """Let values of layers choose a member of a union of settings classes by its ``mode``.

    The first member is chosen where nothing is said. Layers of a configuration are merged before they are checked, and
    one of them may tune a mode that another does not choose: such keys are left out. A key that has no default was
    meant, and is refused where its mode was not chosen.
    """

    def prepared(values: Any) -> Any:
        kinds = kinds_of(union)
        if kinds is None or not isinstance(values, Mapping):
            return values
        mode: Any = values.get(kinds.key, next(iter(kinds.members)))
        if not isinstance(mode, str) or mode not in kinds.members:
            return values
        own = kinds.members[mode].model_fields
        key: Any
        for key in values:
            others = {tag: kind.model_fields[key] for tag, kind in kinds.members.items() if key in kind.model_fields}
            if key in own or all(field.get_default() not in (None, PydanticUndefined) for field in others.values()):
                continue
            if values[key] is not None:
                raise of_another_kind(key, kinds.key, others, mode)
        known = {key for kind in kinds.members.values() for key in kind.model_fields}
        return {kinds.key: mode} | {key: value for key, value in values.items() if key in own or key not in known}

    return BeforeValidator(prepared)


def layer_of(model: Any) -> type[Settings]:
    """Class of what one layer of a configuration may say about a section: of a union, any key of any member."""
    kinds = kinds_of(model)
    if kinds is None:
        return model
    first, *_ = members = list(dict.fromkeys(kinds.members.values()))
    meaning = "; ".join(f"`{tag}`: {_meaning(member)}" for tag, member in kinds.members.items())
    choice = Field(next(iter(kinds.members)), description=meaning)
    fields: dict[str, Any] = {kinds.key: (Literal[tuple(kinds.members)], choice)}
    for member in members:
        for key, field in member.model_fields.items():
            kind: Any = Optional[field.annotation] if field.is_required() else field.annotation  # noqa: UP045 - a value
            default = None if field.is_required() else field.default
            fields.setdefault(key, (kind, FieldInfo.merge_field_infos(field, annotation=kind, default=default)))
    base = next(kind for kind in reversed(first.__mro__) if issubclass(kind, Settings) and kind is not Settings)
    return create_model(base.__name__.lstrip("_") + "Layer", __base__=Settings, __doc__=base.__doc__, **fields)


def _meaning(model: type[BaseModel]) -> str:
    text = (model.__doc__ or "").splitlines()[0].rstrip(".")
    return text[0].lower() + text[1:]
