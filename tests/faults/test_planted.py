"""Faults of all kinds, each planted in a tiny source or file: one line, code 2, and nothing is written."""

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.lens import Lens
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.objects import read_object
from fipt.scene.setup import parse_setup
from fipt.stages.capture.calibration import Calibration, read_calibration, write_calibration
from fipt.stages.capture.raw import _shot
from fipt.stages.importing.build import import_scene
from fipt.stages.importing.settings import ImportSettings
from tests import scenes
from tests.fake_results import write_results
from tests.faults.faults import Fault, contents, named, refused
from tests.layouts import room, write_nerfstudio

ROOM = room()
SETTINGS = json.dumps({"overlay": False, "prepare": "never"})
IMPORT = ("import", "--source", "src", "--format", "nerfstudio", "--dataset", "out", "--settings", SETTINGS)


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def said_by(change: Callable[[dict[str, Any]], object]) -> Callable[[], None]:
    """A source whose transforms.json is changed."""

    def plant() -> None:
        content = write_nerfstudio(Path("src"))
        change(content)
        Path("src/transforms.json").write_text(json.dumps(content))

    return plant


def of_frame(**keys: Any) -> Callable[[], None]:
    return said_by(lambda content: content["frames"][0].update(keys))


def of_all(**keys: Any) -> Callable[[], None]:
    return said_by(lambda content: content.update(keys))


def image(write: Callable[[Path], object]) -> Callable[[], None]:
    """A source whose first image is something else."""

    def plant() -> None:
        write_nerfstudio(Path("src"))
        path = Path("src/images/view_0.exr")
        path.unlink()
        write(path)

    return plant


def marked(name: str, value: float) -> Callable[[], None]:
    """A source whose first image has a layer of one value."""
    return image(lambda path: write_exr(path, {"": np.ones((6, 8, 3)), name: np.full((6, 8), value, np.float32)}))


def mesh(vertices: np.ndarray = ROOM.vertices, triangles: np.ndarray = ROOM.triangles) -> Callable[[], None]:
    def plant() -> None:
        write_nerfstudio(Path("src"))
        write_ply(Path("src/mesh.ply"), Mesh(vertices.astype(np.float32), triangles.astype(np.int32)))

    return plant


def obj(text: str) -> Callable[[], None]:
    def plant() -> None:
        write_nerfstudio(Path("src"))
        Path("src/mesh.ply").unlink()
        Path("src/mesh.obj").write_text(text)

    return plant


def ply(text: str) -> Callable[[], None]:
    def plant() -> None:
        write_nerfstudio(Path("src"))
        Path("src/mesh.ply").write_text(text)

    return plant


def twice() -> None:
    write_nerfstudio(Path("src"))
    path = Path("src/transforms.json")
    path.write_text(path.read_text().replace('"h": 6', '"h": 6, "w": 9'))


def far(vertex: int, value: float) -> np.ndarray:
    changed = ROOM.vertices.astype(np.float64)
    changed[vertex] = value
    return changed


FAR_AWAY = (np.eye(4) + 1e30 * np.eye(4, k=3)).tolist()
NO_POSE = "transform_matrix must be a 4x4 matrix of finite numbers"
LISTED = [f"images/view_{number}.exr" for number in range(3)]
PLY = (
    """ply
format ascii 1.0
element vertex 8
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
"""
    + "".join(f"{x} {y} {z}\n" for x in (0, 4) for y in (0, 3) for z in (0, 5))
    + "3 0 1 2\n3 2 1 3\n3 4 5 6\n3 6 5 7\n"
)
OBJ = "".join(f"v {n} {n % 2} {n % 3}\n" for n in range(12)) + "f 1 2 3\nf 4 5 6\nf 7 8 9\nf 10 11 12\n"
SLASHES = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1/1/1 2/2/1 3/3/1\nf 1/1/1 2/2/1 4/4/1\n"
SOURCES = [
    Fault("a frame twice", said_by(lambda c: c["frames"].append(c["frames"][0])), "or remove a frame that is listed"),
    Fault("an image outside", of_frame(file_path="../../etc/passwd"), "the first is view passwd"),
    Fault("an image that is a number", of_frame(file_path=3), "every frame must have an image"),
    Fault("no frames", of_all(frames=[]), "must list at least one frame"),
    Fault("frames that are words", of_all(frames=["a"]), "src/transforms.json is not a transforms.json with frames"),
    Fault("half a pixel", of_all(w=8.5), "w must be a whole number of pixels; found 8.5"),
    Fault("a focal length of NaN", of_all(fl_x=float("nan")), "fl_x must be a finite number above 0"),
    Fault("a scaled pose", of_frame(transform_matrix=np.diag([2.0, 2, 2, 1]).tolist()), "a mirrored or scaled camera"),
    Fault("a pose of lists", of_frame(transform_matrix=[[[1]] * 4] * 4), "frame 0 is malformed"),
    Fault("a camera beyond the stars", of_frame(transform_matrix=FAR_AWAY), NO_POSE),
    Fault("a fish eye", of_all(camera_model="OPENCV_FISHEYE"), "cameras must be pinholes; found OPENCV_FISHEYE"),
    Fault("one view", said_by(lambda c: c.update(frames=c["frames"][:1])), "must have at least one train view"),
    Fault("an image without colours", image(lambda p: write_exr(p, {"Y": np.ones((6, 8))})), "channels R, G, B"),
    Fault("an image of another size", image(lambda p: write_exr(p, {"": np.ones((3, 4, 3))})), "must be 8x6 like its"),
    Fault("a pipe as image", image(os.mkfifo), "every frame must have an image"),
    Fault("a link to itself as image", image(lambda p: p.symlink_to(p.name)), "every frame must have an image"),
    Fault("a mesh without triangles", mesh(triangles=ROOM.triangles[:0]), "must hold triangles; it has none"),
    Fault("a vertex of NaN", mesh(far(3, np.nan)), "must have finite vertices; 1 are NaN or infinite"),
    Fault("a vertex beyond the stars", mesh(far(3, 1e30)), "must lie within 1e+12 of the origin; 1 do not"),
    Fault("a triangle of no vertex", mesh(triangles=ROOM.triangles + 1), "refers to vertices it does not have"),
    Fault("no triangle with an area", mesh(ROOM.vertices * 0), "none of the mesh's triangles has an area"),
    Fault("vertices of two numbers", obj("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n"), "vertex 0 has 2 coordinates"),
    Fault("a face of vertex 0", obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n"), "refers to vertices it does not have"),
    Fault("a truth value for a focal length", of_all(fl_x=True), "a number must stand where true does"),
    Fault("a truth value in a pose", of_frame(transform_matrix=[[1, 0, 0, True]] * 3), "must stand where true does"),
    Fault("an angle in degrees", of_all(camera_angle_x=90.0), "camera_angle_x must be in radians, below pi; found 90"),
    Fault("pixels a hundred times as long as wide", of_all(fl_y=400.0), "focal lengths of 4 and 400 pixels"),
    Fault("views that differ by case", of_frame(file_path="images/VIEW_1.exr"),
          "src, views: VIEW_1 and view_1 differ by case alone"),
    Fault("a view that is trained and held out", of_all(train_filenames=LISTED, val_filenames=LISTED[:1]),
          "images/view_0.exr is listed for training, and as held out"),
    Fault("a picture of the web", of_frame(file_path="images/view_0.webp"), "images must be EXR files with linear"),
    Fault("equal keys", twice, "src/transforms.json is not JSON (the key 'w' is there twice)"),
    Fault("a mesh of text that is cut", ply(PLY[:-12]), "its header announces 12 lines, 11 follow"),
    Fault("a mesh of more lines than it says", ply(PLY.replace("face 4", "face 2")), "announces 10 lines, 12 follow"),
    Fault("a focal length of a millionth of a pixel", of_all(fl_x=1e-6, fl_y=1e-6), "must be 0.01 to 10000 times as"),
    Fault("a focal length of a billion pixels", of_all(fl_x=1e9, fl_y=1e9), "found 1e+09 of 8 pixels"),
    Fault("a principal point of NaN", of_all(cx=float("nan")), "cx must be a finite number; found nan"),
    Fault("weights of NaN", marked("valid.Y", np.nan), "valid.Y must lie between 0 and 1; 48 pixels do not"),
    Fault("weights of 7", marked("valid.Y", 7), "valid.Y must lie between 0 and 1"),
    Fault("flags below zero", marked("flags.Y", -1), "flags.Y must lie between 0 and"),
    Fault("a focal length against an angle of view", of_all(camera_angle_x=1.0),
          "fl_x and camera_angle_x must mean one lens; 4 pixels are not the 7.32195"),
    Fault("a height that its angle of view contradicts", of_all(camera_angle_y=2.0), "fl_y and camera_angle_y must"),
    Fault("an OBJ cut in its last face", obj(OBJ[:-2]), "'f 10 11 1', has no end, and some vertices belong to no face"),
    Fault("an OBJ cut in a slash", obj(SLASHES[:-3]), "has no end, and the face before is written in another form"),
    Fault("an OBJ cut in a vertex", obj(OBJ + "v 1 1 0.123"), "has no end, and vertices follow the last face"),
    Fault("an OBJ of fewer faces than it says", obj("# Faces: 9\n" + OBJ), "it announces 9 faces, and holds 4"),
    Fault("an OBJ of fewer vertices than it says", obj("# number of vertices: 19\n" + OBJ), "announces 19 vertices"),
    Fault("a face of two vertices", obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n"), "face 0 has 2 vertices"),
    Fault("an applied transform of words", of_all(applied_transform="a"), "applied_transform must be a 3x4 matrix"),
    Fault("an applied scale of nothing", of_all(applied_scale=-1), "src/transforms.json: applied_transform must be"),
    Fault("faces of words", obj("v 0 0 0\nf x y z\n"), "src/mesh.obj is not a readable mesh"),
]  # fmt: skip


@named(SOURCES)
def test_a_source_that_cannot_be(fault: Fault, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    fault.plant()
    before = contents(tmp_path)
    assert fault.said in refused(capsys, *IMPORT)
    assert contents(tmp_path) == before


def test_one_image_under_two_names_and_a_black_one_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    content = write_nerfstudio(Path("src"), w=24, h=18, fl_x=12.0, fl_y=12.0, cx=12.0, cy=9.0)
    content["frames"].append({**content["frames"][0], "file_path": "images/view_3.exr"})
    Path("src/transforms.json").write_text(json.dumps(content))
    same = np.random.default_rng(0).random((18, 24, 3), np.float32)
    for number, pixels in enumerate((same, same, 0.5 * same, 0 * same)):
        write_exr(f"src/images/view_{number}.exr", {"": pixels})
    assert main([*IMPORT]) == 0
    said = capsys.readouterr().err
    assert "warning: views view_0, view_1 have one and the same image" in said
    assert "warning: no pixel of view_3 shows any light" in said


COLMAP_TO_NERFSTUDIO = [[1, 0, 0, 0.5], [0, 0, 1, 0], [0, -1, 0, 0]]


def test_cameras_that_nerfstudio_has_turned_are_told_or_turned_back(capsys: pytest.CaptureFixture[str]) -> None:
    content = write_nerfstudio(Path("src"))
    import_scene("src", "nerfstudio", "plain", ImportSettings.model_validate_json(SETTINGS))
    applied = np.vstack([np.array(COLMAP_TO_NERFSTUDIO), [0, 0, 0, 1]])
    for frame in content["frames"]:
        moved = applied @ frame["transform_matrix"]
        moved[:3, 3] *= 2
        frame["transform_matrix"] = moved.tolist()
    content |= {"applied_transform": COLMAP_TO_NERFSTUDIO, "applied_scale": 2}
    Path("src/transforms.json").write_text(json.dumps(content))
    assert main([*IMPORT]) == 0
    assert "that applied_transform has changed, and the mesh must be in the same" in capsys.readouterr().err
    undo = json.dumps(json.loads(SETTINGS) | {"undo_transform": True})
    assert main([*IMPORT[:-1], undo]) == 0
    assert "applied_transform" not in capsys.readouterr().err
    for plain, found in zip(Dataset("plain").cameras, Dataset("out").cameras, strict=True):
        np.testing.assert_allclose(found.world_from_camera, plain.world_from_camera, atol=1e-12)
    assert "there is no applied_transform to undo" in refused(
        capsys, "import", "--source", "plain", "--format", "fipt", "--dataset", "new", "--settings", undo
    )
    Path("src/transforms.json").write_text(json.dumps(content | {"applied_transform": [[1, 0, 0, 0]] * 3}))
    assert "applied_transform must be a rotation" in refused(capsys, *IMPORT[:-1], undo)


def test_views_of_one_place_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    content = write_nerfstudio(Path("src"))
    assert main([*IMPORT]) == 0
    assert "from one place" not in capsys.readouterr().err
    for number, frame in enumerate(content["frames"]):
        for row, value in enumerate((1.0, 1.5, 4.2 + 0.002 * number)):
            frame["transform_matrix"][row][3] = value
    Path("src/transforms.json").write_text(json.dumps(content))
    assert main([*IMPORT]) == 0
    said = capsys.readouterr().err
    assert "training views are from one place, within 0.2 cm: nothing tells whether the mesh is where" in said
    assert "one place" in Path("out/prepare.json").read_text()


def test_an_unused_vertex_beyond_the_stars_does_no_harm(capsys: pytest.CaptureFixture[str]) -> None:
    mesh(np.vstack([ROOM.vertices, [[1e30, 0, 0]]]))()
    assert main(list(IMPORT)) == 0
    assert "1 unused vertices" in capsys.readouterr().err


BALL = {"shape": "sphere", "center": [1, 1, 1], "radius": 0.2, "radiance": [5, 5, 5]}
LIGHT: list[tuple[str, dict[str, Any], str]] = [
    ("a light beyond the stars", {"lights": [BALL | {"center": [1e30, 0, 0]}]}, "setup.lights.0.center.0: "),
    ("a light of a planet's size", {"lights": [BALL | {"radius": 1e30}]}, "setup.lights.0.radius: "),
    ("a light without size", {"lights": [BALL | {"radius": 1e-30}]}, "setup.lights.0.radius: "),
    ("a light as float32 cannot hold", {"lights": [BALL | {"radiance": [1e300, 0, 0]}]}, "lights.0.radiance.0: "),
    (
        "two numbers for a colour",
        {"lights": [BALL | {"radiance": [1, 1]}]},
        "lights.0.radiance.2: field required",
    ),
    ("two numbers for a place", {"lights": [BALL | {"center": [1, 1]}]}, "setup.lights.0.center.2: field required"),
    ("words for a place", {"lights": [BALL | {"center": "here"}]}, "setup.lights.0.center: "),
    ("lamps a billion billion times", {"emitters": [{"scale": 1e30}]}, "setup.emitters.0.scale: "),
]


@pytest.mark.parametrize(("setup", "said"), [each[1:] for each in LIGHT], ids=[each[0] for each in LIGHT])
def test_a_light_setup_that_cannot_be(setup: dict[str, Any], said: str) -> None:
    with pytest.raises(FiptError) as caught:
        parse_setup(json.dumps(setup))
    assert said in str(caught.value)


def test_a_light_setup_that_says_a_thing_twice() -> None:
    with pytest.raises(FiptError, match=r"setup must be JSON .the key 'emitters' is there twice"):
        parse_setup('{"emitters": [{"scale": 0}], "emitters": [{"scale": 1}]}')


def test_an_object_whose_file_is_cut() -> None:
    Path("o.obj").write_text(OBJ[:-2])
    with pytest.raises(FiptError, match=r"o\.obj is not a readable mesh .it is cut: its last line, 'f 10 11 1', has"):
        read_object(Path("o.obj"))


def test_a_mesh_that_may_be_cut(caplog: pytest.LogCaptureFixture) -> None:
    Path("o.obj").write_text(OBJ[:-1])
    assert len(read_object(Path("o.obj")).mesh.triangles) == 4
    assert "o.obj may be cut: its last line, 'f 10 11 12', has no end; end it if it is whole" in caplog.text


def test_an_object_beyond_the_stars() -> None:
    Path("o.obj").write_text("v 0 0 0\nv 1e30 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FiptError, match=r"o\.obj has 1 vertices that are NaN, infinite or farther than 1e\+12"):
        read_object(Path("o.obj"))


CARD: dict[str, Any] = {
    "id": "fipt", "seed": 0, "label": "ours", "kind": "method", "random": True, "not_estimated": [], "oracle": [],
}  # fmt: skip
FIGURES: dict[str, Any] = {"val": {"kd_psnr": 20.0}, "train": {}, "relight": {}}
JOB: dict[str, Any] = {"wall_s": 1.0, "peak_memory_bytes": 3}
SCORES: dict[str, tuple[object, object, object]] = {
    "figures in a list": (CARD, [], JOB),
    "a split that is a list": (CARD, {"val": [1]}, JOB),
    "a figure of NaN": (CARD, {"val": {"kd_psnr": float("nan")}}, JOB),
    "a setup that is a number": (CARD, FIGURES | {"relight": {"a": 3}}, JOB),
    "stats in a list": (CARD, FIGURES, []),
    "stats without a time": (CARD, FIGURES, {}),
    "a time in words": (CARD, FIGURES, JOB | {"wall_s": "long"}),
    "a card of a thing unknown": (CARD | {"not_estimated": ["x"]}, FIGURES, JOB),
    "a card in a list": ([], FIGURES, JOB),
}


@pytest.mark.parametrize("name", SCORES)
def test_a_method_is_scored_by_files_of_their_form(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    card, figures, job = SCORES[name]
    Path("metrics.json").write_text(json.dumps(figures))
    Path("job.json").write_text(json.dumps(job))
    files = ("--metrics", "metrics.json", "--jobs", "job.json", "--out", "method.json")
    said = refused(capsys, "score", "--card", json.dumps(card), *files)
    assert "--card must be the card of a method" in said or "metrics.json, job.json" in said
    assert not Path("method.json").exists()


@pytest.mark.parametrize("content", ["[]", "{}", '{"figures": []}', '{"figures": {"relight": {}}}'])
def test_methods_are_compared_by_files_of_their_form(content: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("method.json").write_text(content)
    said = refused(capsys, "compare", "--methods", "method.json", "--out", "table.json")
    assert "does not have its form" in said
    assert list(Path().iterdir()) == [Path("method.json")]


METRICS = ("metrics", "--dataset", "x/dataset", "--materials", "x/materials", "--render", "x/render", "--out", "m.json")


def test_figures_of_a_setup_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    write_results(Path("x"))
    assert "--setups needs --relight" in refused(capsys, *METRICS, "--setups", "ghost")
    for setup in ("ghost", "dim,ghost"):
        line = refused(capsys, *METRICS, "--relight", "x/relight", "--setups", setup)
        assert "names ghost, but x/dataset/relight_truth/ghost has no image; there is truth of dim" in line
    for path in Path("x/relight/dim").iterdir():
        path.unlink()
    assert "but x/relight/dim has no image" in refused(capsys, *METRICS, "--relight", "x/relight", "--setups", "dim")
    assert not Path("m.json").exists()


OPTIONS: dict[str, tuple[tuple[str, ...], str]] = {
    "a shard twice": (("cache", "--samples", "s,s", "--out", "c.npz"), "--samples names s twice; name it once"),
    "a shard twice, by two names": (("cache", "--samples", "s,t/../s", "--out", "c.npz"), "names t/../s twice; name"),
    "a view twice": (("samples", "--views", "a,b,a", "--out", "s"), "--views names a twice"),
    "no view": (("samples", "--views", "", "--out", "s"), "--views names nothing"),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_options_that_say_too_much_or_nothing(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    options, said = OPTIONS[name]
    assert said in refused(capsys, *options, "--dataset", "d")


RESULTS = {
    "an image of another size": ("render/a.exr", "render/a.exr must be 16x12 like its view; it is 7x5"),
    "maps of another size": ("materials/a.exr", "materials/a.exr must be 16x12 like its view; it is 7x5"),
    "a picture that is cut": ("dataset/overlay.png", "dataset/overlay.png is not a readable image"),
    "figures in words": ("metrics.json", "metrics.json does not hold what its stage writes"),
    "times in words": ("stats/fit.json", "stats does not hold what its stage writes"),
    "a light setup in a list": ("relight/a.train-000.manifest.json", "does not hold what its stage writes"),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_report_is_made_of_files_of_their_form(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    place, said = RESULTS[name]
    scenes.write_dataset(Path("x/dataset"))
    file = Path("x", place)
    file.parent.mkdir(exist_ok=True)
    Path("x/relight/a").mkdir(parents=True)
    if file.suffix == ".exr":
        write_exr(file, {"": np.ones((5, 7, 3))})
    else:
        content = {"val": {"render_exposure_scale": "a"}, "wall_s": "long", "settings": [], "files": {}}
        file.write_text("PNG" if file.suffix == ".png" else json.dumps(content))
    assert said in refused(capsys, "report", "--results", "x", "--out", "x/report.html")
    assert not Path("x/report.html").exists()


def test_no_training_view_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    scenes.write_dataset(Path("d"))
    write_views("d/views.json", ["a", "b", "c"], dict.fromkeys("ab", "it is bad"))
    line = refused(capsys, "samples", "--dataset", "d", "--views", "a", "--out", "s")
    assert "d has no training view that no check rejected" in line
    assert not Path("s").exists()


def test_a_folder_where_a_file_must_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    write_exr(Path("a.exr"), {"": np.ones((4, 4, 3))})
    Path("a.png").mkdir()
    assert "a.png cannot be written: a folder stands where a file" in refused(capsys, "view", "a.exr", "--out", "a.png")
    assert "cannot be written" in refused(capsys, "view", "a.exr", "--out", "/proc/a.png")
    assert list(Path("a.png").iterdir()) == []


def test_a_working_directory_that_is_gone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "gone").mkdir()
    os.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    try:
        assert "the working directory is gone" in refused(capsys, "run", "demo")
    finally:
        os.chdir(tmp_path)


RAMP = tuple((value / 64 - 2,) * 3 for value in range(256))
SOUND = Calibration("ldr", None, 32, 24, response=RAMP, lens=Lens(32, 24, 20.0, 20.0, 16.0, 12.0))
NAN = float("nan")
CALIBRATIONS: dict[str, tuple[dict[str, Any], str]] = {
    "without a response": ({"response": None}, "must have 256 rows of three numbers"),
    "with ten rows of a response": ({"response": RAMP[:10]}, "must have 256 rows of three numbers"),
    "with a response of NaN": ({"response": ((NAN,) * 3,) * 256}, "response must be finite numbers"),
    "with a white balance of NaN": ({"white_balance": (NAN, 1.0, 1.0)}, "white_balance must be finite numbers"),
    "of no pixels": ({"width": 0, "height": 0}, "size, white balance and focal lengths must be above 0"),
    "with a focal length of 0": ({"lens": Lens(32, 24, 0.0, 1.0, 1.0, 1.0)}, "focal lengths must be above 0"),
    "with a lens of NaN": ({"lens": Lens(32, 24, NAN, 1.0, 1.0, 1.0)}, "lens must be finite numbers"),
}


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_a_calibration_of_no_camera(name: str) -> None:
    changed, said = CALIBRATIONS[name]
    write_calibration("c.json", SOUND)
    read_calibration("c.json")
    write_calibration("c.json", replace(SOUND, **changed))
    with pytest.raises(FiptError, match=r"c\.json is not a calibration .*; run fipt calibrate again") as caught:
        read_calibration("c.json")
    assert said in str(caught.value)


class OfAnotherTime:
    """What LibRaw knows of a file that states a time which no calendar has."""

    lens = None

    @property
    def other(self) -> None:
        raise ValueError("year 12026 is out of range")


def test_a_photograph_of_the_year_12026() -> None:
    """Found by damaging 10,000 DNG files."""
    assert _shot(Path("a.dng"), {}, OfAnotherTime()).time is None
