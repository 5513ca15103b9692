"""Is a part of one colour? Its median colour, and how the colours that single views suggest differ from it.

Each view suggests a base colour for each piece by itself. What two views agree on, beyond the mean of all of them, is
texture: its variance t^2 is their mean product (covariance). What they do not agree on is error of the shading, with
variance e^2. Where e^2 / t^2 is large, the part is better taken for uniform than read from the photographs.
"""

import numpy as np

from fipt.stages.fit.inner_pixels import FEWEST, InnerPixels, best_base_color

FINE = 256
"""Pieces along the scene box in which views are compared: about the size of pixels."""
_FINEST_TEXTURE = 0.01
"""Smallest standard deviation of base colour that is taken for texture."""
_MOST_UNIFORM = 8.0
_MOST_OFF = 0.4
"""Base colours further than this from the part's mean count as this far."""
_FEWEST_PAIRS = 5
"""Pieces that two views must share before texture is judged."""


def median_colors(base: np.ndarray, segment: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """(S, 3) median over the pieces (G, 3) of every segment, those with enough pixels first; grey without any."""
    owner = np.zeros(len(base), np.int64)
    owner[piece] = segment
    enough = np.bincount(piece, minlength=len(base)) >= FEWEST
    result = np.full((count, 3), 0.5)
    for k in np.unique(segment):
        own = owner == k
        result[k] = np.median(base[own & enough if (own & enough).any() else own], axis=0)
    return result


def uniformity(
    inner: InnerPixels, offset: np.ndarray, slope: np.ndarray, fine: np.ndarray, fines: int, color: np.ndarray
) -> np.ndarray:
    """(S,) e^2 / (t^2 n) - 1 where that is positive: error over texture of base colours, with n views a piece.

    A prior of this weight weighs the part's mean against n noisy colours as their variances do (empirical Bayes).

    Parameters
    ----------
    inner
        N pixels.
    offset, slope
        (N, 3) reflected radiance as a line in the base colour.
    fine, fines
        (N,) piece of each pixel, and the number of pieces.
    color
        (S, 3) median colour of every segment.
    """
    count = len(color)
    pairs, suggestion = np.unique(fine * (int(inner.view.max(initial=0)) + 1) + inner.view, return_inverse=True)
    piece, segment = np.zeros(len(pairs), np.int64), np.zeros(len(pairs), np.int64)
    piece[suggestion], segment[suggestion] = fine, inner.segment
    base = best_base_color(inner.radiance, offset, slope, suggestion, len(pairs))
    off = np.clip(base - color[segment], -_MOST_OFF, _MOST_OFF)
    number = np.maximum(np.bincount(segment, minlength=count), 1)
    # their own mean, not the median: an error that all of them share is no texture
    off -= np.stack([np.bincount(segment, o, count) / number for o in off.T], axis=1)[segment]
    views = np.bincount(piece, minlength=fines)
    owner = np.zeros(fines, np.int64)
    owner[piece] = segment
    view_pairs = views * (views - 1.0)
    together = sum(np.bincount(piece, o, fines) ** 2 - np.bincount(piece, o**2, fines) for o in off.T) / 3
    texture = np.bincount(owner, together, count) / np.maximum(np.bincount(owner, view_pairs, count), 1)
    total = np.bincount(segment, (off**2).mean(axis=1), count) / number
    mean_views = np.bincount(owner, views, count) / np.maximum(np.bincount(owner, minlength=count), 1)
    texture = np.maximum(texture, 0)
    ratio = np.maximum(total - texture, 0) / (texture + _FINEST_TEXTURE**2) / np.maximum(mean_views, 1)
    known = np.bincount(owner, view_pairs > 0, count) >= _FEWEST_PAIRS
    return np.where(known, np.clip(ratio - 1, 0, _MOST_UNIFORM), 0.0)
