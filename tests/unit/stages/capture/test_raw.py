"""RAW files: what is read of them, and what is said of those that cannot be used."""

import struct
from datetime import datetime
from fractions import Fraction
from pathlib import Path

import exifread
import numpy as np
import pytest

from fipt.conventions import XYZ_FROM_SRGB
from fipt.errors import FiptError
from fipt.stages.capture.raw import Shot, read_raw, read_shot
from fipt.synthetic import dng
from fipt.synthetic.dng import PATTERNS, Header, write_dng

MATRIX = np.linalg.inv(XYZ_FROM_SRGB)
BLACK = (512.25, 509.5, 514.75, 511.0)


def header(**changes: object) -> Header:
    values = {
        "pattern": "RGGB",
        "black": BLACK,
        "white": 16383,
        "color_matrix": MATRIX,
        "neutral": (0.5, 1.0, 0.8),
        "exposure": Fraction(1, 60),
        "f_number": 8.0,
        "iso": 200,
        "focal_length": 24.0,
        "focal_length_35": 36.0,
        "time": datetime(2026, 5, 1, 10, 0, 0, 250_000),
    }
    return Header(**{**values, **changes})


@pytest.fixture
def mosaic(np_rng: np.random.Generator) -> np.ndarray:
    return np_rng.integers(500, 16000, (64, 96)).astype(np.uint16)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_samples_levels_and_colours_by_position(tmp_path: Path, mosaic: np.ndarray, pattern: str) -> None:
    write_dng(tmp_path / "a.dng", mosaic, header(pattern=pattern))
    frame = read_raw(tmp_path / "a.dng")
    assert (frame.mosaic == mosaic).all()
    assert "".join("RGBG"[c] for c in frame.pattern.ravel()) == pattern
    # LibRaw gives black levels by colour and cuts off fractions; by position they are those of the file.
    assert frame.black[frame.pattern].ravel().tolist() == list(BLACK)
    assert frame.white.tolist() == [16383.0] * 4
    assert frame.white_balance == pytest.approx([2.0, 1.0, 1.25], rel=1e-5)
    assert frame.camera_from_xyz == pytest.approx(MATRIX, abs=1e-5)


@pytest.mark.parametrize(("first", "second", "used"), [(17, 21, 1), (21, 17, 0), (17, 23, 0)])
def test_the_colour_matrix_of_a_dng_is_that_for_daylight(
    tmp_path: Path, mosaic: np.ndarray, monkeypatch: pytest.MonkeyPatch, first: int, second: int, used: int
) -> None:
    """Telephones state one for incandescent light first; D65 is 21."""
    matrices, tags = (MATRIX, MATRIX + 0.25), dng._main_tags

    def two_illuminants(shape: tuple[int, ...], own: Header) -> dict:
        stated = {0xC65A: ("short", [first]), 0xC65B: ("short", [second]), 0xC622: ("srational", np.ravel(matrices[1]))}
        return tags(shape, own) | stated

    monkeypatch.setattr(dng, "_main_tags", two_illuminants)
    write_dng(tmp_path / "a.dng", mosaic, header())
    assert read_raw(tmp_path / "a.dng").camera_from_xyz == pytest.approx(matrices[used], abs=1e-5)


def test_metadata(tmp_path: Path, mosaic: np.ndarray) -> None:
    write_dng(tmp_path / "a.dng", mosaic, header(orientation=6))
    shot = read_shot(tmp_path / "a.dng")
    assert shot == read_raw(tmp_path / "a.dng").shot
    assert (shot.shutter, shot.aperture, shot.iso) == (pytest.approx(1 / 60), 8.0, 200.0)
    assert (shot.focal_length, shot.focal_length_35, shot.orientation) == (24.0, 36.0, 6)
    assert (shot.camera, shot.lens, shot.serial) == ("fipt Simulated camera", "Simulated lens", "0001")
    assert shot.time == datetime.fromisoformat("2026-05-01T10:00:00.25+00:00").timestamp()


def said(path: Path) -> str:
    with pytest.raises(FiptError) as caught:
        read_raw(path)
    return str(caught.value).replace(str(path), "FILE")


def test_files_that_cannot_be_used_are_named_in_one_line(tmp_path: Path, mosaic: np.ndarray) -> None:
    path = tmp_path / "a.dng"
    assert said(path) == "a RAW file is missing: FILE; check the path, or run the stage that writes it"
    path.write_text("this is no photograph\n" * 50)
    assert said(path) == "FILE is not a RAW file that LibRaw reads; leave it out or convert it to DNG"
    write_dng(path, mosaic, header())
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert said(path) == "FILE is truncated or damaged (Input/output error); copy it from the card again"
    write_dng(path, mosaic, header(exposure=None))
    assert said(path) == "FILE states no exposure time; give it in captures.tsv (columns view, file, shutter)"
    write_dng(path, np.stack([mosaic] * 3, axis=-1), header())
    assert said(path) == (
        "FILE holds no colour mosaic (sRAW, mRAW or linear RAW); "
        "photograph in full RAW; these files are demosaiced already"
    )


def test_only_the_header_is_needed_to_see_that_a_time_is_missing(tmp_path: Path, mosaic: np.ndarray) -> None:
    write_dng(tmp_path / "a.dng", mosaic, header(exposure=None))
    with pytest.raises(FiptError, match="states no exposure time"):
        read_shot(tmp_path / "a.dng")


@pytest.mark.parametrize("error", [EOFError, struct.error, NotImplementedError, ValueError])
def test_a_header_that_exifread_cannot_read_tells_nothing(tmp_path, monkeypatch, error):
    def damaged(*_, **__):
        raise error

    (tmp_path / "a.jpg").write_bytes(b"no EXIF")
    monkeypatch.setattr(exifread, "process_file", damaged)
    assert read_shot(tmp_path / "a.jpg") == Shot(tmp_path / "a.jpg")
