"""Depth of two slanted planes with texture comes out as it is; views without parallax or overlap are refused."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.render.variant import Backend, set_variant
from fipt.scene.cameras import Camera
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.depth import depth_maps
from fipt.stages.geometry.neighbours import choose_again, choose_sources
from fipt.stages.geometry.patch_match import _matching
from fipt.stages.geometry.settings import DepthSettings
from fipt.stages.geometry.stereo_view import StereoView, noise_of, normals_of, transfer

WIDTH, HEIGHT, FOCAL = 96, 72, 80.0
PLANES = (((0.5, 0.1, 1.0), -2.4), ((-0.4, 0.2, 1.0), -2.2))
"""Normals and offsets of two planes: the nearer one is seen."""


def camera(name: str, x: float, y: float = 0.0, turn: float = 0.0) -> Camera:
    pose = np.eye(4)
    cosine, sine = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    pose[:3, :3] = [[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]
    pose[:3, 3] = x, y, 0.0
    return Camera(name, "train", WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def seen(taken: Camera) -> tuple[StereoView, np.ndarray, np.ndarray]:
    """A view of the planes, its true depth and its true normals."""
    blank = StereoView(taken, np.zeros((HEIGHT, WIDTH), np.float32), 0.0)
    rays = blank.rays @ blank.rotation  # world axes, at depth 1
    depth, normal = np.full((HEIGHT, WIDTH), np.inf), np.zeros((HEIGHT, WIDTH, 3))
    for direction, offset in PLANES:
        unit = np.array(direction) / np.linalg.norm(direction)
        away = (offset / np.linalg.norm(direction) - taken.center @ unit) / (rays @ unit)
        nearer = (away > 0) & (away < depth)
        depth[nearer], normal[nearer] = away[nearer], unit
    points = taken.center + rays * np.minimum(depth, 10.0)[..., None]
    waves = np.random.default_rng(5).normal(size=(24, 3)) * 9.0
    light = np.sin(points @ waves.T + np.arange(24)).sum(axis=-1) * 0.1
    return StereoView(taken, light.astype(np.float32), 1e-3), depth, normal


PLACES = ((0, 0), (-0.3, 0.1), (0.3, 0, 4), (0, -0.3), (0.1, 0.3))


def estimate(
    places: Sequence[tuple[float, ...]], settings: DepthSettings
) -> list[tuple[DepthMap, np.ndarray, np.ndarray]]:
    """Depth maps of views from places, with their truth."""
    import drjit

    cameras = [camera(f"v{i}", *at) for i, at in enumerate(places)]
    views = [seen(taken) for taken in cameras]
    dj = getattr(drjit, set_variant().name)
    found = depth_maps(dj, [view for view, _, _ in views], settings)
    return [(made, depth, normal) for (_, made), (_, depth, normal) in zip(found, views, strict=True)]


@pytest.fixture(scope="module")
def estimated() -> list[tuple[DepthMap, np.ndarray, np.ndarray]]:
    """Depth maps of five views; nothing is nearer than 1.3 m, and planes before that are not tried."""
    return estimate(PLACES, DepthSettings(nearest=1.0))


def test_three_views_are_enough(backend: Backend) -> None:
    for made, depth, _ in estimate(PLACES[:3], DepthSettings()):
        assert made.known[12:-12, 18:-18].mean() > 0.8
        assert (np.abs(made.depth / depth - 1)[made.known] < 0.02).mean() > 0.97


def test_slanted_planes_come_out_as_they_are(estimated: list[tuple[DepthMap, np.ndarray, np.ndarray]]) -> None:
    for made, depth, normal in estimated:
        inner = np.zeros(depth.shape, bool)
        inner[12:-12, 18:-18] = True
        assert made.known[inner].mean() > 0.85
        wrong = np.abs(made.depth / depth - 1)[made.known]
        assert np.median(wrong) < 0.003
        assert (wrong < 0.02).mean() > 0.97
        cosine = (made.normal * normal).sum(axis=-1)[made.known]
        assert np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))) < 5


def test_what_is_unknown_is_zero(estimated: list[tuple[DepthMap, np.ndarray, np.ndarray]]) -> None:
    for made, _, _ in estimated:
        unknown = ~made.known
        assert unknown.any()
        assert not made.confidence[unknown].any()
        assert not made.normal[unknown].any()
        assert 0 < made.confidence[made.known].min() <= made.confidence.max() <= 1


def test_transfer_goes_through_world_points(np_rng: np.random.Generator) -> None:
    here, there = camera("a", 0.2, 0.1, 10.0), camera("b", -0.4, 0.0, -5.0)
    points = np_rng.uniform((-0.5, -0.5, -4), (0.5, 0.5, -2), (20, 3))
    (pixel, depth), (expected, other) = here.project(points), there.project(points)
    blank = np.zeros((HEIGHT, WIDTH), np.float32)
    turn, shift = transfer(StereoView(here, blank, 0.0), StereoView(there, blank, 0.0))
    at = np.column_stack([pixel - 0.5, np.ones(20)]) @ turn.T + shift / depth[:, None]
    assert np.allclose(at[:, :2] / at[:, 2:] + 0.5, expected)
    assert np.allclose(at[:, 2] * depth, other)


def test_normals_are_those_of_the_plane() -> None:
    view, depth, normal = seen(camera("a", 0.1, 0.0, 7.0))
    q = 1 / depth
    planes = np.stack([q, np.gradient(q, axis=1), np.gradient(q, axis=0)])
    apart = (normals_of(view, planes) * normal).sum(axis=-1)
    assert np.quantile(apart, 0.1) > 0.9999


def test_noise_is_told_from_shading(np_rng: np.random.Generator) -> None:
    shading = np.add.outer(np.linspace(0, 2, 80), np.linspace(0, 1, 90) ** 2)
    assert noise_of(shading) < 1e-4
    assert noise_of(shading + np_rng.normal(0, 0.05, shading.shape)) == pytest.approx(0.05, rel=0.1)


def test_a_panorama_is_refused() -> None:
    with pytest.raises(FiptError, match="one place, as in a panorama"):
        choose_sources([camera(f"v{i}", 0.001 * i, turn=8.0 * i) for i in range(6)], 4, 0.3)


def test_views_that_do_not_overlap_are_refused() -> None:
    with pytest.raises(FiptError, match="at least 3 views"):
        choose_sources([camera("a", 0.0), camera("b", 0.3), camera("c", 0.0, turn=180.0)], 4, 0.3)


def test_sources_look_at_the_same_from_the_side() -> None:
    cameras = [camera("a", 0.0), camera("near", 0.01), camera("side", 0.4), camera("back", 0.4, turn=180.0)]
    cameras += [camera("other", 0.2, 0.3)]
    chosen = choose_sources(cameras, 2, 0.3)[0]
    assert {cameras[j].name for j in chosen} == {"side", "other"}


def test_a_view_without_depth_keeps_the_sources_of_its_camera() -> None:
    cameras = [camera(f"v{i}", *at) for i, at in enumerate(PLACES)]
    by_cameras = choose_sources(cameras, 4, 0.3)
    depths = [seen(taken)[1].astype(np.float32) for taken in cameras]
    assert all(len(row) >= 2 for row in choose_again(cameras, 4, depths, by_cameras))
    depths[1] = np.zeros_like(depths[1])
    assert choose_again(cameras, 4, depths, by_cameras)[1] == by_cameras[1]
    # nor does depth that was found in no view say that views do not overlap
    assert choose_again(cameras, 4, [0 * depth for depth in depths], by_cameras) == by_cameras


def test_something_that_stands_in_the_way_is_left_out() -> None:
    cameras = [camera(f"v{i}", *at) for i, at in enumerate(PLACES)]
    depths = [seen(taken)[1].astype(np.float32) for taken in cameras]
    depths[2] = np.full_like(depths[2], 0.2)
    chosen = choose_again(cameras, 4, depths, choose_sources(cameras, 4, 0.3))
    assert 2 in choose_sources(cameras, 4, 0.3)[0]
    assert 2 not in chosen[0]


def test_views_without_texture_are_said_to_have_none(backend: Backend) -> None:
    import drjit

    cameras = [camera(f"v{i}", *at) for i, at in enumerate(PLACES[:3])]
    # two sizes, the smaller one as small as can be: the second is chosen by the depth of the first
    width, height, focal = 104, 78, FOCAL * 104 / WIDTH
    large = [replace(c, width=width, height=height, fx=focal, fy=focal, cx=width / 2, cy=height / 2) for c in cameras]
    views = [StereoView(taken, np.zeros((height, width), np.float32), 1e-3) for taken in large]
    settings = DepthSettings(rounds=1, later_rounds=1, nearest=2.0)
    with pytest.raises(FiptError, match="no texture was matched: in none of 3 views"):
        list(depth_maps(getattr(drjit, set_variant().name), views, settings))


def test_texels_of_large_sources_are_found_where_they_begin(backend: Backend) -> None:
    """Beyond 2^24 of them float32 holds no odd number."""
    import drjit

    small = StereoView(camera("a", 0.0), np.zeros((HEIGHT, WIDTH), np.float32), 1e-3)
    large = StereoView(small.camera.resized(4099, 4097), np.zeros((4097, 4099), np.float32), 1e-3)
    matching = _matching(getattr(drjit, set_variant().name), small, [large, small])
    assert list(matching.begins) == [0, 4099 * 4097]
