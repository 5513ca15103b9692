"""Depth maps come back from their files as they were; damaged ones are refused."""

from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.scene.depth_maps import DepthMap, read_depth_map, write_depth_map


def some_map(rng: np.random.Generator) -> DepthMap:
    depth = rng.uniform(0.5, 5.0, (4, 6)).astype(np.float32)
    depth[1, 2] = 0.0
    normal = rng.normal(size=(4, 6, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return DepthMap(depth, rng.uniform(0, 1, (4, 6)).astype(np.float32), normal)


def test_a_depth_map_comes_back_as_it_was(tmp_path: Path, np_rng: np.random.Generator) -> None:
    given = some_map(np_rng)
    write_depth_map(tmp_path / "view.exr", given)
    read = read_depth_map(tmp_path / "view.exr")
    for name in ("depth", "confidence", "normal"):
        assert np.array_equal(getattr(read, name), getattr(given, name)), name
    assert read.known.sum() == 23


@pytest.mark.parametrize(("channel", "value"), [("depth", -1.0), ("depth", np.nan), ("confidence", 1.5)])
def test_values_that_cannot_be_are_refused(
    tmp_path: Path, np_rng: np.random.Generator, channel: str, value: float
) -> None:
    path = tmp_path / "view.exr"
    write_depth_map(path, some_map(np_rng))
    channels = read_exr(path)
    channels[channel][2, 3] = value
    write_exr(path, channels)
    with pytest.raises(FiptError, match=rf"{channel} must be finite.*row 2, column 3"):
        read_depth_map(path)


def test_an_image_is_no_depth_map(tmp_path: Path) -> None:
    write_exr(tmp_path / "view.exr", {"": np.ones((2, 3, 3), np.float32)})
    with pytest.raises(FiptError, match="must have the channels depth"):
        read_depth_map(tmp_path / "view.exr")
