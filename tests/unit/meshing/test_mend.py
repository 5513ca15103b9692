"""What no mesh should have is taken out, and nothing else is touched."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fipt.meshing.mend import far_origin, mended
from tests.layouts import room

ROOM = room()
VERTICES, TRIANGLES = ROOM.vertices.astype(np.float64), ROOM.triangles
HERE = np.zeros(3)


def test_a_good_mesh_keeps_every_bit() -> None:
    found = mended(VERTICES, TRIANGLES, HERE)
    np.testing.assert_array_equal(found.mesh.vertices, ROOM.vertices)
    np.testing.assert_array_equal(found.mesh.triangles, ROOM.triangles)
    assert found.figures == {"unused_vertices": 0, "doubled": 0, "degenerate": 0}
    assert found.warnings() == []


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_what_is_added_is_taken_out_again(data: st.DataObject) -> None:
    """Copies of triangles with any winding and vertices of their own, points, lines, and vertices that nobody uses."""
    count = len(TRIANGLES)
    copied = data.draw(
        st.lists(st.tuples(st.integers(0, count - 1), st.permutations(range(3)), st.booleans()), max_size=9)
    )
    pointed = data.draw(st.lists(st.integers(0, len(VERTICES) - 1), max_size=5))
    unused = data.draw(st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), max_size=5))
    vertices, triangles = [*VERTICES], [*TRIANGLES]
    for number, order, own in copied:
        copy = TRIANGLES[number][list(order)]
        if own:  # as a modeller's copy: the same places, other vertices
            vertices += [*VERTICES[copy]]
            copy = np.arange(len(vertices) - 3, len(vertices))
        triangles.append(copy)
    triangles += [np.array((corner, corner, (corner + 1) % len(VERTICES))) for corner in pointed]
    vertices += [np.array(place) for place in unused]
    found = mended(np.array(vertices), np.array(triangles, np.int32), HERE)
    np.testing.assert_array_equal(found.mesh.corners, ROOM.corners)
    assert (found.figures["doubled"], found.figures["degenerate"]) == (len(copied), len(pointed))
    assert found.figures["unused_vertices"] == len(vertices) - len(VERTICES)
    assert len(found.warnings()) == bool(copied or pointed or unused)


def test_triangles_on_a_line_go() -> None:
    vertices = np.vstack([VERTICES, [[0.5, 0, 0], [1, 0, 0], [2, 0, 0]]])
    found = mended(vertices, np.vstack([TRIANGLES, [[8, 9, 10]]]).astype(np.int32), HERE)
    assert found.figures == {"unused_vertices": 3, "doubled": 0, "degenerate": 1}


@settings(max_examples=60, deadline=None)
@given(st.tuples(*[st.floats(-1e7, 1e7)] * 3))
def test_coordinates_of_a_map_are_moved_without_loss(place: tuple[float, float, float]) -> None:
    centers = np.array([(1.0, 1.5, 4.2), (3.4, 1.2, 4.0), (0.7, 1.8, 1.0)]) + place
    origin = far_origin(centers)
    assert (origin == np.rint(origin)).all()
    moved = mended(VERTICES + place, TRIANGLES, origin).mesh.vertices.astype(np.float64) + origin
    # a tenth of the rays' offset, and the rounding of the source's own float64
    np.testing.assert_allclose(moved, VERTICES + place, rtol=0, atol=0.1 * 3e-5 * 5 + 4e-9)
    if np.abs(place).max() > 1000:
        assert np.abs(centers - origin).max() < 10


def test_a_room_near_the_origin_is_not_moved() -> None:
    assert not far_origin(np.array([(30.0, 0, 0), (33.0, 1, 2)])).any()
