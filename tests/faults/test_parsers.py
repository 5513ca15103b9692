"""Every reader turns every failure into one line with the file's name: real files mutated, and made-up text."""

import json
import os
import struct
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fipt.config.files import read_yaml
from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, load_npz, save_npy, save_npz
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.hdr import read_hdr
from fipt.formats.images import read_ids, read_pixels, write_png
from fipt.formats.layouts import READERS
from fipt.formats.manifests import read_manifest, write_manifest
from fipt.formats.pose_files import read_pose_file
from fipt.formats.views import read_rejected
from fipt.scene.cameras import Camera, read_transforms, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.mesh import read_mesh, write_ply
from fipt.scene.sources import read_poses, read_source
from tests.layouts import WRITERS, room, write_obj

Reader = Callable[[Path], object]
MUTATED = 120 * int(os.environ.get("FIPT_FUZZ", "1"))
"""Inputs of each format here; FIPT_FUZZ in the environment multiplies them."""


def _npy(path: Path) -> None:
    save_npy(path, np.arange(60, dtype=np.float32).reshape(20, 3))


def _npz(path: Path) -> None:
    save_npz(path, a=np.arange(40), b=np.eye(3))


def _exr(path: Path) -> None:
    write_exr(path, {"": np.random.default_rng(0).random((6, 8, 3)).astype(np.float32)})


def _hdr(path: Path) -> None:
    rows = np.random.default_rng(0).integers(1, 255, (6, 8, 4), np.uint8)
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 6 +X 8\n" + rows.tobytes())


def _png(path: Path) -> None:
    write_png(path, np.arange(48, dtype=np.uint16).reshape(6, 8))


def _layout(name: str) -> tuple[Callable[[Path], None], Reader]:
    """Writer of a layout in the folder of a file, and reader of its cameras."""
    return lambda path: (WRITERS[name](path.parent), None)[1], lambda path: read_source(path.parent, name)


def _dataset(path: Path) -> None:
    write_transforms(path, [Camera(name, "train", 8, 6, 4.0, 4.0, 4.0, 3.0, np.eye(4)) for name in "ab"])


def _manifest(path: Path) -> None:
    write_manifest(path, "samples", [], {"grid": 2})


def _colmap(path: Path) -> None:
    (path.parent / "cameras.txt").write_text("1 PINHOLE 8 6 4 4 4 3\n")
    path.write_text("1 1 0 0 0 1 2 3 1 a.jpg\n\n2 0.7 0 0.7 0 1 2 3 1 b.jpg\n1 2 3\n")


def _metashape(path: Path) -> None:
    matrix = " ".join(map(str, np.eye(4).ravel()))
    path.write_text(
        '<document><chunk><sensors><sensor id="0" type="frame"><resolution width="8" height="6"/><calibration>'
        '<f>4</f></calibration></sensor></sensors><cameras><camera label="a.jpg" sensor_id="0"><transform>'
        f"{matrix}</transform></camera></cameras></chunk></document>"
    )


def _reality(path: Path) -> None:
    path.write_text("#name,x,y,alt,heading,pitch,roll\na.jpg,1,2,3,10,20,30\n")


def _yaml(path: Path) -> None:
    path.write_text("scenes:\n  room: {source: procedural}\nfit: {steps: 3, seed: 0}\nonly: [room]\n")


FORMATS: dict[str, tuple[str, Callable[[Path], None], Reader]] = {
    "npy": ("a.npy", _npy, load_npy),
    "npz": ("a.npz", _npz, load_npz),
    "exr": ("a.exr", _exr, read_exr),
    "hdr": ("a.hdr", _hdr, read_hdr),
    "ids": ("a.png", _png, read_ids),
    "ply": ("a.ply", lambda path: write_ply(path, room()), read_mesh),
    "obj": ("a.obj", lambda path: write_obj(path, room()), read_mesh),
    "nerfstudio": ("transforms.json", *_layout("nerfstudio")),
    "poses": ("transforms.json", _layout("nerfstudio")[0], read_poses),
    "dataset": ("transforms.json", _dataset, read_transforms),
    "fipt-real": ("cam.txt", *_layout("fipt-real")),
    "manifest": ("a.manifest.json", _manifest, lambda path: read_manifest(path, "samples")),
    "views": ("views.json", lambda path: write_views(path, ["a", "b"], {"b": "blurred"}), read_rejected),
    "colmap": ("images.txt", _colmap, lambda path: read_pose_file(path.parent)),
    "metashape": ("a.xml", _metashape, read_pose_file),
    "realitycapture": ("a.csv", _reality, read_pose_file),
    "yaml": ("a.yaml", _yaml, read_yaml),
}


def judged(read: Reader, path: Path) -> None:
    """A reader returns, or says one line that names a file of the folder, within a second or so."""
    start, said = time.monotonic(), str(path)
    try:
        read(path)
    except FiptError as error:
        said = str(error)
    assert "\n" not in said
    assert str(path.parent) in said
    assert time.monotonic() - start < 10


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes cut, flipped, repeated, replaced by what parsers fall over."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        place = int(rng.integers(0, max(1, len(out))))
        match int(rng.integers(0, 6)):
            case 0:
                del out[place:]
            case 1 if out:
                out[place] ^= 1 << int(rng.integers(0, 8))
            case 2:
                out[place : place + 4] = bytes(rng.integers(0, 256, 4, np.uint8))
            case 3:
                out[place:place] = out[place : place + int(rng.integers(1, 40))]
            case 4:
                del out[place : place + int(rng.integers(1, 40))]
            case _:
                out[place : place + 1] = SPITEFUL[int(rng.integers(0, len(SPITEFUL)))]
    return bytes(out)


SPITEFUL = [
    b"1e999", b"-1", b"9" * 400, b"nan", b"null", b"\xff\xfe", b"\0", b"{", b"[" * 5000, b'"', b"-0", b"1e-400",
    b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"true", b"2147483648", b"&a [*a]", b"!!python/none",
]  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_mutated_files(name: str, tmp_path: Path) -> None:
    file, write, read = FORMATS[name]
    path = tmp_path / file
    write(path)
    whole = path.read_bytes()
    read(path)
    rng = np.random.default_rng(len(name))
    for _ in range(MUTATED):
        path.write_bytes(mutated(whole, rng))
        judged(read, path)


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_such_file(name: str, tmp_path: Path) -> None:
    """Nothing, an empty file, a folder, another format, a null byte."""
    file, write, read = FORMATS[name]
    path = tmp_path / file
    write(path)
    for content in (
        b"",
        b"\0" * 100,
        b"\xff" * 100,
        b"<html></html>",
        b"[]",
        b"{}",
        b"3",
        b'{"frames": 3}',
        b"PK\x03\x04",
    ):
        path.write_bytes(content)
        judged(read, path)
    path.unlink()
    judged(read, path)
    path.mkdir()
    judged(read, path)


WORDS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=9), st.just(10**400), st.just("../../x")
)
KEYS = st.sampled_from(
    [
        "frames",
        "file_path",
        "transform_matrix",
        "w",
        "h",
        "fl_x",
        "cx",
        "split",
        "mask_path",
        "k1",
        "camera_model",
        "views",
    ]
)
VALUES = st.recursive(
    WORDS, lambda inner: st.lists(inner, max_size=5) | st.dictionaries(KEYS, inner, max_size=6), max_leaves=25
)


@pytest.mark.parametrize("name", [name for name, (file, _, _) in FORMATS.items() if file.endswith(".json")])
def test_made_up_json(name: str, tmp_path: Path) -> None:
    file, write, read = FORMATS[name]
    path = tmp_path / file
    write(path)

    @settings(max_examples=60, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(VALUES)
    def run(values: object) -> None:
        path.write_text(json.dumps(values))
        judged(read, path)

    run()


def test_an_absurd_size_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    """65,535 squared of one bit: 4 GB once it is decoded, 50 bytes on the disk."""
    header = struct.pack(">IIBBBBB", 65535, 65535, 1, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")]
    data = b"".join(struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in chunks)
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + data)
    with pytest.raises(FiptError, match=r"a\.png is not a readable image.*(65535x65535 pixels|exceeds limit)"):
        read_pixels(tmp_path / "a.png", "ids")


def test_every_layout_is_read_here() -> None:
    assert {"nerfstudio", "fipt-real"} <= READERS.keys()
