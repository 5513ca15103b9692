"""The comparison of a mesh with the true one."""

import numpy as np
import pytest

from benchmarks import geometry
from benchmarks.scan import depth_camera
from fipt.scene.mesh import Mesh
from fipt.synthetic.shapes import box

pytestmark = pytest.mark.usefixtures("open3d")


class Room:
    """What the comparison asks of a dataset, of a box seen from inside."""

    def __init__(self, views: int = 6) -> None:
        self.cameras = []
        for number in range(views):
            pose = np.eye(4)
            c, s = np.cos(number), np.sin(number)
            pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
            self.cameras.append(depth_camera(pose))

    def mesh(self, size: float = 2.0) -> Mesh:
        walls = box((size, size, size)).moved(0, -size / 2, 0)
        return Mesh(walls.vertices.astype(np.float32), walls.triangles[:, ::-1].astype(np.int32))

    def truth(self, view: str) -> None:
        return None


def test_the_true_mesh_has_no_error(backend):
    room = Room()
    found = geometry.geometry(room.mesh(), room, points=5000)
    assert found["accuracy_mm"]["mean"] < 0.01
    assert found["1cm"] == {"precision": 1.0, "recall": 1.0, "f": 1.0}
    assert found["normals_degrees"]["p90"] < 0.1
    assert found["planes_mm"]["from_true"] < 0.01
    assert found["leaving"] == {"ours": 0.0, "true": 0.0}


def test_walls_that_are_off_and_missing_are_counted(backend):
    room = Room()
    larger = room.mesh(2.03)  # walls are 1.5 cm off
    open_above = Mesh(larger.vertices, larger.triangles[larger.corners.mean(axis=1)[:, 1] < 1.0])
    found = geometry.geometry(open_above, room, points=5000)
    assert found["accuracy_mm"]["median"] == pytest.approx(15, abs=0.5)
    assert found["planes_mm"]["flatness"] < 0.01
    assert found["planes_mm"]["from_true"] == pytest.approx(15, abs=0.5)
    assert found["2cm"]["precision"] > 0.99
    assert found["1cm"]["f"] < 0.05
    assert found["leaving"]["ours"] > 0.1 > found["leaving"]["true"]


def test_light_leaves_on_the_side_of_who_sees_the_point(backend):
    room = Room().mesh()
    floor = np.flatnonzero(room.normals[:, 1] > 0.5)[:1]
    places = room.corners[floor].mean(axis=1).astype(np.float64)
    inside, below = (places + np.array([0.0, height, 0.0]) for height in (0.5, -0.5))
    shares = [
        geometry.leaving(room, places.repeat(200, 0), floor.repeat(200), by.repeat(200, 0), np.random.default_rng(0))
        for by in (inside, below)
    ]
    assert shares == [0.0, 1.0]
