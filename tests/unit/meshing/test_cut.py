"""The mesh cut along edges of radiance."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.meshing.clean import clean
from fipt.meshing.cut import cut_at
from fipt.meshing.holes import without_small_holes
from fipt.meshing.radiance_edges import RadianceEdges, edge_points, find_edges, reduced
from fipt.meshing.subdivide import halved, split_sides, subdivided
from fipt.meshing.topology import border_vertices, neighbours, side_list
from fipt.scene.mesh import Mesh
from tests.scenes import box, joined, sheet
from tests.unit.meshing.views import above, image

WALL = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 2)


def is_sound(mesh: Mesh, like: Mesh) -> bool:
    """Whether a mesh covers the same flat surface without cracks: area, facing, and borders only where they were."""
    inner = border_vertices(mesh) & (np.abs(mesh.vertices[:, :2] - 1) < 0.999).all(axis=1)
    same = np.isclose(mesh.areas.sum(), like.areas.sum(), rtol=1e-5)
    return bool(same and (mesh.area_normals[:, 2] >= -1e-9).all() and not inner.any())


@pytest.mark.parametrize("chosen", [[0], [0, 5], [7, 2, 3], range(8)])
def test_halving_leaves_no_cracks(chosen) -> None:
    wanted = np.zeros(8, bool)
    wanted[list(chosen)] = True
    done = halved(WALL, wanted)
    assert len(done.triangles) > 8
    assert is_sound(done, WALL)


def test_halving_goes_on_until_nothing_is_too_large() -> None:
    def large(mesh: Mesh) -> np.ndarray:
        near = np.linalg.norm(mesh.corners.mean(axis=1)[:, :2] - 0.6, axis=1) < 0.3
        return near & (mesh.areas > 1e-3)

    done = subdivided(WALL, large)
    assert is_sound(done, WALL)
    assert not large(done).any()
    assert len(done.triangles) < 3000


@pytest.mark.parametrize("seed", range(4))
def test_sides_split_anywhere_leave_no_cracks(seed) -> None:
    rng = np.random.default_rng(seed)
    ends, side = side_list(WALL.triangles)
    where = np.where(rng.random(len(ends)) < 0.6, rng.uniform(0.2, 0.8, len(ends)), np.nan)
    done = split_sides(WALL, ends, side, where)
    assert len(done.triangles) == 8 + np.isfinite(where[side]).sum()
    assert is_sound(done, WALL)


def test_edge_points_lie_on_the_edge_to_fractions_of_a_pixel() -> None:
    def slanted(x, y):
        return x + 0.2 * y < 1.13

    column, row = edge_points(image(60, slanted), np.ones((60, 60)))
    x, y = column / 60 * 2, 2 - row / 60 * 2
    off = np.abs(x + 0.2 * y - 1.13) / np.hypot(1, 0.2) * 30  # pixels
    assert len(column) > 50
    assert np.median(off) < 0.1
    assert off.max() < 0.5


def test_no_edge_is_found_beside_pixels_without_weight() -> None:
    valid = np.ones((60, 60))
    valid[:, 32:] = 0
    assert len(edge_points(image(60, lambda x, _: x < 1.05), valid)[0]) == 0


def test_large_images_are_averaged_in_blocks() -> None:
    camera = replace(above("a", 1.2), width=62, height=61)
    radiance = np.random.default_rng(0).random((61, 62, 3))
    valid = np.ones((61, 62))
    valid[5, 7] = 0
    small, means, weights = reduced(camera, radiance, valid, 421)
    assert (small.width, small.height, small.fx) == (20, 20, 20)
    assert means[1, 2] == pytest.approx(radiance[3:6, 6:9].mean(axis=(0, 1)))
    assert weights[1, 2] == 0
    assert weights.sum() == 399
    place = np.array([[0.7, 1.1, 0.0]])
    assert small.project(place)[0] == pytest.approx(camera.project(place)[0] / 3)
    assert reduced(camera, radiance, valid, 10_000)[1] is radiance


@pytest.mark.parametrize("shape", ["line", "disc"])
def test_a_cut_follows_the_edge(backend, shape) -> None:
    def bright(x, y):
        return x + 0.3 * y < 1.2 if shape == "line" else (x - 1) ** 2 + (y - 1) ** 2 < 0.3

    cameras = [above("a", 1.0), above("b", 1.3), above("c", 0.7)]
    seen = image(60, bright)

    def radiance(_: str) -> tuple[np.ndarray, np.ndarray]:
        return np.repeat(seen[..., None], 3, axis=2), np.ones((60, 60))

    edges = find_edges(WALL, cameras, radiance)
    assert len(edges) > 100
    done = cut_at(WALL, edges)
    assert is_sound(done, WALL)
    assert len(done.triangles) < 4000
    # the best labels of whole triangles, by many points of each
    u = np.random.default_rng(0).dirichlet((1, 1, 1), 200)
    points = np.einsum("pk,tkc->tpc", u, done.corners)
    inside = bright(points[..., 0], points[..., 1]).mean(axis=1)
    wrong = (np.minimum(inside, 1 - inside) * done.areas).sum()
    length = 2 * np.hypot(1, 0.3) if shape == "line" else 2 * np.pi * np.sqrt(0.3)
    assert wrong / length < 0.15 / 30  # metres to either side: a seventh of a pixel


def test_an_edge_that_moves_with_the_viewer_is_none(backend) -> None:
    cameras = [above("a", 1.0), above("b", 1.4), above("c", 0.6)]
    at = {"a": 1.0, "b": 1.4, "c": 0.6}

    def radiance(view: str) -> tuple[np.ndarray, np.ndarray]:
        seen = image(60, lambda x, _: x < at[view])
        return np.repeat(seen[..., None], 3, axis=2), np.ones((60, 60))

    assert len(find_edges(WALL, cameras, radiance)) == 0


def test_views_that_mask_a_place_do_not_speak_against_its_edges(backend) -> None:
    cameras = [above("a", 1.0), above("b", 1.3), above("c", 0.7)]
    seen = image(60, lambda x, y: (np.abs(y - 1) < 0.4) & (np.abs(x - 1) < 0.6))

    def masked_in(*views: str) -> int:
        def radiance(view: str) -> tuple[np.ndarray, np.ndarray]:
            valid = np.ones((60, 60))
            valid[10:50, 5:55] = view not in views
            return seen[..., None] * np.ones(3), valid

        return len(find_edges(WALL, cameras, radiance))

    # a view's own edge points are lost with its pixels
    assert masked_in("b") > 0.6 * masked_in()
    assert masked_in("b", "c") > 0.3 * masked_in()


def test_an_edge_along_the_side_of_another_view_stays(backend) -> None:
    cameras = [above("a", 1.0), replace(above("b", 1.0), cx=12.0)]  # b begins at x = 0.6

    def radiance(view: str) -> tuple[np.ndarray, np.ndarray]:
        begin = 0.0 if view == "a" else 0.6
        return image(60, lambda x, _: begin + x < 0.63)[..., None] * np.ones(3), np.ones((60, 60))

    assert len(find_edges(WALL, cameras, radiance)) > 50


def test_a_surface_full_of_edges_is_cut_coarser(monkeypatch) -> None:
    places = np.random.default_rng(0).uniform(0, 2, (4000, 3)) * [1, 1, 0]
    edges = RadianceEdges(places, np.full(4000, 0.01))
    monkeypatch.setattr("fipt.meshing.cut._MOST", 1000)
    done = cut_at(WALL, edges)
    assert is_sound(done, WALL)
    assert len(done.triangles) < 3000


def test_without_edges_the_mesh_stays() -> None:
    assert cut_at(WALL, RadianceEdges(np.zeros((0, 3)), np.zeros(0))) is WALL


def test_small_holes_are_closed_and_large_ones_declared() -> None:
    wall = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 20)
    middle = wall.corners.mean(axis=1)
    small = (np.abs(middle[:, :2] - 0.5) < 0.1).all(axis=1)
    large = (np.abs(middle[:, :2] - 1.4) < 0.2).all(axis=1)
    done, figures = without_small_holes(Mesh(wall.vertices, wall.triangles[~(small | large)]), 0.4)
    # what is left open: the large one, and the border of the sheet
    assert (figures.holes_closed, figures.holes_open) == (1, 2)
    assert figures.hole_area == pytest.approx(4 + 0.16, rel=1e-3)
    assert done.areas.sum() == pytest.approx(4 - 0.16, rel=1e-5)
    assert (done.normals[:, 2] > 0.99).all()
    assert len(neighbours(done.triangles)) > len(neighbours(wall.triangles[~(small | large)]))


def test_a_small_loose_sheet_gets_no_second_skin() -> None:
    pane = sheet((0.95, 0.95, 0.2), (0.08, 0, 0), (0, 0.08, 0), 4)
    done, figures = without_small_holes(joined(WALL, pane), 0.4)
    assert done.areas.sum() == pytest.approx(4 + 0.08**2, rel=1e-5)
    assert (figures.holes_closed, figures.holes_open) == (0, 2)


def test_a_small_box_without_lid_is_closed() -> None:
    lidless = box((0, 0, 0), (0.1, 0.1, 0.1))
    top = lidless.corners[..., 2].min(axis=1) > 0.09
    lidless, _ = clean(Mesh(lidless.vertices, lidless.triangles[~top]), 0.0)
    assert without_small_holes(lidless, 0.4)[1].holes_closed == 1
