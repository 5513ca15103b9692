"""Copies of a shape are found on the mesh."""

import numpy as np

from fipt.meshing.copies import first_copies
from fipt.scene.mesh import Mesh

_TURN = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
_MIRROR = np.diag([-1.0, 1, 1])


def box(*sides: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (8, 3) and triangles (12, 3) of a box."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * sides
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([(q[0], *q[k : k + 2]) for q in quads for k in (1, 2)])


def together(*shapes: tuple[np.ndarray, np.ndarray]) -> Mesh:
    """One mesh of shapes that do not touch."""
    begins = np.cumsum([0, *(len(vertices) for vertices, _ in shapes)])
    triangles = [own + begin for (_, own), begin in zip(shapes, begins, strict=False)]
    vertices = [own + np.array([10 * k, 0, 0]) for k, (own, _) in enumerate(shapes)]
    return Mesh(np.concatenate(vertices).astype(np.float32), np.concatenate(triangles).astype(np.int32))


def test_turned_and_mirrored_shapes_are_copies_other_sizes_are_not():
    (vertices, triangles), large = box(0.1, 0.2, 0.9), box(0.2, 0.4, 1.8)
    mesh = together(
        (vertices, triangles),
        (vertices @ _TURN.T, triangles),
        large,
        (vertices @ _MIRROR, triangles),
        box(0.1, 0.2, 0.8),
    )
    shape = np.arange(12)
    assert first_copies(mesh).tolist() == np.concatenate([shape, shape, shape + 24, shape, shape + 48]).tolist()


def test_a_wire_is_no_copy_of_a_pipe():
    assert first_copies(together(box(1, 0.002, 0.002), box(1, 0.008, 0.008))).tolist() == list(range(24))


def test_a_sheet_of_two_triangles_is_no_shape():
    sheet = (np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float), np.array([(0, 1, 2), (0, 2, 3)]))
    assert first_copies(together(sheet, sheet)).tolist() == [0, 1, 2, 3]
    assert first_copies(together(sheet, sheet), fewest=2).tolist() == [0, 1, 0, 1]
