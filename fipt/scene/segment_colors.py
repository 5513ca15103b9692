"""Segments for eyes: ids in colours that stay apart, and the agreement of votes as a heat map."""

from collections.abc import Iterable

import numpy as np

from fipt.formats.images import to_display

_GOLDEN = 0.6180339887498949


def color_table(count: int) -> np.ndarray:
    """(count, 3) uint8 colours of ids from 0, which is black; neighbouring ids look different."""
    from matplotlib.colors import hsv_to_rgb

    number = np.arange(count)
    hue = number * _GOLDEN % 1.0
    colors = hsv_to_rgb(np.stack([hue, 0.45 + 0.5 * (number * 5 % 7) / 6, 0.95 - 0.4 * (number * 3 % 5) / 4], axis=1))
    colors[:1] = 0
    return (colors * 255 + 0.5).astype(np.uint8)


def in_colors(ids: np.ndarray, table: np.ndarray | None = None) -> np.ndarray:
    """(H, W, 3) uint8 image of ids (H, W); ``table`` (K, 3) uint8 has the colour of each id."""
    table = color_table(int(ids.max(initial=0)) + 1) if table is None else table
    return table[ids]


def matching_colors(pairs: Iterable[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(K, 3) uint8 colours of ids such that each looks like the other map's id that most of its pixels have.

    Parameters
    ----------
    pairs
        Ids and other ids of each view, of one shape, to be shown in `color_table`'s colours.
    """
    keys, counts = np.zeros(0, np.int64), np.zeros(0, np.int64)
    for ids, other in pairs:
        new, count = np.unique(ids.astype(np.int64).ravel() << 16 | other.ravel(), return_counts=True)
        keys, place = np.unique(np.concatenate([keys, new]), return_inverse=True)
        counts = np.bincount(place.reshape(-1), np.concatenate([counts, count]))
    best = np.zeros(int(keys.max(initial=0) >> 16) + 1, np.int64)
    order = np.argsort(counts, kind="stable")
    best[keys[order] >> 16] = keys[order] & 0xFFFF
    table = color_table(int(best.max(initial=0)) + 1)[best]
    table[0] = 0
    return table


def heat(share: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 heat map of shares in [0, 1]: dark where votes disagree, bright where all agree, 0 black."""
    from matplotlib import colormaps

    image = colormaps["inferno"](np.clip(share, 0, 1), bytes=True)[..., :3].copy()
    image[share <= 0] = 0
    return image


def over_photo(photo: np.ndarray, ids: np.ndarray, exposure: float) -> np.ndarray:
    """(H, W, 3) uint8: a photograph (H, W, 3, radiance times ``exposure``) tinted with the colours of its ids."""
    tinted = 0.5 * to_display(np.nan_to_num(photo * exposure)) + 0.5 * in_colors(ids) + 0.5
    return tinted.astype(np.uint8)
