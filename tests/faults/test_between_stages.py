"""Files between stages: what a verb reads is what its stage wrote, and the printed remedy makes it again."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import fipt.stages
from fipt.cli.main import main
from fipt.conventions import SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, load_npz, save_npy
from fipt.formats.files import ANYTHING, atomic_folder, made_again
from fipt.formats.manifests import ListedFiles, write_manifest
from fipt.render.variant import Backend
from fipt.scene.dataset import Dataset
from fipt.scene.samples import read_samples
from fipt.scene.shading import Shading, read_shading, save_shading
from tests.faults.faults import contents, refused
from tests.layouts import write_synthetic


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: Backend) -> Path:
    """A tiny dataset and the samples of a shard, as the workflow lays them out."""
    monkeypatch.chdir(tmp_path)
    write_synthetic(Path("src"))
    root = Path("results/x")
    settings = json.dumps({"overlay": False, "prepare": "never"})
    into = ("--dataset", str(root / "dataset"), "--manifest", str(root / "dataset/images.manifest.json"))
    assert main(["import", "--source", "src", "--format", "fipt-synthetic", *into, "--settings", settings]) == 0
    sampled(root)
    return root


def sampled(root: Path, code: int = 0) -> None:
    shard = root / "samples" / "train-000"
    views = "train_000,train_001"
    assert main(["samples", "--dataset", str(root / "dataset"), "--views", views, "--out", str(shard)]) == code


def flipped(path: Path) -> None:
    """One bit differs, the size stays."""
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(bytes(data))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def lengthened(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"\0")


def of_another_run(path: Path) -> None:
    """A whole file, of something else."""
    array, text = path.suffix == ".npy", path.read_bytes()
    path.write_bytes(b"ply\nformat ascii 1.0\nend_header\n" if not array else text.replace(b"descr", b"Descr"))


HARMS = [flipped, cut, lengthened, of_another_run]


SAID = r"is not what its stage wrote.*; delete .*manifest\.json and run again"
READ: dict[str, tuple[str, Callable[[Path], object]]] = {
    "image": ("dataset/images/train_000.exr", lambda root: Dataset(root / "dataset").image("train_000")),
    "flags": ("dataset/images/train_000.exr", lambda root: Dataset(root / "dataset").flags("train_000")),
    "truth": ("dataset/truth/train_000.exr", lambda root: Dataset(root / "dataset").truth("train_000")),
    "ids": (
        "dataset/segments/part/train_000.png",
        lambda root: Dataset(root / "dataset").segments("train_000", "part"),
    ),
    "mesh": ("dataset/mesh.ply", lambda root: Dataset(root / "dataset").mesh()),
    "positions": ("samples/train-000/position.npy", lambda root: read_samples(root / "samples/train-000")),
    "views": ("samples/train-000/views.json", lambda root: read_samples(root / "samples/train-000")),
}


@pytest.mark.parametrize("name", READ)
def test_what_changed_since_it_was_written_is_refused(name: str, made: Path) -> None:
    file, read = READ[name]
    path, whole = made / file, (made / file).read_bytes()
    read(made)
    for harm in HARMS:
        harm(path)
        with pytest.raises(FiptError, match=SAID) as caught:
            read(made)
        assert str(path) in str(caught.value)
        path.write_bytes(whole)
    read(made)


def test_shading_too(tmp_path: Path) -> None:
    folder = tmp_path / "round-0" / "shading" / "train-000"
    folder.mkdir(parents=True)
    save_shading(folder, Shading.of(np.ones((5, SHADING_OUTPUTS, 3), np.float32)))
    write_manifest(folder.with_name("train-000.manifest.json"), "bake", sorted(folder.iterdir()), {})
    read_shading(folder)
    flipped(folder / "shading.npy")
    with pytest.raises(FiptError, match=r"delete .*train-000\.manifest\.json and run again"):
        read_shading(folder)


def test_the_printed_remedy_works(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The manifest that the line names is an output of the rule: without it the job runs again, and all is well."""
    flipped(made / "samples/train-000/weight.npy")
    cache = ("cache", "--dataset", str(made / "dataset"), "--samples", str(made / "samples/train-000"))
    said = refused(capsys, *cache, "--out", str(made / "cache.npz"))
    manifest = Path(said.split("; delete ")[1].split(" and run again")[0])
    assert manifest == made / "samples/train-000.manifest.json"
    manifest.unlink()
    sampled(made)
    assert main([*cache, "--out", str(made / "cache.npz")]) == 0


def test_a_verb_reads_no_image_of_another_import(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flipped(made / "dataset/mesh.ply")
    sampled(made, code=2)
    assert "mesh.ply is not what its stage wrote" in capsys.readouterr().err


def test_files_without_a_manifest_are_read(tmp_path: Path) -> None:
    """What somebody made by hand has none, and a damaged manifest says nothing."""
    folder = tmp_path / "shading"
    folder.mkdir()
    save_shading(folder, Shading.of(np.ones((5, SHADING_OUTPUTS, 3), np.float32)))
    read_shading(folder)
    for text in ("{", '{"files": 3}', "\xff"):
        folder.with_name("shading.manifest.json").write_text(text, encoding="latin-1")
        read_shading(folder)


def test_the_remedy_names_what_the_workflow_knows(tmp_path: Path) -> None:
    alone = tmp_path / "a.npy"
    alone.write_bytes(b"\x93NUMPY\x01\x00")
    with pytest.raises(FiptError, match=r"; delete .*a\.npy and run again"):
        load_npy(alone)
    folder = tmp_path / "shard" / "sub"
    save_npy(folder / "b.npy", np.zeros(3))
    write_manifest(tmp_path / "all.manifest.json", "samples", [folder / "b.npy"], {})
    assert made_again(folder / "b.npy") == f"delete {tmp_path}/all.manifest.json and run again"
    write_manifest(tmp_path / "shard.manifest.json", "samples", [], {})
    assert made_again(folder / "b.npy") == f"delete {tmp_path}/shard.manifest.json and run again"


@pytest.mark.parametrize(
    ("folder", "file", "read"),
    [
        ("dataset", "images/train_000.exr", lambda: Dataset(".").image("train_000")),
        ("dataset", "mesh.ply", lambda: Dataset(".").mesh()),
        ("dataset/images", "train_000.exr", lambda: Dataset("..").image("train_000")),
        ("samples/train-000", "position.npy", lambda: read_samples(".")),
    ],
)
def test_the_working_directory_is_a_folder_like_others(
    folder: str, file: str, read: Callable[[], object], made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``--dataset .`` and ``--samples .``: their manifests lie in them, or beside them."""
    monkeypatch.chdir(made / folder)
    read()
    flipped(Path(file))
    with pytest.raises(FiptError, match=SAID):
        read()


@pytest.mark.parametrize("path", ["a.npz", "results/x/a.npz", "./a.npz", "../a.npz"])
def test_a_damaged_array_of_a_relative_path_is_one_line(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "w" / "results" / "x").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "w")
    Path(path).write_bytes(b"PK\x03\x04")
    with pytest.raises(FiptError, match=r"a\.npz is not a complete npz file.*; delete .*a\.npz and run again"):
        load_npz(path)


def test_a_manifest_beside_the_working_directory_is_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_npy(tmp_path / "shard" / "a.npy", np.zeros(3))
    write_manifest(tmp_path / "shard.manifest.json", "samples", [tmp_path / "shard" / "a.npy"], {})
    monkeypatch.chdir(tmp_path / "shard")
    cut(Path("a.npy"))
    with pytest.raises(FiptError, match=f"delete {tmp_path}/shard.manifest.json and run again"):
        load_npy("a.npy")


@pytest.mark.parametrize("folder", [".", "..", "a/.."])
def test_a_folder_without_a_name_is_not_replaced(folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "w" / "a").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "w")
    before = contents(tmp_path)
    with pytest.raises(FiptError, match="has no name of its own"), atomic_folder(folder, ANYTHING):
        pass
    assert contents(tmp_path) == before


def test_one_manifest_that_is_right_is_enough(tmp_path: Path) -> None:
    """Shards that are cut in another way leave manifests of images that were written again since."""
    image = tmp_path / "images" / "train_012.exr"
    image.parent.mkdir()
    for shard, content in (("train-003", b"old"), ("train-001", b"new")):
        image.write_bytes(content)
        write_manifest(tmp_path / f"images.{shard}.manifest.json", "synthesize", [image], {})
    assert ListedFiles(tmp_path).check(image) == image
    image.write_bytes(b"neither")
    with pytest.raises(FiptError, match=r"delete .*images\.train-001\.manifest\.json and run again"):
        ListedFiles(tmp_path).check(image)


def test_samples_that_are_killed_before_their_manifest_leave_none(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shard = made / "samples" / "train-000"

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("fipt.formats.manifests.write_manifest", killed)
    views = ("--dataset", str(made / "dataset"), "--views", "train_000")
    assert main(["samples", *views, "--out", str(shard)]) != 0
    assert read_samples(shard).views == ("train_000",)
    assert not shard.with_name("train-000.manifest.json").exists()


def test_every_stage_takes_its_old_manifest_away_first() -> None:
    """Else one that is killed while it writes leaves new files and a manifest of others."""
    stages = Path(fipt.stages.__file__).parent
    writers = [
        path for path in stages.rglob("*.py") if re.search(r"^ +write_manifest\(", path.read_text(), re.MULTILINE)
    ]
    assert len(writers) > 10
    keep = [path for path in writers if not re.search(r"^ +withdraw_manifest\(", path.read_text(), re.MULTILINE)]
    assert keep == []
