"""Geometry is not trusted: what does not belong to a room changes nothing, or is named."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.meshing.mend import mended
from fipt.render.scene import RayScene
from fipt.render.variant import Backend
from fipt.scene.cameras import read_origin, read_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh, write_ply
from tests.faults.faults import Fault, contents, named, refused
from tests.layouts import POSES, room, write_nerfstudio

ROOM = room()
QUICK = {"overlay": False}


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def double_ply(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """A PLY whose positions are doubles, as surveyors write them."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(repr, map(float, row))) for row in vertices] + [f"3 {a} {b} {c}" for a, b, c in triangles]
    path.write_text("\n".join([*head, *rows]) + "\n")


def source(name: str, mesh: Mesh, scale: float = 1.0, shift: tuple[float, ...] = (0, 0, 0)) -> None:
    """A source of the box room with another mesh, its cameras scaled and moved."""
    content = write_nerfstudio(Path(name))
    write_ply(Path(name) / "mesh.ply", mesh)
    for frame in content["frames"]:
        matrix = np.array(frame["transform_matrix"])
        matrix[:3, 3] = matrix[:3, 3] * scale + shift
        frame["transform_matrix"] = matrix.tolist()
    (Path(name) / "transforms.json").write_text(json.dumps(content))


def imported(name: str, **settings: object) -> Dataset:
    values = json.dumps(QUICK | settings)
    assert (
        main(["import", "--source", name, "--format", "nerfstudio", "--dataset", f"{name}.out", "--settings", values])
        == 0
    )
    return Dataset(f"{name}.out")


def with_unused() -> Mesh:
    return replace(ROOM, vertices=np.vstack([ROOM.vertices, [[1e6, 0, 0]]]).astype(np.float32))


def with_doubled() -> Mesh:
    return replace(ROOM, triangles=np.vstack([ROOM.triangles, ROOM.triangles[:5], ROOM.triangles[:3, ::-1]]))


def with_degenerate() -> Mesh:
    return replace(ROOM, triangles=np.vstack([ROOM.triangles, [[0, 0, 1], [2, 2, 2]]]).astype(np.int32))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (with_unused, "1 unused vertices"),
        (with_doubled, "8 doubled triangles"),
        (with_degenerate, "2 triangles without area"),
    ],
)
def test_what_no_mesh_should_have_changes_no_byte(
    changed: Callable[[], Mesh], said: str, backend: Backend, capsys: pytest.CaptureFixture[str]
) -> None:
    source("plain", ROOM)
    source("other", changed())
    imported("plain")
    imported("other")
    err = capsys.readouterr().err
    assert f"warning: taken out of the mesh: {said}" in err
    assert ("; numbers of triangles are those of what stays" in err) == ("triangles" in said)
    plain, other = (
        {Path(path).relative_to(f"{name}.out"): value for path, value in contents(Path(f"{name}.out")).items()}
        for name in ("plain", "other")
    )
    told = {Path("prepare.json"), Path("import.manifest.json")}
    assert {path for path in plain if plain[path] != other[path]} == told
    assert plain.keys() == other.keys()


@pytest.mark.parametrize("shift", [0.0, 431234.0])
def test_what_is_written_is_compared(shift: float) -> None:
    """Doubles that differ by less than float32 holds are the same places once they are written."""
    corners = np.array([[3, 0, 0], [3, 1, 0], [3, 0, 1]], np.float64)
    close = corners + np.array([[1e-9, 0, 0], [0, 2e-9, 0], [0, 0, 0]])
    thin = np.array([[1, 1, 1], [1 + 1e-9, 1, 1], [2, 2, 2]], np.float64)
    vertices = np.vstack([corners, close, thin]) + np.array([shift, 0, 0])
    found = mended(vertices, np.arange(9, dtype=np.int32).reshape(3, 3), np.array([shift, 0, 0]))
    assert found.figures == {"unused_vertices": 6, "doubled": 1, "degenerate": 1}
    np.testing.assert_allclose(found.mesh.vertices, corners, atol=1e-6)


def test_coordinates_of_a_map_give_the_room_near_the_origin(
    backend: Backend, capsys: pytest.CaptureFixture[str]
) -> None:
    shift = (431234.5, 5412345.25, 312.0)
    source("plain", ROOM)
    source("map", ROOM, shift=shift)
    double_ply(Path("map/mesh.ply"), ROOM.vertices + np.array(shift), ROOM.triangles)
    plain, moved = imported("plain"), imported("map")
    assert "positions are those of a map" in capsys.readouterr().err
    origin = read_origin("map.out/transforms.json")
    assert not read_origin("plain.out/transforms.json").any()
    np.testing.assert_allclose(moved.mesh().vertices + origin, ROOM.vertices + np.array(shift), rtol=0, atol=1e-6)
    for here, there in zip(plain.cameras, moved.cameras, strict=True):
        np.testing.assert_allclose(there.center + origin, here.center + shift, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(here.world_from_camera[:3, :3], there.world_from_camera[:3, :3])


def test_a_unit_is_the_same_room(backend: Backend) -> None:
    source("plain", ROOM)
    source("millimetres", replace(ROOM, vertices=ROOM.vertices * 1000), scale=1000)
    plain, scaled = imported("plain"), imported("millimetres", unit=0.001)
    np.testing.assert_allclose(scaled.mesh().vertices, plain.mesh().vertices, atol=1e-6)
    for here, there in zip(plain.cameras, scaled.cameras, strict=True):
        np.testing.assert_allclose(there.world_from_camera, here.world_from_camera, atol=1e-9)


def mesh_scaled(factor: float) -> Mesh:
    return replace(ROOM, vertices=(ROOM.vertices * factor).astype(np.float32))


def scaled(factor: float) -> None:
    source("src", mesh_scaled(factor), scale=factor)


SCALES = [
    Fault("all in millimetres", lambda: scaled(1000), "likely millimetres (import.unit: 0.001)"),
    Fault("all in centimetres", lambda: scaled(100), "centimetres (import.unit: 0.01)"),
    Fault("all in kilometres", lambda: scaled(0.001), "likely kilometres (import.unit: 1000)"),
    Fault("mesh in millimetres", lambda: source("src", mesh_scaled(1000)), "scale the mesh by 0.001"),
    Fault("mesh in centimetres", lambda: source("src", mesh_scaled(100)), "scale the mesh by 0.01"),
    Fault("cameras in millimetres", lambda: source("src", ROOM, scale=1000), "scale the cameras by 0.001"),
]  # fmt: skip


@named(SCALES)
def test_a_wrong_scale_is_named(
    fault: Fault, backend: Backend, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    fault.plant()
    before = contents(tmp_path)
    said = refused(
        capsys,
        *("import", "--source", "src", "--format", "nerfstudio", "--dataset", "out", "--settings", json.dumps(QUICK)),
    )
    assert fault.said in said
    assert contents(tmp_path) == before


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_an_object_far_away_does_not_set_the_scale(far: float, backend: Backend) -> None:
    centers = np.array([view.origin for view in POSES])
    thing = np.array([[far, 0, 0], [far, 1, 0], [far, 0, 1]], np.float32)
    mesh = Mesh(np.vstack([ROOM.vertices, thing]), np.vstack([ROOM.triangles, [[8, 9, 10]]]).astype(np.int32), centers)
    plain = RayScene(replace(ROOM, seen_from=centers))
    assert RayScene(ROOM).epsilon == plain.epsilon
    assert 0.9 * plain.epsilon < RayScene(mesh).epsilon < 1.001 * plain.epsilon
    # without cameras the bounds are all that is known, of what triangles use
    assert RayScene(replace(mesh, seen_from=None)).extent == pytest.approx(far, rel=1e-2)
    assert RayScene(replace(mesh, triangles=ROOM.triangles, seen_from=None)).epsilon == plain.epsilon


def test_offsets_grow_outside_the_bounds_only(backend: Backend) -> None:
    import mitsuba as mi

    scene = RayScene(ROOM)
    points = mi.Point3f(np.array([[0, 0, 0], [4, 3, 5], [2, 1, 2], [2, 1.5, 5002.5]], np.float32).T)
    offsets = scene.offset(points).numpy() / scene.epsilon
    np.testing.assert_allclose(offsets, [1, 1, 1, 1000], rtol=1e-5)


def test_a_dataset_knows_where_its_cameras_stand(backend: Backend) -> None:
    source("src", ROOM)
    data = imported("src")
    seen_from = data.mesh().seen_from
    assert seen_from is not None
    np.testing.assert_array_equal(seen_from, [camera.center for camera in read_transforms("src.out/transforms.json")])


def test_a_mesh_made_of_imported_views_is_in_their_place(backend: Backend) -> None:
    """Views alone are imported first, the mesh is made of them, and both come together."""
    shift = (431234.5, 5412345.25, 312.0)
    source("map", replace(ROOM, vertices=ROOM.vertices * 1000), scale=1000, shift=tuple(1000 * x for x in shift))
    start = ["import", "--source", "map", "--format", "nerfstudio", "--settings", json.dumps(QUICK | {"unit": 0.001})]
    assert main([*start, "--mesh", "none", "--dataset", "geometry/views"]) == 0
    origin = read_origin("geometry/views/transforms.json")
    made = (ROOM.vertices + np.array(shift) - origin).astype(np.float32)
    write_ply(Path("geometry/mesh.ply"), replace(ROOM, vertices=made))
    assert main([*start, "--mesh", "geometry/mesh.ply", "--dataset", "out"]) == 0
    np.testing.assert_array_equal(read_origin("out/transforms.json"), origin)
    np.testing.assert_allclose(Dataset("out").mesh().vertices, made, atol=1e-6)


def test_a_mesh_of_another_place_is_told(backend: Backend, capsys: pytest.CaptureFixture[str]) -> None:
    """No unit explains it: the samples refuse it in one line when they are traced."""
    source("src", ROOM, shift=(0, 400.0, 0))
    imported("src")
    assert "0% of the cameras' rays meet the mesh; check axes, unit and place of both" in capsys.readouterr().err
