"""Predicted depth is brought to the depth that is known, view by view."""

from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.scene.depth_maps import DepthMap
from fipt.stages.geometry.volume.prior import scale_and_shift, with_prior
from tests.unit.stages.geometry.test_fusing import view_of_cube

VIEW = view_of_cube("v", (0.2, 0.1, 0.3), 0.4)


def sparse(share: float):
    """The view with a part of its depth."""
    keep = np.random.default_rng(0).random(VIEW.map.depth.shape) < share
    return VIEW.with_map(DepthMap(np.where(keep, VIEW.map.depth, 0), keep.astype(np.float32), VIEW.map.normal))


def test_scale_and_shift_are_solved_despite_outliers(tmp_path: Path):
    rng = np.random.default_rng(1)
    depth = rng.uniform(1, 4, 400)
    wrong = np.where(rng.random(400) < 0.2, depth + 2, depth)
    scale, shift = scale_and_shift((depth - 0.5) / 3, wrong, np.ones(400))
    assert (scale, shift) == pytest.approx((3, 0.5), abs=1e-3)


def test_predicted_depth_fills_the_view(tmp_path: Path):
    layers = {"depth": (VIEW.map.depth - 0.3) / 2} | {
        f"normal.{axis}": VIEW.map.normal[..., k] for k, axis in enumerate("XYZ")
    }
    write_exr(tmp_path / "v.exr", layers)
    (found,) = with_prior([sparse(0.1)], tmp_path)
    np.testing.assert_allclose(found.map.depth, VIEW.map.depth, atol=1e-3)
    np.testing.assert_allclose(found.map.normal, VIEW.map.normal, atol=1e-3)


@pytest.mark.parametrize(
    "predicted",
    [
        (VIEW.map.depth - VIEW.map.depth.mean()) / VIEW.map.depth.std(),
        2 * (VIEW.map.depth - VIEW.map.depth.min()) / np.ptp(VIEW.map.depth) - 1,
    ],
    ids=["normalized", "-1 to 1"],
)
def test_predicted_depth_may_be_negative(tmp_path: Path, predicted: np.ndarray) -> None:
    values = predicted.copy()
    values[:5, :5], values[5:10, :5] = np.nan, 0
    write_exr(tmp_path / "v.exr", {"depth": values})
    (found,) = with_prior([sparse(0.1)], tmp_path)
    assert not found.map.known[:10, :5].any()
    assert found.map.known.mean() > 0.98
    np.testing.assert_allclose(found.map.depth[found.map.known], VIEW.map.depth[found.map.known], atol=1e-3)


def test_a_view_of_which_nothing_is_known_has_no_predicted_depth(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    write_exr(tmp_path / "v.exr", {"depth": VIEW.map.depth})
    (found,) = with_prior([sparse(0.0)], tmp_path)
    assert not found.map.known.any()
    assert "predicted depth of v is left out" in caplog.text


def test_predicted_depth_that_cannot_be_used(tmp_path: Path):
    with pytest.raises(FiptError, match=r"geometry.prior must hold .*v.png is missing"):
        with_prior([VIEW], tmp_path)
    write_exr(tmp_path / "v.exr", {"depth": VIEW.map.depth[:30]})
    with pytest.raises(FiptError, match=r"must have the shape of its view, 80x60 .*it is 80x30"):
        with_prior([VIEW], tmp_path)
    write_exr(tmp_path / "v.exr", {"depth": 1 / VIEW.map.depth})
    with pytest.raises(FiptError, match="grows with the distance"):
        with_prior([VIEW], tmp_path)
