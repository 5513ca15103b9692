"""What varies slowly within a part is light that was traced wrongly; what varies fast is texture."""

import numpy as np

from fipt.stages.fit.light_errors import RESOLUTION, LightErrors, cells_of, measured

CENTER, SIDE = np.array([2.0, 2.0, 2.0]), 4.0
VOXEL = SIDE / RESOLUTION


def wall(segment: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A point in each voxel of a wall of 3 m x 2 m, its part, and how far it is along, 0 to 1."""
    x, y = np.meshgrid(np.arange(0.5, 3, VOXEL), np.arange(1, 3, VOXEL), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 1.0)], axis=1)
    return points, np.full(len(points), segment), (x.ravel() - 0.5) / 2.5


def errors(points: np.ndarray, segment: np.ndarray, base: np.ndarray, use: np.ndarray | None = None) -> LightErrors:
    key, cell = cells_of(points, segment, CENTER, SIDE)
    color = np.zeros((len(key), 3))
    color[cell] = base[:, None]
    told = np.ones(len(key), bool)
    if use is not None:
        told[cell] = use
    return measured(key, color, told, CENTER, SIDE)


def test_a_wall_that_gets_brighter_towards_a_lamp_has_one_colour():
    points, segment, along = wall()
    base = 0.5 * np.exp(0.4 * along)
    factor = errors(points, segment, base).factor(points, segment)
    left = base / factor
    assert left.std() < 0.1 * base.std()
    assert abs(np.median(left) / np.median(base) - 1) < 0.02, "the level of the part stays"
    assert 0.9 < errors(points, segment, base).size / np.log(base).std() < 1.1


def test_light_may_be_missing_where_base_colours_would_be_more_than_one():
    points, segment, along = wall()
    base = 0.8 * np.exp(2 * np.maximum(along - 0.7, 0))
    assert base.max() > 1.4
    assert (base / errors(points, segment, base).factor(points, segment)).max() < 0.95


def test_texture_stays(np_rng):
    points, segment, _ = wall()
    base = np.where(np_rng.random(len(points)) < 0.5, 0.2, 0.7)
    factor = errors(points, segment, base).factor(points, segment)
    assert np.abs(np.log(factor)).max() < 0.05
    tiles = np.where((np.floor(points[:, 0] / 0.3) + np.floor(points[:, 1] / 0.3)) % 2 > 0, 0.2, 0.7)
    of_tiles = np.log(errors(points, segment, tiles).factor(points, segment)).std()
    assert of_tiles < 0.15 * np.log(tiles).std(), "tiles of 30 cm"
    stripes = np.where(np.floor(points[:, 0] / VOXEL / 7) % 2 > 0, 0.2, 0.7)
    of_stripes = np.log(errors(points, segment, stripes).factor(points, segment)).std()
    assert of_stripes < 0.2 * np.log(stripes).std(), "stripes twice as wide as the Gaussian's deviation"


def test_parts_are_judged_by_themselves_and_only_by_what_tells():
    points, one, along = wall()
    bright = 0.5 * np.exp(0.4 * along)
    both, segment = np.concatenate([points, points + np.array([0, 0, VOXEL])]), np.concatenate([one, one + 1])
    base = np.concatenate([bright, np.full(len(points), 0.1)])
    factor = errors(both, segment, base).factor(both, segment)
    assert factor[: len(points)].std() > 0.05
    np.testing.assert_allclose(factor[len(points) :], 1, atol=1e-6)
    none = errors(points, one, bright, np.zeros(len(points), bool))
    assert none.factor(points, one).tolist() == [1.0] * len(points)
    assert none.size == 0


def test_what_stands_alone_tells_nothing(np_rng):
    points, one, _ = wall()
    alone = (np.arange(len(points)) % 97 == 0) | (np.arange(len(points)) % 89 == 0)
    base = 0.5 * np.exp(0.4 * np_rng.standard_normal(alone.sum()))
    assert errors(points[alone], one[alone], base).factor(points, one).tolist() == [1.0] * len(points)


def test_a_picture_on_a_wall_keeps_its_dark_half():
    """It is smaller than what is averaged; a larger one would be a wall that a lamp lights from one side."""
    points, one, _ = wall()
    off = np.abs(points[:, :2] - [2, 2]).max(axis=1)
    for half, known in ((0.3, False), (0.9, True)):
        own = off < half
        base = np.exp((points[own, 0] - 2) / half)
        assert (len(errors(points[own], one[own], base).key) > 0) == known


def test_where_hardly_any_light_was_traced_nothing_around_changes():
    points, segment, along = wall()
    strip = np.abs(along - 0.5) < 1.5 * VOXEL / 2.5
    for base in (3e5, 0.0):
        factor = errors(points, segment, np.where(strip, base, 0.5)).factor(points, segment)
        assert np.abs(np.log(factor)).max() < 0.4
        np.testing.assert_allclose(factor[np.abs(along - 0.5) > 10 * VOXEL / 2.5], 1, atol=1e-3)


def test_between_voxels_it_is_interpolated_and_beyond_them_nothing_is_known():
    points, segment, along = wall()
    found = errors(points, segment, 0.5 * np.exp(0.4 * along))
    line = np.stack([np.linspace(1, 2.5, 1000), np.full(1000, 2.0), np.full(1000, 1.0)], axis=1)
    factor = found.factor(line, np.ones(1000, int))
    assert (np.diff(factor) > -1e-6).all()
    assert np.diff(factor).max() < 2 * np.diff(factor).mean()
    away = np.array([[2.0, 2.0, 3.0]])
    assert found.factor(away, np.array([1])).tolist() == [1.0]
    assert found.factor(line[:1], np.array([2])).tolist() == [1.0], "another part"
