"""Settings of the environment map."""

from typing import Literal

from pydantic import Field

from fipt.errors import FiptError
from fipt.settings import Angle, Positive, Rgb, Settings


class EnvironmentSettings(Settings):
    """Light from outside: the radiance of rays that leave the mesh."""

    mode: Literal["auto", "none", "constant", "map", "given"] = Field(
        "auto",
        description="`none`: zero; `constant`, `map`: fitted to training pixels that see no surface; `given`: `file`; "
        "`auto`: `map` where enough pixels see outside, else `none`",
    )
    radiance: Rgb | None = Field(None, description="of mode `constant`, instead of a fitted one")
    file: str | None = Field(
        None, description="equirectangular map of mode `given`, EXR or HDR; {data_root} is replaced"
    )
    up: Literal["y", "z"] = Field("y", description="world axis towards the upper edge of the map")
    rotation: Angle = Field(0.0, description="turns `file` about that axis, degrees, counter-clockwise from above")
    resolution: Positive = Field(32, le=512, description="rows of a fitted map; it has twice as many columns")


def check_environment(settings: EnvironmentSettings, where: str = "environment") -> EnvironmentSettings:
    """Return the settings if their keys go together; ``where`` names the section in errors.

    Raises
    ------
    FiptError
        If mode `given` has no file, or a key is given that the mode does not use.
    """
    if settings.mode == "given" and settings.file is None:
        raise FiptError(f"{where}.mode is given, but environment.file is missing", "name an EXR or HDR environment map")
    for key, mode in (("file", "given"), ("radiance", "constant")):
        if getattr(settings, key) is not None and settings.mode != mode:
            raise FiptError(
                f"{where}.{key} is only for mode {mode}; mode is {settings.mode}", f"set {where}.mode: {mode}"
            )
    return settings
