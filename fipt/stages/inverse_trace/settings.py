"""Settings of inverse path tracing with one material a part."""

from pydantic import Field

from fipt.settings import Count, Positive, Settings


class InverseTraceSettings(Settings):
    """Radiance of parts, materials of parts, texels or networks, optimised through the path tracer: for comparisons."""

    steps: Positive = Field(default=300, description="steps of Adam")
    pixels: Positive = Field(default=128, description="pixels in a step")
    spp: Positive = Field(
        default=32,
        description="paths per pixel, as many again for the gradient; of few the median, which L1 asks for, is below "
        "the mean, so that everything comes out too bright",
    )
    max_depth: Positive = Field(default=5, description="longest path, bounces")
    learning_rate: float = Field(default=0.05, gt=0, description="of materials, before the logistic function")
    emission_rate: float = Field(default=0.25, gt=0, description="of the logarithm of emitted radiance")
    texels: float = Field(default=0.0, ge=0, le=1000, description="a metre has so many texels; 0: one material a part")
    smoothness: float = Field(default=0.3, ge=0, description="weight of the differences of neighbouring texels")
    field: bool = Field(
        default=False, description="materials of texels are what the fit's networks say there; learning_rate is theirs"
    )
    seed: Count = Field(default=0, description="seed of the random numbers")
