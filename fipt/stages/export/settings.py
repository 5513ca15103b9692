"""Settings of the export."""

from typing import ClassVar

from pydantic import Field

from fipt.settings import Count, Positive, Settings, Weight


class ExportSettings(Settings):
    """The room for other programs, and the check of its files."""

    of_plans: ClassVar = frozenset({"enabled"})

    enabled: bool = Field(
        default=False, description="export and check with every run; `export` as a target does it anyway"
    )
    texel_density: Weight = Field(
        default=0.0, description="texels along a metre of surface; 0 = two along a pixel of the closer training views"
    )
    max_resolution: int = Field(default=4096, ge=64, le=16384, description="longest side of the textures, texels")
    samples: Positive = Field(default=2, le=8, description="a texel asks the model at the square of this many points")
    padding: Positive = Field(default=2, le=32, description="texels between charts of the atlas")
    point_size: Weight = Field(
        default=0.0,
        description="emitters smaller than this, metres, are point lights in glTF too (KHR_lights_punctual); 0 = none",
    )
    check_views: Positive = Field(default=2, description="held-out views that the check renders from every format")
    check_spp: Positive = Field(default=256, description="paths per pixel of these")
    max_depth: Positive = Field(default=32, description="longest path of the Mitsuba scenes and of the check, bounces")
    seed: Count = Field(default=0, description="seed of the check's random numbers")
