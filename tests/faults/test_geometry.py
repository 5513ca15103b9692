"""Geometry is not trusted: what does not belong to a room changes nothing, or is named."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.meshing.mend import far_origin, mended
from fipt.meshing.subdivide import subdivided
from fipt.render.scene import RayScene
from fipt.render.variant import Backend
from fipt.scene.cameras import read_origin, read_transforms
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh, read_geometry, write_ply
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


def test_coordinates_of_a_map_lose_nothing(tmp_path: Path) -> None:
    """The bits of the room moved by whole metres: nothing is rounded to float32 before it is near the origin."""
    shift, rng = np.array([512345.0, 5412345, 321]), np.random.default_rng(0)
    vertices = rng.uniform(0, 5, (300, 3)).astype(np.float32).astype(np.float64)
    triangles, centers = np.arange(300, dtype=np.int32).reshape(-1, 3), rng.uniform(0.5, 4.5, (9, 3))
    double_ply(tmp_path / "m.ply", vertices + shift, triangles)
    origin = far_origin(centers + shift)
    found, moved = mended(*read_geometry(tmp_path / "m.ply"), origin), mended(vertices, triangles, origin - shift)
    np.testing.assert_array_equal(found.mesh.vertices, moved.mesh.vertices)
    np.testing.assert_allclose(centers + shift - origin, centers - (origin - shift), rtol=0, atol=2**-30)


def test_a_unit_is_the_same_room(backend: Backend) -> None:
    source("plain", ROOM)
    source("millimetres", replace(ROOM, vertices=ROOM.vertices * 1000), scale=1000)
    plain, scaled = imported("plain"), imported("millimetres", unit=0.001)
    np.testing.assert_allclose(scaled.mesh().vertices, plain.mesh().vertices, atol=1e-6)
    for here, there in zip(plain.cameras, scaled.cameras, strict=True):
        np.testing.assert_allclose(there.world_from_camera, here.world_from_camera, atol=1e-9)


def mesh_scaled(factor: float) -> Mesh:
    return replace(ROOM, vertices=(ROOM.vertices * factor).astype(np.float32))


def mesh_around_origin(factor: float) -> None:
    """The origin is in the middle of the room, and the mesh in another unit."""
    middle = np.array([2, 1.5, 2.5])
    source("src", replace(ROOM, vertices=((ROOM.vertices - middle) * factor).astype(np.float32)), shift=tuple(-middle))


def scaled(factor: float) -> None:
    source("src", mesh_scaled(factor), scale=factor)


SCALES = [
    Fault("all in millimetres", lambda: scaled(1000), "likely millimetres (import.unit: 0.001)"),
    Fault("all in centimetres", lambda: scaled(100), "centimetres (import.unit: 0.01)"),
    Fault("all in kilometres", lambda: scaled(0.001), "likely kilometres (import.unit: 1000)"),
    Fault("mesh in millimetres", lambda: mesh_around_origin(1000), "scale the mesh by 0.001"),
    Fault("mesh in centimetres", lambda: mesh_around_origin(100), "scale the mesh by 0.01"),
    Fault("cameras in millimetres", lambda: source("src", ROOM, scale=1000), "scale the cameras by 0.001"),
]  # fmt: skip
IMPORT = ("import", "--source", "src", "--format", "nerfstudio", "--dataset", "out", "--settings")


@named(SCALES)
def test_a_wrong_scale_is_named(
    fault: Fault, backend: Backend, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    fault.plant()
    before = contents(tmp_path)
    assert fault.said in refused(capsys, *IMPORT, json.dumps(QUICK))
    assert contents(tmp_path) == before
    assert main([*IMPORT, json.dumps(QUICK | {"unit": 1, "prepare": "auto"})]) == 0  # somebody knows better
    assert "warning: " in capsys.readouterr().err


def with_dome(radius: float) -> Mesh:
    """The room without its ceiling on a wide ground, under a dome of many triangles: most rays leave the room."""
    level, round_ = np.linspace(0.01, np.pi / 2, 12), np.linspace(0, 2 * np.pi, 24)
    a, b = (grid.ravel() for grid in np.meshgrid(level, round_))
    dome = radius * np.stack([np.cos(a) * np.cos(b), np.sin(a), np.cos(a) * np.sin(b)], axis=-1)
    return joined([Mesh(ROOM.vertices, ROOM.triangles[:2]), Mesh(dome.astype(np.float32), quads(12, 24))])


def joined(parts: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    triangles = [part.triangles + start for part, start in zip(parts, starts, strict=False)]
    return Mesh(np.vstack([part.vertices for part in parts]), np.vstack(triangles).astype(np.int32))


def quads(columns: int, rows: int) -> np.ndarray:
    """Two triangles for each square of a grid of vertices."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    a, b, c, d = first, first + 1, first + columns, first + columns + 1
    return np.vstack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).astype(np.int32)


SOUND = [
    ("a room under a dome of 5 km", lambda: source("src", with_dome(5000.0)), "the mesh is 9.98e+03 m large"),
    ("a room on a ground of 4 km", lambda: source("src", joined([ROOM, GROUND])), "the mesh is 4e+03 m large"),
    ("a mesh in millimetres with the origin in its corner", lambda: source("src", mesh_scaled(1000)), "5e+03 m large"),
    ("a mesh in centimetres with the origin in its corner", lambda: source("src", mesh_scaled(100)), "500 m large"),
    ("a miniature of 25 cm", lambda: scaled(0.05), ""),
    ("a miniature of 10 cm", lambda: scaled(0.02), "cameras see half of it within 0.0"),
    ("a room", lambda: source("src", ROOM), ""),
]
GROUND = Mesh(np.array([[-2e3, -1, -2e3], [2e3, -1, -2e3], [-2e3, -1, 2e3], [2e3, -1, 2e3]], np.float32), quads(2, 2))


@pytest.mark.parametrize(("plant", "said"), [case[1:] for case in SOUND], ids=[case[0] for case in SOUND])
def test_a_sound_room_is_imported(
    plant: Callable[[], None], said: str, backend: Backend, capsys: pytest.CaptureFixture[str]
) -> None:
    plant()
    assert main([*IMPORT, json.dumps(QUICK)]) == 0
    assert ("give import.unit" in capsys.readouterr().err) == bool(said)
    assert any(said in warning for warning in json.loads(Path("out/prepare.json").read_text())["warnings"] or [""])


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
    given = ("--mesh", "geometry/mesh.ply", "--mesh-views", "geometry/views/transforms.json")
    assert main([*start, *given, "--dataset", "out"]) == 0
    np.testing.assert_array_equal(read_origin("out/transforms.json"), origin)
    np.testing.assert_allclose(Dataset("out").mesh().vertices, made, atol=1e-6)


def test_a_mesh_that_was_prepared_is_not_prepared_again(backend: Backend) -> None:
    """Noise and small triangles would ask for it, had the mesh not been made of these views."""
    source("src", ROOM)
    fine = subdivided(ROOM, lambda mesh: mesh.areas > 0.02)
    noise = np.random.default_rng(0).normal(scale=0.01, size=fine.vertices.shape)
    write_ply(Path("made.ply"), replace(fine, vertices=(fine.vertices + noise).astype(np.float32)))
    start = ["import", "--source", "src", "--format", "nerfstudio", "--settings", '{"overlay": false}']
    assert main([*start, "--mesh", "none", "--dataset", "views"]) == 0
    assert main([*start, "--mesh", "made.ply", "--dataset", "given"]) == 0
    made = ("--mesh", "made.ply", "--mesh-views", "views/transforms.json")
    assert main([*start, *made, "--dataset", "made"]) == 0
    assert [json.loads(Path(d, "prepare.json").read_text())["prepared"] for d in ("given", "made")] == [True, False]


def test_a_mesh_of_another_place_is_told(backend: Backend, capsys: pytest.CaptureFixture[str]) -> None:
    """No unit explains it: the samples refuse it in one line when they are traced."""
    source("src", ROOM, shift=(0, 400.0, 0))
    imported("src")
    assert "0% of the cameras' rays meet the mesh; check axes, unit and place of both" in capsys.readouterr().err


def test_a_mesh_that_is_there_twice_is_told(backend: Backend, capsys: pytest.CaptureFixture[str]) -> None:
    moved = replace(ROOM, vertices=ROOM.vertices + np.array([0.02, 0.015, 0.02], np.float32))
    source("src", joined([ROOM, moved]))
    imported("src", prepare="auto")
    assert "most of the mesh is there twice: behind " in capsys.readouterr().err
