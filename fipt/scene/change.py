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

All views together say k, so it is found where the shading of all shards is read. A refinement writes x beside y, and
for each view the sums by which they differ (docs/adr/0064-any-shard-size.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.manifests import ListedFiles
from fipt.scene.samples import Empty, FootprintSamples
from fipt.scene.shading import BEFORE, Shading, read_shading
from fipt.scene.voxels import FACINGS, facings, voxel_keys

DIFFERENCES = "differences.npz"
"""Name of the file in a folder of refined shading."""
_PIECES = 96
"""Pieces along the scene box, as in the search for parts: several pixels of several views each."""
_MOST = 1.0
"""Differences count up to here, a factor of 2.7: corners into which no light falls have no logarithm."""
_DARKEST = 1e-4
"""Radiance below which shading counts as black."""
_BRIGHTER = 0.1
"""Share of the pixels that may have become brighter than white."""
_SIGMAS = 3.0
"""Standard errors, from the scatter over views, by which that share must grow."""
_DIGITS = 4
"""Decimals of the share that is kept."""
_FORMS = {
    "piece": "number K",
    "weight": "amount K",
    "mean": "finite K",
    "total": "amount V",
    "square": "amount V",
    "brighter": "finite V",
    "judged": "number V",
    "damping": "share",
}


@dataclass(frozen=True)
class ShadingChange:
    """What a refinement found different from the shading before it, as the natural logarithm of diffuse shading.

    Attributes
    ----------
    change
        Root mean square of what all views of a surface find alike: 0.05 is a change by 5 %.
    noise
        Standard deviation of what is left of a single sample: noise of the rays and of denoising.
    kept
        Share of the last round's shading that is kept.
    light_missing
        Whether it is kept whole, since the emitters that were found give too little light.
    """

    change: float
    noise: float
    kept: float
    light_missing: bool = False


@dataclass(frozen=True)
class ShadingDifferences:
    """What two estimates of the diffuse shading of V views differ by; K pieces of surface, view by view.

    Attributes
    ----------
    piece
        (K,) int64 piece of surface.
    weight, mean
        (K,) summed weight of its samples in a view, and the mean of d over them.
    total, square
        (V,) summed weight of each view's samples; that of their weight times d squared.
    brighter, judged
        (V,) share of the pixels by which more are brighter than any reflection than before, and how many were judged.
    """

    piece: np.ndarray
    weight: np.ndarray
    mean: np.ndarray
    total: np.ndarray
    square: np.ndarray
    brighter: np.ndarray
    judged: np.ndarray

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
    brighter: tuple[float, int] = (0.0, 0),
) -> ShadingDifferences:
    """Compare two estimates of the shading of view number ``index``.

    Parameters
    ----------
    shading
        (N,) mean radiance of Ld over the channels: of this round, and of the one before.
    box
        Centre (3,) and side of the scene box, metres.
    brighter
        Share by which more pixels are brighter than any reflection, and how many pixels were judged.
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
    whole = (weight.sum(), (weight * d * d).sum(), *brighter)
    return ShadingDifferences(piece, total, mean, *(np.array([value]) for value in whole))


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
        return ShadingChange(0.0, 0.0, damping)
    every = float(found.square.sum()) / total
    learnt = min(max(_across_views(found), 0.0), every)
    kept = damping * (1 - learnt / every) if every > 0 else damping
    missing = _light_is_missing(found.brighter[found.judged > 0])
    return ShadingChange(learnt**0.5, ((every - learnt) / 2) ** 0.5, 1.0 if missing else round(kept, _DIGITS), missing)


def write_differences(folder: Path, found: ShadingDifferences, damping: float) -> None:
    """Write what the shading of a shard differs by, and what share of the one before may be kept."""
    arrays = {own.name: getattr(found, own.name) for own in fields(found)}
    save_npz(folder / DIFFERENCES, **arrays, damping=np.array(damping))


def read_change(folders: Sequence[Path | str]) -> ShadingChange | None:
    """What a refinement changed, by the folders of all its shards in the order of their views; None of baked shading.

    Raises
    ------
    FiptError
        If a file is missing, damaged or of another run.
    """
    paths = [Path(folder) / DIFFERENCES for folder in folders]
    if not any(path.is_file() for path in paths):
        return None
    read = [load_npz(ListedFiles(path.parent).check(path), forms=_FORMS) for path in paths]
    damping = max(float(arrays.pop("damping")) for arrays in read)
    return measured_change(ShadingDifferences.joined([ShadingDifferences(**arrays) for arrays in read]), damping)


def read_round(
    folders: Sequence[Path | str], samples: Sequence[FootprintSamples], empty: Empty = np.empty
) -> list[Shading]:
    """Shading of a round, of all its shards in the order of their views: what was kept of the round before is in it.

    ``empty`` makes the arrays over all samples: in memory, or `fipt.formats.arrays.on_disk`.

    Raises
    ------
    FiptError
        If a file is missing, damaged or of other samples.
    """
    found = read_change(folders)
    kept = 0.0 if found is None else found.kept
    return [joined_shading(folder, own, kept, empty) for folder, own in zip(folders, samples, strict=True)]


def joined_shading(folder: Path | str, samples: FootprintSamples, kept: float, empty: Empty = np.empty) -> Shading:
    """Shading of a shard, of which a share is that of the round before."""
    new = read_shading(folder, samples)
    if kept == 0:
        return new
    old = read_shading(folder, samples, BEFORE)
    if kept == 1:
        return old
    result = Shading(empty(new.words.shape, new.words.dtype))
    for own in map(samples.of_view, range(len(samples.views))):
        result[own] = (1 - kept) * new[own] + kept * old[own]
    return result


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
    return bool(np.mean(more) - _SIGMAS * np.std(more, ddof=1) / len(more) ** 0.5 > _BRIGHTER)
