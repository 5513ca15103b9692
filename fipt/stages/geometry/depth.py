"""Depth maps of posed views: planes swept on small pictures, refined on larger ones, and compared between views."""

import logging
from collections.abc import Callable, Iterator, Sequence
from types import ModuleType

import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.consistency import Matched, agreed
from fipt.stages.geometry.neighbours import choose_again, choose_sources
from fipt.stages.geometry.patch_match import refine
from fipt.stages.geometry.settings import DepthSettings
from fipt.stages.geometry.stereo_view import StereoView
from fipt.stages.geometry.sweep import sweep

log = logging.getLogger(__name__)

_SWEPT = 100
"""Planes are swept on pictures of at most this many columns: they need to come near the surface only."""
_PIXEL_BYTES = 120
"""Memory that a pixel of the views takes at most: planes and scores before and after a round, and depth maps."""
_COARSER = 0.5
"""Confidence of what smaller pictures tell, for each halving: their errors are so much larger."""


def check_memory(views: Sequence[StereoView], most: float) -> None:
    """Refuse views whose depth would need more than ``most`` gigabytes, before it starts."""
    needed = _PIXEL_BYTES * sum(view.light.size for view in views) / 1e9
    if needed > most:
        raise FiptError(
            f"depth of {len(views)} views needs about {needed:.2g} GB; depth.memory_gb is {most:g}",
            "give fewer or smaller views, or raise depth.memory_gb",
        )
    log.info("depth of %d views takes about %.2g GB of memory", len(views), needed)


def depth_maps(dj: ModuleType, views: Sequence[StereoView], settings: DepthSettings) -> Iterator[tuple[str, DepthMap]]:
    """Estimate the depth of every view.

    Parameters
    ----------
    dj
        Dr.Jit's module of the device in use.

    Yields
    ------
    name, map
        In the order of the views.

    Raises
    ------
    FiptError
        If fewer than three views overlap, all stand in one place, or no pixel of any view has a depth.
    """
    cameras = [view.camera for view in views]
    by_cameras = choose_sources(cameras, settings.sources, settings.nearest)
    sources = by_cameras
    levels = [list(views)]
    while max(view.camera.width for view in levels[-1]) > _SWEPT:
        levels.append([view.halved() for view in levels[-1]])
    levels.reverse()

    def swept(view: StereoView, others: list[StereoView], _: int) -> tuple[np.ndarray, np.ndarray]:
        return sweep(view, others, settings.nearest)

    found = _each("plane sweep", levels[0], sources, swept)
    maps: list[DepthMap] = []
    for number, level in enumerate(levels):
        if number:
            found = [_enlarged(match, view) for match, view in zip(found, level, strict=True)]
            maps = [_enlarged_map(depth_map, view) for depth_map, view in zip(maps, level, strict=True)]
        starts = [match.planes for match in found]

        def refined(
            view: StereoView, others: list[StereoView], i: int, starts: list[np.ndarray] = starts, number: int = number
        ) -> tuple[np.ndarray, np.ndarray]:
            rounds = settings.rounds if number == 0 else settings.later_rounds
            return refine(dj, view, others, starts[i], rounds, settings.nearest, settings.seed + 1000 * number + i)

        width = level[0].camera.width
        found = _each(f"depth at {width} columns", level, sources, refined)
        least = settings.consistent_views
        own = [agreed(found, sources, i, least, settings.correlation) for i in range(len(views))]
        maps = [_completed(*pair) for pair in zip(own, maps, strict=True)] if number else own
        if number < len(levels) - 1:
            sources = choose_again(cameras, settings.sources, [made.depth for made in maps], by_cameras)
    if not any(made.known.any() for made in maps):
        raise FiptError(
            f"no texture was matched: in none of {len(views)} views did other views confirm the depth of a pixel",
            "check the poses, photograph surface with texture, or give a mesh",
        )
    for view, made in zip(views, maps, strict=True):
        yield view.camera.name, made


def _each(
    label: str,
    views: Sequence[StereoView],
    sources: Sequence[Sequence[int]],
    match: Callable[[StereoView, list[StereoView], int], tuple[np.ndarray, np.ndarray]],
) -> list[Matched]:
    """Match every view with its sources; a view without any keeps no depth."""
    found = []
    with progress(label, len(views), " views") as bar:
        for i, view in enumerate(views):
            others = [views[j] for j in sources[i]]
            if others:
                found.append(Matched(view, *match(view, others, i)))
            else:
                empty = np.zeros((3, *view.light.shape), np.float32)
                found.append(Matched(view, empty, np.full(view.light.shape, -1.0, np.float32)))
            bar.advance(1, view.camera.name)
    return found


def _enlarged(match: Matched, view: StereoView) -> Matched:
    """Planes of a view from those at half its size: every pixel takes the plane of the one that covers it."""
    rows, columns = view.light.shape
    small_rows, small_columns = match.score.shape
    v, u = np.arange(rows), np.arange(columns)
    row, column = np.minimum(v // 2, small_rows - 1), np.minimum(u // 2, small_columns - 1)
    q, along_u, along_v = (part[row[:, None], column] for part in match.planes)
    q = q + along_u * ((u - 0.5) / 2 - column) + along_v * ((v - 0.5) / 2 - row)[:, None]
    planes = np.stack([q, along_u / 2, along_v / 2]).astype(np.float32)
    return Matched(view, planes, match.score[row[:, None], column])


def _enlarged_map(made: DepthMap, view: StereoView) -> DepthMap:
    """Depth map of a view from that at half its size: every pixel continues the surface of the one that covers it."""
    rows, columns = view.light.shape
    row = np.minimum(np.arange(rows) // 2, made.depth.shape[0] - 1)[:, None]
    column = np.minimum(np.arange(columns) // 2, made.depth.shape[1] - 1)
    depth, normal = made.depth[row, column], made.normal[row, column]
    # the covering pixel's centre is half a pixel away along both axes
    centre = np.stack([2 * column + 0.5 + 0 * row, 2 * row + 0.5 + 0 * column, np.ones((rows, columns))], axis=-1)
    covering = centre @ np.linalg.inv(view.intrinsics).T
    inner = normal @ view.rotation.T
    ratio = (inner * covering).sum(-1) / np.minimum((inner * view.rays).sum(-1), -1e-6)
    known = (depth > 0) & (ratio > 0.5) & (ratio < 2.0)
    return DepthMap(
        np.where(known, depth * ratio, 0).astype(np.float32),
        np.where(known, made.confidence[row, column] * _COARSER, 0).astype(np.float32),
        np.where(known[..., None], normal, 0).astype(np.float32),
    )


def _completed(own: DepthMap, coarse: DepthMap) -> DepthMap:
    """A depth map, and what smaller pictures told where it knows nothing: there, windows hold more of the surface."""
    known = own.known
    return DepthMap(
        np.where(known, own.depth, coarse.depth),
        np.where(known, own.confidence, coarse.confidence),
        np.where(known[..., None], own.normal, coarse.normal),
    )
