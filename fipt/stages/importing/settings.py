"""Settings of the import."""

from pydantic import Field

from fipt.settings import Length, Positive, Settings


class ImportSettings(Settings):
    """Other people's layouts into a dataset."""

    val_every: Positive = Field(default=8, description="every n-th view is held out where the source has no split")
    overlay: bool = Field(default=True, description="write an image of mesh edges over one photo")
    exposure: Length | None = Field(
        default=None, description="factor on a capture's radiance; absent: what brings its median luminance to 0.2"
    )
