"""What the page shows of a results folder, which may hold results of an earlier plan too."""

from collections.abc import Sequence
from dataclasses import dataclass

from fipt.errors import FiptError

SECTIONS = ("capture", "poses", "geometry", "export")
"""Stages with a section of their own that not every scene has."""


@dataclass(frozen=True)
class Selection:
    """What the page shows, as far as the folder holds it.

    Attributes
    ----------
    setups, camera_setups
        Light setups: those seen by views of the dataset, and those with cameras of their own. None: all, of each what
        its own cameras saw if it had some.
    olat_shards
        Shards of the views in the light mixer; None: all.
    sections
        Some of `SECTIONS`; None: all.

    Raises
    ------
    FiptError
        If there is no such section.
    """

    setups: Sequence[str] | None = None
    camera_setups: Sequence[str] | None = None
    olat_shards: Sequence[str] | None = None
    sections: Sequence[str] | None = None

    def __post_init__(self) -> None:
        """Check the names of the sections."""
        for name in self.sections or ():
            if name not in SECTIONS:
                raise FiptError(f"sections must be some of {', '.join(SECTIONS)}; found {name!r}", "correct it")

    def has(self, section: str) -> bool:
        """Whether a section is shown."""
        return self.sections is None or section in self.sections


EVERYTHING = Selection()
