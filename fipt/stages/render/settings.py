"""Settings of everything that is rendered with the fitted scene."""

from typing import ClassVar, Literal

from pydantic import Field

from fipt.settings import Count, Length, Positive, Settings


class MaterialsSettings(Settings):
    """Material maps of every view."""

    average: bool = Field(default=True, description="average over the footprint instead of the pixel's centre")


class RenderSettings(Settings):
    """Held-out views, path traced with the model."""

    spp: Positive = Field(default=128, description="paths per pixel, spread over its rays; two a ray at least")
    max_depth: Positive = Field(default=32, description="longest path, bounces")
    denoise: bool = Field(default=True, description="denoise the rendered views")
    seed: Count = Field(default=0, description="seed of the random numbers")


class RelightSettings(Settings):
    """Sampling of relit views."""

    of_plans: ClassVar = frozenset({"split"})

    split: Literal["train", "val", "all"] = Field(default="val", description="views to relight")
    spp: Positive = Field(default=128, description="paths per pixel, spread over its rays; two a ray at least")
    max_depth: Positive = Field(default=32, description="longest path, bounces")
    denoise: bool = Field(default=True, description="denoise the rendered views")
    seed: Count = Field(default=0, description="seed of the random numbers")


class VideoSettings(Settings):
    """Images and videos of what a setup's own cameras see."""

    exposure: Length | None = Field(
        default=None,
        description="factor before the tone curve; absent: that of the report, by the dataset's photographs",
    )
    quality: int = Field(
        default=20, ge=0, le=51, description="of the MP4 (H.264 constant rate factor), lower is better"
    )


class OlatSettings(Settings):
    """Views with one light at a time, for the report's light mixer."""

    views: Count = Field(
        default=3, description="held-out views (training views where there are none); 0 = no light mixer"
    )
    separate: Positive = Field(
        default=8, description="most powerful emitters that are rendered one by one; the rest together"
    )
    spp: Positive = Field(
        default=256, description="paths per pixel and light, spread over its rays; two a ray at least"
    )
    max_depth: Positive = Field(default=32, description="longest path, bounces")
    denoise: bool = Field(default=True, description="denoise the rendered views")
    seed: Count = Field(default=0, description="seed of the random numbers")
