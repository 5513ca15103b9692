"""Every writer leaves the whole file or the one before it; names stay inside their folder."""

import errno
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.arrays import save_npy, save_npz
from fipt.formats.exr import write_exr
from fipt.formats.files import atomic, atomic_folder, check_name, existing_file, write_text
from fipt.formats.images import write_png
from fipt.scene.mesh import write_ply
from tests.layouts import room

WRITERS: dict[str, Callable[[Path], None]] = {
    "text.json": lambda path: write_text(path, "new"),
    "array.npy": lambda path: save_npy(path, np.arange(3)),
    "arrays.npz": lambda path: save_npz(path, a=np.arange(3)),
    "image.exr": lambda path: write_exr(path, {"Y": np.zeros((2, 3), np.float32)}),
    "ids.png": lambda path: write_png(path, np.zeros((2, 3), np.uint16)),
    "mesh.ply": lambda path: write_ply(path, room()),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_writer_that_is_stopped_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = tmp_path / "folder" / name
    path.parent.mkdir()
    path.write_text("old")

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", stop)
        with pytest.raises(KeyboardInterrupt):
            WRITERS[name](path)
    assert path.read_text() == "old"
    assert list(path.parent.iterdir()) == [path]
    WRITERS[name](path)
    assert path.read_bytes() != b"old"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("name", WRITERS)
def test_writers_make_their_folder_and_repeat_exactly(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / "a" / "b" / name)
    WRITERS[name](tmp_path / "c" / name)
    assert (tmp_path / "a" / "b" / name).read_bytes() == (tmp_path / "c" / name).read_bytes()


def test_the_temporary_name_keeps_the_suffix(tmp_path: Path) -> None:
    with atomic(tmp_path / "x.exr") as temporary:
        assert temporary.suffix == ".exr"
        assert temporary.parent == tmp_path
        temporary.touch()


@pytest.mark.parametrize("writer", [atomic, partial(atomic_folder, holds="out")])
@pytest.mark.parametrize(
    ("code", "message"),
    [
        (errno.EACCES, "out cannot be written .*; check the folder's permissions"),
        (errno.EROFS, "out cannot be written .*; check the folder's permissions"),
        (errno.ENOSPC, "the disk is full while writing .*out; free some space"),
    ],
)
def test_disk_and_permission_errors_are_explained(tmp_path: Path, writer: Callable, code: int, message: str) -> None:
    with pytest.raises(FiptError, match=message), writer(tmp_path / "out"):
        raise OSError(code, os.strerror(code))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder_is_explained(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(FiptError, match="cannot be written"):
        write_text(tmp_path / "out", "text")


def test_other_os_errors_keep_their_traceback(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="timed out"), atomic(tmp_path / "out"):
        raise OSError(errno.ETIMEDOUT, "timed out")


def test_a_folder_is_replaced_as_a_whole(tmp_path: Path) -> None:
    folder = tmp_path / "shard"
    for content in ("one", "two"):
        with atomic_folder(folder, "one|two") as temporary:
            (temporary / content).write_text(content)
        assert [path.name for path in folder.iterdir()] == [content]
    with pytest.raises(FileNotFoundError), atomic_folder(folder, "one|two") as temporary:
        (temporary / "missing" / "three").write_text("three")
    assert [path.name for path in folder.iterdir()] == ["two"]
    assert list(tmp_path.iterdir()) == [folder]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FiptError, match=r"the mesh is missing: .*room\.ply"):
        existing_file(tmp_path / "room.ply", "the mesh")
    (tmp_path / "import.manifest.json").write_text('{"files": {\n "images/a.exr": "1"}}')
    with pytest.raises(FiptError, match=r"images/a\.exr; delete .*/import\.manifest\.json and run again"):
        existing_file(tmp_path / "images" / "a.exr", "an image")
    with pytest.raises(FiptError, match=r"images/b\.exr; check the path, or run the stage that writes it"):
        existing_file(tmp_path / "images" / "b.exr", "an image")
    with pytest.raises(FiptError, match="missing"):
        existing_file(tmp_path, "the mesh")


@pytest.mark.parametrize("name", ["000", "train_003", "IMG-1.raw", "a" * 100])
def test_usable_names(name: str) -> None:
    assert check_name(name, "view") == name


@pytest.mark.parametrize(
    "name", ["", ".", "..", ".hidden", "a/b", "../x", "a\\b", "a b", "-x", "a..b", "ü", "a\n",
             "a" * 101],
)  # fmt: skip
def test_names_that_would_leave_the_folder(name: str) -> None:
    with pytest.raises(FiptError, match="cannot be used as a file name"):
        check_name(name, "view")


@pytest.mark.parametrize("holds", [r"\w+\.npy", "part"])
def test_a_folder_with_other_files_is_not_replaced(tmp_path: Path, holds: str) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "holiday.jpg").write_text("mine")
    with pytest.raises(FiptError, match=r"photos is replaced, but holds holiday\.jpg"), atomic_folder(folder, holds):
        pass
    assert (folder / "holiday.jpg").read_text() == "mine"


def test_a_folder_that_is_a_link_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "mine")
    with pytest.raises(FiptError, match=r"is a link to .*mine; remove the link"), atomic_folder(tmp_path / "out", ".*"):
        pass
    assert (tmp_path / "mine").is_dir()
