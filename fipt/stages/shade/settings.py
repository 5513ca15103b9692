"""Settings of the shading: baked, then refined."""

from typing import Literal

from pydantic import Field

from fipt.settings import Count, Fraction, Positive, Settings


class BakeSettings(Settings):
    """Shading of round 0, read from the cache, or path traced in the true room."""

    truth: bool = Field(
        default=False, description="path trace it with true materials and emitters: a bound for comparisons"
    )

    sampling: Literal["shared", "separate"] = Field(
        default="shared", description="one ray set for all shading outputs, or one lobe at a time as the paper"
    )
    diffuse_spp: Positive = Field(
        default=64,
        description="rays per sample from the cosine lobe; 4 points share them where 4 divides all three",
    )
    specular_spp: Positive = Field(default=16, description="rays per sample from each GGX lobe")
    smooth_spp: Positive = Field(default=16, description="rays per sample from the smoothest GGX lobe")
    denoise: bool = Field(default=True, description="denoise the shading images")
    fill: bool = Field(
        default=True, description="give unseen surface the light of the nearest seen one instead of black"
    )
    seed: Count = Field(default=0, description="seed of the random numbers")


class RefineSettings(Settings):
    """Shading of later rounds, path traced with the current materials and emitters."""

    sampling: Literal["shared", "separate"] = Field(default="shared", description="as of bake")
    diffuse_spp: Positive = Field(
        default=64,
        description="paths per sample from the cosine lobe; 4 points share them where 4 divides all three",
    )
    specular_spp: Positive = Field(default=16, description="paths per sample from each GGX lobe")
    smooth_spp: Positive = Field(default=16, description="paths per sample from the smoothest GGX lobe")
    light_sampling: bool = Field(default=True, description="sample emitters at the first hit too (the paper does not)")
    max_depth: Positive = Field(default=5, description="longest path, bounces")
    cache_roughness: Fraction = Field(default=0.6, description="rougher vertices end the path in the radiance cache")
    damping: Fraction = Field(
        default=0.5, lt=1, description="share of the previous round's shading that is kept where both differ by noise"
    )
    denoise: bool = Field(default=True, description="denoise the shading images")
    seed: Count = Field(default=0, description="seed of the random numbers")
