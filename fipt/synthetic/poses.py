"""Where the cameras stand: the paper's capture (supplement, B.1), sampled in any room.

Several places in its open space, 0.5-2.5 m high, turned towards the room's centre, then by up to 60 degrees of yaw
and 45 of pitch, with little roll. Of several such candidates the one that shows most unseen surface is kept.

Open space is what is connected: of places drawn in the interior box that have clearance, see surface in most
directions and have ground below, the largest group that see one another. So cameras stand neither in a wardrobe, nor
between a wall and the house's outer wall, nor outdoors.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import KDTree

from fipt.errors import FiptError
from fipt.groups import connected_groups
from fipt.render.directions import all_around
from fipt.scene.cameras import Camera
from fipt.scene.mesh import points_of
from fipt.synthetic.room import SyntheticRoom
from fipt.synthetic.settings import SynthesizeSettings

Intersect = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""(N, 3) origins, (N, 3) unit directions -> (N,) distances in metres, (N,) triangles or -1."""

CLEARANCE = 0.3
"""Nearest surface to a camera, metres."""

HEIGHTS = (0.5, 2.5)
"""Lowest and highest camera over the floor, metres; the ceiling's clearance caps the latter."""

_EYES = 1.1
"""Height over the floor that the cameras turn to before they are turned away at random, metres."""

_EYE_HEIGHT = 1.5
"""Height over the floor of cameras that walk, metres."""
_DRAWN_IN = np.linspace(0.85, 0.15, 15)
"""Shares of the way from the room's middle to its walls at which they try to stand, in order."""

_YAW, _PITCH, _ROLL = 60.0, 45.0, 1.5
_STEEPEST = (-50.0, 20.0)
_CANDIDATES = 12
_SCAN = (32, 24)
_MEDIAN_DEPTH = 1.3
"""Least median distance of what a view shows, metres; in small rooms `_DEPTH_SHARE` of the floor's diagonal."""
_DEPTH_SHARE = 0.3
_NEAR_SHARE = 0.03
_COVERED = 0.9
_LARGEST = 4.0
"""A triangle counts as at most so many square metres: a landscape behind a window is not what a room is."""

_PLACES, _DRAWN = 256, 8192
"""Places by which open space is known, and how many are drawn at most to find them."""
_AROUND = 128
"""Directions in which a place is looked at."""
_ESCAPING = 0.5
"""Largest share of these that may meet nothing: more is outdoors."""
_SEEN_PLACES = 0.05
"""Share of the places of open space that another place in it sees."""
_TRIES = 2000
_SPACING = 0.04
_EDGE = 3.0
"""Pixels around a view in which what no view shall show must not lie either."""
_LONGEST_EDGE = 3.0
_JUDGED = 20_000
"""Points of the surface by which coverage is measured."""


def sample_cameras(space: OpenSpace, settings: SynthesizeSettings) -> list[Camera]:
    """Choose the cameras ``train_000, ..., val_000, ...`` of a room.

    Parameters
    ----------
    space
        Where they may stand.
    settings
        Numbers of views, image size, field of view and seed.

    Returns
    -------
    list of Camera
        A longer list begins with the cameras of a shorter one of the same split, unless they walk.
    """
    if settings.cameras == "walk":
        return _walk(space, settings)
    weight = np.sqrt(np.minimum(space.room.mesh.areas, _LARGEST))
    seen = np.zeros(len(weight), int)
    train: list[Camera] = []
    for index in range(settings.train_views):
        options = _candidates(f"train_{index:03d}", space, settings)
        # A triangle counts half as much for every view that shows it already.
        gains = [(weight[shown] * 0.5 ** seen[shown]).sum() for _, shown in options]
        camera, shown = options[int(np.argmax(gains))]
        seen[shown] += 1
        train.append(camera)

    covered = np.zeros(len(weight), bool)
    for camera in train:
        covered[scan(camera, space.intersect, (96, 72))[1]] = True
    val: list[Camera] = []
    for index in range(settings.val_views):
        options = _candidates(f"val_{index:03d}", space, settings)
        shares = [weight[shown] @ covered[shown] / max(weight[shown].sum(), 1e-9) for _, shown in options]
        enough = np.flatnonzero(np.array(shares) >= _COVERED)
        val.append(options[enough[0] if len(enough) else int(np.argmax(shares))][0])
    return train + val


def _walk(space: OpenSpace, settings: SynthesizeSettings) -> list[Camera]:
    """Stand once around the room in equal steps, looking across its middle: neighbours show much of the same.

    The way is an ellipse in the interior, drawn in where something stands; held-out views lie evenly among the others.
    """
    counts = {"train": settings.train_views, "val": settings.val_views}
    places = [((k + 0.5) / count, split, k) for split, count in counts.items() for k in range(count)]
    half = (space.high - space.low) / 2
    eyes = min(space.low[1] - HEIGHTS[0] + _EYE_HEIGHT, space.high[1])
    cameras = {}
    for number, (_, split, k) in enumerate(sorted(places)):
        angle = 2 * np.pi * number / len(places)
        way = np.array([half[0] * np.cos(angle), 0, half[2] * np.sin(angle)])
        middle = np.array([space.target[0], eyes, space.target[2]])
        free = (place for place in (middle + share * way for share in _DRAWN_IN) if space.holds(place))
        name = f"{split}_{k:03d}"
        center = next(free, None)
        if center is None:
            raise FiptError(
                f"no free space for view {name} between the room's middle and its walls",
                "let the cameras stand anywhere (synthesize.cameras: scattered)",
            )
        # From the middle on outwards: whoever stands in the very middle looks across it all the same.
        yaw = np.arctan2(way[0], way[2])
        level = np.arctan2(space.target[1] - eyes, np.linalg.norm(half[[0, 2]]))
        cameras[name] = _camera(name, center, _turn(1, yaw) @ _turn(0, level), settings)
    found = [cameras[f"{split}_{k:03d}"] for split, count in counts.items() for k in range(count)]
    if any(map(space.shows_unseen, found)):
        raise FiptError(
            f"no view may show {', '.join(space.room.unseen)}; cameras that walk do",
            "let the cameras stand anywhere (synthesize.cameras: scattered)",
        )
    return found


class OpenSpace:
    """Where in a room a camera may stand.

    Parameters
    ----------
    room
        The room.
    first_hits
        Traces rays against its mesh.
    seed
        Of the places that are tried.

    Attributes
    ----------
    low, high
        (3,) corners of the box of possible places, metres.
    target
        (3,) what cameras turn to.
    depth
        Least median distance of what a view shows, metres.
    places
        (N, 3) float32 places in open space.

    Raises
    ------
    FiptError
        If there is none.
    """

    def __init__(self, room: SyntheticRoom, intersect: Intersect, seed: int) -> None:
        bottom, top = room.box
        size = top - bottom
        self.room, self.intersect, self.seed = room, intersect, seed
        self.low = bottom + np.array([CLEARANCE, HEIGHTS[0], CLEARANCE])
        self.high = top - CLEARANCE
        self.high[1] = min(bottom[1] + HEIGHTS[1], top[1] - CLEARANCE)
        self.target = (bottom + top) / 2
        self.target[1] = bottom[1] + min(_EYES, size[1] / 2)
        self.depth = min(_MEDIAN_DEPTH, _DEPTH_SHARE * float(np.hypot(size[0], size[2])))
        self._around = all_around(_AROUND)
        measured = " x ".join(f"{side:.2f}" for side in size)
        if (self.low >= self.high).any():
            raise FiptError(
                f"the room's interior is {measured} m: too small for cameras {CLEARANCE} m off every surface and "
                f"{HEIGHTS[0]} m over the floor",
                "check the unit of the scene file (synthesize.scene.scale)",
            )
        self._surface = KDTree(surface_points(room, seed))
        self._unseen = _unseen_points(room, seed)
        drawn = np.random.default_rng([seed, 3]).uniform(self.low, self.high, (_DRAWN, 3))
        free = drawn[self._surface.query(drawn)[0] >= CLEARANCE][:_PLACES]
        remedy = "check the scene file's unit (synthesize.scene.scale), and that it is a room with floor and walls"
        if len(free) < 2:
            raise FiptError(
                f"no free space for cameras: of {_DRAWN} places in the interior of {measured} m, {len(free)} are "
                f"{CLEARANCE} m off every surface",
                remedy,
            )
        enclosed = free[self._enclosed(free)]
        if len(enclosed) < 2:
            raise FiptError(
                f"no place in the interior of {measured} m is indoors: from each of {len(free)} free places, most "
                "directions or the one straight down meet nothing",
                remedy,
            )
        self.places = _largest_group(enclosed.astype(np.float32), intersect)

    def holds(self, place: np.ndarray) -> bool:
        """Whether a camera may stand at a place (3,) between `low` and `high`."""
        if self._surface.query(place)[0] < CLEARANCE or not self._enclosed(place[None])[0]:
            return False
        seen = visible(np.broadcast_to(np.float32(place), self.places.shape), self.places, self.intersect)
        return bool(seen.mean() >= _SEEN_PLACES)

    def shows_unseen(self, camera: Camera) -> bool:
        """Whether a view shows a part that no view shall show, or nearly so."""
        if not len(self._unseen):
            return False
        image, depth = camera.project(self._unseen)
        size = (camera.width, camera.height)
        near = (depth > 0) & (image >= -_EDGE).all(axis=1) & (image < np.add(size, _EDGE)).all(axis=1)
        points = self._unseen[near]
        eyes = np.broadcast_to(camera.center.astype(np.float32), points.shape)
        return bool(visible(eyes, points, self.intersect).any())

    def _enclosed(self, places: np.ndarray) -> np.ndarray:
        """(N,) bool: whether (N, 3) places have ground below and surface in most directions."""
        directions = np.concatenate([self._around, np.array([[0, -1, 0]], np.float32)])
        origins = np.repeat(places.astype(np.float32), len(directions), axis=0)
        _, triangle = self.intersect(origins, np.tile(directions, (len(places), 1)))
        meets = (triangle >= 0).reshape(len(places), -1)
        return (meets[:, :-1].mean(axis=1) >= 1 - _ESCAPING) & meets[:, -1]


def _largest_group(places: np.ndarray, intersect: Intersect) -> np.ndarray:
    """Return those of (N, 3) places that form the largest group in which each sees another."""
    first, second = np.triu_indices(len(places), 1)
    seen = visible(places[first], places[second], intersect)
    pairs = (first[seen], second[seen])
    group = connected_groups(pairs, len(places))
    return places[group == np.bincount(group).argmax()]


def visible(eyes: np.ndarray, points: np.ndarray, intersect: Intersect) -> np.ndarray:
    """(N,) bool: whether nothing is between (N, 3) eyes and (N, 3) points; a point may lie on a surface."""
    if len(points) == 0:  # Mitsuba cannot trace no rays
        return np.zeros(0, bool)
    way = (points - eyes).astype(np.float64)
    length = np.linalg.norm(way, axis=1)
    directions = (way / np.maximum(length, 1e-9)[:, None]).astype(np.float32)
    distance, _ = intersect(eyes.astype(np.float32), directions)
    return distance > length * (1 - 1e-3) - 1e-3


def surface_points(room: SyntheticRoom, seed: int) -> np.ndarray:
    """(N, 3) points at random on the surfaces in and around the interior, at most about `_SPACING` metres apart."""
    corners, areas = _nearby(room)
    counts = np.ceil(areas / _SPACING**2).astype(int)
    return _on(corners, counts, np.random.default_rng([seed, 2]))


def _unseen_points(room: SyntheticRoom, seed: int) -> np.ndarray:
    """(N, 3) float32 points at random on the parts that no view shows, about `_SPACING` metres apart."""
    ids = [index + 1 for index, name in enumerate(room.parts) if name in room.unseen]
    chosen = np.isin(room.part, ids)
    counts = np.ceil(room.mesh.areas[chosen] / _SPACING**2).astype(int)
    return _on(room.mesh.corners[chosen], counts, np.random.default_rng([seed, 5])).astype(np.float32)


def _on(corners: np.ndarray, counts: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) random points, so many on each of (T, 3, 3) triangles."""
    corners = np.repeat(corners, counts, axis=0)
    return points_of(corners, *rng.random((2, len(corners))))


def _nearby(room: SyntheticRoom) -> tuple[np.ndarray, np.ndarray]:
    """Triangles (T, 3, 3) in and around the interior, and their areas (T,); those with long edges in pieces."""
    corners, done = room.mesh.corners.astype(np.float64), []
    low, high = room.box + np.array([[-CLEARANCE], [CLEARANCE]])
    while len(corners):
        corners = corners[((corners.min(axis=1) <= high) & (corners.max(axis=1) >= low)).all(axis=1)]
        long = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) > _LONGEST_EDGE
        done.append(corners[~long])
        a, b, c = np.moveaxis(corners[long], 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        corners = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    corners = np.concatenate(done)
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, 0.5 * np.linalg.norm(sides, axis=1)


def coverage(space: OpenSpace, cameras: Sequence[Camera]) -> dict[str, float]:
    """Measure how much of the surface that is visible from open space the training views show.

    Returns
    -------
    dict
        ``points``: places on the surface, evenly by area, that open space sees; ``seen`` and ``seen_twice``: the
        shares of them that at least one and at least two training views show.
    """
    rng = np.random.default_rng([space.seed, 4])
    corners, areas = _nearby(space.room)
    points = _on(corners, rng.multinomial(_JUDGED, areas / areas.sum()), rng).astype(np.float32)
    shown = np.zeros(len(points), bool)
    for place in space.places[:: max(len(space.places) // 32, 1)]:
        hidden = np.flatnonzero(~shown)
        shown[hidden] = visible(np.broadcast_to(place, (len(hidden), 3)), points[hidden], space.intersect)
    points = points[shown]
    views = np.zeros(len(points), int)
    for camera in cameras:
        if camera.split == "train":
            image, depth = camera.project(points)
            inside = (depth > 0) & (image >= 0).all(axis=1) & (image < (camera.width, camera.height)).all(axis=1)
            near = np.flatnonzero(inside)
            eyes = np.broadcast_to(camera.center.astype(np.float32), (len(near), 3))
            views[near] += visible(eyes, points[near], space.intersect)
    shares = {"seen": float((views >= 1).mean()), "seen_twice": float((views >= 2).mean())}
    return {"points": len(points)} | {key: round(share, 4) for key, share in shares.items()}


def scan(camera: Camera, intersect: Intersect, grid: tuple[int, int] = _SCAN) -> tuple[np.ndarray, np.ndarray]:
    """Trace a grid of a view's rays; return (N,) distances and the distinct triangles hit."""
    columns = (np.arange(grid[0]) + 0.5) / grid[0] * camera.width
    rows = (np.arange(grid[1]) + 0.5) / grid[1] * camera.height
    directions = camera.directions(*np.meshgrid(columns, rows)).reshape(-1, 3)
    origins = np.broadcast_to(camera.center.astype(np.float32), directions.shape)
    distance, triangle = intersect(origins, directions)
    return distance, np.unique(triangle[triangle >= 0])


def _candidates(name: str, space: OpenSpace, settings: SynthesizeSettings) -> list[tuple[Camera, np.ndarray]]:
    """Draw acceptable cameras of one name, each with the triangles it shows."""
    # The name is the key of the random numbers: no view depends on how many others there are.
    rng = np.random.default_rng([settings.seed, zlib.crc32(name.encode())])
    options = []
    for _ in range(50 * _CANDIDATES):
        camera = _draw(name, rng, space, settings)
        distance, shown = scan(camera, space.intersect)
        staring = np.median(distance) < space.depth
        blocked = (distance < 1.5 * CLEARANCE).mean() > _NEAR_SHARE
        if not staring and not blocked and not space.shows_unseen(camera):
            options.append((camera, shown))
        if len(options) == _CANDIDATES:
            break
    if not options:
        raise FiptError(
            f"no place found for view {name}: wherever the camera stands in open space, half of what it sees is nearer "
            f"than {space.depth:.1f} m",
            "choose another seed or a wider field of view",
        )
    return options


def _draw(name: str, rng: np.random.Generator, space: OpenSpace, settings: SynthesizeSettings) -> Camera:
    """Draw one camera in open space."""
    for _ in range(_TRIES):
        center = rng.uniform(space.low, space.high)
        if space.holds(center):
            break
    else:
        raise FiptError(
            f"no free space for view {name} in {_TRIES} tries",
            "check the scene file's unit (synthesize.scene.scale)",
        )
    toward = space.target - center
    yaw = np.arctan2(-toward[0], -toward[2]) + np.radians(rng.uniform(-_YAW, _YAW))
    level = np.arctan2(toward[1], np.hypot(toward[0], toward[2]))
    while True:
        pitch = level + np.radians(rng.uniform(-_PITCH, _PITCH))
        if _STEEPEST[0] <= np.degrees(pitch) <= _STEEPEST[1]:
            break
        level *= 0.8  # above or below the centre itself the drawn range may miss every allowed pitch
    roll = np.radians(rng.normal(0.0, _ROLL))
    return _camera(name, center, _turn(1, yaw) @ _turn(0, pitch) @ _turn(2, roll), settings)


def _camera(name: str, center: np.ndarray, rotation: np.ndarray, settings: SynthesizeSettings) -> Camera:
    focal = settings.width / 2 / np.tan(np.radians(settings.fov) / 2)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, center
    return Camera(
        name, name.partition("_")[0], settings.width, settings.height,
        focal, focal, settings.width / 2, settings.height / 2, pose,
    )  # fmt: skip


def _turn(axis: int, angle: float) -> np.ndarray:
    """(3, 3) right-handed rotation around a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = c
    matrix[first, second], matrix[second, first] = -s, s
    return matrix
