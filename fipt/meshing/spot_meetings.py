"""Where rays through bright spots meet, with one intensity: of three views or more, or of two with a known one."""

import numpy as np

from fipt.meshing.bright_spots import Spots

VIEWS = 3
"""That must show it: two rays meet somewhere by chance."""
PIXELS = 1.0
"""By which a ray may miss the place."""
INTENSITY = 1.3
"""Ratio of intensities that are the same. Bulbs of five rooms have a spread of 1 to 15 %, openings and spots that meet
by chance one of 20 to 35 %."""
_ALIKE = 1.1
"""Ratio of intensities of lamps of one kind, as two views say."""
_PARALLAX = 0.05
"""Least sine of the angle between two rays: those of less meet nowhere in particular."""
NEAREST = 0.1
"""Metres before a camera."""


def meetings(spots: Spots) -> list[Spots]:
    """Spots of three or more views, one of each, whose rays meet and whose intensities agree; no spot twice."""
    found: list[tuple[int, float, np.ndarray]] = []
    groups: list[set[int]] = [set() for _ in range(len(spots))]
    for first in range(len(spots)):
        for second in _partners(spots, first).tolist():
            if groups[first] & groups[second]:
                continue  # the same place
            own, miss = _together(spots, np.array([first, second]))
            if len(own) >= VIEWS:
                for index in {first, second, *own.tolist()}:
                    groups[index].add(len(found))
                found.append((len(own), -miss, own))
    found.sort(key=lambda meeting: meeting[:2], reverse=True)
    taken, chosen = np.zeros(len(spots), bool), []
    for _, _, own in found:
        if not taken[own].any():
            taken[own] = True
            chosen.append(spots[own])
    return chosen


def alike(one: np.ndarray | float, other: np.ndarray | float) -> np.ndarray:
    """(...) bool: whether intensities (...) are those of lamps of one kind."""
    return np.abs(np.log(one) - np.log(other)) < np.log(_ALIKE)


def alike_pairs(spots: Spots, centers: np.ndarray, intensities: np.ndarray) -> list[Spots]:
    """Spots of two views whose rays meet, as intense there as three or more known lamps are: lamps come in sets.

    Parameters
    ----------
    centers, intensities
        (K, 3) and (K,) of the known lamps. A spot whose ray passes one of them shows that one.
    """
    if len(intensities) < VIEWS:
        return []
    for center in centers:
        distance, off = passing(spots, center)
        spots = spots[(distance < NEAREST) | (off > PIXELS)]
    found = []
    for first in range(len(spots)):
        for second in _partners(spots, first).tolist():
            pair = spots[np.array([first, second])]
            distance, off = passing(pair, nearest(pair)[0])
            if alike((pair.irradiance * distance**2)[:, None], intensities).all(axis=0).sum() >= VIEWS:
                found.append((float(off.mean()), first, second))
    taken, chosen = np.zeros(len(spots), bool), []
    for _, first, second in sorted(found):
        if not taken[[first, second]].any():
            taken[[first, second]] = True
            chosen.append(spots[np.array([first, second])])
    return chosen


def _partners(spots: Spots, first: int) -> np.ndarray:
    """(M,) later spots of other views that one may be the same as: rays meet, and intensities there agree."""
    others = np.flatnonzero(spots.view > spots.view[first])
    offset, toward = spots.center[others] - spots.center[first], spots.direction[others]
    cosine = toward @ spots.direction[first]
    along, against = offset @ spots.direction[first], (offset * toward).sum(axis=1)
    square = np.maximum(1 - cosine**2, 1e-12)
    near = (along - cosine * against) / square  # distances along both rays to where they are nearest
    far = (cosine * along - against) / square
    between = near[:, None] * spots.direction[first] - offset - far[:, None] * toward
    allowed = PIXELS * (near * spots.pixel[first] + far * spots.pixel[others])
    ratio = spots.irradiance[others] * far**2 / (spots.irradiance[first] * near**2 + 1e-30)
    sound = (square > _PARALLAX**2) & (np.minimum(near, far) > NEAREST)
    sound &= (ratio < INTENSITY) & (ratio > 1 / INTENSITY)
    return others[sound & (np.linalg.norm(between, axis=1) < allowed)]


def _together(spots: Spots, pair: np.ndarray) -> tuple[np.ndarray, float]:
    """(K,) spots, one of a view, whose rays pass where those of two meet, as intense there; mean miss in pixels."""
    distance, off = passing(spots, nearest(spots[pair])[0])
    intensity = spots.irradiance * distance**2
    ratio = intensity / np.sqrt(intensity[pair].prod())
    own = np.flatnonzero((distance > NEAREST) & (off < PIXELS) & (ratio < INTENSITY) & (ratio > 1 / INTENSITY))
    own = own[np.argsort(off[own], kind="stable")]
    own = own[np.unique(spots.view[own], return_index=True)[1]]
    return own, float(off[own].mean()) if len(own) else 0.0


def passing(spots: Spots, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances along the rays of spots at which they pass a place, and (N,) by how many pixels."""
    distance = ((place - spots.center) * spots.direction).sum(axis=1)
    off = np.linalg.norm(place - spots.center - distance[:, None] * spots.direction, axis=1)
    return distance, off / (np.maximum(distance, NEAREST) * spots.pixel)


def nearest(spots: Spots) -> tuple[np.ndarray, np.ndarray]:
    """(3,) the place nearest to the rays of spots, and (K, 3, 3) what projects across each."""
    across = np.eye(3) - spots.direction[:, :, None] * spots.direction[:, None]
    right = (across @ spots.center[:, :, None]).sum(axis=0)[:, 0]
    return np.linalg.solve(across.sum(axis=0), right), across
