"""``fipt samples`` and bad input."""

import numpy as np

from fipt.scene.cameras import write_transforms
from fipt.scene.mesh import Mesh, write_ply
from tests import scenes


def test_bad_meshes(work, refused):
    path, room = work / "dataset" / "mesh.ply", scenes.room().mesh
    out = ("--out", work / "new" / "train-000")
    path.unlink()
    assert "the mesh is missing" in refused("samples", *out)
    write_ply(path, Mesh(room.vertices, room.triangles[:0]))
    assert "must hold triangles" in refused("samples", *out) or "not a readable mesh" in refused("samples", *out)
    vertices = room.vertices.copy()
    vertices[[2, 5], 1] = np.nan
    write_ply(path, Mesh(vertices, room.triangles))
    assert "2 are NaN or infinite, the first is vertex 2" in refused("samples", *out)


def test_a_view_that_sees_nothing(work, refused):
    cameras = scenes.cameras()
    away = scenes.look_at("b", (10, 1, 1), (20, 1, 1))
    write_transforms(work / "dataset" / "transforms.json", [cameras[0], away, cameras[2]])
    assert "view b: all rays miss the mesh" in refused("samples", "--out", work / "samples" / "new")


def test_an_unknown_view(refused):
    assert "view d is not among the accepted views" in refused("samples", "--views", "a,d")
