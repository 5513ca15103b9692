"""Settings of the report."""

from pydantic import Field

from fipt.settings import Positive, Settings


class ReportSettings(Settings):
    """The HTML page."""

    max_views: Positive = Field(default=12, description="views shown")
    width: Positive = Field(default=640, description="largest width of each picture, pixels")
