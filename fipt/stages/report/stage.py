"""``fipt report``: write the HTML page that shows everything."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

if TYPE_CHECKING:
    from fipt.stages.report.settings import ReportSettings


@dataclass(frozen=True, kw_only=True)
class ReportInputs:
    """Files of ``fipt report``; of what is None, the page shows all that the folder holds."""

    results: Annotated[Path, "Results folder of the scene."]
    out: Annotated[Path, "HTML file to write."]
    setups: Annotated[
        tuple[str, ...] | None, "Setups whose views are shown, comma-separated; default: all that the folder holds."
    ] = None
    camera_setups: Annotated[
        tuple[str, ...] | None, "Setups with cameras of their own that are shown; default: likewise."
    ] = None
    olat_shards: Annotated[
        tuple[str, ...] | None, "Shards of views that the light mixer shows, comma-separated; default: likewise."
    ] = None
    sections: Annotated[
        tuple[str, ...] | None,
        "Which of capture, poses, geometry and export are shown, comma-separated; default: likewise.",
    ] = None


def run(inputs: ReportInputs, settings: "ReportSettings") -> dict[str, Any]:
    """Write one HTML page with all images in it; it loads nothing else.

    Shows whatever the folder holds: files that do not exist yet are left out.
    """
    from fipt.formats.files import write_text
    from fipt.stages.report.page import build_page
    from fipt.stages.report.selection import Selection

    selection = Selection(inputs.setups, inputs.camera_setups, inputs.olat_shards, inputs.sections)
    page = build_page(inputs.results, settings, selection)
    write_text(inputs.out, page)
    return {"page_bytes": len(page.encode("utf-8"))}
