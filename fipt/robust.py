"""Standard deviations that outliers do not move."""

from typing import Any

import numpy as np

NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def deviation(residuals: np.ndarray, axis: int | None = None) -> Any:
    """Return `NORMAL` times the median of absolute residuals, at least one along ``axis``; None: of all of them."""
    return NORMAL * np.median(np.abs(residuals), axis=axis)


def spread(values: np.ndarray) -> Any:
    """Return the standard deviation of values (N,) or (N, C), N at least 1, about their median: a number or (C,)."""
    return deviation(values - np.median(values, axis=0), axis=0)
