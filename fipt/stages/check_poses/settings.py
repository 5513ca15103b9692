"""Settings of the check of cameras."""

from pydantic import Field

from fipt.settings import Fraction, Positive, Settings


class CheckPosesSettings(Settings):
    """Second check of the cameras, through the mesh: every view must show what the others show."""

    enabled: bool | None = Field(
        default=None,
        description="check before the fit; absent: for all views but those of known rooms, whose poses are exact",
    )
    width: Positive = Field(default=192, description="images are reduced to this many columns at most")
    partners: Positive = Field(
        default=10, description="other views that each view is compared with, those that share most"
    )
    least_score: Fraction = Field(
        default=0.55,
        description="a view is rejected whose correlation with the others is below this share of the median view's",
    )
    least_overlap: Fraction = Field(default=0.05, description="share of a view that others must show to judge it")
    correct_exposure: bool = Field(
        default=True, description="bring a view whose exposure is off to that of the others, where these tell it"
    )
    keep: Fraction = Field(
        default=0.7, description="with fewer views than this share left, stop: mesh and views do not match"
    )
