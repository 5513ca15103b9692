"""Parts without any network: smooth regions of the mesh, parted where the colour of the light that leaves them jumps.

Regions grow from single triangles. In every round each region joins the neighbour, across sides that are not sharp,
whose colour at their common border differs the least from its own (Borůvka's rounds: a few, however many triangles).
Where the mesh was scanned, its creases are round and edges of colour are spread over some triangles, so that no side
parts anything: what regions are as a whole, the way they face and their mean colour, must not differ more than sides
may. A wall that fades into shadow may become two regions, and a round shape several; `fipt.stages.segment.regroup`
joins them. What is too narrow for a pixel is one region with what it touches (`fipt.stages.segment.slivers`).
"""

from pathlib import Path

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.formats.manifests import Stats
from fipt.groups import connected_groups
from fipt.progress import progress
from fipt.scene.dataset import Dataset
from fipt.stages.segment.fuse import numbered
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.slivers import without_slivers
from fipt.stages.segment.split import whole
from fipt.stages.segment.surface import CellSurface, near_pieces, surface_of, tidied
from fipt.stages.segment.views import CellObservations, observe
from fipt.stages.segment.write import Fused, FusionResult, write_fused

_BRIGHTNESS = 0.3
"""Weight of brightness against hue: it changes with the light, hue hardly."""
_NOISE = 0.3
"""Standard deviation of the logarithm of one pixel's colour: texture and edges within the pixel."""
_DARKEST = 1e-3
"""Radiance that is added before the logarithm, in units of the brightest triangle's median."""


def grow_parts(dataset: Path, segments: Path, settings: FuseSettings) -> Stats:
    """Grow parts from mesh and training images and write them as `fipt.stages.segment.fuse` writes fused ones."""
    data = Dataset(dataset)
    mesh = data.mesh()
    surface = surface_of(mesh)
    observations = observe(mesh, [data.camera(view) for view in data.views("train")], segments)
    color, pixels = seen_colors(data, observations, len(mesh.triangles))
    ids = without_slivers(surface, regions(surface, color, pixels, settings, mesh.normals), observations)
    ids, kind = numbered(ids, np.zeros(int(ids.max()) + 1, np.int64), surface.area)
    views = np.zeros(len(kind), np.int64)
    for number in range(len(observations.cameras)):
        cell, _ = observations.of(number)
        views[np.unique(ids[cell[cell >= 0]])] += 1
    found = Fused(ids, np.zeros_like(ids), (pixels > 0).astype(np.float64), pixels, kind, views)
    about = {"source": "geometry", "views": len(observations.cameras)}
    result = FusionResult(whole(mesh), found, ["part"], about, observations)
    return write_fused(segments, data, result, settings)


def seen_colors(data: Dataset, observations: CellObservations, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour (count, 3) of each triangle and the pixels (count,) that tell it; 0 where no training view sees it.

    The colour is made for comparing: logarithms of red and blue over green, and of brightness with less weight.
    """
    total, pixels = np.zeros((count, 3)), np.zeros(count)
    with progress("reading images", len(observations.cameras), " views") as bar:
        for number, camera in enumerate(observations.cameras):
            image, valid = data.image(camera.name)
            cell, _ = observations.of(number)
            usable = (cell >= 0) & (valid.ravel() > 0)
            weight = valid.ravel()[usable]
            pixels += np.bincount(cell[usable], weight, count)
            for channel in range(3):
                total[:, channel] += np.bincount(cell[usable], weight * image.reshape(-1, 3)[usable, channel], count)
            bar.advance()
    seen = pixels > 0
    mean = total[seen] / pixels[seen, None]
    bright = mean @ LUMINANCE
    mean = mean + _DARKEST * max(float(np.median(bright)) if len(bright) else 1.0, 1e-12)
    color = np.zeros((count, 3))
    logs = np.log(mean)
    color[seen] = np.stack(
        [_BRIGHTNESS * np.log(mean @ LUMINANCE), logs[:, 0] - logs[:, 1], logs[:, 2] - logs[:, 1]], 1
    )
    return color, pixels


def regions(
    surface: CellSurface, color: np.ndarray, pixels: np.ndarray, settings: FuseSettings, normal: np.ndarray
) -> np.ndarray:
    """(C,) int64 region from 1 of every triangle.

    Parameters
    ----------
    color, pixels
        (C, 3) colour of each triangle, and the pixels (C,) that tell it.
    normal
        (C, 3) unit normals.
    """
    smooth = surface.bend >= np.cos(np.radians(settings.crease))
    ids = _grown(surface, smooth, color, pixels, settings, normal) + 1
    if settings.smallest == 0:
        return ids
    # small regions join the one they share most of their border with: first around no edge, then around any
    weak = np.zeros(len(ids))
    for borders in (smooth, None):
        ids = tidied(surface, ids, weak, settings.smallest, borders)
    # what is small and touches nothing (leaves) joins its like nearby
    small = np.bincount(ids, surface.area)[ids] < settings.smallest
    piece = near_pieces(surface, small.astype(np.int64), settings.gap)
    return np.where(small, ids.max() + 1 + piece, ids)


def _grown(
    surface: CellSurface,
    smooth: np.ndarray,
    color: np.ndarray,
    pixels: np.ndarray,
    settings: FuseSettings,
    normal: np.ndarray,
) -> np.ndarray:
    """(C,) int64 region of each triangle, joined across ``smooth`` (E,) sides; arguments as of `regions`."""
    a, b = surface.pairs[smooth].T
    length = np.maximum(surface.border[smooth], 1e-9)
    known = (pixels[a] > 0) & (pixels[b] > 0)
    jump = np.where(known[:, None], color[a] - color[b], 0.0)
    doubt = np.where(known, _NOISE**2 * (1 / np.maximum(pixels[a], 1e-9) + 1 / np.maximum(pixels[b], 1e-9)), 0.0)
    region = np.arange(len(surface))
    turns = np.cos(np.radians(settings.crease))
    while True:
        low, high = np.minimum(region[a], region[b]), np.maximum(region[a], region[b])
        turn = np.where(region[a] < region[b], 1.0, -1.0)
        key = low.astype(np.int64) << 32 | high
        pairs, place = np.unique(key, return_inverse=True)
        place = place.reshape(-1)
        total = np.bincount(place, length)
        known_length = np.bincount(place, length * known)
        means = [np.bincount(place, length * turn * jump[:, k]) / np.maximum(known_length, 1e-9) for k in range(3)]
        # of a mean over the border, weighted by length; colours that no view tells are taken for alike
        noise = np.sqrt(np.bincount(place, length**2 * doubt)) / np.maximum(known_length, 1e-9)
        first, second = pairs >> 32, pairs & 0xFFFFFFFF
        off, alike = _as_a_whole(region, first, second, color, pixels, surface.area[:, None] * normal)
        cost = np.maximum(np.linalg.norm(means, axis=0) - noise, off)
        usable = (first != second) & (cost < settings.color) & (alike > turns)
        if not usable.any():
            return region
        # the best neighbour of each region: the least jump and turn, then the longest border, then the first pair
        cost = cost / settings.color + (1 - alike) / (1 - turns)
        first, second, cost, total = first[usable], second[usable], cost[usable], total[usable]
        rank = np.empty(len(cost), np.int64)
        rank[np.lexsort((-total, cost))] = np.arange(len(cost))
        best = np.full(len(surface), len(rank), np.int64)
        np.minimum.at(best, first, rank)
        np.minimum.at(best, second, rank)
        chosen = np.argsort(rank)[np.unique(best[best < len(rank)])]
        region = connected_groups((first[chosen], second[chosen]), len(surface))[region]


def _as_a_whole(
    region: np.ndarray,
    first: np.ndarray,
    second: np.ndarray,
    color: np.ndarray,
    pixels: np.ndarray,
    weighted_normal: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """By how much the mean colours of pairs of regions differ beyond noise (K,), and the cosine of their turn (K,).

    Parameters
    ----------
    region
        (C,) of each triangle.
    first, second
        (K,) the pairs.
    weighted_normal
        (C, 3) normals times areas.
    """
    count = int(region.max(initial=0)) + 1
    seen = np.bincount(region, pixels, count)
    mean = np.stack([np.bincount(region, pixels * values, count) for values in color.T], axis=1)
    mean /= np.maximum(seen, 1e-9)[:, None]
    facing = np.stack([np.bincount(region, values, count) for values in weighted_normal.T], axis=1)
    facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-30)
    noise = _NOISE * np.sqrt(1 / np.maximum(seen[first], 1e-9) + 1 / np.maximum(seen[second], 1e-9))
    known = (seen[first] > 0) & (seen[second] > 0)
    off = np.where(known, np.linalg.norm(mean[first] - mean[second], axis=1) - noise, 0.0)
    return off, (facing[first] * facing[second]).sum(axis=1)
