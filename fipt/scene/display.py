"""How radiance is shown: one exposure for all pictures of a scene, the sRGB curve."""

from collections.abc import Iterable

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.formats.images import to_display
from fipt.scene.dataset import Dataset

MIDDLE_GREY = 0.2
"""Linear value to which the exposure brings the median luminance of the scene's photographs."""


def shown_views(data: Dataset, most: int) -> list[str]:
    """Held-out views first, then training views spread over their list, at most so many."""
    val, train = data.views("val"), data.views("train")
    names = val[:most]
    left = min(most - len(names), len(train))
    picks = np.linspace(0, len(train) - 1, left).round().astype(int) if left else []
    return names + [train[pick] for pick in picks]


def common_exposure(photos: Iterable[np.ndarray]) -> float:
    """Return the factor that brings the median luminance of (H, W, 3) photographs to middle grey.

    One factor serves every tone-mapped picture of a scene, so that they can be compared. Black
    pixels (outside the frame, invalid) do not count; 1 where nothing is left.
    """
    seen = [photo @ LUMINANCE for photo in photos]
    luminance = np.concatenate([values[values > 0] for values in seen]) if seen else np.zeros(0)
    return float(MIDDLE_GREY / np.median(luminance)) if len(luminance) else 1.0


def tone_mapped(radiance: np.ndarray, exposure: float) -> np.ndarray:
    """(H, W, 3) linear radiance times ``exposure``, clipped to [0, 1], sRGB curve; uint8."""
    return to_display(np.nan_to_num(radiance * exposure))
