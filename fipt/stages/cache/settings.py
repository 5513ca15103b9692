"""Settings of the radiance cache."""

from pydantic import Field

from fipt.settings import Settings


class CacheSettings(Settings):
    """Radiance cache over the surface."""

    resolution: int = Field(default=256, ge=8, le=1024, description="voxels along the scene box")
