"""Settings of the metrics."""

from pydantic import Field

from fipt.settings import Settings


class MetricsSettings(Settings):
    """Figures against ground truth and photographs."""

    fit_exposure: bool = Field(
        default=False, description="fit one exposure scale before comparing renders (photographs)"
    )
