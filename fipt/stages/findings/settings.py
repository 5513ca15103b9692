"""Settings of the findings."""

from pydantic import Field

from fipt.settings import Count, Positive, Settings


class FindingsSettings(Settings):
    """What is wrong with a run, why, and what to do: how much is looked at. Thresholds are no settings."""

    views: Positive = Field(default=16, description="training views that are rendered again, spread over their list")
    width: int = Field(default=56, ge=16, description="of these images, pixels: photographs are reduced to it")
    spp: Positive = Field(default=32, description="paths per pixel of these images")
    max_depth: Positive = Field(default=32, description="longest path, bounces")
    pixels: int = Field(
        default=100_000, ge=1000, description="training pixels compared with what the fit says of them, about"
    )
    patches: Positive = Field(default=320, description="patches around edges whose place is compared, about")
    seed: Count = Field(default=0, description="seed of the random numbers")
