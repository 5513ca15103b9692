"""What checks measured: every number with its threshold, also where nothing is wrong."""

from dataclasses import dataclass, field

from fipt.scene.findings import Measure
from fipt.stages.findings.tolerance import severity


@dataclass(frozen=True)
class Notes:
    """Measures by the id of the finding that they may lead to, and the standard error of each."""

    measures: dict[str, tuple[Measure, float]] = field(default_factory=dict)

    def judge(self, key: str, measure: Measure, error: float = 0.0) -> str | None:
        """Keep a measure; return how bad it is, None where it is not told (`fipt.stages.findings.tolerance`)."""
        self.measures[key] = measure, error
        return severity(measure.value, measure.threshold, error)
