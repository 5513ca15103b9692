"""DNG files as LibRaw (rawpy) and ExifRead see them."""

from dataclasses import replace
from datetime import datetime
from fractions import Fraction

import exifread
import numpy as np
import pytest
import rawpy

from fipt.conventions import XYZ_FROM_SRGB
from fipt.errors import FiptError
from fipt.synthetic.dng import PATTERNS, Header, write_dng

BLACK = (512.25, 640.5, 100.0, 77.75)
"""Different at each position of the cell, and fractional."""


def header(**changes) -> Header:
    described = Header(
        pattern="RGGB",
        black=BLACK,
        white=16383,
        color_matrix=np.linalg.inv(XYZ_FROM_SRGB),
        neutral=(0.5, 1.0, 0.625),
        exposure=Fraction(1, 60),
        f_number=5.6,
        iso=200,
        focal_length=24.5,
        focal_length_35=36.6,
        time=datetime(2026, 1, 2, 3, 4, 5, 670_000),
        make="Maker",
        model="Model 7",
        serial="12345",
        lens="24-105 mm",
    )
    return replace(described, **changes)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize(("bits", "shape"), [(12, (24, 32)), (14, (63, 97)), (16, (64, 96))])
def test_libraw_reads_every_sample_and_knows_its_colour(tmp_path, np_rng, pattern, bits, shape):
    mosaic = np_rng.integers(0, 2**bits, shape).astype(np.uint16)
    mosaic[:2, 0] = 0, 2**bits - 1
    write_dng(tmp_path / "a.dng", mosaic, header(pattern=pattern, white=2**bits - 1))
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        np.testing.assert_array_equal(raw.raw_image_visible, mosaic)
        np.testing.assert_array_equal(raw.raw_image, mosaic)
        colors = raw.raw_colors_visible[:2, :2].ravel()
        assert "".join(chr(raw.color_desc[c]) for c in colors) == pattern
        assert raw.white_level == 2**bits - 1
        # LibRaw lists black levels by colour (R, G, B, second G) and cuts off fractions.
        levels = [raw.black_level_per_channel[c] for c in colors]
        assert levels == [int(level) for level in BLACK]
        assert raw.camera_whitebalance[:3] == pytest.approx([2.0, 1.0, 1.6], rel=1e-5)


def test_exif_tells_how_it_was_taken(tmp_path):
    write_dng(tmp_path / "a.dng", np.zeros((24, 32), np.uint16), header())
    with open(tmp_path / "a.dng", "rb") as file:
        tags = exifread.process_file(file)
    expected = {
        "EXIF ExposureTime": [Fraction(1, 60)],
        "EXIF FNumber": [Fraction(28, 5)],
        "EXIF ISOSpeedRatings": [200],
        "EXIF FocalLength": [Fraction(49, 2)],
        "EXIF FocalLengthIn35mmFilm": [37],
        "EXIF DateTimeOriginal": "2026:01:02 03:04:05",
        "EXIF SubSecTimeOriginal": "67",
        "EXIF LensModel": "24-105 mm",
        "EXIF BodySerialNumber": "12345",
        "Image Make": "Maker",
        "Image Model": "Model 7",
        "Image Orientation": [1],
        "Image BlackLevel": [Fraction(level) for level in BLACK],
    }
    assert {name: tags[name].values for name in expected} == expected
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.other.shutter_speed == pytest.approx(1 / 60)
        assert raw.other.aperture == pytest.approx(5.6)
        assert raw.other.iso_speed == 200


@pytest.mark.parametrize("seconds", ["1/8000", "1/3", "0.8", "1.3", "30"])
def test_exposure_times_survive(tmp_path, seconds):
    write_dng(tmp_path / "a.dng", np.zeros((24, 32), np.uint16), header(exposure=Fraction(seconds)))
    with open(tmp_path / "a.dng", "rb") as file:
        assert exifread.process_file(file)["EXIF ExposureTime"].values == [Fraction(seconds)]


def test_exposure_time_can_be_left_out(tmp_path):
    write_dng(tmp_path / "a.dng", np.zeros((24, 32), np.uint16), header(exposure=None))
    with open(tmp_path / "a.dng", "rb") as file:
        assert "EXIF ExposureTime" not in exifread.process_file(file)
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.other.shutter_speed == 0


@pytest.mark.parametrize(("orientation", "flip", "shape"), [(1, 0, (64, 96)), (3, 3, (64, 96)), (6, 6, (96, 64))])
def test_a_camera_held_upright(tmp_path, orientation, flip, shape):
    write_dng(tmp_path / "a.dng", np.full((64, 96), 9000, np.uint16), header(orientation=orientation))
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.sizes.flip == flip
        assert raw.raw_image_visible.shape == (64, 96)
        assert raw.postprocess().shape[:2] == shape


def test_colour_matrix_and_neutral_make_white_white(tmp_path):
    """LibRaw's own development of what a camera with mixed colours records of sRGB white and of sRGB blue."""
    mixing = np.array([[0.8, 0.2, 0.0], [0.1, 0.8, 0.1], [0.05, 0.15, 0.8]])
    camera = np.diag((0.5, 1.0, 0.625)) @ mixing
    described = header(color_matrix=camera @ np.linalg.inv(XYZ_FROM_SRGB), black=(0, 0, 0, 0))
    for color in ((1, 1, 1), (0.2, 0.3, 0.9)):
        recorded = 8000 * camera @ color
        cell = np.array([[recorded[0], recorded[1]], [recorded[1], recorded[2]]])
        write_dng(tmp_path / "a.dng", np.tile(cell, (32, 48)).astype(np.uint16), described)
        with rawpy.imread(str(tmp_path / "a.dng")) as raw:
            shown = raw.postprocess(use_camera_wb=True, no_auto_bright=True, gamma=(1, 1), output_bps=16)
        shown = shown[32, 48].astype(float)
        np.testing.assert_allclose(shown / shown.max(), np.array(color) / max(color), atol=0.01)


def test_linear_raw_is_no_mosaic(tmp_path):
    write_dng(tmp_path / "a.dng", np.full((24, 32, 3), 700, np.uint16), header())
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.raw_type == rawpy.RawType.Stack
        assert (raw.raw_image_visible[..., :3] == 700).all()


def test_what_cannot_be_written_is_refused(tmp_path):
    mosaic = np.zeros((24, 32), np.uint16)
    for wrong, described in (
        (mosaic, header(pattern="RGBG")),
        (mosaic.astype(np.float32), header()),
        (mosaic[0], header()),
        (mosaic[..., None], header()),
    ):
        with pytest.raises(FiptError, match=r"Bayer|mosaic"):
            write_dng(tmp_path / "a.dng", wrong, described)
    with pytest.raises(FiptError, match="found 40x21"):
        write_dng(tmp_path / "a.dng", np.zeros((21, 40), np.uint16), header())
    assert not (tmp_path / "a.dng").exists()
    write_dng(tmp_path / "a.dng", np.zeros((22, 22), np.uint16), header())
    with rawpy.imread(str(tmp_path / "a.dng")) as raw:
        assert raw.raw_image_visible.shape == (22, 22)
