"""What is said of a mesh from depth maps, and what is left out of it."""

import numpy as np
import pytest

from fipt.scene.depth_maps import DepthMap
from fipt.scene.mesh import Mesh
from fipt.stages.geometry import build
from fipt.stages.geometry.completion import Completed
from fipt.stages.geometry.room_box import RoomBox
from tests.scenes import sheet
from tests.unit.stages.geometry.test_fusing import around


def test_pixels_without_depth_lessen_no_other_share() -> None:
    view = around()[0]
    column = np.broadcast_to(np.arange(80), (60, 80))
    own, known = column < 20, column < 60  # the rest shows nothing
    shown = view.with_map(DepthMap(np.where(known, view.map.depth, 0), view.map.confidence, view.map.normal))
    shares = build._of_pixels([Completed(shown, own, column >= 40)], [own])
    assert (shares["known"], shares["completed"], shares["closed"]) == (0.25, 0.25, 0.5)


def test_what_openings_leave_out_leaves_no_vertices(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 20)
    box = RoomBox(np.eye(3), np.zeros(3), np.full(3, 2.0), np.full((2, 3), np.nan))

    def middle(mesh: Mesh, _: object) -> np.ndarray:
        near = (np.abs(mesh.corners.mean(axis=1)[:, :2] - 1) < 0.3).all(axis=1)
        return near & (np.arange(len(near)) < len(wall.triangles))

    monkeypatch.setattr(build, "find_openings", middle)
    done, kept, area = build._closed(wall, box, 0.02, around()[:1])
    assert area == pytest.approx(0.36, rel=0.01)
    assert (~kept).any()
    assert len(np.unique(done.triangles)) == len(done.vertices)
