"""Holes of a mesh: closed where they are small or no view looks through them, else declared."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.meshing.holes import without_hidden_holes
from fipt.meshing.topology import neighbours
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from tests.scenes import box, sheet
from tests.unit.meshing.views import above

_DOWN = above("down", 1)


def below() -> Camera:
    """A view straight up, from 2 m below."""
    pose = np.diag([1.0, -1, -1, 1])
    pose[:3, 3] = 1, 1, -2
    return replace(_DOWN, name="up", world_from_camera=pose)


@pytest.mark.usefixtures("backend")
def test_small_holes_are_closed_and_large_ones_that_a_view_shows_declared() -> None:
    wall = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 20)
    middle = wall.corners.mean(axis=1)
    small = (np.abs(middle[:, :2] - 0.5) < 0.1).all(axis=1)
    large = (np.abs(middle[:, :2] - 1.4) < 0.2).all(axis=1)
    done, figures = without_hidden_holes(Mesh(wall.vertices, wall.triangles[~(small | large)]), 0.4, [_DOWN])
    # what is left open: the large one, and the border of the sheet
    assert (figures.holes_closed, figures.holes_hidden, figures.holes_open) == (1, 0, 2)
    assert figures.hole_area == pytest.approx(4 + 0.16, rel=1e-3)
    assert done.areas.sum() == pytest.approx(4 - 0.16, rel=1e-5)
    assert (done.normals[:, 2] > 0.99).all()
    assert len(neighbours(done.triangles)) > len(neighbours(wall.triangles[~(small | large)]))


@pytest.mark.usefixtures("backend")
def test_the_back_of_a_thing_is_closed_unless_a_view_shows_it_open() -> None:
    whole = box((0.8, 0.8, 0), (1.2, 1.2, 0.4))
    vertices, weld = np.unique(whole.vertices, axis=0, return_inverse=True)
    triangles = weld.reshape(-1)[whole.triangles].astype(np.int32)
    back = (vertices[triangles][..., 2] == 0).all(axis=1)
    open_box = Mesh(vertices, triangles[~back])
    assert back.sum() == 2
    done, figures = without_hidden_holes(open_box, 0.1, [_DOWN])
    assert (figures.holes_closed, figures.holes_hidden, figures.holes_open, figures.hole_area) == (1, 1, 0, 0)
    assert done.areas.sum() == pytest.approx(whole.areas.sum(), rel=1e-5)
    away = replace(_DOWN, cx=300.0)
    assert without_hidden_holes(open_box, 0.1, [away])[1].holes_open == 1, "nobody looks there: it may be a door"
    done, figures = without_hidden_holes(open_box, 0.1, [_DOWN, away, below()])
    assert (figures.holes_closed, figures.holes_open) == (0, 1)
    assert done.areas.sum() == pytest.approx(open_box.areas.sum(), rel=1e-5)
