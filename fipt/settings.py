"""Base of all settings: frozen models whose defaults are the preset ``default``; unknown keys are errors."""

import json
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fipt.errors import FiptError

Positive = Annotated[int, Field(ge=1)]
Count = Annotated[int, Field(ge=0)]
Weight = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1)]
Length = Annotated[float, Field(gt=0)]
Rgb = Annotated[tuple[Weight, Weight, Weight], Field(description="linear RGB")]
Angle = Annotated[float, Field(ge=-360, le=360)]
Point = Annotated[tuple[float, float, float], Field(description="world position, metres")]


class Settings(BaseModel):
    """Base of all settings: frozen, unknown keys refused, NaN refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


Turn = Annotated[tuple[Angle, Angle, Angle], Field(description="degrees about x, then y, then z of the world")]
Reflectance = Annotated[tuple[Fraction, Fraction, Fraction], Field(description="linear RGB, 0 to 1")]
Roughness = Annotated[float, Field(ge=0.02, le=1)]


def explain(error: ValidationError, where: str) -> str:
    """Return one line for the first problem of a pydantic error: key path, what is allowed, what was found."""
    problem = error.errors()[0]
    path = ".".join([where, *(str(part) for part in problem["loc"])])
    if problem["type"] == "value_error":  # keys that do not go together
        return f"{path}: {problem['ctx']['error']}"
    if problem["type"] == "extra_forbidden":
        return f"unknown key {path}"
    text = problem["msg"]
    return f"{path}: {text[0].lower()}{text[1:]}; found {problem.get('input')!r}"


def dumped(settings: Settings) -> dict[str, Any]:
    """Settings as plain JSON types."""
    return json.loads(settings.model_dump_json())


def validate(model: type[Settings], section: str, values: Mapping[str, Any]) -> Any:
    """Return ``values`` as ``model``.

    Raises
    ------
    FiptError
        One line that names the key's path below ``section`` and what is allowed.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        allowed = ", ".join(model.model_fields)
        raise FiptError(explain(error, section), f"allowed keys of {section}: {allowed}") from error
