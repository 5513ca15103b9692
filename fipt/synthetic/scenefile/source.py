"""Where a scene is read from: its folder, what is missing or unknown in it, and what there is to say about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.synthetic.scenefile.xml import Node, inside
from fipt.synthetic.settings import SceneFile

_LISTED = 12
"""Problems of one kind named in an error."""


@dataclass
class SceneFileReader:
    """Collects problems instead of stopping at the first, and notes.

    Attributes
    ----------
    path
        The scene file.
    settings
        How to read it.
    missing, unknown, outside
        Files that are not there, plugins that have no rule, files outside the folder; each named once.
    notes
        What was approximated, dropped or replaced, a line each.
    files
        Files that were asked for and are there.
    """

    path: Path
    settings: SceneFile
    missing: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    def file(self, node: Node | None) -> Path | None:
        """Return the file that a string property names; None, and a problem, where it cannot be used."""
        name = node.attributes.get("value", "") if node is not None else ""
        path = inside(self.path.parent, name) if name else None
        if name and path is None:
            _once(self.outside, name)
        elif path is None or not path.is_file():
            _once(self.missing, name or "a file without a name")
        else:
            _once(self.files, path)
            return path
        return None

    def refuse(self, node: Node, what: str) -> None:
        """Remember a plugin without a rule."""
        _once(self.unknown, f"{what} ({node.where})")

    def note(self, text: str) -> None:
        """Remember something to say, once."""
        _once(self.notes, text)

    def check(self) -> None:
        """Raise one error for all problems of the most serious kind; with ``allow_missing`` they become notes."""
        if self.outside:
            raise FiptError(
                f"{self.path} refers outside its own folder, which is refused: {_listed(self.outside)}",
                "copy the files into the scene's folder and correct the paths",
            )
        problems = []
        if self.missing:
            problems.append(f"{len(self.missing)} files are missing: {_listed(self.missing)}")
        if self.unknown:
            problems.append(f"{len(self.unknown)} unknown: {_listed(self.unknown)}")
        if problems and not self.settings.allow_missing:
            raise FiptError(
                f"{self.path}: {'; '.join(problems)}",
                "supply or correct them, or set allow_missing: true, which leaves out meshes and lights and makes "
                "textures and materials grey",
            )
        for problem in problems:
            self.note(problem)


def _once(items: list[Any], item: object) -> None:
    if item not in items:
        items.append(item)


def _listed(items: list[str]) -> str:
    more = len(items) - _LISTED
    return ", ".join(items[:_LISTED]) + (f" and {more} more" if more > 0 else "")
