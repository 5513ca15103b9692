"""Segments by number and by a point, boxes, and what an edit makes of a material."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.render.edits import Box, Segments, without
from fipt.scene.setup import RelightSetup
from tests import scenes

TWO = scenes.joined(scenes.box((0, 0, 0), (4, 3, 5)), scenes.turned(scenes.box((1, 0.5, 1), (2, 1.5, 2))))
"""Walls (connected part 0) and a block (part 1) of 12 triangles each."""
BLOCK = np.arange(24) >= 12


def segments(ids=None, up="y", mesh=TWO):
    return Segments(mesh, ids, up)


def gone(ids=None, up="y", **entry):
    return segments(ids, up).removed(RelightSetup.model_validate({"remove": [entry]}))


def edits(up="y", **entry):
    (edit,) = segments(up=up).edits(RelightSetup.model_validate({"materials": [entry]}))
    return edit


@pytest.mark.parametrize("entry", [{"segment": 1}, {"at": [1.5, 1.6, 1.2]}, {"at": [1.02, 1.0, 1.5]}])
def test_a_segment_by_number_and_by_a_point(entry, caplog):
    caplog.set_level("INFO")
    np.testing.assert_array_equal(gone(**entry), BLOCK)
    assert "segment 1, 12 triangles, 6 m2, around (1.50, 1.00, 1.50)" in caplog.text


def test_fused_ids_of_which_none_was_found():
    with pytest.raises(FiptError, match="names segment 3, which does not exist; there is none"):
        gone(np.zeros(24, np.uint16), segment=3)


def test_fused_segments_go_by_their_ids():
    ids = np.where(np.arange(24) % 2 == 0, 7, 3).astype(np.uint16)
    np.testing.assert_array_equal(gone(ids, segment=7), ids == 7)
    ids[:12] = 0
    with pytest.raises(FiptError, match="belongs to no segment; choose a box instead"):
        gone(ids, at=[2, 3, 4])
    with pytest.raises(FiptError, match="names segment 0, which does not exist"):
        gone(ids, segment=0)


def test_a_segment_that_does_not_exist_is_answered_with_those_that_do():
    said = (
        r"remove\.0 names segment 5, which does not exist; there are 0 to 1; the largest: 0 around \(2\.0, 1\.5, 2\.5\)"
    )
    with pytest.raises(FiptError, match=said):
        gone(segment=5)
    with pytest.raises(FiptError, match="there are 1 to 2, 9;"):
        gone(np.repeat([1, 2, 9, 9], 6), segment=5)


def test_a_box_takes_triangles_whose_centre_it_holds(caplog):
    caplog.set_level("INFO")
    np.testing.assert_array_equal(gone(box={"center": [1.5, 1, 1.5], "size": [1.2, 1.2, 1.2]}), BLOCK)
    assert not gone(box={"center": [3, 1, 3], "size": [0.1, 0.1, 0.1]}).any()
    assert "remove.0: 0 triangles have their centre in the box" in caplog.text


def test_an_edit_of_nothing_is_said(caplog):
    edits(box={"center": [3, 1, 3], "size": [0.1, 0.1, 0.1]}, metallic=1)
    assert "materials.0: the box touches no surface; nothing is changed" in caplog.text
    caplog.clear()
    edits(box={"center": [3, 0, 3], "size": [0.1, 0.1, 0.1]}, metallic=1)
    assert not caplog.records


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_box_turns_counter_clockwise_as_seen_from_above(up):
    """Turned by 90 degrees, what lay along x lies along -z (y up) or y (z up)."""
    box = edits(up, box={"center": [1, 0, 0], "size": [2, 0.2, 0.2], "rotation": 60}, metallic=1).where
    assert isinstance(box, Box)
    c, s = 0.5, np.sqrt(0.75)
    along = np.array([c, 0, -s] if up == "y" else [c, s, 0])
    assert box.holds(np.array([[1, 0, 0] + 0.95 * along, [1, 0, 0] - 0.95 * along])).all()
    other = along * ([1, 1, -1] if up == "y" else [1, -1, 1])
    assert not box.holds(np.array([[1, 0, 0] + 0.95 * other, [1, 0, 0] + 1.05 * along])).any()


def test_edits_hold_on_triangles_or_in_boxes():
    edit = edits(segment=1, base_color=[0.1, 0.2, 0.3])
    np.testing.assert_array_equal(edit.holds(np.zeros((5, 3)), np.array([0, 12, 23, -1, 99])), [0, 1, 1, 0, 0])
    np.testing.assert_array_equal(edit.of_triangles(np.array([3, 13, 5])).where, [False, True, False])
    np.testing.assert_array_equal(edit.extended(30).where, np.append(BLOCK, np.zeros(6, bool)))
    found = np.float32([[0.5, 0.5, 0.5], [0.9, 0.1, 0.9]])
    np.testing.assert_allclose(edit.color(found), [[0.1, 0.2, 0.3]] * 2)
    np.testing.assert_allclose(edits(segment=1, tint=[2, 1, 0]).color(found), [[1, 0.5, 0], [1, 0.1, 0]])
    np.testing.assert_array_equal(edits(segment=1, roughness=0.3).color(found), found)


def test_removed_triangles_keep_their_numbers(backend):
    from fipt.render.scene import RayScene

    mesh = without(TWO, BLOCK)
    assert mesh.triangles.shape == TWO.triangles.shape
    np.testing.assert_array_equal(mesh.triangles[:12], TWO.triangles[:12])
    np.testing.assert_array_equal(mesh.areas[12:], 0)
    down = np.float32([[0, -1, 0]])
    start = np.float32([1.5, 2.5, 1.4])
    assert RayScene(TWO).intersect(start, down)[0] == pytest.approx(1.0, rel=1e-4)
    distance, triangle = RayScene(mesh).intersect(start, down)
    assert distance == pytest.approx(2.5, rel=1e-4)
    assert triangle[0] < 12
