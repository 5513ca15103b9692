"""``fipt plant-errors``: a dataset -> the same with errors of mesh, cameras or exposures."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import DatasetFolder

if TYPE_CHECKING:
    from fipt.stages.plant_errors.settings import PlantErrorsSettings


@dataclass(frozen=True, kw_only=True)
class PlantErrorsInputs:
    """Files of ``fipt plant-errors``."""

    dataset: DatasetFolder
    out: Annotated[Path, "Dataset folder to write; what has no error is linked."]


def run(inputs: PlantErrorsInputs, settings: "PlantErrorsSettings") -> dict[str, Any]:
    """Plant errors into a dataset, for comparisons: they tell what each costs."""
    from fipt.stages.plant_errors.plant import plant

    return plant(inputs.dataset, inputs.out, settings)
