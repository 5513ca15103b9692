"""Depth maps completed by planes: where a view's picture is bare, the plane of what lies beside it goes on."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.progress import progress
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.borrowed_depth import borrowed
from fipt.stages.geometry.closing import closed
from fipt.stages.geometry.depth_views import DepthNoise, DepthView, pixels_of
from fipt.stages.geometry.other_views import OtherViews
from fipt.stages.geometry.photo_consistency import Radiances
from fipt.stages.geometry.possible_planes import PossiblePlanes, alike, probes_of
from fipt.stages.geometry.room_box import UNEVENNESS, RoomBox, find_box
from fipt.stages.geometry.room_planes import WITHIN, RoomPlanes, find_room_planes
from fipt.stages.geometry.superpixels import Superpixels, superpixels

_SUPPORTED = 0.6
"""Share of a superpixel's known pixels that must lie on a plane."""
_DOUBTED = 3.0
"""Deviations of doubtful depth, in those of the rest (see `_WORSE_VARIANCE`)."""
_DOUBTED_SHARE = 0.4
"""Share of a superpixel's known pixels, doubtful ones too, that must lie on a face inside the room for it to take that:
by chance one in fifty does."""
_BARE = 3
"""Known pixels below which a superpixel may take a plane that they do not tell."""
_BARRIER = float(np.log(2.0))
"""Contrast that no plane crosses: what is so much brighter than what lies beside it may emit, and be a thing of its
own (`fipt.meshing.radiance_edges.JUMP`)."""
_STEP = 0.05
"""Cost of a step between superpixels without contrast, in log radiance: a near plane is likelier than a far one."""
_TEXTURED, _BESIDE = 0.5, 0.1
"""Confidence of a completed pixel in units of the view's median: with own known pixels on the plane, and without."""
_WORSE_VARIANCE = 9.0
"""Factor on the variance of depth of little confidence: its noise is at least three times that of the rest."""
_EVERY = 4
"""Pixels along a row and a column of which one is carried into other views: a superpixel gets some."""
_PIXELS = 60_000
"""Known pixels of a view that are held against the planes at once."""


@dataclass(frozen=True)
class Completed:
    """A view, completed.

    Attributes
    ----------
    view
        With its depth map completed, and pixels near planes put onto them.
    measured
        (H, W) bool: pixels whose depth is the view's own.
    closed
        (H, W) bool: pixels that show a wall of the room's box for want of anything else, or nothing.
    """

    view: DepthView
    measured: np.ndarray
    closed: np.ndarray


@dataclass(frozen=True)
class Completion:
    """All views completed, the planes that they show, and the room's box."""

    views: list[Completed]
    planes: RoomPlanes
    box: RoomBox


def complete(views: Sequence[DepthView], noise: DepthNoise) -> "Completion":
    """Find the room's planes on confident depth, and complete the depth maps of all views by them.

    A superpixel whose known pixels lie on a plane takes it; else a face inside the room that many of them lie on, be
    they doubtful. From there planes along the room's directions go on to bare superpixels, along the least contrast
    first, where they stay in the room's box and other views neither see through them nor show another radiance there;
    and once more from what other views found. Depth that radiance contradicts, or that is borrowed over an edge, has
    little confidence, too.
    Depth of little confidence counts for nothing else, and stays where no plane tells another. Pixels of which then
    nothing is known show the nearest wall of the room that no other view sees through.
    """
    confident = [view.confident(noise.confident) for view in views]
    pieces = [superpixels(view.radiance) for view in views]
    planes = find_room_planes(confident, pieces, noise.at_1m)
    box = find_box(views, planes.directions)
    planes = planes.with_faces(box.faces, UNEVENNESS)
    slopes, straight = [planes.slopes(view) for view in confident], planes.axis >= 0
    lent = [borrowed(view, piece) for view, piece in zip(confident, pieces, strict=True)]
    confident, doubtful = ([v.without(m) for v, m in zip(some, lent, strict=True)] for some in (confident, views))
    possible = _possible(confident, pieces, slopes, box, noise.at_1m)
    confident, others = [each.view for each in possible], possible[0].others
    own, labels, faces = [], [], np.append(np.flatnonzero(planes.among(box.inner, UNEVENNESS)), -1)
    for number, (view, piece) in enumerate(zip(confident, pieces, strict=True)):
        label, known = _supported(view, piece, slopes[number], noise.at_1m)
        own.append(label >= 0)
        doubted = slopes[number][faces[:-1]], _DOUBTED * noise.at_1m, _DOUBTED_SHARE
        face = _uncontradicted(faces[_supported(doubtful[number], piece, *doubted)[0]], possible[number].alike)
        label = np.where(label >= 0, label, face)
        labels.append(_spread(piece, label, known, straight, possible[number]))
    carried = _carried(confident, pieces, slopes, labels, straight)
    result = []
    for number, (view, piece) in enumerate(zip(confident, pieces, strict=True)):
        bare = np.bincount(piece.label[view.map.known], minlength=piece.count) < _BARE
        label = labels[number].copy()
        for k in np.flatnonzero((label < 0) & bare & (carried[number] >= 0)):
            if possible[number](int(k), int(carried[number][k])):
                label[k] = carried[number][k]
        label = _spread(piece, label, np.where(bare, 0, _BARE), straight, possible[number])
        done = _filled(view, piece, slopes[number], label, own[number], planes, noise.at_1m)
        done = _with_doubtful(done, views[number])
        known = done.view.map.known
        result.append(Completed(closed(done.view, number, others, box, noise.at_1m), done.measured, ~known))
    return Completion(result, planes, box)


def _possible(
    views: Sequence[DepthView], pieces: Sequence[Superpixels], slopes: Sequence[np.ndarray], box: RoomBox, noise: float
) -> list[PossiblePlanes]:
    """What planes may be in each view; its depth is gone where other views' radiance contradicts it."""
    radiances, probes = Radiances.of(views), [probes_of(piece) for piece in pieces]
    like, kept = [], []
    with progress("planes against radiance", len(views), " views") as bar:
        for i, (view, piece) in enumerate(zip(views, pieces, strict=True)):
            like.append(alike(radiances, i, slopes[i], probes[i], box))
            label, _ = _supported(view, piece, slopes[i], noise)
            kept.append(view.without((_uncontradicted(label, like[i]) < label)[piece.label]))
            bar.advance(1, view.camera.name)
    others = OtherViews.of(kept)
    return [PossiblePlanes(i, kept[i], slopes[i], probes[i], like[i], others, box, noise) for i in range(len(kept))]


def _uncontradicted(label: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Planes of superpixels, -1 where there is none, or ``like`` (S, P) speaks against it."""
    some = np.flatnonzero(label >= 0)
    result = np.full(len(label), -1)
    result[some] = np.where(like[some, label[some]], label[some], -1)
    return result


def _carried(
    views: Sequence[DepthView],
    pieces: Sequence[Superpixels],
    slopes: Sequence[np.ndarray],
    labels: Sequence[np.ndarray],
    straight: np.ndarray,
) -> list[np.ndarray]:
    """Plane of each superpixel of each view that most of what other views see there lies on, -1 for none."""
    points, planes = [np.zeros((0, 3))], [np.zeros(0, np.int64)]
    for view, piece, slope, label in zip(views, pieces, slopes, labels, strict=True):
        plane = label[piece.label[::_EVERY, ::_EVERY]]
        on = (plane >= 0) & np.append(straight, False)[plane]
        rays = view.rays[::_EVERY, ::_EVERY][on]
        points.append(view.camera.center + rays / (rays * slope[plane[on]]).sum(axis=-1, keepdims=True))
        planes.append(plane[on].astype(np.int64))
    place, plane = np.concatenate(points), np.concatenate(planes)
    result = []
    for view, piece, slope in zip(views, pieces, slopes, strict=True):
        row, column, _, inside = pixels_of(view.camera, place)
        inside &= (slope[plane] ** 2).sum(axis=1) > 0  # planes that face the view
        votes = np.zeros((piece.count, len(straight) + 1), np.int32)
        np.add.at(votes, (piece.label[row[inside], column[inside]], plane[inside]), 1)
        result.append(np.where(votes.max(axis=1) > 0, votes.argmax(axis=1), -1))
    return result


def _with_doubtful(done: Completed, view: DepthView) -> Completed:
    """Add depth of little confidence where there is no other; what lies before it is free, too."""
    add = view.map.known & ~done.view.map.known
    low = view.map.confidence / _WORSE_VARIANCE
    found = DepthMap(
        np.where(add, view.map.depth, done.view.map.depth),
        np.where(add, low, done.view.map.confidence),
        np.where(add[..., None], view.map.normal, done.view.map.normal),
    )
    return Completed(view.with_map(found), done.measured, done.closed)


def _supported(
    view: DepthView, pieces: Superpixels, slopes: np.ndarray, noise: float, least: float = _SUPPORTED
) -> tuple[np.ndarray, np.ndarray]:
    """Plane of each superpixel that its known pixels lie on, -1 for none, and how many known pixels it has.

    ``least`` is the share of them that must lie there.
    """
    row, column = np.nonzero(view.map.known)
    step = max(1, len(row) // _PIXELS)
    row, column = row[::step], column[::step]
    label = pieces.label[row, column].astype(np.int64)
    count = np.bincount(label, minlength=pieces.count)
    if len(slopes) == 0:
        return np.full(pieces.count, -1), count * step
    off = view.rays[row, column] @ slopes.T - 1 / view.map.depth[row, column, None]
    near = np.abs(off) < WITHIN * noise
    inside, spread = np.zeros((pieces.count, len(slopes))), np.zeros((pieces.count, len(slopes)))
    np.add.at(inside, label, near)
    np.add.at(spread, label, np.minimum((off / noise) ** 2, WITHIN**2))
    share = inside / np.maximum(count, 1)[:, None]
    spread = np.where(share >= least, spread, np.inf)
    best = spread.argmin(axis=1)
    good = np.isfinite(spread[np.arange(len(best)), best]) & (count * step >= _BARE)
    return np.where(good, best, -1), count * step


def _spread(
    pieces: Superpixels,
    own: np.ndarray,
    known: np.ndarray,
    straight: np.ndarray,
    possible: PossiblePlanes,
) -> np.ndarray:
    """Plane of each superpixel after those of superpixels with support went on to bare ones; -1 for none.

    ``straight`` planes may go on, where they are ``possible``.
    """
    label = own.copy()
    queue: list[tuple[float, int, int]] = []

    def offer(cost: float, piece: int) -> None:
        for beside, contrast in pieces.neighbours[piece]:
            if label[beside] < 0 and known[beside] < _BARE and contrast < _BARRIER and straight[label[piece]]:
                heapq.heappush(queue, (cost + _STEP + contrast, beside, int(label[piece])))

    for piece in np.flatnonzero(own >= 0):
        offer(0.0, int(piece))
    refused: set[tuple[int, int]] = set()
    while queue:
        cost, piece, plane = heapq.heappop(queue)
        if label[piece] >= 0 or (piece, plane) in refused:
            continue
        if not possible(piece, plane):
            refused.add((piece, plane))
            continue
        label[piece] = plane
        offer(cost, piece)
    return label


def _filled(
    view: DepthView,
    pieces: Superpixels,
    slopes: np.ndarray,
    label: np.ndarray,
    own: np.ndarray,
    planes: RoomPlanes,
    noise: float,
) -> Completed:
    """The view with known pixels put onto the planes of their superpixels, and unknown ones filled."""
    found = view.map
    plane = label[pieces.label]
    slope = slopes[plane] if len(planes) else np.zeros((*plane.shape, 3))
    q = np.where(plane >= 0, (view.rays * slope).sum(axis=-1), 0.0)
    depth = np.where(q > 0, 1 / np.where(q > 0, q, 1.0), 0.0)
    near = found.known & (q > 0) & (np.abs(q - 1 / np.where(found.known, found.depth, 1.0)) < WITHIN * noise)
    bare = ~found.known & (q > 0)
    onto = near | bare
    usual = float(np.median(found.confidence[found.known])) if found.known.any() else 1.0
    confidence = np.where(bare, np.where(own[pieces.label], _TEXTURED, _BESIDE) * usual, found.confidence)
    normal = np.where(onto[..., None], planes.normal[plane] if len(planes) else 0.0, found.normal)
    complete = DepthMap(
        np.where(onto, depth, found.depth).astype(np.float32), confidence.astype(np.float32), normal.astype(np.float32)
    )
    return Completed(view.with_map(complete), found.known, np.zeros_like(found.known))
