"""Settings of the footprint samples."""

from pydantic import Field

from fipt.conventions import RAYS_PER_SIDE
from fipt.settings import Positive, Settings


class SamplesSettings(Settings):
    """Footprint samples of camera rays."""

    grid: Positive = Field(
        default=RAYS_PER_SIDE,
        le=16,
        description="a pixel is sampled by the square of this many rays; 1 = its centre only",
    )
    max_samples: Positive = Field(default=4, le=16, description="distinct surface pieces kept for each pixel")
