"""Warnings about cameras in walls, in objects and outdoors, whatever the mesh's windings are."""

import numpy as np
import pytest

from fipt.scene.mesh import Mesh
from tests import scenes

INSIDE = scenes.joined(scenes.turned(scenes.box((0, 0, 0), (4, 3, 5))), scenes.box((1, 0, 1), (2, 1, 2)))
"""A room with a chest, the room's triangles facing inwards and the chest's outwards."""
THICK = scenes.joined(INSIDE, scenes.box((-0.2, -0.2, -0.2), (4.2, 3.2, 5.2)))
"""The same with walls 20 cm thick."""


def meshes():
    rng = np.random.default_rng(0)
    for name, mesh in (("thin", INSIDE), ("thick", THICK)):
        yield pytest.param(mesh, id=name)
        flipped = np.where(rng.random(len(mesh.triangles))[:, None] < 0.5, mesh.triangles[:, ::-1], mesh.triangles)
        yield pytest.param(Mesh(mesh.vertices, flipped), id=f"{name}, windings at random")
    # as a scan: small triangles, of which few are seen by the sparse rays of the views
    import trimesh

    fine = trimesh.Trimesh(THICK.vertices, THICK.triangles, process=False)
    for _ in range(6):
        fine = fine.subdivide()
    faces = np.asarray(fine.faces)
    faces = np.where(rng.random(len(faces))[:, None] < 0.5, faces[:, ::-1], faces)
    yield pytest.param(Mesh(np.float32(fine.vertices), np.int32(faces)), id="small triangles, windings at random")


@pytest.fixture
def said(backend):
    from fipt.render.scene import RayScene
    from fipt.stages.render.placement import unlikely_viewpoints

    def judge(mesh, *positions):
        cameras = [scenes.look_at(f"at-{number}", place, (3.1, 1.3, 2.2)) for number, place in enumerate(positions)]
        views = [
            scenes.look_at(f"view-{n}", eye, to)
            for n, (eye, to) in enumerate(
                [((3, 1.5, 4), (1, 0.5, 1)), ((0.5, 1.5, 0.5), (3, 0.5, 4)), ((2.5, 2, 0.5), (1.4, 0.4, 2.5))]
            )
        ]
        return unlikely_viewpoints(RayScene(mesh), cameras, views)

    return judge


@pytest.mark.parametrize("mesh", list(meshes()))
def test_where_cameras_stand(said, mesh):
    assert said(mesh, (2, 1.5, 2.5), (3.8, 0.2, 4.8), (0.4, 2.8, 0.3), (2.06, 0.5, 1.5)) == []
    for place in ((1.5, 0.5, 1.5), (1.1, 0.9, 1.9), (5.5, 1, 1), (2, 4.5, 2), (-30, 1, 1)):
        (warning,) = said(mesh, place)
        assert "stand in a wall or object, or outside the room: at-0" in warning, place
    (warning,) = said(mesh, (2, 1.5, 2.5), (3.99, 1.5, 2.5), (2, 1.5, 2))
    assert "1 of 3 cameras stand less than 3 cm from a surface: at-1 (nearest: at-1, 1.0 cm)" in warning
    if mesh.vertices.min() < 0:
        assert "in a wall or object" in said(mesh, (4.1, 1.5, 2.5))[-1]


def test_nothing_around(said):
    far = scenes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    (warning,) = said(far, (0.5, 0.5, 4000))
    assert "1 of 1 cameras have no surface around them: at-0" in warning
