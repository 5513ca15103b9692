"""``fipt check-poses``: images, cameras and mesh -> which views show what the others show."""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from fipt.inputs import POSITIONAL

if TYPE_CHECKING:
    from fipt.scene.findings import RoomFinding
    from fipt.stages.check_poses.settings import CheckPosesSettings
    from fipt.stages.check_poses.verdict import Verdict

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class CheckPosesInputs:
    """Files of ``fipt check-poses``."""

    dataset: Annotated[Path, "Dataset folder.", POSITIONAL]
    reject: Annotated[bool, "Write the verdicts into the dataset: later stages leave such views out."] = False
    mesh: Annotated[Path | None, "Mesh to check through, made of these views; default: the dataset's own."] = None
    out: Annotated[Path | None, "File for the verdicts in place of the dataset's, with --reject."] = None


def run(inputs: CheckPosesInputs, settings: "CheckPosesSettings") -> dict[str, Any]:
    """Check through the mesh that every view shows what the others show.

    Finds cameras that are mirrored, turned or swapped. Exit code 2 if a view fails, unless --reject
    leaves it out. With --reject and enabled: false in the settings, every view is accepted unseen.

    Raises
    ------
    FiptError
        If a view fails and is not left out, or a file is named for verdicts that are not written.
    """
    from fipt.errors import FiptError
    from fipt.formats.files import write_text
    from fipt.scene.dataset import CHECKED

    if inputs.out is not None and not inputs.reject:
        raise FiptError("--out is where --reject writes its verdicts; --reject is not given", "give both or neither")
    seen = not inputs.reject or settings.enabled is not False
    verdicts, findings = _judged(inputs, settings) if seen else ([], [])
    for finding in findings:
        log.warning("%s %s", finding.cause, finding.remedy)
    failed = [verdict for verdict in verdicts if not verdict.accepted]
    if inputs.reject:
        views = {verdict.view: verdict.plain() for verdict in verdicts}
        content = {"checked": seen, "views": views, "findings": [finding.row for finding in findings]}
        text = json.dumps(content, indent=1, allow_nan=False)
        write_text(inputs.out or inputs.dataset / CHECKED, text + "\n")
    elif failed:
        raise FiptError(
            f"{len(failed)} of {len(verdicts)} views do not show what the others show: "
            + ", ".join(verdict.view for verdict in failed),
            "correct their cameras, or leave them out with --reject",
        )
    return {
        "rejected": [verdict.view for verdict in failed],
        "warnings": [f"{finding.cause} {finding.remedy}" for finding in findings]
        + [f"{verdict.view} {verdict.reason}" for verdict in verdicts if verdict.reason],
    }


def _judged(inputs: CheckPosesInputs, settings: "CheckPosesSettings") -> tuple[list["Verdict"], list["RoomFinding"]]:
    """Look at every view, and at what all have in common; a check that is off chooses no device."""
    from fipt.render.scene import RayScene
    from fipt.render.variant import set_variant
    from fipt.scene.dataset import Dataset
    from fipt.stages.check_poses.color import judged_by_color
    from fipt.stages.check_poses.compare import enough, judge, table
    from fipt.stages.check_poses.diagnose import doubt, explain
    from fipt.stages.check_poses.misplaced import judged_by_alignment
    from fipt.stages.check_poses.surface import shown_views
    from fipt.stages.check_poses.vignetting import dark_corners

    set_variant()
    data = Dataset(inputs.dataset, unchecked=True, mesh=inputs.mesh)
    scene = RayScene(data.mesh())
    views = shown_views(scene, data, settings.width)
    verdicts = judge(scene, views, settings)
    spoiled = inputs.mesh is not None and not all(verdict.accepted for verdict in verdicts)
    verdicts = judged_by_color(scene, views, verdicts)
    log.info("%s", table(verdicts))
    explain(data, verdicts, settings)
    enough(verdicts, settings)
    misplaced: list[RoomFinding] = []
    if spoiled:
        log.info("small errors are not looked for: views that are rejected may have helped to make this mesh")
    else:
        verdicts, misplaced = judged_by_alignment(scene, views, verdicts)
    for verdict in verdicts:
        if verdict.accepted and verdict.reason:
            log.warning("%s %s", verdict.view, verdict.reason)
    return verdicts, [*doubt(verdicts), *misplaced, *dark_corners(scene, views, verdicts)]
