"""Meshes: order, sizes, and what is said of bad ones."""

from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.scene import mesh
from fipt.scene.mesh import Mesh, read_mesh, write_ply
from tests.layouts import room, write_obj


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_round_trip_keeps_every_order(tmp_path: Path, np_rng: np.random.Generator, suffix: str) -> None:
    vertices = np_rng.normal(size=(50, 3)).astype(np.float32)
    vertices[10] = vertices[20]  # equal vertices must not be merged
    triangles = np_rng.integers(0, 50, (80, 3)).astype(np.int32)
    triangles[7] = (3, 3, 4)  # nor degenerate triangles dropped
    written = Mesh(vertices, triangles)
    path = tmp_path / f"mesh{suffix}"
    (write_ply if suffix == ".ply" else write_obj)(path, written)
    read = read_mesh(path)
    np.testing.assert_array_equal(read.corners, written.corners)
    assert read.vertices.dtype == np.float32
    assert read.triangles.dtype == np.int32


def test_objects_of_a_file_are_merged_in_order(tmp_path: Path) -> None:
    text = (
        "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nusemtl x\nv 0 0 1\nf 2 3 4\no a\nf 1 3 4\n"
        "usemtl y\nf 1//1 2/7/2 -1/2 3\n"
    )
    (tmp_path / "a.obj").write_text(text)
    merged = read_mesh(tmp_path / "a.obj")
    expected = [[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                [[0, 0, 0], [0, 1, 0], [0, 0, 1]],
                [[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 0, 0], [0, 0, 1], [0, 1, 0]]]  # fmt: skip
    np.testing.assert_array_equal(merged.corners, expected)


def test_areas_and_normals() -> None:
    box = room()
    assert box.areas.sum() == pytest.approx(2 * (4 * 3 + 4 * 5 + 3 * 5))
    np.testing.assert_allclose(np.linalg.norm(box.normals, axis=1), 1, rtol=1e-6)
    flat = Mesh(np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    assert (flat.normals == 0).all()


def test_colours_do_not_disturb_the_geometry(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply", room(), np.full((8, 3), 200, np.uint8))
    np.testing.assert_array_equal(read_mesh(tmp_path / "a.ply").corners, room().corners)


@pytest.mark.parametrize("colors", [None, np.full((8, 3), 200, np.uint8)])
def test_what_we_wrote_is_read_without_trimesh_and_alike(tmp_path: Path, monkeypatch, colors) -> None:
    write_ply(tmp_path / "a.ply", room(), colors)
    by_trimesh = mesh._read_other(tmp_path / "a.ply")
    monkeypatch.setattr(mesh, "_read_other", None)
    for own, other in zip(mesh.read_geometry(tmp_path / "a.ply"), by_trimesh, strict=True):
        np.testing.assert_array_equal(own, other)
        assert own.dtype == other.dtype


def test_faces_of_other_programs_that_have_four_corners_become_triangles(tmp_path: Path) -> None:
    """Their header may be ours to the byte."""
    write_ply(tmp_path / "a.ply", Mesh(room().vertices[:4], np.array([[0, 1, 2]], np.int32)))
    content = (tmp_path / "a.ply").read_bytes()[:-13]
    (tmp_path / "a.ply").write_bytes(content + b"\x04" + np.array([0, 1, 2, 3], "<i4").tobytes())
    assert read_mesh(tmp_path / "a.ply").triangles.shape == (2, 3)


@pytest.mark.parametrize("missing", [1, 13, 40])
def test_a_mesh_that_was_cut_short(tmp_path: Path, missing: int) -> None:
    write_ply(tmp_path / "a.ply", room())
    (tmp_path / "a.ply").write_bytes((tmp_path / "a.ply").read_bytes()[:-missing])
    with pytest.raises(FiptError, match="not a readable mesh"):
        read_mesh(tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "must hold triangles; it has none"),
        ("a.obj", "", "must hold triangles; it has none"),
        ("a.obj", "v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", "1 are NaN or infinite, .* vertex 1"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "vertices it does not have"),
        ("a.obj", "v 0 0 0\nv 1 0\nf 1 2 1\n", "not a readable mesh"),
        ("a.obj", "v 0 0 0\nf 1 a 1\n", "not a readable mesh .*'a'"),
        ("a.ply", "nonsense", "not a readable mesh"),
        ("a.xyz", "0 0 0\n", "must hold triangles|not a readable mesh"),
    ],
)  # fmt: skip
def test_bad_meshes(tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(FiptError, match=message):
        read_mesh(tmp_path / name)


def test_a_missing_mesh(tmp_path: Path) -> None:
    with pytest.raises(FiptError, match=r"the mesh is missing: .*scene\.obj"):
        read_mesh(tmp_path / "scene.obj")
