"""Emitters that hardly fill a pixel: spots in a ceiling, strips below a cupboard, tubes at the edge of a picture.

A pixel that is brighter by `EMITTER_GAIN` than all that it shows could be, if each of its surfaces reflected as much as
any material can, shows something that emits: its other surfaces are ordinary, or emitters that are known. A triangle
is a candidate if most of what is seen of it lies in such pixels, by shares. So the ceiling around a spot is none.

Candidates that touch and face along one axis are one emitter. Where none of those that touch is found, and they fill
a few pixels, they are one, however they face: no pixels tell them apart. Pixels and shares together tell the radiance
of each,

    C = sum over others of w R + sum over emitters of w L,        L >= 0

with what others send out, R, known from pixels that they fill. L is found by multiplicative updates (Richardson 1972,
Lucy 1974), which keep it positive; for an emitter that shares no pixel with another it is the ratio of the sums of
light and of shares, so that errors of shares cancel in its flux. Views are observations: an emitter is believed if the
mean of ln(L / (`EMITTER_GAIN` times the brightest reflection)) over views is above 0 by three standard errors. A
highlight on a curved handle moves from view to view, or is no brighter than one error. What one view alone shows is
cut along its longer extent into sections, a tenth of the picture long. They are observations then: a strip below a
shelf has several, a fault of the sensor or a highlight on a handle has one. A highlight as long as a strip passes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.optimize import nnls
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from fipt.conventions import EMITTER_GAIN, RAYS_PER_SIDE
from fipt.groups import connected_groups
from fipt.model.reflectance import brightest_reflection
from fipt.scene.mesh import Mesh, facing_pieces, touching_triangles
from fipt.scene.observed import ObservedShard
from fipt.stages.emitters.observations import Observations
from fipt.stages.emitters.regions import Surface

_BEYOND = 0.5
"""Of what is seen of a surface, in pixels brighter than any reflection: above it is a candidate, else seen dark."""
_FEW = 20.0
"""Pixels at most that any view shows of a lamp whose faces may be one emitter: a bulb of a chandelier."""
_LEAST_SHARE = 0.2
"""Of a pixel: what shines makes it bright; a smaller share does not tell that a surface is dark."""
RELEVANT = 1e-3
"""Share of the light of all emitters that makes one matter: less changes no picture."""
_SIGMAS = 3.0
"""Standard errors by which an emitter must be brighter than reflections."""
_FEWEST_VIEWS = 2
"""Views that must show it: in one alone a few pixels may be a fault of its sensor, or a highlight."""
_SECTIONS = 10
"""Of a picture's longer side."""
_FEWEST_SECTIONS = 3
"""Sections in which a single view must show it: their scatter tells an error."""
_COUNTED = 1 / RAYS_PER_SIDE**2
"""Variance of a counted share w over w (1 - w): what is thinner than the distance of rays is met by chance."""
_AT_ONCE = 4
"""One in so many of the emitters that are not certain goes at once: noise makes a thousand that share pixels, and an
hour of taking one at a time. The others become more certain as pixels are left to them."""
_UPDATES = 50
"""Multiplicative updates: emitters that share pixels are then apart to a percent."""
_DIMMEST = 1e-3
"""Share of the brightest reflection that stands for a radiance of nothing, whose logarithm is asked for."""


@dataclass(frozen=True)
class _Shared:
    """N samples of candidates, each in one pixel.

    Attributes
    ----------
    triangle, view, section, sample, pixel
        (N,) int64; the pixel is numbered over those that show a candidate, the section over all views.
    share
        (N,) of the pixel.
    most
        (N,) brightest reflection there.
    left
        (N, 3) radiance of the pixel without what other surface sends there.
    clipped
        (N,) bool: that is only a lower bound.
    """

    triangle: np.ndarray
    view: np.ndarray
    section: np.ndarray
    sample: np.ndarray
    pixel: np.ndarray
    share: np.ndarray
    most: np.ndarray
    left: np.ndarray
    clipped: np.ndarray

    def __getitem__(self, rows: np.ndarray) -> "_Shared":
        return _Shared(*(getattr(self, own.name)[rows] for own in fields(self)))


@dataclass(frozen=True)
class SmallEmitters:
    """What emits though it hardly fills a pixel.

    Attributes
    ----------
    number
        (T,) int64 number of the emitter of each triangle, -1 where it is none of these.
    pixels
        The pixels that show them, sorted by view, with the radiance of the emitter alone.
    seen_dark
        (T, 2) bool: front and back of other surface that views show, if only in pixels that it shares, and that no
        pixel proves to shine. Sides of whole pieces, which are connected and face along one axis, with triangles of
        them that nobody sees.
    """

    number: np.ndarray
    pixels: Observations
    seen_dark: np.ndarray


def small_emitters(
    mesh: Mesh, shards: Sequence[ObservedShard], surface: Surface, emitting: np.ndarray, never: np.ndarray
) -> SmallEmitters:
    """Find emitters that are told by a few pixels, most of them shared with other surface.

    Parameters
    ----------
    shards
        The training views.
    surface
        What the views show of surface that fills pixels.
    emitting, never
        (T,) bool: known to emit; emits in no case.
    """
    number, dark = _candidates(mesh, shards, surface, emitting, emitting | never)
    shared = _shared(shards, surface, number)
    others = float(np.nansum(surface.radiance[emitting].mean(axis=1) * mesh.areas[emitting]))
    found, level = _proved(mesh, shared, number, others)
    wholes = _with_wholes(mesh, shared, number, found >= 0)
    if (wholes != number).any():
        found, level = _proved(mesh, shared, wholes, others)
    number, shared = found, shared[found[shared.triangle] >= 0]
    nothing = np.zeros(len(shared.triangle), np.float32)
    radiance = level[number[shared.triangle]].astype(np.float32)
    pixels = Observations(shared.triangle, radiance, shared.view, nothing, shared.clipped, shared.sample)
    return SmallEmitters(number, pixels, dark & (number < 0)[:, None])


def _proved(mesh: Mesh, shared: _Shared, number: np.ndarray, others: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) number of each candidate that pixels prove to shine, -1 elsewhere, and (E, 3) radiance of these.

    ``others`` is what other emitters give, radiance times area; what is little beside it is left out.
    """
    shared = shared[number[shared.triangle] >= 0]
    number = _renumbered(number, _needed(shared, number[shared.triangle], int(number.max(initial=-1)) + 1))
    shared = shared[number[shared.triangle] >= 0]
    emitter = number[shared.triangle]
    level = _levels(shared, emitter, int(number.max(initial=-1)) + 1)
    power = np.bincount(number[number >= 0], mesh.areas[number >= 0], len(level)) * level.mean(axis=1)
    believed = _believed(shared, emitter, level) & (power > RELEVANT * (others + power.sum()))
    return _renumbered(number, believed), level[believed]


def _with_wholes(mesh: Mesh, shared: _Shared, number: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(T,) int64 numbers of candidates; those that touch are one if none of them is ``found`` (T,) and they are small.

    A scan rounds a bulb, which then faces to all sides, and no pixel tells its faces apart.
    """
    chosen = number >= 0
    a, b = touching_triangles(mesh)
    joined = chosen[a] & chosen[b]
    whole = connected_groups((a[joined], b[joined]), len(chosen))
    count = int(whole.max(initial=-1)) + 1
    lost = np.bincount(whole, found, count) == 0
    cell, place = np.unique(shared.view * count + whole[shared.triangle], return_inverse=True)
    lost[cell[np.bincount(place.reshape(-1), shared.share, len(cell)) > _FEW] % max(count, 1)] = False
    faces = np.unique(np.stack([whole[chosen], number[chosen]]), axis=1)[0]
    lost &= np.bincount(faces, minlength=count) > 1
    named = np.where(lost[whole], int(number.max(initial=-1)) + 1 + whole, number)[chosen]
    result = np.full(len(chosen), -1, np.int64)
    result[chosen] = np.unique(named, return_inverse=True)[1].reshape(-1)  # no gaps: each number costs time
    return result


def _candidates(
    mesh: Mesh, shards: Sequence[ObservedShard], surface: Surface, emitting: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Number the surface that may emit, and tell what is seen dark.

    Returns
    -------
    number
        (T,) int64 of each piece of surface of which most that is seen lies in pixels that no reflection explains; -1
        for all else. A piece is connected and faces along one axis. Where only a part of it is bright, its bright
        triangles are pieces.
    dark
        (T, 2) bool: sides of pieces of which a pixel's worth is seen in pixels that tell, half of it or more, in the
        mean of the views, in such as reflection explains.
    """
    total, beyond = np.zeros((2, len(emitting)))
    piece = facing_pieces(mesh, ~other)
    shown, views, bright_views = np.zeros((3, int(piece.max(initial=-1)) + 1, 2))
    for (triangle, side), share, bright, tells in _pixels(mesh, shards, surface, emitting):
        total += np.bincount(triangle, share, len(total))
        beyond += np.bincount(triangle, share * bright, len(total))
        telling = share * (tells & (share >= _LEAST_SHARE))
        face = 2 * piece[triangle] + side
        here, lit = (np.bincount(face, each, shown.size).reshape(-1, 2) for each in (telling, telling * bright))
        shown += here
        counts = np.minimum(here, 1)  # a pixel's worth of it is an observation
        views += counts
        bright_views += counts * lit / np.maximum(here, 1e-12)
    dark = (shown >= 1) & (bright_views <= _BEYOND * views)
    whole = np.bincount(piece, beyond) > _BEYOND * np.bincount(piece, total)
    part = facing_pieces(mesh, ~other & ~whole[piece] & (beyond > _BEYOND * total))
    number = np.where(whole[piece], piece, piece.max(initial=-1) + 1 + part)
    chosen = ~other & (whole[piece] | (beyond > _BEYOND * total))
    result = np.full(len(total), -1, np.int64)
    result[chosen] = np.unique(number[chosen], return_inverse=True)[1].reshape(-1)
    return result, dark[piece] & ~other[:, None]


def _pixels(
    mesh: Mesh, shards: Sequence[ObservedShard], surface: Surface, emitting: np.ndarray
) -> Iterator[tuple[tuple[np.ndarray, np.ndarray], np.ndarray, np.ndarray, np.ndarray]]:
    """Yield triangle, its side (0 front, 1 back) and share (N,) of the samples of each view, and (N,) bool of pixels.

    The latter are whether the pixel is brighter than all that it shows could reflect, and whether that tells of its
    surface: neither it nor one of those around shows a known emitter, and a pixel that is not so bright is not clipped.
    """
    known = np.where(emitting, np.nan_to_num(surface.radiance.mean(axis=1)), 0)
    for shard in shards:
        samples = shard.samples
        for index, (height, width) in enumerate(samples.shapes):
            own, pixel, first = samples.of_view(index), samples.pixel_of_sample(index), samples.pixels(index)
            triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own], np.float64)
            most = brightest_reflection(np.asarray(shard.shading[own], np.float32))
            most = np.bincount(pixel, share * np.where(emitting[triangle], 0, most), height * width)
            # a pixel beside a known emitter may show it, where mesh and lens are not exact
            light = np.zeros(height * width)
            np.maximum.at(light, pixel, known[triangle])
            light = maximum_filter(light.reshape(height, width), 3).reshape(-1)
            bright = np.asarray(shard.radiance[first]).mean(axis=1) > EMITTER_GAIN * (light + most)
            usable = np.asarray(shard.weight[first]) > 0
            rows = np.flatnonzero(usable[pixel])
            tells = (light == 0) & (bright | ~np.asarray(shard.clipped[first]))
            side = np.where(mesh.front(triangle, samples.normal[own]), 0, 1)
            yield (triangle[rows], side[rows]), share[rows], bright[pixel[rows]], tells[pixel[rows]]


def _shared(shards: Sequence[ObservedShard], surface: Surface, number: np.ndarray) -> _Shared:
    """Samples of candidates, those with a ``number`` (T,), and what other surface leaves of their pixels."""
    ordinary = np.where((number >= 0)[:, None], 0, np.nan_to_num(surface.radiance))
    columns: list[tuple[np.ndarray, ...]] = []
    pixels = 0
    for shard in shards:
        samples = shard.samples
        for index in range(len(samples.views)):
            own, pixel, first = samples.of_view(index), samples.pixel_of_sample(index), samples.pixels(index)
            triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own], np.float64)
            rows = np.flatnonzero((number[triangle] >= 0) & (np.asarray(shard.weight[first])[pixel] > 0))
            shown, place = np.unique(pixel[rows], return_inverse=True)
            left = np.asarray(shard.radiance[first])[shown].astype(np.float64)
            around = np.flatnonzero(np.isin(pixel, shown))
            other = share[around, None] * ordinary[triangle[around]]
            np.subtract.at(left, np.searchsorted(shown, pixel[around]), other)
            place = place.reshape(-1)
            section = _sections(shown[place], number[triangle[rows]], samples.shapes[index])
            most = brightest_reflection(np.asarray(shard.shading[rows + own.start], np.float32))
            columns.append((
                triangle[rows].astype(np.int64), np.full(len(rows), len(columns)), len(columns) * _SECTIONS + section,
                rows + own.start, pixels + place, share[rows], most,
                np.maximum(left, 0)[place], np.asarray(shard.clipped[first])[pixel[rows]],
            ))  # fmt: skip
            pixels += len(shown)
    return _Shared(*(np.concatenate(column) for column in zip(*columns, strict=True)))


def _sections(pixel: np.ndarray, candidate: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """(N,) int64 section of the picture that each pixel lies in, counted along its candidate, from one end of it."""
    place = np.stack(np.divmod(pixel, shape[1]), axis=1)
    low, high = (np.full((int(candidate.max(initial=-1)) + 1, 2), end) for end in (max(shape), -1))
    np.minimum.at(low, candidate, place)
    np.maximum.at(high, candidate, place)
    longer = (high - low).argmax(axis=1)[candidate]
    along = np.take_along_axis(place - low[candidate], longer[:, None], axis=1)[:, 0]
    return along * _SECTIONS // max(shape)


def _needed(shared: _Shared, emitter: np.ndarray, count: int) -> np.ndarray:
    """(count,) bool: emitters without which pixels would be brighter than the errors of shares let them be.

    Of those that share pixels, the least certain ones go first, until all that stay are certain.
    """
    if count == 0:
        return np.zeros(0, bool)
    of_pixel = coo_matrix((np.ones(len(emitter)), (emitter, shared.pixel))).tocsr()
    cluster = connected_components(of_pixel @ of_pixel.T, directed=False)[1]
    level, result = _levels(shared, emitter, count).mean(axis=1), np.zeros(count, bool)
    for number in np.unique(cluster):
        rows = np.flatnonzero(cluster[emitter] == number)
        names, column = np.unique(emitter[rows], return_inverse=True)
        pixels, row = np.unique(shared.pixel[rows], return_inverse=True)
        shares, left = np.zeros((len(pixels), len(names))), np.zeros(len(pixels))
        np.add.at(shares, (row.reshape(-1), column.reshape(-1)), shared.share[rows])
        left[row.reshape(-1)] = shared.left[rows].mean(axis=1)
        most = EMITTER_GAIN * np.bincount(column.reshape(-1), shared.share[rows] * shared.most[rows])
        most /= np.maximum(np.bincount(column.reshape(-1), shared.share[rows]), 1e-12)
        kept = np.arange(len(names))
        while len(kept):
            try:
                found, error = _solved(shares[:, kept], left, level[names[kept]])
            except RuntimeError:  # no convergence: these pixels tell nothing
                kept = kept[:0]
                break
            certainty = (found - most[kept]) / error
            doubtful = int((certainty <= _SIGMAS).sum())
            if doubtful == 0:
                break
            kept = np.delete(kept, np.argsort(certainty, kind="stable")[: max(doubtful // _AT_ONCE, 1)])
        result[names[kept]] = True
    return result


def _solved(shares: np.ndarray, left: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (E,) of emitters that share pixels, and its standard error, by non-negative least squares.

    Parameters
    ----------
    shares
        (P, E) of the pixels.
    left
        (P,) radiance of the pixels, without other surface.
    level
        (E,) radiance about which errors of shares count.

    Raises
    ------
    RuntimeError
        If the iteration does not converge.
    """
    noise = _COUNTED * (np.maximum(shares * (1 - shares), _COUNTED) @ level**2)
    scale = 1 / np.sqrt(np.maximum(noise, 1e-12))
    root, goal = shares * scale[:, None], left * scale
    found = nnls(root, goal)[0]
    misfit = np.square(goal - root @ found).sum() / max(len(left) - len(level), 1)
    inverse = np.linalg.pinv(root.T @ root, hermitian=True)
    return found, np.sqrt(np.maximum(np.diag(inverse), 1e-12) * max(misfit, 1.0))


def _levels(shared: _Shared, emitter: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) radiance of each emitter, those of samples (N,), by multiplicative updates."""
    seen = np.maximum(np.bincount(emitter, shared.share, count), 1e-12)
    level = np.ones((count, 3))
    for _ in range(_UPDATES):
        given = shared.share[:, None] * level[emitter]
        for channel in range(3):
            whole = np.bincount(shared.pixel, given[:, channel])
            part = given[:, channel] / np.maximum(whole, 1e-12)[shared.pixel] * shared.left[:, channel]
            level[:, channel] = np.bincount(emitter, part, count) / seen
    return level


def _believed(shared: _Shared, emitter: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(E,) bool: emitters brighter than any reflection, as their views say together, or the sections of the one."""
    by_views, views = _brighter(shared, emitter, level, shared.view)
    by_sections, sections = _brighter(shared, emitter, level, shared.section)
    return np.where(views >= _FEWEST_VIEWS, by_views, (sections >= _FEWEST_SECTIONS) & by_sections)


def _brighter(
    shared: _Shared, emitter: np.ndarray, level: np.ndarray, observed_in: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(E,) bool: emitters brighter than any reflection by three standard errors; and (E,) number of observations.

    ``observed_in`` (N,) numbers the observation that a sample belongs to.
    """
    count, observations = len(level), int(observed_in.max(initial=0)) + 1
    given = shared.share * level.mean(axis=1)[emitter]
    part = given / np.maximum(np.bincount(shared.pixel, given), 1e-12)[shared.pixel] * shared.left.mean(axis=1)
    pair, place = np.unique(emitter * observations + observed_in, return_inverse=True)
    place, owner = place.reshape(-1), pair // observations

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(place, values, len(pair))

    share = total(shared.share)
    most = EMITTER_GAIN * total(shared.share * shared.most) / np.maximum(share, 1e-12)
    excess = np.log(np.maximum(total(part) / np.maximum(share, 1e-12) / np.maximum(most, 1e-12), _DIMMEST))
    counting = _COUNTED * total(shared.share * (1 - shared.share)) / np.maximum(share, 1e-12) ** 2
    # a share that may be nothing tells nothing; observations differ by more than what is counted
    trust = (_SIGMAS**2 * counting < 1) / (counting + _COUNTED)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.bincount(owner, trust * values, count) / np.maximum(np.bincount(owner, trust, count), 1e-12)

    middle = mean(excess)
    seen_in = np.bincount(owner, trust > 0, count)
    scatter = mean((excess - middle[owner]) ** 2) / np.maximum(seen_in - 1, 1)
    error = np.sqrt(np.maximum(scatter, mean(counting) / np.maximum(seen_in, 1)))
    return middle > _SIGMAS * error, seen_in


def _renumbered(number: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """(T,) numbers of those emitters that are kept (E,), without gaps; -1 for all others."""
    new = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    return new[number]
