"""Round trips of EXR, npy, npz and PNG, and what is said of damaged ones."""

import errno
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, load_npz, on_disk, save_npy, save_npz
from fipt.formats.exr import read_exr, read_rgb, write_exr
from fipt.formats.images import read_ids, srgb_decode, srgb_encode, to_display, write_png

# --- EXR ------------------------------------------------------------------------------------------


def test_exr_round_trip(tmp_path: Path, np_rng: np.random.Generator) -> None:
    rgb = np_rng.uniform(0, 1e6, (5, 7, 3)).astype(np.float32)
    layer = np_rng.normal(size=(5, 7, 3)).astype(np.float32)
    scalar = np.array([0, -1, np.inf, np.nan, 1e-30] * 7, np.float32).reshape(5, 7)
    ids = np_rng.integers(0, 2**32, (5, 7), dtype=np.uint32)
    write_exr(tmp_path / "a.exr", {"": rgb, "kd": layer, "roughness.Y": scalar, "id": ids})
    read = read_exr(tmp_path / "a.exr")
    assert set(read) == {"R", "G", "B", "kd.R", "kd.G", "kd.B", "roughness.Y", "id"}
    np.testing.assert_array_equal(read_rgb(tmp_path / "a.exr"), rgb)
    np.testing.assert_array_equal(read_rgb(tmp_path / "a.exr", "kd"), layer)
    np.testing.assert_array_equal(read["roughness.Y"], scalar)
    np.testing.assert_array_equal(read["id"], ids)
    assert read["id"].dtype == np.uint32
    assert read["R"].dtype == np.float32


def test_half_exr_is_read_as_float32(tmp_path: Path) -> None:
    values = np.linspace(0, 2, 12, dtype=np.float32).reshape(3, 4)
    write_exr(tmp_path / "a.exr", {"Y": values}, half=True)
    read = read_exr(tmp_path / "a.exr")["Y"]
    assert read.dtype == np.float32
    np.testing.assert_array_equal(read, values.astype(np.float16).astype(np.float32))


def test_missing_channels_are_named(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"R": np.zeros((2, 2)), "Z": np.zeros((2, 2))})
    with pytest.raises(FiptError, match=r"a\.exr must have the channels R, G, B; G, B not among R, Z"):
        read_rgb(tmp_path / "a.exr")


def test_a_damaged_exr_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"": np.random.default_rng(0).random((32, 32, 3))})
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(FiptError, match=r"a\.exr is not a readable EXR file"):
        read_exr(path)
    path.write_text("not an image")
    with pytest.raises(FiptError, match=r"a\.exr is not a readable EXR file"):
        read_exr(path)


# --- npy, npz -------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int32, np.int64, np.uint8])
def test_npy_round_trip(tmp_path: Path, dtype: type) -> None:
    array = np.arange(24).reshape(2, 3, 4).astype(dtype)[:, ::2]
    save_npy(tmp_path / "a.npy", array)
    for mmap in (True, False):
        read = load_npy(tmp_path / "a.npy", mmap)
        assert read.dtype == dtype
        np.testing.assert_array_equal(read, array)
    with pytest.raises(ValueError, match="read-only"):
        load_npy(tmp_path / "a.npy")[0] = 1


def test_npz_round_trip(tmp_path: Path) -> None:
    arrays = {"triangle": np.arange(3), "radiance": np.ones((3, 3), np.float32)}
    save_npz(tmp_path / "a.npz", **arrays)
    read = load_npz(tmp_path / "a.npz")
    assert set(read) == set(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(read[name], array)


def test_nothing_is_pickled(tmp_path: Path) -> None:
    objects = np.array([{}, None], dtype=object)
    with pytest.raises(ValueError, match="allow_pickle"):
        save_npy(tmp_path / "a.npy", objects)
    np.save(tmp_path / "b.npy", objects, allow_pickle=True)
    with pytest.raises(FiptError, match="not a complete npy array"):
        load_npy(tmp_path / "b.npy")
    np.savez(tmp_path / "b.npz", a=objects)
    with pytest.raises(FiptError, match="not a complete npz file"):
        load_npz(tmp_path / "b.npz")


@pytest.mark.parametrize("keep", [0, 40, 200])
def test_cut_arrays_are_named(tmp_path: Path, keep: int) -> None:
    save_npy(tmp_path / "a.npy", np.arange(100))
    save_npz(tmp_path / "a.npz", a=np.arange(100))
    for path, load in ((tmp_path / "a.npy", load_npy), (tmp_path / "a.npz", load_npz)):
        path.write_bytes(path.read_bytes()[:keep])
        with pytest.raises(FiptError, match=f"{path.name} is not a complete"):
            load(path)


# --- PNG, sRGB ------------------------------------------------------------------------------------


def test_ids_round_trip(tmp_path: Path) -> None:
    ids = np.array([[0, 1, 255], [256, 40_000, 65_535]], np.uint16)
    write_png(tmp_path / "a.png", ids)
    read = read_ids(tmp_path / "a.png")
    assert read.dtype == np.uint16
    np.testing.assert_array_equal(read, ids)


def test_a_colour_picture_is_no_id_map(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((2, 2, 3), np.uint8)).save(tmp_path / "a.png")
    with pytest.raises(FiptError, match="must be a grey PNG"):
        read_ids(tmp_path / "a.png")


def test_srgb_curve() -> None:
    np.testing.assert_allclose(srgb_encode(np.array([0, 0.0031308, 0.2140411, 1.0])),
                               [0, 0.04045, 0.5, 1.0], atol=1e-5)  # fmt: skip
    values = np.geomspace(1e-6, 50, 99)
    np.testing.assert_allclose(srgb_decode(srgb_encode(values)), values, rtol=1e-5)
    assert (np.diff(srgb_encode(values)) > 0).all()
    assert to_display(np.array([-1.0, 0.0, 1.0, 7.0])).tolist() == [0, 0, 255, 255]


# --- arrays without a name ------------------------------------------------------------------------


def test_arrays_on_disk_leave_nothing_behind(tmp_path: Path) -> None:
    empty = on_disk(tmp_path / "new")
    array = empty((3, 1000), np.float32)
    array[:] = np.arange(1000)
    assert array.dtype == np.float32
    assert array.sum() == 3 * 499500
    assert list((tmp_path / "new").iterdir()) == []
    assert empty((0, 3), np.uint8).shape == (0, 3)


def test_arrays_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full, raising=False)
    with pytest.raises(FiptError, match="the disk is full"):
        on_disk(tmp_path)((10,), np.uint8)
