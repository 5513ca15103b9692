"""``fipt pose``: views without poses -> cameras in metres, with evidence."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.poses.settings import PosesSettings

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PoseInputs:
    """Files of ``fipt pose``: developed photographs, or a folder of images with its intrinsics."""

    out: Annotated[Path, "Folder to write: transforms.json, views.json, poses.json and images."]
    capture: Annotated[Path | None, "Developed photographs: the folder of fipt develop."] = None
    source: Annotated[Path | None, "Or any folder of undistorted VIEW.exr."] = None
    intrinsics: Annotated[Path | None, "With --source: JSON with w, h, fl_x, ... in pixels."] = None
    held_out: Annotated[tuple[str, ...], "Views that become val, comma-separated; repeatable."] = ()


def run(inputs: PoseInputs, settings: "PosesSettings") -> dict[str, Any]:
    """Estimate the poses of views with COLMAP; believe them only where there is evidence.

    Incremental and global mapping must agree on every camera. Cameras that fail a check are
    rejected by name in views.json; if too few are left, the reason and what to do are said.
    Features, matches and models are kept in OUT/work and used again.
    """
    from fipt.errors import FiptError
    from fipt.stages.poses.estimate import estimate, write
    from fipt.stages.poses.views import read_capture, read_folder

    held, out = set(inputs.held_out), inputs.out
    if inputs.capture is not None and inputs.source is None and inputs.intrinsics is None:
        views = read_capture(inputs.capture, held)
    elif inputs.capture is None and inputs.source is not None and inputs.intrinsics is not None:
        views = read_folder(inputs.source, inputs.intrinsics, held)
    else:
        raise FiptError("give --capture, or --source with --intrinsics", "see fipt pose --help")
    found = estimate(views, out / "work", settings)
    write(out, views, found)
    refused = {name: e.reason for name, e in found.evidence.items() if e.reason is not None}
    warnings = [f"view {name} is rejected: {reason}" for name, reason in refused.items()]
    warnings += found.align.get("warnings", ())
    for warning in warnings:
        log.warning("%s", warning)
    log.info("%s: %d of %d views have a pose", out, len(found.reconstruction.cameras), len(views.cameras))
    return {
        "views": len(views.cameras),
        "rejected": list(refused),
        "points": len(found.reconstruction.points),
        "warnings": warnings,
    }
