"""``fipt check-poses``: images, cameras and mesh -> which views show what the others show."""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import POSITIONAL

if TYPE_CHECKING:
    from fipt.stages.check_poses.settings import CheckPosesSettings
    from fipt.stages.check_poses.verdict import Verdict

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CheckPosesInputs:
    """Files of ``fipt check-poses``."""

    dataset: Annotated[Path, "Dataset folder.", POSITIONAL]
    reject: Annotated[bool, "Write the verdicts into the dataset: later stages leave such views out."] = False
    mesh: Annotated[Path | None, "Mesh to check through; default: the dataset's own."] = None
    out: Annotated[Path | None, "File for the verdicts in place of the dataset's, with --reject."] = None


def run(inputs: CheckPosesInputs, settings: "CheckPosesSettings") -> dict[str, Any]:
    """Check through the mesh that every view shows what the others show.

    Finds cameras that are mirrored, turned or swapped. Exit code 2 if a view fails, unless --reject
    leaves it out. With --reject and enabled: false in the settings, every view is accepted unseen.

    Raises
    ------
    FiptError
        If a view fails and is not left out.
    """
    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.scene.dataset import CHECKED
    from fipt.stages.check_poses.diagnose import doubt

    seen = not inputs.reject or settings.enabled is not False
    verdicts = _verdicts(inputs, settings) if seen else []
    doubts = [said] if (said := doubt(verdicts)) else []
    for warning in doubts:
        log.warning("%s", warning)
    failed = [verdict for verdict in verdicts if not verdict.accepted]
    if inputs.reject:
        views = {verdict.view: verdict.plain() for verdict in verdicts}
        text = json.dumps({"checked": seen, "views": views}, indent=1, allow_nan=False)
        write_text(inputs.out or inputs.dataset / CHECKED, text + "\n")
    elif failed:
        raise FiptError(
            f"{len(failed)} of {len(verdicts)} views do not show what the others show: "
            + ", ".join(verdict.view for verdict in failed),
            "correct their cameras, or leave them out with --reject",
        )
    return {
        "rejected": [verdict.view for verdict in failed],
        "warnings": doubts + [f"{verdict.view} {verdict.reason}" for verdict in verdicts if verdict.reason],
    }


def _verdicts(inputs: CheckPosesInputs, settings: "CheckPosesSettings") -> list["Verdict"]:
    """Look at every view. The device is chosen here, since a check that is off starts none."""
    from fipt.render.variant import set_variant
    from fipt.scene.dataset import Dataset
    from fipt.stages.check_poses.compare import check, enough, table
    from fipt.stages.check_poses.diagnose import explain

    set_variant()
    data = Dataset(inputs.dataset, unchecked=True, mesh=inputs.mesh)
    verdicts = check(data, settings)
    log.info("%s", table(verdicts))
    explain(data, verdicts, settings)
    enough(verdicts, settings)
    return verdicts
