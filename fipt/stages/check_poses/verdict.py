"""What the check of the cameras says of a view."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Verdict:
    """What the check says of a view.

    Attributes
    ----------
    view
        Its name.
    score
        Median over its partners of the correlation with them; None where none tells.
    overlap
        Share of its pixels that its best partner shows too.
    behind
        Share of its pixels that others see from the other side of the surface.
    color
        Share of the compared pixels that look the same in both.
    exposure
        Its brightness over that of its partners on the same surface, by medians; None where none tells.
    partners
        Views that it was compared with.
    accepted, reason
        The verdict, and a sentence where there is something to say.
    gain
        Factor that brings its images to the exposure of the others; 1 where they have it, or none tells.
    displacement
        How far its pixels are from where the others show them, by the median, in pixels of the reduced view; None where
        that is not told.
    """

    view: str
    score: float | None
    overlap: float
    behind: float
    color: float | None
    exposure: float | None
    partners: tuple[str, ...]
    accepted: bool
    reason: str
    gain: float = 1.0
    displacement: float | None = None

    def plain(self) -> dict[str, Any]:
        """Return the content as plain JSON types."""
        return asdict(self) | {"partners": list(self.partners)}


def accepted_partners(verdicts: Sequence[Verdict]) -> list[list[int]]:
    """Of each view the numbers of the accepted views it was compared with; none of a view that is not accepted."""
    place = {verdict.view: i for i, verdict in enumerate(verdicts) if verdict.accepted}
    return [[place[name] for name in v.partners if name in place] if v.accepted else [] for v in verdicts]
