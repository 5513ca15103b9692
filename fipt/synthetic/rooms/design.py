"""What a file of a room in code says."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fipt.synthetic.parts import RoomPart


@dataclass(frozen=True)
class RoomDesign:
    """A room in code.

    Attributes
    ----------
    size
        Interior along x, y, z, metres; one lower corner is the origin, y is up.
    exposure
        Factor on all its emitters, chosen once so that the median pixel of a view is about 0.25.
    furnish
        Makes its parts, emitters first, from the random numbers of its details. Parts whose name starts with `PANE`
        close its windows.
    semantics
        Semantic names in the order of their ids; None: as the parts mention them.
    unseen
        Parts that no view shows.
    """

    size: tuple[float, float, float]
    exposure: float
    furnish: Callable[[np.random.Generator], list[RoomPart]]
    semantics: tuple[str, ...] | None = None
    unseen: tuple[str, ...] = ()


PANE = "window pane"
"""How the names of panes begin: emitters that close a window, left out where `synthesize.opening` is set."""
