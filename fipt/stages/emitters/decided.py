"""What a person decided about triangles."""

from dataclasses import dataclass

import numpy as np

from fipt.errors import FiptError
from fipt.scene.review import ReviewDecisions, numbers


@dataclass(frozen=True)
class Decided:
    """Decisions by triangle.

    Attributes
    ----------
    emitter
        (T,) int32 number of the accepted emitter of a triangle, -1 for all others.
    rejected
        (T,) bool, never emit.
    merged
        Triangles of emitters that are one emitter.
    """

    emitter: np.ndarray
    rejected: np.ndarray
    merged: tuple[np.ndarray, ...] = ()

    @staticmethod
    def of(decisions: ReviewDecisions, triangles: int) -> "Decided":
        """ReviewDecisions about a mesh of so many triangles."""

        def rows(*texts: str) -> np.ndarray:
            return np.array(sorted(t for text in texts for t in numbers(text, triangles)), np.int64)

        emitter, rejected = np.full(triangles, -1, np.int32), np.zeros(triangles, bool)
        for number, text in enumerate(decisions.accept):
            emitter[rows(text)] = number
        rejected[rows(*decisions.reject)] = True
        both = np.flatnonzero(rejected & (emitter >= 0))
        if len(both):
            raise FiptError(f"triangle {both[0]} must be accepted or rejected; decisions do both", "decide once")
        return Decided(emitter, rejected, tuple(rows(*group) for group in decisions.merge))
