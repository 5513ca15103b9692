"""Every reader turns every failure into one line with the file's name: real files mutated, and made-up text."""

import json
import os
import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fipt.errors import FiptError
from fipt.formats.images import read_pixels
from fipt.formats.layouts import READERS
from tests.faults.formats import FORMATS, damaged, judged

INPUTS = 80 * int(os.environ.get("FIPT_FUZZ", "1"))
"""Of each format here; FIPT_FUZZ in the environment multiplies them. `tests.faults.formats` runs 10,000."""


@pytest.mark.parametrize("name", FORMATS)
def test_mutated_files(name: str, tmp_path: Path) -> None:
    assert damaged(name, tmp_path, INPUTS).total() == INPUTS


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
