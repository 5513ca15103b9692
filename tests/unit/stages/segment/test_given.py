"""Ids that exist already: every form they come in, and what is said of bad ones."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from fipt.config import load
from fipt.errors import FiptError
from fipt.formats.arrays import save_npz
from fipt.formats.exr import write_exr
from fipt.formats.images import write_png
from fipt.formats.manifests import read_manifest
from fipt.scene.dataset import Dataset
from fipt.scene.samples import read_samples
from fipt.scene.segments import read_view_ids, write_view_ids
from fipt.stages.segment.degraded import DegradedIds
from fipt.stages.segment.given import GivenIds, class_of_ids
from fipt.stages.segment.settings import DegradedSegments, GivenSegments, GrownSegments
from fipt.stages.segment.stage import SegmentInputs, run
from tests.fake_results import write_results

IDS = np.array([[7, 7, 7, 7, 65535, 65535, 0, 0]] * 3 + [[2, 2, 2, 2, 2, 2, 2, 2]] * 3, np.uint16)
"""Ids of the two training views: 8x6 pixels."""


@pytest.fixture
def room(tmp_path):
    """Results with a dataset of views a and b (training, in one shard) and c; four triangles."""
    return write_results(tmp_path / "room", truth=False)


@pytest.fixture
def folder(tmp_path):
    """Ids of both views as 16-bit PNG."""
    for view in "ab":
        write_png(tmp_path / "ids" / f"{view}.png", IDS)
    return tmp_path / "ids"


def given(room, path, **keys):
    """The source, and what it says of its views."""
    settings = GivenSegments(path=str(path), **keys)
    source = GivenIds(Dataset(room / "dataset"), read_samples(room / "samples" / "train-000"), settings)
    return source, {view: (ids, classes) for view, ids, classes in source.views()}


def table(folder, *entries):
    (folder / "table.json").write_text(json.dumps(entries))


def test_png_exr_and_colours_say_the_same(room, folder):
    _, grey = given(room, folder)
    assert list(grey) == ["a", "b"]
    for ids, classes in grey.values():
        np.testing.assert_array_equal(ids, IDS)
        assert ids.dtype == np.uint16
        assert len(classes) == 65536
        assert not classes.any()

    for view in "ab":
        (folder / f"{view}.png").unlink()
        write_exr(folder / f"{view}.exr", {"Y": IDS.astype(np.float32)})
    np.testing.assert_array_equal(given(room, folder)[1]["b"][0], IDS)

    colors = {0: (0, 0, 0), 2: (9, 8, 7), 7: (255, 255, 254), 65535: (0, 0, 1)}
    for view in "ab":
        (folder / f"{view}.exr").unlink()
        write_png(folder / f"{view}.png", np.array([[colors[k] for k in row] for row in IDS.tolist()], np.uint8))
    table(folder, *({"id": k, "color": c, "class": "wood"} for k, c in colors.items() if k))
    with Image.open(folder / "b.png") as image:  # many programs write few colours as a palette
        image.quantize(4).save(folder / "b.png")
    source, found = given(room, folder)
    np.testing.assert_array_equal(found["a"][0], IDS)
    np.testing.assert_array_equal(found["b"][0], IDS)
    assert source.names == {1: "wood"}
    assert found["a"][1][[0, 2, 7, 65535]].tolist() == [0, 1, 1, 1]


def test_classes_come_from_the_table_or_from_semantic_ids(room, folder):
    table(folder, {"id": 7, "class": "wall"}, {"id": 2, "class": "floor"}, {"id": 65535, "class": "wall"})
    source, found = given(room, folder)
    assert source.names == {1: "floor", 2: "wall"}
    assert found["a"][1][[2, 7, 65535]].tolist() == [1, 2, 2]

    for view in "ab":
        write_png(folder / "part" / f"{view}.png", IDS)
        write_png(folder / "semantic" / f"{view}.png", np.where(IDS == 2, 5, 3).astype(np.uint16))
    (folder / "table.json").unlink()
    (folder / "semantic.json").write_text(json.dumps({"ids": {"3": "wall", "5": "floor"}}))
    source, found = given(room, folder)
    assert source.names == {3: "wall", 5: "floor"}
    assert found["b"][1][[0, 2, 7, 65535]].tolist() == [0, 5, 3, 3]

    shutil.rmtree(folder / "part")
    ids, classes = given(room, folder)[1]["a"]
    assert np.unique(ids).tolist() == [3, 5]
    assert classes.tolist() == [0, 1, 2, 3, 4, 5]


def test_semantic_images_have_the_classes_and_names_of_the_table(room, folder):
    """Two ids of one class, and colours in place of ids."""
    wall, chair, door = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    semantic = [[wall] * 4 + [chair] * 4] * 3 + [[door] * 8] * 3
    part = [[1] * 4 + [2] * 4] * 3 + [[3] * 8] * 3
    for view in "ab":
        write_png(folder / "semantic" / f"{view}.png", np.array(semantic, np.uint8))
    colors = [{"id": 10, "color": wall}, {"id": 20, "color": chair}, {"id": 30, "color": door}]
    table(folder, *({**each, "class": name} for each, name in zip(colors, ("wall", "chair", "wall"), strict=True)))
    source, found = given(room, folder)
    ids, classes = found["a"]
    assert np.unique(ids).tolist() == [10, 20, 30]
    assert [source.names[k] for k in classes[[10, 20, 30]]] == ["wall", "chair", "wall"]

    for view in "ab":
        write_png(folder / "part" / f"{view}.png", np.array(part, np.uint16))
    source, found = given(room, folder)
    assert [source.names[k] for k in found["b"][1][[1, 2, 3]]] == ["wall", "chair", "wall"]

    table(folder, *colors)
    (folder / "semantic.json").write_text(json.dumps({"ids": {"10": "wall", "20": "chair", "30": "door"}}))
    source, found = given(room, folder)
    assert [source.names[k] for k in found["b"][1][[1, 2, 3]]] == ["wall", "chair", "door"]

    table(folder, {**colors[0], "class": "wall"}, *colors[1:])
    with pytest.raises(FiptError, match=r"must give the class of every id; it misses id 20 of semantic/a.png"):
        given(room, folder)


def test_the_class_of_an_id_is_that_of_most_pixels():
    ids = np.array([[1, 1, 1, 2, 2, 0]], np.uint16)
    classes = class_of_ids(ids, np.array([[4, 9, 9, 0, 0, 4]], np.uint16))
    assert classes.tolist() == [0, 9, 0]


@pytest.mark.parametrize("binary", [True, False])
def test_labels_of_triangles(room, tmp_path, binary):
    """Of the four triangles, views see number 0 in the top row and 1 below."""
    labels = [65535, 3, 3, 1]
    path = tmp_path / "labelled.ply"
    head = ["ply", f"format {'binary_little_endian' if binary else 'ascii'} 1.0", "element vertex 3"]
    head += [f"property float {axis}" for axis in "xyz"]
    head += ["element face 4", "property list uchar int vertex_indices", "property ushort part", "end_header"]
    corners = np.eye(3, dtype="<f4")
    if binary:
        rows = b"".join(b"\3" + np.array([0, 1, 2], "<i4").tobytes() + np.array(k, "<u2").tobytes() for k in labels)
        path.write_bytes("\n".join([*head, ""]).encode() + corners.tobytes() + rows)
    else:
        rows = [" ".join(map(str, corner)) for corner in corners.tolist()] + [f"3 0 1 2 {k}" for k in labels]
        path.write_text("\n".join([*head, *rows, ""]))
    ids, classes = given(room, path, property="part")[1]["b"]
    assert (ids[0] == 65535).all()
    assert (ids[1:] == 3).all()
    assert len(classes) == 65536
    with pytest.raises(FiptError, match=r"no property 'segment'; found .*part.*segment.property"):
        given(room, path)

    save_npz(tmp_path / "labels.npz", segment=np.array([2, 1, 1, 0]), classes=np.array([0, 8, 9]))
    ids, classes = given(room, tmp_path / "labels.npz")[1]["a"]
    assert (ids[0] == 2).all()
    assert (ids[1:] == 1).all()
    assert classes.tolist() == [0, 8, 9]


def test_bad_labels_of_triangles(room, tmp_path):
    path = tmp_path / "labels.npz"
    for labels, message in (
        (np.zeros(5, int), "a label for each of the mesh's 4 triangles; segment has shape"),
        (np.array([0, 1, 65536, 2]), "triangle 2 has 65536"),
        (np.array([0, 1, 0.5, 2]), "triangle 2 has 0.5"),
    ):
        save_npz(path, segment=labels)
        with pytest.raises(FiptError, match=message):
            given(room, path)
    save_npz(path, segment=np.array([0, 1, 2, 3]), classes=np.array([0, 1, 1]))
    with pytest.raises(FiptError, match=r"classes has 3 entries, the largest label is 3"):
        given(room, path)
    for wrong, said in ((-1, "2 has class -1"), (65536, "2 has class 65536"), (1.5, "2 has class 1.5"), ("wall", "0")):
        save_npz(path, segment=np.array([0, 1, 2, 2]), classes=np.array([0, 1, wrong]))
        with pytest.raises(FiptError, match=f"classes must be whole numbers .*; label {said}"):
            given(room, path)
    (tmp_path / "broken.ply").write_text("ply\nformat ascii 1.0\n")
    with pytest.raises(FiptError, match=r"broken.ply is not a readable PLY mesh"):
        given(room, tmp_path / "broken.ply")


def test_ids_of_another_size(room, folder):
    write_png(folder / "a.png", IDS.repeat(2, axis=0).repeat(3, axis=1))
    write_png(folder / "b.png", IDS[::2, ::2])
    source, found = given(room, folder)
    np.testing.assert_array_equal(found["a"][0], IDS)
    np.testing.assert_array_equal(found["b"][0], IDS[::2, ::2].repeat(2, axis=0).repeat(2, axis=1))
    assert [warning.split("ids/")[1] for warning in source.warnings] == [
        "a.png has 24x12, its view 8x6: the nearest ids were taken",
        "b.png has 4x3, its view 8x6: the nearest ids were taken",
    ]
    with pytest.raises(FiptError, match=r"a.png must have the size of its view; it has 24x12, its view 8x6"):
        given(room, folder, other_size="error")


def test_bad_images(room, folder):
    def said():
        with pytest.raises(FiptError) as error:
            given(room, folder)
        return str(error.value)

    (folder / "b.png").write_bytes(b"no picture")
    assert "b.png is not a readable PNG" in said()
    write_png(folder / "b.png", np.full((6, 8, 3), 5, np.uint8))
    assert "b.png is a colour image, but table.json with the id of each colour is missing" in said()
    table(folder, {"id": 1, "color": [5, 5, 4]})
    assert "48 pixels have colours that table.json does not list, the first at row 0, column 0: [5, 5, 5]" in said()
    (folder / "b.png").unlink()
    assert "must hold VIEW.png or VIEW.exr of every training view; b missing" in said()
    for value, text in (
        (0.5, "such as 0.5"),
        (np.nan, "such as nan"),
        (65536.0, "whole ids from 0 to 65535; 48 pixels do not, such as 65536"),
    ):
        write_exr(folder / "b.exr", {"Y": np.full((6, 8), value, np.float32)})
        assert text in said()
    write_exr(folder / "b.exr", {"": np.random.default_rng(0).random((6, 8, 3)).astype(np.float32)})
    assert "b.exr must have one channel of ids; found B, G, R" in said()


def test_bad_tables(room, folder):
    table(folder, {"id": 7, "class": "wall"}, {"id": 2, "class": "floor"})
    with pytest.raises(FiptError, match=r"must give the class of every id; it misses id 65535 of a.png"):
        given(room, folder)
    for content in ("{", "{}x", '[{"color": [1, 2, 3]}]', '[{"id": 70000}]', '[{"id": 1, "color": [1, 2]}]', "[3]"):
        (folder / "table.json").write_text(content)
        with pytest.raises(FiptError, match=r"table.json is not a table of ids"):
            given(room, folder)


def test_the_stage_writes_ids_names_and_warnings(room, folder):
    write_png(folder / "b.png", np.zeros((6, 8), np.uint16))
    table(folder, *({"id": k, "class": "Grün"} for k in (2, 7, 65535)))
    out = room / "segments" / "views"
    settings = GivenSegments(path=str(folder))
    shard, manifest = room / "samples" / "train-000", room / "segments" / "m.json"
    inputs = SegmentInputs(dataset=room / "dataset", samples=shard, out=out, manifest=manifest)
    stats = run(inputs, settings)
    listed = read_manifest(room / "segments" / "m.json", "segment")["files"]
    assert sorted(listed) == ["classes.json", "views/a.npz", "views/b.npz"]
    assert json.loads((room / "segments" / "classes.json").read_text()) == {"1": "Grün"}
    ids, classes = read_view_ids(out / "a.npz")
    np.testing.assert_array_equal(ids, IDS)
    assert classes[7] == 1
    assert stats["warnings"] == ["b has no segment id at all"]
    with pytest.raises(
        FiptError, match=r"segment.mode must be mask2former, given or degraded for ids of views; it is geometry"
    ):
        run(inputs, GrownSegments())


def test_ids_of_a_view_on_disk(tmp_path):
    path = tmp_path / "v.npz"
    write_view_ids(path, IDS, np.zeros(65536))
    ids, classes = read_view_ids(path)
    assert (ids.dtype, classes.dtype) == (np.uint16, np.int32)
    save_npz(path, ids=IDS, classes=np.zeros(65535, np.int32))
    with pytest.raises(FiptError, match=r"must hold ids \(H, W\) uint16 and the class of each; found .* up to 65535"):
        read_view_ids(path)


# --- which mode a scene has -----------------------------------------------------------------------


def scene(entry, **settings):
    values = {"scenes": {"room": {**entry, "settings": settings}}, "data_root": "/data"}
    return load(values).scenes["room"]


def test_the_mode_of_a_scene(room, folder, tmp_path):
    procedural = {"source": "procedural"}
    assert scene(procedural).segmentation.origin == "dataset"
    assert scene(procedural, segment={"mode": "geometry"}).segmentation.origin == "geometry"
    without = scene(procedural, segment={"mode": "none"})
    assert without.segmentation.origin == "none"
    assert json.loads(without.settings_json("fit"))["segments"] == "none"
    assert scene(procedural, segment={"mode": "mask2former"}, fit={"segments": "none"}).segmentation.origin == "none"

    raw = {"source": "raw", "path": "p", "poses": "q", "mesh": "m"}
    assert scene(raw).segmentation.origin == "geometry"
    assert scene({**raw, "segments": "s"}).segmentation.origin == "dataset"

    shutil.copy(room / "dataset" / "transforms.json", room / "dataset" / "images")
    posed = {"source": "dataset", "format": "nerfstudio", "path": str(room / "dataset")}
    assert scene(posed).segmentation.origin == "geometry"  # this layout brings no ids

    chosen = scene(procedural, segment={"mode": "given", "path": "{data_root}/ids"})
    assert json.loads(chosen.settings_json("segment"))["path"] == "/data/ids"
    chosen = scene(procedural, segment={"mode": "given", "path": str(folder)})
    assert chosen.segmentation.files() == [str(folder / "a.png"), str(folder / "b.png")]
    named = json.loads(scene(procedural, segment={"mode": "mask2former"}).settings_json("segment"))["model"]
    assert named == "facebook/mask2former-swin-large-coco-panoptic"

    with pytest.raises(FiptError, match=r"scene room: segment.path is missing; mode: given needs path: "):
        scene(procedural, segment={"mode": "given"})
    with pytest.raises(FiptError, match=r"segment.path is only for mode given; mode is auto"):
        scene(procedural, segment={"path": "x"})


@pytest.mark.parametrize(("name", "mode"), [("IndexMA", "dataset"), ("segmentation", "dataset"), ("other", "geometry")])
def test_a_published_scene_brings_ids_or_not(tmp_path, name, mode):
    identity = np.eye(4).tolist()
    for split in ("train", "val"):
        (tmp_path / split / "Image").mkdir(parents=True)
        (tmp_path / split / name).mkdir()
        frames = [{"file_path": "000", "transform_matrix": identity}]
        cameras = {"camera_angle_x": 1.0, "w": 4, "h": 3, "frames": frames}
        (tmp_path / split / "transforms.json").write_text(json.dumps(cameras))
        (tmp_path / split / "Image" / "000_0001.exr").touch()
    entry = {"source": "dataset", "format": "fipt-synthetic", "path": str(tmp_path)}
    assert scene(entry).segmentation.origin == mode


def test_ids_are_made_worse_view_by_view(room):
    """Whatever else is in the shard; a dataset without ids is refused."""
    data, shard = Dataset(room / "dataset"), read_samples(room / "samples" / "train-000")
    with pytest.raises(FiptError, match="has no segment ids"):
        DegradedIds(data, shard, DegradedSegments())
    for view in "ab":
        write_png(room / "dataset" / "segments" / "part" / f"{view}.png", IDS)
    found = {view: ids for view, ids, _ in DegradedIds(data, shard, DegradedSegments(noise=0, shift=0)).views()}
    assert list(found) == ["a", "b"]
    for ids in found.values():
        assert ((ids == 0) == (IDS == 0)).all()
        assert {len(np.unique(ids[value == IDS])) for value in np.unique(IDS)} == {1}
    alone = SimpleNamespace(views=("b",))
    again = {view: ids for view, ids, _ in DegradedIds(data, alone, DegradedSegments(noise=0, shift=0)).views()}
    np.testing.assert_array_equal(again["b"], found["b"])
