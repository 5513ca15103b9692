"""Shapes: the same rays must find the same points, fronts and texture coordinates as on Mitsuba's own shapes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fipt.scene.mesh import Mesh
from fipt.synthetic.settings import SceneFile

MOVE = '<transform name="toWorld"><scale x="1.2" y="0.8" z="1"/>'
MOVE += '<rotate x="0.6" y="0.8" angle="40"/><translate x="0.4"/></transform>'
MIRROR = '<transform name="toWorld"><scale x="-1.2" y="0.8" z="1"/></transform>'
OBJ = """v -1 -1 0\nv 1 -1 0.2\nv 1 1 0\nv -1 1 0.3\nv 0 0 1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5
vn 0 0 1
f 1/1/1 2/2/1 3/3/1 4/4/1
f 1/1/1 2/2/1 5/5/1
"""
BARE = re.sub(r"(?m)(/\d+)/1\b", r"\1", OBJ.replace("vn 0 0 1\n", ""))
"""The same without normals."""
PLY = """ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z
property float u\nproperty float v\nelement face 2\nproperty list uchar int vertex_indices\nend_header
-1 -1 0 0 0\n1 -1 0.1 1 0\n1 1 0 1 1\n-1 1 0.4 0 1\n3 0 1 2\n3 0 2 3\n"""

SHAPES = {
    "rectangle": f'<shape type="rectangle">{MOVE}</shape>',
    "rectangle-mirrored": f'<shape type="rectangle">{MIRROR}</shape>',
    "rectangle-flipped": f'<shape type="rectangle">{MOVE}<boolean name="flipNormals" value="true"/></shape>',
    "disk": f'<shape type="disk">{MOVE}</shape>',
    "cube": f'<shape type="cube">{MOVE}</shape>',
    "cube-mirrored": f'<shape type="cube">{MIRROR}</shape>',
    "sphere": '<shape type="sphere"><point name="center" x="0.2" y="0.1" z="0"/>'
    '<float name="radius" value="0.7"/></shape>',
    "cylinder": '<shape type="cylinder"><point name="p0" x="-1" y="0" z="0"/><point name="p1" x="1" y="0.2" z="0"/>'
    '<float name="radius" value="0.4"/></shape>',
    "obj": f'<shape type="obj"><string name="filename" value="m.obj"/>{MOVE}</shape>',
    "obj-mirrored": f'<shape type="obj"><string name="filename" value="m.obj"/>{MIRROR}</shape>',
    "obj-faces": '<shape type="obj"><string name="filename" value="m.obj"/>'
    '<boolean name="faceNormals" value="true"/></shape>',
    "obj-unflipped": '<shape type="obj"><string name="filename" value="m.obj"/>'
    '<boolean name="flipTexCoords" value="false"/></shape>',
    "obj-bare-mirrored": f'<shape type="obj"><string name="filename" value="bare.obj"/>{MIRROR}</shape>',
    "ply": f'<shape type="ply"><string name="filename" value="m.ply"/>{MOVE}</shape>',
    "ply-mirrored": f'<shape type="ply"><string name="filename" value="m.ply"/>{MIRROR}</shape>',
    "group": '<shape type="shapegroup" id="g"><shape type="rectangle"/></shape>'
    f'<shape type="instance"><ref id="g"/>{MOVE}</shape>',
}
ROUND = ("disk", "sphere", "cylinder")


def ours(path: Path):
    from fipt.synthetic.scenefile.shapes import geometry, placed
    from fipt.synthetic.scenefile.source import SceneFileReader
    from fipt.synthetic.scenefile.xml import read_tree

    source = SceneFileReader(path, SceneFile())
    found = [geometry(shape, source) for shape in placed(read_tree(path).root, source)]
    source.check()
    return found


def samples(scene, count: int = 6000):
    import mitsuba as mi

    rng = np.random.default_rng(1)
    target, origin = rng.uniform(-0.6, 0.6, (2, count, 3))
    origin = 4 * origin / np.linalg.norm(origin, axis=1, keepdims=True)
    direction = target - origin
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    ray = mi.Ray3f(
        mi.Point3f(*(mi.Float(a.astype(np.float32)) for a in origin.T)),
        mi.Vector3f(*(mi.Float(a.astype(np.float32)) for a in direction.T)),
    )
    si = scene.ray_intersect(ray)
    return np.array(si.is_valid()), np.array(si.p).T, np.array(si.sh_frame.n).T, np.array(si.uv).T


@pytest.mark.parametrize("name", SHAPES)
def test_rays_find_what_they_find_on_mitsubas_shapes(name, tmp_path, backend):
    import mitsuba as mi

    from fipt.render.reference import _mesh

    (tmp_path / "m.obj").write_text(OBJ)
    (tmp_path / "bare.obj").write_text(BARE)
    (tmp_path / "m.ply").write_text(PLY)
    text = f'<scene version="0.6.0">{SHAPES[name]}</scene>'
    (tmp_path / "scene.xml").write_text(text)
    theirs = samples(mi.load_file(str(tmp_path / "scene.xml")))
    (shape,) = ours(tmp_path / "scene.xml")
    mesh = Mesh(shape.vertices.astype(np.float32), shape.triangles)
    mine = samples(mi.load_dict({"type": "scene", "m": _mesh("m", mesh, shape.uv.astype(np.float32))}))
    round_ = any(name.startswith(kind) for kind in ROUND)
    assert (mine[0] != theirs[0]).mean() < (0.01 if round_ else 1e-3)
    both = mine[0] & theirs[0] & (np.linalg.norm(mine[1] - theirs[1], axis=1) < (0.05 if round_ else 1e-3))
    assert both.sum() > 0.95 * theirs[0].sum() > 500
    front = (mine[2][both] * theirs[2][both]).sum(axis=1)
    assert (front > 0).mean() > 0.999
    apart = np.abs(mine[3][both] - theirs[3][both])
    apart = np.minimum(apart, 1 - apart)  # round shapes close
    assert np.quantile(apart, 0.99) < (0.02 if round_ else 1e-3)


def test_serialized_files_by_index(tmp_path, backend):
    import mitsuba as mi

    quads = [mi.load_dict({"type": "cube", "to_world": mi.ScalarTransform4f().translate([k, 0, 0])}) for k in range(2)]
    serialized = tmp_path / "m.serialized"
    blobs = [
        _serialized(np.array(mi.traverse(q)["vertex_positions"]), np.array(mi.traverse(q)["faces"])) for q in quads
    ]
    offsets = np.cumsum([0] + [len(blob) for blob in blobs[:-1]])
    table = np.array(offsets, "<u8").tobytes() + np.array([len(blobs)], "<u4").tobytes()
    serialized.write_bytes(b"".join(blobs) + table)
    (tmp_path / "scene.xml").write_text(
        '<scene version="0.5.0"><shape type="serialized"><string name="filename" value="m.serialized"/>'
        '<integer name="shapeIndex" value="1"/></shape></scene>'
    )
    (shape,) = ours(tmp_path / "scene.xml")
    assert shape.vertices.min(axis=0).tolist() == [0, -1, -1]
    assert len(shape.triangles) == 12


def _serialized(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A mesh in Mitsuba's format, version 4: single precision, positions only."""
    import zlib

    counts = np.array([len(vertices) // 3, len(faces) // 3], "<u8").tobytes()
    body = np.array([0x1000], "<u4").tobytes() + b"m\0" + counts
    body += vertices.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    return np.array([0x041C, 4], "<u2").tobytes() + zlib.compress(body)


def test_faces_that_count_backwards(tmp_path, backend):
    from fipt.render.assets import load_mesh

    (tmp_path / "a.obj").write_text(OBJ)
    backwards = OBJ.replace("f 1/1/1 2/2/1 3/3/1 4/4/1", "f -5/-5/-1 -4/-4/-1 -3/-3/-1 -2/-2/-1")
    (tmp_path / "b.obj").write_text(backwards)
    a, b = (load_mesh("obj", tmp_path / name) for name in ("a.obj", "b.obj"))
    assert np.array_equal(a.vertices, b.vertices)
    assert np.array_equal(a.triangles, b.triangles)
    assert np.array_equal(a.uv, b.uv)


def test_slivers_go_and_the_rest_keeps_its_order(backend):
    from fipt.synthetic.scenefile.shapes import ShapeGeometry, without_slivers

    vertices = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (0, 0, 1), (np.nan, 0, 0)], float)
    triangles = np.array([(0, 1, 2), (0, 1, 3), (1, 1, 2), (0, 4, 2), (0, 5, 1)], np.int32)
    kept = without_slivers(ShapeGeometry(vertices * 1e-3, triangles, None)).triangles
    assert kept.tolist() == [[0, 1, 2], [0, 4, 2]]


def test_a_mask_cuts_the_clear_half(backend):
    from fipt.synthetic.scenefile.shapes import ShapeGeometry, cut
    from fipt.synthetic.scenefile.textures import Map

    quad = ShapeGeometry(
        np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float),
        np.array([(0, 1, 2), (0, 2, 3)], np.int32),
        np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float),
    )
    values = np.zeros((8, 8, 3), np.float32)
    values[:, 4:] = 1  # opaque where u > 0.5
    left = cut(quad, Map(values, np.eye(3)[:2]))
    mesh = Mesh(left.vertices.astype(np.float32), left.triangles)
    assert mesh.areas.sum() == pytest.approx(0.5, abs=0.07)
    assert (mesh.corners.mean(axis=1)[:, 0] > 0.4).all()
    assert np.allclose(left.uv, left.vertices[:, :2])
    whole = cut(quad, Map(np.ones((2, 2, 3), np.float32), np.eye(3)[:2]))
    assert Mesh(whole.vertices.astype(np.float32), whole.triangles).areas.sum() == pytest.approx(1)
