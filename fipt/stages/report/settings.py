"""Settings of the report."""

from pydantic import Field

from fipt.conventions import SHOWN_VIEWS
from fipt.settings import Positive, Settings


class ReportSettings(Settings):
    """The HTML page."""

    max_views: Positive = Field(default=SHOWN_VIEWS, description="views shown")
    width: Positive = Field(default=640, description="largest width of each picture, pixels")


class ComparePageSettings(Settings):
    """The page that compares methods."""

    views: Positive = Field(default=2, le=8, description="views that the page shows")
    width: int = Field(default=240, ge=64, le=1024, description="of an image, pixels")
