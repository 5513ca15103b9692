"""Exposures: true shutter times and f-numbers behind nominal ones, and ratios measured from the images."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fipt.robust import deviation
from fipt.stages.capture.raw import RawFrame, Shot

REFERENCE_ISO = 100.0
REFERENCE_APERTURE = 8.0
"""Radiance is stated in sensor ranges per second at this ISO and f-number."""

SAME_STOPS = 1 / 6
"""Exposures closer than this, in stops, are the same."""

RATIO_TOLERANCE = 0.02
"""A measured ratio of exposures that differs more than this from the stated one is reported."""

_LONGEST_NOMINAL = 31.0
"""Seconds; longer times are held by hand or by a timer and taken as they are."""

_HALVES = (1.5, 3.0, 12.0)
"""Nominal times of half stops, seconds, that lie nearer to a third, and are the name of none."""

_SAME_STOP = 1e-3
"""Stops by which a half stop must be nearer than a third: whole stops are both."""

_PIXELS_MEASURED = 400_000


def snapped(seconds: float) -> float:
    """Return the true time behind a nominal one: cameras double light in thirds of a stop, 2^(n/3) s.

    1/60 s is 1/64 s, 30 s is 32 s; nominal times are up to 7 % off. Half stops (1/45, 1/90 s) go to 2^(n/2) s, by
    distance, and where that does not tell, by name. Times above 30 s are taken as they are.
    """
    if seconds > _LONGEST_NOMINAL:
        return seconds
    stop = math.log2(seconds)
    if any(math.isclose(seconds, half, rel_tol=1e-3) for half in _HALVES):
        return 2.0 ** (round(2 * stop) / 2)
    third, half = round(3 * stop) / 3, round(2 * stop) / 2
    return 2.0 ** (half if abs(stop - half) < abs(stop - third) - _SAME_STOP else third)


def snapped_aperture(number: float) -> float:
    """Return the true f-number behind a nominal one, 2^(n/6): f/5.6 is 5.657, f/11 is 11.31."""
    return 2.0 ** (round(6 * math.log2(number)) / 6)


def exposure(shot: Shot, snap: bool = True) -> float:
    """Light gathered by a shot relative to 1 s at ISO 100 and f/8; unknown ISO and aperture count as these.

    Parameters
    ----------
    shot
        With a shutter time.
    snap
        Take nominal times as their true third-stop values. Apertures always are.
    """
    time = snapped(shot.seconds) if snap else shot.seconds
    gain = (shot.iso or REFERENCE_ISO) / REFERENCE_ISO
    aperture = snapped_aperture(shot.aperture) if shot.aperture else REFERENCE_APERTURE
    return time * gain * (REFERENCE_APERTURE / aperture) ** 2


def stops(shot: Shot) -> float:
    """Binary logarithm of the exposure."""
    return math.log2(exposure(shot))


def shutter_text(seconds: float) -> str:
    """A shutter time as photographers write it: ``1/60 s``, ``0.5 s``, ``2 s``."""
    return f"1/{1 / seconds:.0f} s" if seconds < 0.3 else f"{seconds:.3g} s"


def measured_ratio(longer: RawFrame, shorter: RawFrame, black: np.ndarray, stated: float) -> float | None:
    """Ratio of two exposures of the same view, from pixels that both see well.

    Pixels are chosen by the longer exposure (15 to 85 % of its range), whose noise is small, so that the choice does
    not bias the ratio; those that disagree with the median ratio beyond noise (something moved) are left out.

    Parameters
    ----------
    longer, shorter
        Frames of one bracket.
    black
        (4,) black level by colour index.
    stated
        The expected ratio; pixels whose shorter signal would be below 1 % of the range are not used.

    Returns
    -------
    float or None
        Longer over shorter; None where fewer than 200 pixels are seen well by both.
    """
    rows, columns = longer.shape
    stride = 2 * max(1, int(math.sqrt(rows * columns / _PIXELS_MEASURED)) // 2) + 1  # odd: meets every colour
    levels = black[longer.pattern]
    spans = (longer.white - black)[longer.pattern]
    i, j = np.arange(0, rows, stride) & 1, np.arange(0, columns, stride) & 1
    offset, span = levels[np.ix_(i, j)], spans[np.ix_(i, j)]
    z_long = longer.mosaic[::stride, ::stride] - offset
    z_short = shorter.mosaic[::stride, ::stride] - offset
    lowest = max(0.15, 0.01 * stated)
    use = (z_long > lowest * span) & (z_long < 0.85 * span)
    z_long, z_short = z_long[use], z_short[use]
    if z_long.size < 200:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        share = z_short / z_long
    middle = np.median(share)
    calm = np.abs(share - middle) <= 3 * deviation(share - middle) + 1e-6
    total = z_short[calm].sum()
    return float(z_long[calm].sum() / total) if total > 0 else None


def chained(ratios: Sequence[float | None], stated: Sequence[float], anchor: int) -> list[float]:
    """Exposures from the measured ratios of neighbours, longest first; absent ratios are taken as stated.

    Parameters
    ----------
    ratios
        Exposure k over exposure k + 1, measured; None where it could not be.
    stated
        Exposures as stated.
    anchor
        Index of the exposure that keeps its stated value.
    """
    values = [1.0]
    for k, ratio in enumerate(ratios):
        values.append(values[-1] / (ratio or stated[k] / stated[k + 1]))
    scale = stated[anchor] / values[anchor]
    return [value * scale for value in values]
