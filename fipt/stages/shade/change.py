"""What a refinement changed, told apart from its noise, and how much of the shading before it is kept.

Two estimates of the same shading, x of the round before and y of this one, differ by noise and by what the round has
learnt. Noise of different views is independent; what was learnt is the same for all views of a surface. So for the
difference d = ln y - ln x of diffuse shading, with its mean in each view of a small piece of surface,

    c^2 = mean product of the means of two different views          what was learnt
    D   = mean of d^2 over samples,      v = (D - c^2) / 2          noise of x, and of y

If y has no bias, and x the bias c, then (1 - k) y + k x is best with k = v / D = (1 - c^2 / D) / 2: the mean of both
where they differ by noise alone, y alone where all views agree that x was wrong.

It has a bias where emitters are missing: then less arrives than the photographs show, in all views alike, and fits make
up for it by base colours near white. What tells is surface that is brighter than white under y, and not under x.
Nothing is taken from such a round.

All of it is told by sums over views, which are added in the order of the views: how these are cut into shards changes
nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from fipt.formats.arrays import load_npz, save_npz
from fipt.model.reflectance import brightest_reflection
from fipt.scene.samples import ALONE, FootprintSamples
from fipt.scene.settled import ShadingChange
from fipt.scene.shading import Shading
from fipt.scene.voxels import FACINGS, facings, voxel_keys

DIFFERENCES = "differences.npz"
"""Name of the file in a folder of traced shading."""
_PIECES = 96
"""Pieces along the scene box, as in the search for parts: several pixels of several views each."""
_MOST = 1.0
"""Differences count up to here, a factor of 2.7: corners into which no light falls have no logarithm."""
_DARKEST = 1e-4
"""Radiance below which shading counts as black."""
_TOLERANCE = 0.1
"""Relative error of light that is tolerated, and share of the pixels that may be brighter than white."""
_SIGMAS = 3.0
"""Standard errors, from the scatter over views, by which that share must grow."""
_FORMS = {
    "piece": "number K",
    "weight": "amount K",
    "mean": "finite K",
    "pieces": "number V",
    "total": "amount V",
    "square": "amount V",
    "samples": "number V",
    "brighter": "float V",
    "damping": "share",
}


@dataclass(frozen=True)
class ShadingDifferences:
    """What two estimates of the diffuse shading of V views differ by; K pieces of surface, view by view.

    Attributes
    ----------
    piece
        (K,) int64 piece of surface.
    weight, mean
        (K,) summed weight of its samples in a view, and the mean of d over them.
    pieces
        (V,) int64 pieces of each view.
    total, square
        (V,) summed weight of each view's samples; that of their weight times d squared.
    samples
        (V,) int64 samples of each view.
    brighter
        (V,) share of the pixels by which more are brighter than any reflection than before; NaN where none tells.
    """

    piece: np.ndarray
    weight: np.ndarray
    mean: np.ndarray
    pieces: np.ndarray
    total: np.ndarray
    square: np.ndarray
    samples: np.ndarray
    brighter: np.ndarray

    @staticmethod
    def joined(parts: Sequence["ShadingDifferences"]) -> "ShadingDifferences":
        """Those of the views of all parts, in their order."""
        return ShadingDifferences(
            *(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(ShadingDifferences))
        )


def view_differences(
    samples: FootprintSamples,
    index: int,
    shading: tuple[np.ndarray, np.ndarray],
    box: tuple[np.ndarray, float],
    brighter: float,
) -> ShadingDifferences:
    """Compare two estimates of the shading of view number ``index``.

    Parameters
    ----------
    shading
        (N,) mean radiance of Ld over the channels: of this round, and of the one before.
    box
        Centre (3,) and side of the scene box, metres.
    brighter
        See `more_brighter`.
    """
    own, (new, old) = samples.of_view(index), shading
    dark = (new < _DARKEST) & (old < _DARKEST)
    d = np.clip(np.log(np.maximum(new, _DARKEST) / np.maximum(old, _DARKEST)), -_MOST, _MOST)
    weight = np.where(dark, 0, np.asarray(samples.weight[own], np.float64))
    surface = voxel_keys(np.asarray(samples.position[own]), *box, _PIECES) * FACINGS
    surface += facings(np.asarray(samples.normal[own]))
    piece, group = np.unique(surface, return_inverse=True)
    group = group.reshape(-1)
    total = np.bincount(group, weight, len(piece))
    mean = np.bincount(group, weight * d, len(piece)) / np.maximum(total, 1e-12)
    whole = (len(piece), weight.sum(), (weight * d * d).sum(), len(d), brighter)
    return ShadingDifferences(piece, total, mean, *(np.array([value]) for value in whole))


def more_brighter(
    samples: FootprintSamples,
    index: int,
    shading: tuple[Shading, Shading],
    pixels: tuple[np.ndarray, np.ndarray, np.ndarray],
    emitting: np.ndarray,
) -> float:
    """By what share of the pixels of view number ``index`` more are brighter than any reflection than before.

    Parameters
    ----------
    shading
        Of all samples: of this round, and of the one before.
    pixels
        (P, 3) radiance, (P,) weight, and (P,) bool whether the radiance is only a lower bound.
    emitting
        Triangles that emit: their pixels are no reflection.
    """
    radiance, weight, clipped = pixels
    own, pixel = samples.of_view(index), samples.pixel_of_sample(index)
    use = (np.asarray(samples.weight[own]) >= ALONE) & (weight[pixel] > ALONE) & ~clipped[pixel]
    use = np.flatnonzero(use & ~np.isin(np.asarray(samples.triangle[own]), emitting))
    if len(use) == 0:
        return float("nan")
    bright, rows = radiance[pixel[use]].mean(axis=1), use + own.start
    now, before = (bright > (1 + _TOLERANCE) * brightest_reflection(np.asarray(each[rows])) for each in shading)
    return float(now.mean() - before.mean())


def measured_change(found: ShadingDifferences, damping: float) -> ShadingChange:
    """What a round changed, and what is kept of the one before.

    Parameters
    ----------
    found
        Of all training views.
    damping
        Share of the shading before to keep, were the difference noise alone.
    """
    total = float(found.total.sum())
    if total == 0:
        return ShadingChange(0.0, 0.0, damping, 0)
    every = float(found.square.sum()) / total
    learnt = min(max(_across_views(found), 0.0), every)
    kept = damping * (1 - learnt / every) if every > 0 else damping
    missing = _light_is_missing(found.brighter[np.isfinite(found.brighter)])
    noise = ((every - learnt) / 2) ** 0.5
    return ShadingChange(learnt**0.5, noise, 1.0 if missing else kept, int(found.samples.sum()), float(missing))


def damped(samples: FootprintSamples, new: Shading, old: Shading, kept: float) -> None:
    """Let ``new`` keep a share of ``old``, in place; both are of all samples of a shard."""
    if kept > 0:
        for own in map(samples.of_view, range(len(samples.views))):
            new[own] = (1 - kept) * new[own] + kept * old[own]


def write_differences(path: Path, found: ShadingDifferences, damping: float) -> None:
    """Write what the shading of a shard differs by, and what share of the one before may be kept."""
    arrays = {own.name: getattr(found, own.name) for own in fields(found)}
    save_npz(path, **arrays, damping=np.array(damping))


def read_differences(folders: Sequence[Path]) -> tuple[ShadingDifferences, float]:
    """Those of all shards, given as folders of traced shading in the order of their views.

    Raises
    ------
    FiptError
        If a file is missing or damaged.
    """
    read = [load_npz(folder / DIFFERENCES, forms=_FORMS) for folder in folders]
    damping = max(float(arrays.pop("damping")) for arrays in read)
    return ShadingDifferences.joined([ShadingDifferences(**arrays) for arrays in read]), damping


def _across_views(found: ShadingDifferences) -> float:
    """Mean product of the means of d in two views of a piece of surface; 0 where no piece has two views."""
    _, piece = np.unique(found.piece, return_inverse=True)
    piece = piece.reshape(-1)
    seen = (found.weight > 0).astype(np.float64)
    views, covered = np.bincount(piece, seen), np.bincount(piece, found.weight)
    pairs = views > 1
    if not pairs.any():
        return 0.0
    product = np.bincount(piece, found.mean) ** 2 - np.bincount(piece, found.mean**2)
    return float(np.average(product[pairs] / (views * (views - 1))[pairs], weights=covered[pairs]))


def _light_is_missing(more: np.ndarray) -> bool:
    """Whether many more pixels are brighter than any reflection: by shares (V,) of views that tell."""
    if len(more) < 2:
        return False
    return bool(np.mean(more) - _SIGMAS * np.std(more, ddof=1) / len(more) ** 0.5 > _TOLERANCE)
