"""The fusion end to end on small rooms, and its counting against brute force."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from benchmarks.segmentation import PLAIN, best_match
from fipt.errors import FiptError
from fipt.formats.images import read_ids
from fipt.formats.manifests import read_manifest
from fipt.render.scene import RayScene
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.fusion import read_fusion
from fipt.scene.mesh import write_ply
from fipt.scene.segments import write_view_ids
from fipt.stages.segment.degraded import degraded, renumbered
from fipt.stages.segment.fuse import fuse_views
from fipt.stages.segment.settings import FuseSettings
from fipt.stages.segment.views import observe, without_speckles
from fipt.stages.segment.votes import most_votes, share_of
from fipt.synthetic.poses import OpenSpace, sample_cameras
from fipt.synthetic.room import build
from fipt.synthetic.settings import SynthesizeSettings
from tests.scenes import joined, look_at, quad, write_dataset

pytestmark = pytest.mark.usefixtures("backend")


def labelled(folder: Path, view: str, ids: np.ndarray, kinds: np.ndarray | None = None) -> None:
    count = int(ids.max()) + 1
    write_view_ids(folder / "views" / f"{view}.npz", ids, np.zeros(count, np.int32) if kinds is None else kinds)


def fused(folder: Path, view: str, kind: str = "part") -> np.ndarray:
    return read_ids(folder / "fused" / kind / f"{view}.png")


def panels(root: Path, *meshes, views: int = 4, size: int = 64) -> Dataset:
    """Views that look straight down the -z axis at meshes around the origin, from places side by side."""
    cameras = [
        look_at(f"v{k}", (0.2 * k - 0.3, 0.1 * k, 3.0), (0.2 * k - 0.3, 0.1 * k, 0.0), "train", size, size, size)
        for k in range(views)
    ]
    write_ply(root / "mesh.ply", joined(*meshes))
    write_transforms(root / "transforms.json", cameras)
    write_views(root / "views.json", [camera.name for camera in cameras])
    return Dataset(root)


def points(data: Dataset, view: str) -> np.ndarray:
    """(H, W, 3) where the pixels' centres meet the plane z = 0."""
    camera = data.camera(view)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns, rows)
    return camera.center + directions * (-camera.center[2] / directions[..., 2:])


WALL = quad((-4, -4, 0), (8, 0, 0), (0, 8, 0))


# --- counting -------------------------------------------------------------------------------------


def test_winner_and_share_against_brute_force(np_rng: np.random.Generator) -> None:
    votes = np_rng.integers(0, 4, (200, 7)).astype(float)
    votes[np_rng.random(votes.shape) < 0.5] = 0
    winner, share, total = most_votes(csr_matrix(votes))
    np.testing.assert_array_equal(winner, votes.argmax(axis=1))  # the first of equals; 0 where there is none
    np.testing.assert_allclose(total, votes.sum(axis=1))
    np.testing.assert_allclose(share, votes.max(axis=1) / np.maximum(votes.sum(axis=1), 1))
    ids = np_rng.integers(0, 7, 200)
    expected = votes[np.arange(200), ids] / np.maximum(votes.sum(axis=1), 1)
    np.testing.assert_allclose(share_of(csr_matrix(votes), ids), expected)


def test_speckles_against_brute_force(np_rng: np.random.Generator) -> None:
    ids = np_rng.integers(0, 4, (12, 9)).astype(np.uint16)
    found = without_speckles(ids)
    for row, column in np.ndindex(ids.shape):
        around = ids[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        alike = (around == ids[row, column]).sum() - 1
        assert found[row, column] == (ids[row, column] if alike >= 2 else 0)


def test_the_plain_count_is_a_count_with_the_largest_id_and_the_last_triangle(tmp_path: Path) -> None:
    data = Dataset(write_dataset(tmp_path / "dataset"))
    mesh, views, rng = data.mesh(), data.views("train"), np.random.default_rng(0)
    observations = observe(mesh, [data.camera(view) for view in views], tmp_path)
    votes: dict[int, list[int]] = {}
    out = tmp_path / "segments"
    for number, view in enumerate(views):
        cell, _ = observations.of(number)
        ids = rng.choice(np.uint16([1, 7, 65535]), cell.shape, p=[0.3, 0.3, 0.4])
        last = cell == len(mesh.triangles) - 1
        ids[last] = 65535
        labelled(out, view, ids.reshape(data.camera(view).height, -1))
        for triangle, own in zip(cell.tolist(), ids.tolist(), strict=True):
            votes.setdefault(triangle, []).append(own)
    assert len(mesh.triangles) - 1 in votes
    fuse_views(data.root, out, PLAIN)
    fusion, about = read_fusion(out / "fusion.npz")
    groups: dict[int, set[int]] = {}
    for triangle, given in votes.items():
        ids, counts = np.unique(given, return_counts=True)
        groups.setdefault(int(ids[counts.argmax()]), set()).add(int(fusion.part[triangle]))
        assert fusion.agreement[triangle] == pytest.approx(counts.max() / counts.sum())
    assert all(len(found) == 1 and 0 not in found for found in groups.values())
    assert len(set.union(*groups.values())) == len(groups) == len(about["segments"])
    assert groups[65535] == {int(fusion.part[-1])}
    unseen = np.setdiff1d(np.arange(len(mesh.triangles)), list(votes))
    assert (fusion.part[unseen] == 0).all()


# --- what views say -------------------------------------------------------------------------------


def test_degraded_views_of_a_room_agree_on_the_true_parts(tmp_path: Path) -> None:
    room = build(0)
    settings = SynthesizeSettings(train_views=8, val_views=1, width=96, height=64)
    cameras = sample_cameras(OpenSpace(room, RayScene(room.mesh).intersect, settings.seed), settings)
    write_ply(tmp_path / "dataset" / "mesh.ply", room.mesh)
    write_transforms(tmp_path / "dataset" / "transforms.json", cameras)
    write_views(tmp_path / "dataset" / "views.json", [camera.name for camera in cameras])
    observations = observe(room.mesh, cameras, tmp_path)
    true = [
        np.where(observations.of(k)[0] >= 0, room.part[observations.of(k)[0]], 0).reshape(64, 96)
        for k in range(len(cameras))
    ]
    matched = {}
    for name, chosen in {"fused": FuseSettings(), "plain": PLAIN}.items():
        out = tmp_path / name
        for number, camera in enumerate(cameras[:-1]):
            rng = np.random.default_rng([3, number])
            ids = degraded(true[number].astype(np.uint16), rng, shift=1.5)  # of so few pixels
            labelled(out, camera.name, renumbered(ids, rng))
        fuse_views(tmp_path / "dataset", out, chosen)
        found = np.concatenate([fused(out, camera.name).ravel() for camera in cameras])
        matched[name] = best_match(found, np.concatenate(true).ravel())
    assert matched["fused"] > 0.92
    assert matched["plain"] < 0.6  # numbers mean nothing beyond their view


def test_a_print_on_a_wall_of_two_triangles_is_found_and_triangles_keep_their_order(tmp_path: Path) -> None:
    data = panels(tmp_path / "dataset", WALL)
    out = tmp_path / "segments"
    for number, view in enumerate(data.views("train")):
        place = points(data, view)
        inside = (np.abs(place[..., 0]) < 0.7) & (np.abs(place[..., 1] - 0.2) < 0.5)
        labelled(out, view, np.where(inside, *((1, 2) if number % 2 else (2, 1))).astype(np.uint16))
    fuse_views(data.root, out, FuseSettings())
    fusion, about = read_fusion(out / "fusion.npz")
    assert len(about["segments"]) == 2
    assert fusion.split.all()
    np.testing.assert_array_equal(fusion.part, 1)  # most of the area of either triangle is wall
    assert about["segments"][1]["area"] == pytest.approx(1.4, rel=0.1)
    for view in data.views("train"):
        place = points(data, view)
        far = np.maximum(np.abs(place[..., 0]) - 0.7, np.abs(place[..., 1] - 0.2) - 0.5)
        clear = np.abs(far) > 0.07
        np.testing.assert_array_equal(fused(out, view)[clear], np.where(far < 0, 2, 1)[clear])
    fuse_views(data.root, out, FuseSettings(split=False))
    assert not read_fusion(out / "fusion.npz")[0].split.any()


def test_classes_name_segments_and_pieces_of_a_class_without_instances_are_parts(tmp_path: Path) -> None:
    chairs = [quad((x, -0.3, 0.2), (0.5, 0, 0), (0, 0.6, 0)) for x in (-1.0, 0.6)]
    data = panels(tmp_path / "dataset", WALL, *chairs)
    observations = observe(data.mesh(), data.cameras, tmp_path)
    for name, apart in {"semantic": False, "panoptic": True}.items():
        out = tmp_path / name
        out.mkdir()
        (out / "classes.json").write_text(json.dumps({"3": "chair", "9": "wall"}))
        for number, view in enumerate(data.views("train")):
            cell = observations.of(number)[0].reshape(64, 64)
            ids = np.select([cell < 2, cell < 4], [1, 2], 3 if apart else 2).astype(np.uint16)
            labelled(out, view, ids, np.int32([0, 9, 3, 3]))
        fuse_views(data.root, out, FuseSettings())
        fusion, about = read_fusion(out / "fusion.npz")
        assert [segment["class"] for segment in about["segments"]] == [9, 3, 3]
        assert about["segments"][0]["name"] == "wall 1"
        assert [len(np.unique(fusion.part[own])) for own in (slice(0, 2), slice(2, 4), slice(4, 6))] == [1, 1, 1]
        assert fusion.part[2] != fusion.part[4]
        np.testing.assert_array_equal(fusion.semantic, [9, 9, 3, 3, 3, 3])
        assert json.loads((out / "fused" / "semantic.json").read_text()) == {"ids": {"3": "chair", "9": "wall"}}
        np.testing.assert_array_equal(np.unique(fused(out, "v0", "semantic")), [3, 9])
    paper = PLAIN.model_copy(update={"associate": "classes"})
    fuse_views(data.root, out, paper)
    assert not (out / "fused" / "part").exists()  # classes are no parts
    np.testing.assert_array_equal(np.unique(fused(out, "v0", "semantic")), [3, 9])


def test_unseen_surface_takes_the_id_of_its_smooth_region_and_held_out_views_are_drawn(tmp_path: Path) -> None:
    # a second wall, which no training view sees, and a far part of the first
    data = panels(
        tmp_path / "dataset", WALL, quad((4, -4, 0), (3, 0, 0), (0, 8, 0)), quad((7, -4, 0), (0, 8, 0), (0, 0, 2))
    )
    train = data.cameras[:-1]
    write_transforms(data.root / "transforms.json", [*train, replace(data.cameras[-1], split="val")])
    out = tmp_path / "segments"
    for camera in train:
        labelled(out, camera.name, np.full((64, 64), 5, np.uint16))
    fuse_views(data.root, out, FuseSettings())
    fusion, about = read_fusion(out / "fusion.npz")
    np.testing.assert_array_equal(fusion.part, [1, 1, 1, 1, 0, 0])
    np.testing.assert_array_equal(fusion.seen[2:], 0)
    assert (fused(out, data.cameras[-1].name) == 1).all()
    assert about["area_without_id"] == pytest.approx(16)
    fuse_views(data.root, out, FuseSettings(fill=False))
    np.testing.assert_array_equal(read_fusion(out / "fusion.npz")[0].part[2:], 0)


def test_a_fusion_repeats_to_the_byte_and_has_a_manifest(tmp_path: Path) -> None:
    data = Dataset(write_dataset(tmp_path / "dataset"))
    for name in ("one", "two"):
        for number, view in enumerate(data.views("train")):
            rng = np.random.default_rng(number)
            labelled(tmp_path / name, view, degraded(data.segments(view, "part"), rng))
        fuse_views(data.root, tmp_path / name, FuseSettings())
    first, second = (read_manifest(tmp_path / name / "fused.manifest.json", "fuse") for name in ("one", "two"))
    assert first == second
    assert {"fusion.npz", "fusion.json", "fused/part/a.png", "fused/part/c.png", "fused/agreement/a.png"} <= set(
        first["files"]
    )


# --- bad input ------------------------------------------------------------------------------------


@pytest.fixture
def given(tmp_path: Path) -> tuple[Dataset, Path]:
    data = Dataset(write_dataset(tmp_path / "dataset"))
    for view in data.views("train"):
        labelled(tmp_path / "segments", view, data.segments(view, "part"))
    return data, tmp_path / "segments"


def test_ids_of_another_size_are_resampled_with_a_warning_or_refused(given, caplog) -> None:
    data, out = given
    ids = np.repeat(np.repeat(data.segments("a", "part"), 2, axis=0), 2, axis=1)
    labelled(out, "a", ids)
    fuse_views(data.root, out, FuseSettings())
    warned = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert warned
    assert "a.npz must be 16x12 like its view; it is 32x24; the nearest ids are taken" in warned[0]
    assert best_match(fused(out, "a"), data.segments("a", "part")) > 0.95
    with pytest.raises(FiptError, match=r"must be 16x12 like its view; it is 32x24; .*fuse\.other_size"):
        fuse_views(data.root, out, FuseSettings(other_size="error"))


def test_views_without_labels_are_named_and_none_at_all_is_an_error(given, caplog) -> None:
    data, out = given
    labelled(out, "a", np.zeros((12, 16), np.uint16))
    fuse_views(data.root, out, FuseSettings())
    assert "views without any segment: a" in caplog.text
    assert read_fusion(out / "fusion.npz")[1]["views_without_segments"] == ["a"]
    labelled(out, "b", np.zeros((12, 16), np.uint16))
    with pytest.raises(FiptError, match=r"no view of .* has a segment"):
        fuse_views(data.root, out, FuseSettings())


def test_ids_that_do_not_fit_16_bits_missing_files_and_bad_tables_are_refused(given) -> None:
    data, out = given
    np.savez(out / "views" / "a.npz", ids=np.full((12, 16), 65536, np.int32), classes=np.zeros(65537, np.int32))
    with pytest.raises(FiptError, match=r"a\.npz must hold ids .* uint16 .* up to 65536"):
        fuse_views(data.root, out, FuseSettings())
    (out / "views" / "a.npz").unlink()
    with pytest.raises(FiptError, match=r"missing: .*a\.npz"):
        fuse_views(data.root, out, FuseSettings())
    (out / "classes.json").write_text("[1, 2]")
    with pytest.raises(FiptError, match=r"classes\.json must map class numbers to names"):
        fuse_views(data.root, out, FuseSettings())
