"""Settings of the report."""

from pydantic import Field

from fipt.conventions import SHOWN_VIEWS
from fipt.settings import Positive, Settings


class ReportSettings(Settings):
    """The HTML page."""

    max_views: Positive = Field(default=SHOWN_VIEWS, description="views shown")
    width: Positive = Field(default=640, description="largest width of each picture, pixels")
