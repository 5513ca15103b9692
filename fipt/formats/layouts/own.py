"""A dataset folder of this program: its views, with truth and segment ids as they are there."""

from dataclasses import replace
from pathlib import Path

from fipt.formats.files import existing_file
from fipt.formats.layouts.common import PosedViews, SourceView
from fipt.formats.layouts.nerfstudio import read_nerfstudio
from fipt.formats.views import read_rejected

KINDS = ("part", "semantic")
"""Kinds of segment ids: folders below segments/."""


def read_own(root: Path) -> PosedViews:
    """Read transforms.json of a dataset; views that its views.json rejects are left out."""
    rejected = read_rejected(existing_file(root / "views.json", "the list of views of a dataset"))
    found = read_nerfstudio(root)
    views = tuple(replace(view, dataset=root) for view in found.views if view.name not in rejected)
    return PosedViews(views, root / "mesh.ply", root)


def truth_file(root: Path, view: str) -> Path:
    """Ground truth of a view of a dataset."""
    return root / "truth" / f"{view}.exr"


def ids_file(root: Path, kind: str, view: str) -> Path:
    """Segment ids of one kind of a view of a dataset."""
    return root / "segments" / kind / f"{view}.png"


def known_files(view: SourceView) -> list[Path]:
    """Truth and ids of a view that there are."""
    if view.dataset is None:
        return []
    files = [truth_file(view.dataset, view.name), *(ids_file(view.dataset, kind, view.name) for kind in KINDS)]
    return [file for file in files if file.is_file()]
