"""Radiance of surface that hardly a pixel shows alone: slats and the window behind them, a grille and its tubes.

A pixel has the mean radiance of the surfaces that it shows, by their shares w. Within a small tile of a view, surface
that faces one way is about equally bright. So the pixels of a tile tell the radiance of each kind of surface in it,

    C = sum over kinds of w_k L_k,        L_k >= 0

by least squares, with a standard error from what is left. Shares are counted by few rays. The error of a share w, of
variance f w (1 - w) / rays, would draw all kinds to the mean; what it adds to the squares is taken out.

An *island* is connected surface that faces along one axis, of which nine in ten pixels are mixed. In a tile, an island
that fills an eighth of it, and the one that fills most, is a kind of its own; other islands that face one way are one
kind, and so is other surface of one connected part. Tiles of which islands fill less than half tell nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from fipt.conventions import RAYS_PER_SIDE
from fipt.scene.mesh import Mesh, connected_parts, facing_pieces
from fipt.scene.samples import ALONE, FootprintSamples, summed_by
from fipt.scene.voxels import FACINGS, facings

_RARE = 0.1
"""Share of what is seen of a triangle that pixels may show alone: they lie at gaps and at its edges."""
_TILE = 16
"""Side of a tile, pixels: some hundred pixels for a dozen unknowns."""
_MOST = 0.5
"""Share of a tile that islands must fill: where it shows more of other surface, uneven light of that falls on them."""
_COUNTED = 0.18 / RAYS_PER_SIDE**2
"""Variance of a share over w (1 - w).

An edge's has a standard error of 0.043 (docs/measurements/accuracy.md), and w (1 - w) is 1 / 6 on average.
"""
_OWN = 1 / 8
"""Share of a tile that makes an island a kind of its own: as many unknowns as a tile can tell, with other surface."""
_LEAST = 4.0
"""Pixels that a kind must fill in a tile, all shares together."""


@dataclass(frozen=True)
class Unmixed:
    """What the samples of islands send out, in one view: N samples.

    Attributes
    ----------
    sample
        (N,) int64 row in the view.
    island
        (N,) int64; -1 for islands that were solved together with others.
    radiance
        (N, 3).
    error
        (N,) standard error of its mean over RGB.
    tile
        (N,) int64 number of the tile.
    """

    sample: np.ndarray
    island: np.ndarray
    radiance: np.ndarray
    error: np.ndarray
    tile: np.ndarray


@dataclass(frozen=True)
class Islands:
    """Of T triangles.

    Attributes
    ----------
    number
        (T,) int64 island, -1 where pixels show the triangle alone, or nothing shows it.
    part
        (T,) int64 connected part of the mesh.
    """

    number: np.ndarray
    part: np.ndarray


def find_islands(mesh: Mesh, shards: Sequence[FootprintSamples]) -> Islands:
    """Find the surface that hardly a pixel of any view shows alone."""
    total = summed_by(((samples.triangle, samples.weight) for samples in shards), len(mesh.triangles))
    alone = summed_by(((samples.triangle, samples.weight >= ALONE) for samples in shards), len(mesh.triangles))
    mixed = (total > 0) & (alone <= _RARE * total)
    number = np.where(mixed, facing_pieces(mesh, mixed), -1)
    return Islands(number, connected_parts(mesh).astype(np.int64))


def unmixed(
    samples: FootprintSamples, index: int, islands: Islands, radiance: np.ndarray, usable: np.ndarray
) -> Unmixed:
    """Tell the radiance of the islands in view number ``index``.

    Parameters
    ----------
    radiance, usable
        (P, 3) and (P,) bool of the view's pixels.
    """
    own, pixel = samples.of_view(index), samples.pixel_of_sample(index)
    width = samples.shapes[index][1]
    tile = (pixel // width // _TILE) * (width // _TILE + 1) + pixel % width // _TILE
    triangle, share = np.asarray(samples.triangle[own]), np.asarray(samples.weight[own], np.float64)
    number, owner = islands.number[triangle], islands.part[triangle]
    rows = np.flatnonzero(np.isin(tile, tile[number >= 0]) & usable[pixel])
    rows = rows[np.argsort(tile[rows], kind="stable")]
    facing = facings(np.asarray(samples.normal[own])[rows]).astype(np.int64)
    found: list[tuple[np.ndarray, ...]] = []
    for part in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(tile[rows])) + 1) if len(rows) else []:
        sample = rows[part]
        mixed = number[sample] >= 0
        if share[sample][mixed].sum() < _MOST * share[sample].sum():
            continue
        row = np.unique(pixel[sample], return_inverse=True)
        large = _large(number[sample], share[sample], len(row[0]))
        # three ranges of numbers: other surface by part and facing, islands by facing, large ones by themselves
        kind = np.where(mixed, -1 - facing[part], owner[sample] * FACINGS + facing[part])
        kind = np.where(large, -1 - FACINGS - number[sample], kind)
        solved = _solved(kind, row[1].reshape(-1), share[sample], radiance[row[0]])
        if solved is None:
            continue
        level, error = solved
        known = mixed & np.isfinite(error)
        island_of = np.where(large, number[sample], -1)
        found.append((sample[known], island_of[known], level[known], error[known], tile[sample][known]))
    if not found:
        none = np.zeros(0, np.int64)
        return Unmixed(none, none, np.zeros((0, 3)), np.zeros(0), none)
    return Unmixed(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _large(island: np.ndarray, share: np.ndarray, pixels: int) -> np.ndarray:
    """(N,) bool: samples of islands that fill enough of a tile of so many pixels, and of the one that fills most."""
    names, of = np.unique(island, return_inverse=True)
    fills = np.where(names >= 0, np.bincount(of.reshape(-1), share, len(names)), 0)
    own = (fills >= _OWN * pixels) | (fills == fills.max(initial=0))
    return (own & (names >= 0))[of.reshape(-1)]


def _solved(
    kind: np.ndarray, row: np.ndarray, share: np.ndarray, radiance: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Radiance (N, 3) of the kinds (N,) of samples in the pixels ``row`` (N,), and its standard error (N,).

    ``radiance`` (P, 3) is that of the pixels. The error is infinite where a kind hardly fills any; None where there are
    too few pixels, or no solution is found.
    """
    names, column = np.unique(kind, return_inverse=True)
    shares = np.zeros((len(radiance), len(names)))
    np.add.at(shares, (row, column), share)
    if len(radiance) <= 2 * len(names):
        return None
    noise = _COUNTED * (np.diag(shares.sum(axis=0)) - shares.T @ shares)
    values, vectors = np.linalg.eigh(shares.T @ shares - noise)
    values = np.maximum(values, _COUNTED)  # less is noise
    root = np.sqrt(values)[:, None] * vectors.T
    goal = (vectors.T @ (shares.T @ radiance)) / np.sqrt(values)[:, None]
    try:
        solution = np.stack([nnls(root, channel)[0] for channel in goal.T], axis=1)
    except RuntimeError:  # no convergence: this tile tells nothing
        return None
    left = np.square(radiance - shares @ solution).sum(axis=0).mean() / (len(radiance) - len(names))
    inverse = (vectors / values) @ vectors.T
    error = np.where(shares.sum(axis=0) >= _LEAST, np.sqrt(left * np.diag(inverse)), np.inf)
    return solution[column], error[column]
