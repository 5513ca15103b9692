"""Backs of sheets that light can come from, such as the inside of a lampshade."""

import numpy as np
import pytest

from fipt.meshing.backs import with_backs
from fipt.scene.mesh import Mesh, connected_parts
from tests.scenes import box, joined, look_at, sheet, turned

GAP = 0.002
TABLE = sheet((-1, 0, -1), (0, 0, 2), (2, 0, 0), 8)
"""Faces up."""
FROM_THE_SIDES = [look_at(str(k), (2 * np.cos(k), 0.5, 2 * np.sin(k)), (0, 0.4, 0)) for k in range(6)]


def shade(around: int = 24, rows: int = 4) -> Mesh:
    """A cone without ends, 30 cm high and 40 cm wide below, that faces out; views from the sides see through nothing."""
    angle, height = np.meshgrid(2 * np.pi * np.arange(around) / around, np.linspace(0, 1, rows + 1))
    radius = 0.2 - 0.08 * height
    places = np.stack([radius * np.cos(angle), 0.3 + 0.3 * height, radius * np.sin(angle)], axis=-1).reshape(-1, 3)
    row, column = np.mgrid[:rows, :around]
    a, b = row * around + column, row * around + (column + 1) % around
    triangles = np.stack([np.stack([a, a + around, b], -1), np.stack([b, a + around, b + around], -1)], 2)
    return Mesh(places.astype(np.float32), triangles.reshape(-1, 3).astype(np.int32))


@pytest.mark.parametrize("wound", [shade(), turned(shade())], ids=["out", "in"])
def test_the_inside_of_a_lampshade_becomes_surface_of_its_own(backend, wound) -> None:
    mesh = joined(TABLE, wound)
    done, count = with_backs(mesh, FROM_THE_SIDES, GAP)
    assert count == 1
    np.testing.assert_array_equal(done.triangles[: len(mesh.triangles)], mesh.triangles)
    back = Mesh(done.vertices, done.triangles[len(mesh.triangles) :])
    middle, radial = back.corners.mean(axis=1), back.corners.mean(axis=1) * (1, 0, 1)
    assert (np.sum(back.normals * radial, axis=1) < 0).all()  # faces in
    assert back.areas.sum() == pytest.approx(shade().areas.sum(), rel=0.03)
    away = np.linalg.norm(radial, axis=1) - (0.2 - 0.08 * (middle[:, 1] - 0.3) / 0.3)
    assert ((away < 0) & (away > -3 * GAP)).all()
    assert len(np.unique(connected_parts(done))) == len(np.unique(connected_parts(mesh))) + 1


def test_an_inside_that_views_show_is_no_back(backend) -> None:
    views = [look_at(f"{k}", (0.3 * np.cos(k), 2, 0.3 * np.sin(k)), (0, 0.4, 0)) for k in range(6)]
    upright = shade()
    bowl = Mesh(upright.vertices * np.float32([1, -1, 1]) + np.float32([0, 0.9, 0]), turned(upright).triangles)
    assert with_backs(joined(TABLE, bowl), FROM_THE_SIDES, GAP)[1] == 1
    assert with_backs(joined(TABLE, bowl), FROM_THE_SIDES + views, GAP)[1] == 0


def test_a_closed_shape_has_no_back(backend) -> None:
    mesh = joined(TABLE, turned(box((-0.2, 0.3, -0.2), (0.2, 0.6, 0.2))))
    done, count = with_backs(mesh, FROM_THE_SIDES, GAP)
    assert count == 0
    assert len(done.triangles) == len(mesh.triangles)
