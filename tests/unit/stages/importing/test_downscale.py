"""Datasets of smaller images than their source's."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fipt.conventions import FLAG_NOISE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.images import write_png
from fipt.scene.blocks import block_flags, block_ids, block_mean
from fipt.scene.dataset import Dataset
from fipt.stages.importing.build import import_scene
from fipt.stages.importing.downscale import downscale
from fipt.stages.importing.settings import ImportSettings
from tests.layouts import HEIGHT, LAMP, POSES, WIDTH, WRITERS, photo, write_masked

HALF = ImportSettings(overlay=True, downscale=2)


def test_images_truth_and_ids_are_averaged_and_cameras_with_them(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    WRITERS["fipt-synthetic"](tmp_path / "source")
    import_scene(tmp_path / "source", "fipt-synthetic", tmp_path / "full", ImportSettings(overlay=False))
    import_scene(tmp_path / "source", "fipt-synthetic", tmp_path / "half", HALF)
    full, half = Dataset(tmp_path / "full"), Dataset(tmp_path / "half")
    for large, small in zip(full.cameras, half.cameras, strict=True):
        assert (small.width, small.height) == (WIDTH // 2, HEIGHT // 2)
        radiance, valid = half.image(small.name)
        np.testing.assert_allclose(radiance, block_mean(full.image(large.name)[0], 2), rtol=1e-6)
        assert (valid == 1).all()
        np.testing.assert_allclose(small.project(LAMP[None])[0], large.project(LAMP[None])[0] / 2)
        before, after = full.truth(large.name), half.truth(small.name)
        assert before is not None
        assert after is not None
        assert set(before) == set(after)
        np.testing.assert_allclose(after["kd"], block_mean(before["kd"], 2), rtol=1e-6)
        np.testing.assert_array_equal(
            half.segments(small.name, "part"), block_ids(full.segments(large.name, "part"), 2)
        )
    assert (tmp_path / "half" / "overlay.png").is_file()


def test_pixels_without_weight_do_not_count_and_a_clipped_one_bounds_its_block(tmp_path: Path) -> None:
    bits = np.zeros((HEIGHT, WIDTH), np.uint32)
    bits[2, 5] = FLAG_SATURATED

    radiance = photo(POSES[0])
    radiance[:2, :2] = 3.0
    (tmp_path / "source").mkdir()
    write_masked(tmp_path / "source", radiance, bits)
    import_scene(tmp_path / "source", "nerfstudio", tmp_path / "half", HALF)
    half = Dataset(tmp_path / "half")
    radiance, valid = half.image("view_0")
    assert valid[0, 0] == 0.75
    np.testing.assert_allclose(radiance[0, 0], 3.0)
    flags = half.flags("view_0")
    assert flags[1, 2] == FLAG_SATURATED
    assert (flags > 0).sum() == 1


def test_a_clipped_pixel_does_not_stand_for_those_that_have_no_weight(tmp_path: Path) -> None:
    """Neighbours of a lamp have none, since demosaicing carries its light to them."""
    radiance, valid = np.zeros((2, 4, 3), np.float32), np.zeros((2, 4), np.float32)
    flags = np.zeros((2, 4), np.uint32)
    radiance[0, 0], valid[0, 0], flags[0, 0] = 10.0, 1, FLAG_SATURATED
    radiance[0, 2], valid[0, 2] = 0.1, 1
    write_exr(tmp_path / "a.exr", {"": radiance, "valid.Y": valid, "flags.Y": flags})
    camera: Any = SimpleNamespace(name="a", width=4, height=2, reduced=lambda factor: factor)
    (tmp_path / "images").mkdir()
    (tmp_path / "a.exr").rename(tmp_path / "images" / "a.exr")
    downscale(tmp_path, [camera], 2)
    found = read_exr(tmp_path / "images" / "a.exr", required="RGB")
    np.testing.assert_allclose(found["R"], [[2.5, 0.1]])
    np.testing.assert_allclose(found["valid.Y"], [[0.25, 0.25]])


def test_a_mask_and_the_weights_of_an_image_both_count(tmp_path: Path) -> None:
    from fipt.stages.importing.frames import read_image

    weight = np.ones((HEIGHT, WIDTH), np.float32)
    weight[0] = 0
    write_exr(tmp_path / "a.exr", {"": photo(POSES[0]), "valid.Y": weight})
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[:, 0] = 0
    write_png(tmp_path / "mask.png", mask)
    frame: Any = SimpleNamespace(image=tmp_path / "a.exr", mask=tmp_path / "mask.png")
    _, valid = read_image(frame)
    assert (valid[0] == 0).all()
    assert (valid[:, 0] == 0).all()
    assert (valid[1:, 1:] == 1).all()


def test_flags_of_noise_need_most_of_a_block() -> None:
    flags = np.array([[FLAG_NOISE, FLAG_SATURATED | FLAG_NOISE, FLAG_NOISE, 0], [FLAG_NOISE, 0, 0, 0]], np.uint32)
    np.testing.assert_array_equal(block_flags(flags, 2), [[FLAG_SATURATED | FLAG_NOISE, 0]])


def test_an_id_is_that_of_most_pixels_and_the_rest_is_cut_off() -> None:
    ids = np.array([[7, 7, 9, 3, 1], [7, 2, 3, 9, 1], [5, 5, 5, 5, 5]], np.uint16)
    np.testing.assert_array_equal(block_ids(ids, 2), [[7, 3]])


def test_something_must_be_left(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    WRITERS["nerfstudio"](tmp_path / "source")
    with pytest.raises(FiptError, match=f"16 leaves none of view .* of {WIDTH}x{HEIGHT}"):
        import_scene(tmp_path / "source", "nerfstudio", tmp_path / "d", ImportSettings(downscale=16))
    assert not (tmp_path / "d").exists()
