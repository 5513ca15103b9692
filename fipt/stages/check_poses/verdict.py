"""What the check of the cameras says of a view."""

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
    colour
        Share of the compared pixels that look the same in both.
    exposure
        Its brightness over that of its partners on the same surface, by medians; None where none tells.
    partners
        Views that it was compared with.
    accepted, reason
        The verdict, and a sentence where there is something to say.
    gain
        Factor that brings its images to the exposure of the others; 1 where they have it, or none tells.
    """

    view: str
    score: float | None
    overlap: float
    behind: float
    colour: float | None
    exposure: float | None
    partners: tuple[str, ...]
    accepted: bool
    reason: str
    gain: float = 1.0

    def plain(self) -> dict[str, Any]:
        """Return the content as plain JSON types."""
        return asdict(self) | {"partners": list(self.partners)}
