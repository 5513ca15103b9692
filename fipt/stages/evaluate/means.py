"""Means of many arrays, and decibels of them."""

from dataclasses import dataclass

import numpy as np

from fipt.formats.images import psnr_of_error


@dataclass
class Mean:
    """A running mean: sums of many arrays, and how many numbers they held."""

    total: float = 0.0
    count: int = 0

    def add(self, values: np.ndarray) -> None:
        """Add all numbers of an array."""
        self.total += float(np.sum(values, dtype=np.float64))
        self.count += int(np.size(values))

    @property
    def value(self) -> float | None:
        """The mean, or None if nothing was added."""
        return self.total / self.count if self.count else None


def psnr(mse: float | None) -> float | None:
    """Peak signal-to-noise ratio for peak 1, dB, of a mean squared error; None stays None."""
    return None if mse is None else psnr_of_error(mse)
