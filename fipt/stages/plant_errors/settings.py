"""Settings of planted errors: none by default."""

from pydantic import Field

from fipt.settings import Count, Fraction, Settings


class PlantErrorsSettings(Settings):
    """Errors that are planted into a dataset, for comparisons: what do they cost? All images stay true."""

    mesh_noise: float = Field(default=0.0, ge=0, description="standard deviation of every vertex, metres")
    moved_part: str = Field(default="", description="part of a room in code whose front is moved; empty: none")
    moved_by: float = Field(default=0.0254, description="outwards, metres")
    removed_parts: tuple[str, ...] = Field(default=(), description="parts of a room in code that the mesh lacks")
    pose_angle: float = Field(
        default=0.0, ge=0, description="every training camera is turned by this about an axis of its own, degrees"
    )
    exposure_stops: float = Field(
        default=0.0, description="exposure of some training views is off by so much, up and down in turn"
    )
    exposure_share: Fraction = Field(default=0.1, description="share of these views")
    seed: Count = Field(default=0, description="seed of the random numbers")

    @property
    def any(self) -> bool:
        """Whether there is an error at all."""
        wrong = self.mesh_noise or self.pose_angle or (self.exposure_stops and self.exposure_share)
        return bool(wrong or self.moved_part or self.removed_parts)
