"""Settings of the environment map."""

from typing import Annotated, Literal

from pydantic import Field

from fipt.settings import Angle, Positive, Rgb, Settings, by_mode


class _Environment(Settings):
    """Light from outside: the radiance of rays that leave the mesh."""

    up: Literal["y", "z"] = Field(default="y", description="world axis towards the upper edge of the map")


class _Fitted(_Environment):
    resolution: Positive = Field(default=32, le=512, description="rows of a fitted map; it has twice as many columns")


class _Map(_Fitted):
    unseen: Literal["room", "smooth"] = Field(
        default="room",
        description="directions that no pixel looks along: `room` finds what explains the light in the room, "
        "`smooth` continues what is seen",
    )
    sun: bool = Field(default=True, description="with `unseen: room`, look for a sun that no pixel sees")


class AutoEnvironment(_Map):
    """As `map` where enough training pixels see outside, else as `none`."""

    mode: Literal["auto"] = "auto"


class NoEnvironment(_Environment):
    """Zero."""

    mode: Literal["none"] = "none"


class ConstantEnvironment(_Fitted):
    """One radiance for all directions: stated, or fitted to training pixels that see no surface."""

    mode: Literal["constant"] = "constant"
    radiance: Rgb | None = Field(default=None, description="of mode `constant`, instead of a fitted one")


class FittedMap(_Map):
    """Fitted to training pixels that see no surface."""

    mode: Literal["map"] = "map"


class GivenEnvironment(_Environment):
    """A map of a `file`."""

    mode: Literal["given"] = "given"
    file: str = Field(description="equirectangular map of mode `given`, EXR or HDR; {data_root} is replaced")
    rotation: Angle = Field(
        default=0.0, description="turns `file` about that axis, degrees, counter-clockwise from above"
    )


_AnyMode = AutoEnvironment | NoEnvironment | ConstantEnvironment | FittedMap | GivenEnvironment
EnvironmentSettings = Annotated[_AnyMode, Field(discriminator="mode"), by_mode(_AnyMode)]
