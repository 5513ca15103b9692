"""What the scaling benchmark makes: cut meshes, sizes, and a load that the stages accept."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.scaling import Usage, Work, call, draw, halved
from tests import scenes


def test_cutting_triangles_keeps_the_surface():
    mesh = scenes.box((0, 0, 0), (4, 3, 5))
    once, twice = halved(mesh), halved(halved(mesh))
    assert (len(once.triangles), len(twice.triangles)) == (24, 48)
    half = np.concatenate([mesh.areas / 2] * 2)
    np.testing.assert_allclose(once.areas, half, rtol=1e-6)
    np.testing.assert_allclose(once.normals, np.concatenate([mesh.normals] * 2), atol=1e-6)
    assert len(once.vertices) <= len(mesh.vertices) + 18  # neighbours share the new vertex
    sides = np.linalg.norm(twice.corners - np.roll(twice.corners, 1, axis=1), axis=2)
    assert sides.max() < 5.1  # the longest side is cut, so that triangles do not become needles


def test_pixels_double():
    sizes = [Work(pixels=4800 * 2**k).size for k in range(4)]
    assert sizes[0] == (80, 60)
    assert [w * h for w, h in sizes] == pytest.approx([4800, 9600, 19200, 38400], rel=0.02)


def test_a_verb_that_fails_ends_the_run(tmp_path):
    with pytest.raises(SystemExit, match="fipt cache failed"):
        call("cache", ["--dataset", "none", "--samples", "none", "--out", "cache.npz"], Path("stats.json"), tmp_path)


def test_the_picture(tmp_path):
    usage = vars(Usage(1.0, 2.0, 300.0, None))
    rows = [
        {"views": 6 * k, "pixels": 4800 * k, "triangles": 100 * k, "stages": {"fit": usage, "bake": usage}}
        for k in (1, 2, 4)
    ]
    draw(tmp_path / "a.png", dict.fromkeys(("views", "pixels", "triangles"), rows), "caption")
    assert (tmp_path / "a.png").stat().st_size > 10_000
