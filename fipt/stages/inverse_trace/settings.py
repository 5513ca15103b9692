"""Settings of inverse path tracing with one material a part."""

from pydantic import Field

from fipt.settings import Count, Positive, Settings


class InverseTraceSettings(Settings):
    """One material and one radiance a part, optimised through the path tracer: a method for comparisons."""

    steps: Positive = Field(default=400, description="steps of Adam")
    pixels: Positive = Field(default=2048, description="pixels in a step")
    spp: Positive = Field(default=8, description="paths per pixel, as many again for the gradient")
    max_depth: Positive = Field(default=5, description="longest path, bounces")
    learning_rate: float = Field(default=0.05, gt=0, description="of materials, before the logistic function")
    emission_rate: float = Field(default=0.25, gt=0, description="of the logarithm of emitted radiance")
    seed: Count = Field(default=0, description="seed of the random numbers")
