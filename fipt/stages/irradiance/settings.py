"""Settings of the baseline that divides radiance by irradiance."""

from pydantic import Field

from fipt.settings import Settings


class IrradianceSettings(Settings):
    """Albedo as radiance over irradiance, and emitters by a threshold: a baseline for comparisons."""

    threshold: float = Field(
        default=4.0, gt=0, description="a triangle emits where the median of its brightest channel exceeds this"
    )
