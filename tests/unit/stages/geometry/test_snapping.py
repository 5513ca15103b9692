"""A mesh is put onto the room's planes, and it is said what speaks for each region."""

import numpy as np
import pytest

from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh
from fipt.stages.geometry.completion import Completed
from fipt.stages.geometry.evidence import SurfaceEvidence, evidence, regions
from fipt.stages.geometry.room_planes import RoomPlanes
from fipt.stages.geometry.snapping import snapped
from tests import scenes
from tests.unit.stages.geometry.test_fusing import HALF, around

ROUGH = 0.004


def walls() -> RoomPlanes:
    """The six planes of the cube."""
    normal = np.concatenate([np.eye(3), -np.eye(3)])
    return RoomPlanes(normal, np.full(6, -HALF), np.full(6, 1e-3), np.full(6, 9.0), np.full(6, 8), np.arange(6) % 3,
                      np.eye(3))  # fmt: skip


def cube() -> Mesh:
    """The cube's inside, finely cut, its vertices moved by some millimetres."""
    mesh = scenes.box((-HALF, -HALF, -HALF), (HALF, HALF, HALF))
    corners = mesh.corners
    for _ in range(4):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate(
            [np.stack(parts, 1) for parts in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
    places, of = np.unique(corners.reshape(-1, 3).round(5), axis=0, return_inverse=True)
    places = places + np.random.default_rng(2).uniform(-ROUGH, ROUGH, places.shape)
    return Mesh(places.astype(np.float32), of.reshape(-1, 3).astype(np.int32))


def test_vertices_are_put_onto_planes_lines_and_corners():
    mesh, plane = snapped(cube(), walls(), 2 * ROUGH)
    assert (plane >= 0).all()
    off = np.sort(HALF - np.abs(mesh.vertices), axis=1)
    assert np.abs(off[:, 0]).max() < 1e-5
    on_edge = off[:, 1] < 2 * ROUGH
    assert on_edge.sum() > 12 * 15
    assert np.abs(off[on_edge, 1]).max() < 1e-5


def test_what_stands_out_farther_stays():
    rough = cube()
    mesh, plane = snapped(rough, walls(), ROUGH / 10)
    assert (plane < 0).mean() > 0.9
    moved = np.linalg.norm(mesh.vertices - rough.vertices, axis=1)
    assert moved.max() < ROUGH


@pytest.mark.usefixtures("backend")
def test_each_region_says_what_is_known_of_it():
    mesh, plane = snapped(cube(), walls(), 2 * ROUGH)
    views = []
    for view in around():
        # nothing is measured of the wall at x = HALF: one view closes it, the others show depth of planes
        bare = np.abs(view.points[..., 0] - HALF) < 0.01
        views.append(Completed(view, view.map.known & ~bare, bare & (len(views) % 2 == 0)))
    support = evidence(mesh, views)
    found = {region["plane"]: region for region in regions(mesh, plane, support)}
    assert set(found) == set(range(6))
    assert found[3]["measured"] < 0.01
    assert found[3]["completed"] + found[3]["closed"] > 0.8
    assert found[0]["measured"] > 0.8
    assert found[0]["views"] >= 2
    assert found[0]["area"] == pytest.approx(4 * HALF**2, rel=0.01)
    for region in found.values():
        shares = [region[name] for name in ("measured", "completed", "closed", "unseen")]
        assert sum(shares) == pytest.approx(1, abs=0.001)
    assert support.share(mesh.areas)["unseen"] < 0.5


@pytest.mark.usefixtures("backend")
def test_a_view_without_depth_says_that_nothing_is_known():
    mesh = cube()
    view = around()[0]
    none = view.with_map(DepthMap(0 * view.map.depth, 0 * view.map.depth, 0 * view.map.normal))
    empty = np.zeros_like(view.map.known)
    support = evidence(mesh, [Completed(none, empty, empty)])
    share = support.share(mesh.areas)
    assert share["measured"] == share["completed"] == 0
    assert share["closed"] > 0.05


def test_things_that_stand_separately_on_one_plane_are_regions_each():
    x, y = np.meshgrid(np.linspace(0, 4, 41), np.linspace(0, 4, 41), indexing="ij")
    height = np.zeros_like(x)
    for center in (1, 3):
        height = np.maximum(height, 0.5 - 2 * ((x - center) ** 2 + (y - center) ** 2))
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3).astype(np.float32)
    at = np.arange(41 * 41, dtype=np.int32).reshape(41, 41)
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    mesh = Mesh(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    plane = np.where((mesh.corners[..., 2] == 0).all(axis=1), 0, -1)
    count = len(plane)
    found = regions(mesh, plane, SurfaceEvidence(np.ones(count, np.int64), np.zeros(count, np.int64)))
    assert [region["plane"] for region in found] == [0, None, None]
    assert sorted(region["low"][0] < 2 for region in found[1:]) == [False, True]
    for bump in found[1:]:
        assert bump["high"][0] - bump["low"][0] < 1.2
