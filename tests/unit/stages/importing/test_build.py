"""Datasets that the import writes: round trips, axes, and what a killed import leaves."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.manifests import file_hash, read_manifest
from fipt.render.scene import RayScene
from fipt.render.variant import Backend
from fipt.scene.cameras import read_transforms
from fipt.scene.dataset import Dataset
from fipt.stages.importing.build import import_scene
from fipt.stages.importing.overlay import visible_triangles
from fipt.stages.importing.settings import ImportSettings
from tests.layouts import (
    BRIGHT,
    HEIGHT,
    LAMP,
    POSES,
    WIDTH,
    WRITERS,
    photo,
    room,
    truth_layers,
    write_blender,
    write_masked,
    write_nerfstudio,
)  # fmt: skip

PLAIN = ImportSettings(overlay=False)


def imported(tmp_path: Path, format: str, write: object = None, **options: object) -> Dataset:
    source = tmp_path / "source"
    source.mkdir()
    (write or WRITERS[format])(source)
    import_scene(source, format, tmp_path / "dataset", options.pop("settings", PLAIN), **options)
    return Dataset(tmp_path / "dataset")


@pytest.mark.parametrize("format", WRITERS)
def test_round_trip(tmp_path: Path, format: str) -> None:
    dataset = imported(tmp_path, format)
    assert len(dataset.cameras) == len(POSES)
    for camera, pose in zip(dataset.cameras, POSES, strict=True):
        radiance, valid = dataset.image(camera.name)
        np.testing.assert_array_equal(radiance, photo(pose))
        assert (valid == 1).all()
        assert (camera.width, camera.height) == (WIDTH, HEIGHT)
        np.testing.assert_allclose([camera.fx, camera.fy, camera.cx, camera.cy], [4, 4, 4, 3])
    mesh = dataset.mesh()
    np.testing.assert_array_equal(mesh.vertices, room().vertices)
    np.testing.assert_array_equal(mesh.triangles, room().triangles)
    assert set(read_manifest(dataset.root / "import.manifest.json", "import")["files"]) == {
        str(path.relative_to(dataset.root))
        for path in dataset.root.rglob("*")
        if path.is_file() and path.name != "import.manifest.json"
    }


@pytest.mark.parametrize("format", [*WRITERS, "blender"])
def test_the_lamp_is_where_the_picture_shows_it(tmp_path: Path, format: str) -> None:
    write = write_blender if format == "blender" else WRITERS[format]
    dataset = imported(tmp_path, "nerfstudio" if format == "blender" else format, write)
    for camera in dataset.cameras:
        (image,), (depth,) = camera.project(LAMP[None])
        assert depth > 0
        radiance, _ = dataset.image(camera.name)
        assert radiance[int(image[1]), int(image[0]), 0] == BRIGHT
        # The ray through that point comes back to the lamp.
        direction = camera.directions(image[0], image[1])
        away = np.linalg.norm(LAMP - camera.center)
        np.testing.assert_allclose(camera.center + away * direction, LAMP, atol=1e-5)


def test_truth_and_ids_of_the_synthetic_layout(tmp_path: Path) -> None:
    dataset = imported(tmp_path, "fipt-synthetic")
    layers, truth = truth_layers(POSES[2]), dataset.truth("val_000")
    for layer, folder in (
        ("kd", "DiffCol"), ("base_color", "BaseColor"), ("reflectance", "albedo"),
        ("emission", "Emit"),
    ):  # fmt: skip
        np.testing.assert_allclose(truth[layer], layers[folder], rtol=1e-6)
    assert (truth["roughness"] == np.float32(0.4)).all()
    assert (truth["metallic"] == 0).all()
    np.testing.assert_array_equal(truth["emission_mask"], layers["Emit"][..., 0] > 0)
    assert truth["emission_mask"].sum() == 1
    np.testing.assert_array_equal(dataset.segments("val_000", "part"), layers["IndexMA"][..., 0])
    np.testing.assert_array_equal(dataset.segments("val_000", "semantic"), layers["segmentation"][..., 0])
    assert dataset.segment_kind() == "part"
    names = json.loads((dataset.root / "segments" / "semantic.json").read_text())
    assert names == {"ids": {"1": "Wall", "2": "Oak"}}
    assert json.loads((dataset.root / "segments" / "part.json").read_text()) == {"ids": {}}


def test_layers_a_source_does_not_know_stay_absent(tmp_path: Path) -> None:
    def write(root: Path) -> None:
        WRITERS["fipt-synthetic"](root)
        for split in ("train", "val"):
            for folder in ("BaseColor", "Metallic"):
                for path in (root / split / folder).iterdir():
                    path.unlink()
                (root / split / folder).rmdir()

    truth = imported(tmp_path, "fipt-synthetic", write).truth("train_000")
    assert set(truth) == {"kd", "reflectance", "emission", "emission_mask", "roughness"}


def test_the_real_layout_has_semantic_ids_and_no_truth(tmp_path: Path) -> None:
    dataset = imported(tmp_path, "fipt-real")
    assert dataset.segment_kind() == "semantic"
    assert dataset.truth("001") is None


def test_a_dataset_is_a_nerfstudio_source(tmp_path: Path) -> None:
    first = imported(tmp_path, "fipt-synthetic")
    import_scene(first.root, "nerfstudio", tmp_path / "again", PLAIN)
    again = Dataset(tmp_path / "again")
    for a, b in zip(first.cameras, again.cameras, strict=True):
        assert (a.name, a.split, a.fx, a.cx) == (b.name, b.split, b.fx, b.cx)
        np.testing.assert_array_equal(a.world_from_camera, b.world_from_camera)


def test_masks_and_flags_travel_along(tmp_path: Path) -> None:
    bits = np.zeros((HEIGHT, WIDTH), np.uint32)
    bits[2, 5] = 3

    def write(root: Path) -> None:
        write_masked(root, photo(POSES[0]), bits)

    dataset = imported(tmp_path, "nerfstudio", write, settings=ImportSettings(overlay=True))
    radiance, valid = dataset.image("view_0")
    assert valid[0, 0] == 0
    assert valid.sum() == HEIGHT * WIDTH - 1
    assert (radiance[0, 0] == 0).all()
    np.testing.assert_array_equal(dataset.flags("view_0"), bits)


def test_a_mesh_in_the_wrong_place_is_mentioned(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def write(root: Path) -> None:
        WRITERS["fipt-real"](root)
        text = (root / "scene.obj").read_text()
        (root / "scene.obj").write_text(text.replace("v 0 ", "v 3 "))

    imported(tmp_path, "fipt-real", write)
    assert "2 of 3 cameras stand outside the mesh's bounds (000, 002)" in caplog.text


def test_the_same_source_gives_the_same_files(tmp_path: Path) -> None:
    first = imported(tmp_path, "fipt-synthetic", settings=ImportSettings())
    manifest = (first.root / "import.manifest.json").read_text()
    import_scene(tmp_path / "source", "fipt-synthetic", first.root, ImportSettings())
    assert (first.root / "import.manifest.json").read_text() == manifest


def test_views_that_left_the_source_leave_the_dataset(tmp_path: Path) -> None:
    dataset = imported(tmp_path, "nerfstudio")
    source = tmp_path / "source" / "transforms.json"
    content = json.loads(source.read_text())
    source.write_text(json.dumps({**content, "frames": content["frames"][:2]}))
    import_scene(source.parent, "nerfstudio", dataset.root, PLAIN)
    assert sorted(p.name for p in (dataset.root / "images").iterdir()) == [
        "view_0.exr", "view_1.exr",
    ]  # fmt: skip


def test_the_manifest_may_stand_beside_the_dataset(tmp_path: Path) -> None:
    dataset = imported(tmp_path, "nerfstudio", manifest=tmp_path / "dataset.manifest.json")
    files = read_manifest(tmp_path / "dataset.manifest.json", "import")["files"]
    assert files["dataset/mesh.ply"] == file_hash(dataset.root / "mesh.ply")
    assert not (dataset.root / "import.manifest.json").exists()


# --- a killed import --------------------------------------------------------------------------

KILLED = """
import os, signal, sys
from fipt.stages.importing import build, frames
from fipt.stages.importing.settings import ImportSettings
setattr(frames if sys.argv[1] == "write_exr" else build, sys.argv[1], lambda *_: os.kill(os.getpid(), signal.SIGKILL))
build.import_scene(sys.argv[2], "nerfstudio", sys.argv[3], ImportSettings(overlay=False))
"""


@pytest.mark.parametrize("step", ["write_exr", "write_views", "write_manifest"])
@pytest.mark.parametrize("earlier", [False, True])
def test_a_killed_import_is_not_taken_for_finished(tmp_path: Path, step: str, earlier: bool) -> None:
    source, target = tmp_path / "source", tmp_path / "dataset"
    write_nerfstudio(source)
    import_scene(source, "nerfstudio", tmp_path / "expected", PLAIN)
    if earlier:
        import_scene(source, "nerfstudio", target, PLAIN)
    arguments = [sys.executable, "-c", KILLED, step, str(source), str(target)]
    done = subprocess.run(arguments, capture_output=True, check=False)
    assert done.returncode == -signal.SIGKILL
    manifest = target / "import.manifest.json"
    # Until the exchange, the earlier dataset stands untouched; after it, no manifest vouches.
    assert manifest.exists() == (earlier and step != "write_manifest")
    import_scene(source, "nerfstudio", target, PLAIN)
    expected = (tmp_path / "expected" / "import.manifest.json").read_text()
    assert manifest.read_text() == expected
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dataset", "expected", "source"]


def test_a_bad_frame_leaves_the_earlier_dataset(tmp_path: Path) -> None:
    dataset = imported(tmp_path, "nerfstudio")
    write_exr(tmp_path / "source" / "images" / "view_2.exr", {"": -photo(POSES[2])})
    with pytest.raises(FiptError, match="are negative"):
        import_scene(tmp_path / "source", "nerfstudio", dataset.root, PLAIN)
    read_manifest(dataset.root / "import.manifest.json", "import")
    assert (dataset.image("view_2")[0] == photo(POSES[2])).all()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dataset", "source"]


# --- the living room --------------------------------------------------------------------------


@pytest.fixture(scope="session")
def living_dataset(living_room: Path, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("living") / "dataset"
    import_scene(living_room / "dataset", "fipt-synthetic", folder, PLAIN)
    return Dataset(folder)


def test_living_room_counts(living_dataset: Dataset) -> None:
    assert len(living_dataset.views("train")) == 16
    assert len(living_dataset.views("val")) == 8
    assert len(living_dataset.mesh().triangles) == 131_815
    assert living_dataset.camera("val_003").fx == pytest.approx(80 / np.tan(np.radians(35)))


def test_living_room_triangle_order(living_room: Path, living_dataset: Dataset) -> None:
    lines = (living_room / "dataset" / "scene.obj").read_text().splitlines()
    faces = [line.split()[1:] for line in lines if line.startswith("f ")]
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], np.float32)
    corners = vertices[np.array(faces, np.int64) - 1]
    np.testing.assert_allclose(living_dataset.mesh().corners, corners, atol=1e-6)


def test_living_room_axes_agree_with_its_truth(backend: Backend, living_room: Path, living_dataset: Dataset) -> None:
    mesh = living_dataset.mesh()
    rays = RayScene(mesh)
    meta = json.loads((living_room / "dataset" / "meta.json").read_text())
    windows = len(mesh.triangles) - meta["emitter_triangles"]  # they come last in the file
    ids, parts = [], []
    for camera in living_dataset.cameras[::3]:
        triangle, _ = visible_triangles(rays, camera)
        emits = living_dataset.truth(camera.name)["emission_mask"] > 0
        seen = triangle >= windows
        # Rays through pixel centres that graze an edge may differ by rounding.
        assert (seen != emits).sum() <= 2, camera.name
        ids.append(triangle.ravel())
        parts.append(living_dataset.segments(camera.name, "part").ravel())
    ids, parts = np.concatenate(ids), np.concatenate(parts)
    assert (ids < 0).sum() == (parts == 0).sum() or (ids < 0).mean() < 1e-4
    # One triangle belongs to one part, in every view.
    largest = np.zeros(len(mesh.triangles))
    smallest = np.full(len(mesh.triangles), np.inf)
    np.maximum.at(largest, ids[ids >= 0], parts[ids >= 0])
    np.minimum.at(smallest, ids[ids >= 0], parts[ids >= 0])
    seen = np.isfinite(smallest)
    assert (largest[seen] == smallest[seen]).mean() > 0.999


def test_living_room_written_cameras_equal_the_source(living_room: Path, living_dataset: Dataset) -> None:
    source = json.loads((living_room / "dataset" / "val" / "transforms.json").read_text())
    cameras = read_transforms(living_dataset.root / "transforms.json")[16:]
    for frame, camera in zip(source["frames"], cameras, strict=True):
        expected = np.array(frame["transform_matrix"]) @ np.diag([-1, 1, -1, 1])
        np.testing.assert_array_equal(camera.world_from_camera, expected)


def test_a_dataset_is_imported_with_truth_and_ids_and_another_mesh(tmp_path: Path) -> None:
    from fipt.scene.mesh import write_ply
    from fipt.scene.sources import has_segments, read_source

    first = imported(tmp_path, "fipt-synthetic")
    (first.root / "room.json").write_text("{}")
    write_ply(tmp_path / "scan.ply", room())
    import_scene(first.root, "fipt", tmp_path / "again", PLAIN, tmp_path / "scan.ply")
    again = Dataset(tmp_path / "again")
    assert [(c.name, c.split) for c in again.cameras] == [(c.name, c.split) for c in first.cameras]
    assert has_segments(read_source(first.root, "fipt")) == has_segments(
        read_source(tmp_path / "source", "fipt-synthetic")
    )
    assert (again.root / "room.json").is_file()
    for camera in first.cameras:
        truth, expected = again.truth(camera.name), first.truth(camera.name)
        assert truth is not None
        assert expected is not None
        assert set(truth) == set(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(truth[name], values)
        for kind in ("part", "semantic"):
            assert again.has_segments(kind) == first.has_segments(kind)
            if first.has_segments(kind):
                np.testing.assert_array_equal(again.segments(camera.name, kind), first.segments(camera.name, kind))
                assert (again.root / f"segments/{kind}.json").read_text() == (
                    first.root / f"segments/{kind}.json"
                ).read_text()
