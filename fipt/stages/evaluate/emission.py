"""Figures of what emits: triangles, area and flux against the truth."""

from collections.abc import Iterable
from typing import Any

import numpy as np


def emitting_triangles(
    triangles: int, views: Iterable[tuple[np.ndarray, np.ndarray | None]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which triangles emit in truth, which are seen, and of which there is truth, by what pixel centres show.

    Parameters
    ----------
    triangles
        Number of triangles of the mesh.
    views
        Pairs of (n,) triangle ids at pixel centres and (n,) bool, whether that pixel truly emits; None: no truth.

    Returns
    -------
    emitting, seen, judged : (triangles,) bool
        A triangle emits if more than half of the pixel centres that see it, in views with truth, emit.
    """
    seen, judged, emitting_pixels = np.zeros((3, triangles), np.int64)
    for ids, emitting in views:
        count = np.bincount(ids, minlength=triangles)
        seen += count
        if emitting is not None:
            judged += count
            emitting_pixels += np.bincount(ids[emitting], minlength=triangles)
    return 2 * emitting_pixels > judged, seen > 0, judged > 0


def emitted_ratios(views: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> dict[str, float | None]:
    """Emitting area and flux that the views show, found over true.

    Triangles of a scan are not those of the truth, so that counting them means little; pixels see the same surface.

    Parameters
    ----------
    views
        For every view: (n,) area that each pixel centre stands for, square metres; true and found radiance (n, 3).

    Returns
    -------
    dict
        ``emitted_area`` and ``emitted_flux``; None where nothing emits in truth.
    """
    sums = np.zeros((2, 2))
    for area, true, found in views:
        for row, radiance in enumerate((true, found)):
            sums[row] += area[radiance.max(axis=1) > 0].sum(), (area * radiance.mean(axis=1)).sum()
    ratios = [float(found / true) if true > 0 else None for true, found in sums.T]
    return dict(zip(("emitted_area", "emitted_flux"), ratios, strict=True))


def triangle_figures(
    found: np.ndarray,
    truth: np.ndarray | None,
    areas: np.ndarray,
    seen: np.ndarray | None = None,
    unknown: np.ndarray | None = None,
) -> dict[str, Any]:
    """Compare the triangles found to emit with the true ones.

    Parameters
    ----------
    found
        (E,) ids of the triangles found to emit.
    truth
        (T,) bool, triangles that emit in truth; None where it is unknown.
    areas
        (T,) areas, square metres.
    seen
        (T,) bool, triangles that some pixel sees; a true one that none sees cannot be missed.
    unknown
        (T,) bool, triangles of which ``truth`` says nothing: they are not false.

    Returns
    -------
    dict
        Counts and areas (m2) of found, true, false and missed triangles; None where unknown.
    """
    found_mask = np.zeros(len(areas), bool)
    found_mask[found] = True
    names = ("true", "false", "missed", "unseen")
    sets: dict[str, np.ndarray | None] = dict.fromkeys(names)
    if truth is not None:
        visible = truth if seen is None else truth & seen
        sets = {
            "true": truth,
            "false": found_mask & ~truth if unknown is None else found_mask & ~truth & ~unknown,
            "missed": visible & ~found_mask,
            "unseen": None if seen is None else truth & ~seen,
        }
    figures: dict[str, Any] = {}
    for name, mask in {"found": found_mask, **sets}.items():
        figures[f"{name}_triangles"] = None if mask is None else int(mask.sum())
        figures[f"{name}_area"] = None if mask is None else float(areas[mask].sum())
    return figures
