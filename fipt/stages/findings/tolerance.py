"""From when on a deviation is told: significant against its own noise, and large enough to matter."""

import numpy as np

from fipt.robust import spread

TOLERANCE = 0.1
"""Relative error of light from which on it is told.

Base colours err by as much in proportion: at one of 0.5 this is 0.05, so that kd cannot come out better than 26 dB.
"""

SERIOUS = 2.0
"""So many times a threshold is serious: at twice the tolerance kd cannot come out better than 20 dB."""

SIGMAS = 3.0
"""Standard errors by which an estimate must clear its threshold: by chance one in 740 does."""

OUTLIER = 5.0
"""Standard deviations from which on one of many is an outlier: one in 1.7 million is one by chance."""


def severity(value: float, threshold: float, error: float = 0.0) -> str | None:
    """Return how bad a value is that may have a standard error; None: it is not told.

    Parameters
    ----------
    value, threshold
        Not negative, in one unit.
    """
    least = value - SIGMAS * error
    if not np.isfinite(least) or least <= threshold:
        return None
    return "serious" if least > SERIOUS * threshold else "warning"


def median_error(values: np.ndarray) -> float:
    """Return the standard error of the median of N independent values; infinite for fewer than two."""
    # of a normal distribution the median errs by sqrt(pi / 2) times as much as the mean
    return float(np.sqrt(np.pi / 2) * spread(values) / np.sqrt(len(values))) if len(values) > 1 else float("inf")


def mean_error(values: np.ndarray) -> float:
    """Return the standard error of the mean of N independent values; 0 for one, of which nothing is known."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0


def share_error(share: float, count: float) -> float:
    """Return the standard error of a share that was counted in ``count`` independent trials."""
    return float(np.sqrt(max(share * (1 - share), 0.0) / max(count, 1.0)))
