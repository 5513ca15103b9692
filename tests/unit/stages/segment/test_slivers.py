"""What is too narrow for a pixel is one region with what it touches."""

from pathlib import Path

import numpy as np
import pytest

from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.observed import read_observed
from fipt.scene.samples import segments_of
from fipt.stages.segment.region_pixels import region_pixels
from fipt.stages.segment.slivers import without_slivers
from fipt.stages.segment.surface import CellSurface
from fipt.stages.segment.views import CellObservations


def row_of_cells(widths: list[int]) -> tuple[CellSurface, CellObservations]:
    """Strips side by side and the one view of them, 6 pixels high; each strip is some pixels wide."""
    count = len(widths)
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    ones = np.ones(count)
    surface = CellSurface(np.zeros((count, 3)), ones, pairs, ones[1:], np.zeros(count - 1))
    shown = np.tile(np.repeat(np.arange(count), widths), 6).astype(np.int32)
    camera = Camera("view", "train", sum(widths), 6, 10.0, 10.0, 0.0, 0.0, np.eye(4))
    return surface, CellObservations([camera], shown, np.ones(len(shown), np.float16), 0.01)


@pytest.mark.parametrize(
    ("widths", "expected"),
    [
        ([4, 1, 2, 4], [0, 1, 1, 3]),  # two narrow ones between two wide ones
        ([4, 1, 4], [0, 1, 2]),  # a narrow one alone stays what it is
        ([4, 1, 0, 1, 4], [0, 1, 2, 3, 4]),  # what no view shows joins nothing
    ],
)
def test_slivers_that_touch_are_one_region(widths, expected) -> None:
    surface, observations = row_of_cells(widths)
    found = without_slivers(surface, np.arange(len(widths)) + 5, observations)
    assert found.min() == 1
    assert [int(np.flatnonzero(found == k)[0]) for k in found] == expected


def test_a_region_has_no_pixels_but_those_that_it_fills(scene: Path) -> None:
    data = Dataset(scene / "dataset")
    shards = read_observed(data, [scene / "samples" / "train-000"], [scene / "round-0" / "shading" / "train-000"])
    regions = [segments_of(data, shard.samples, "part") for shard in shards]
    whole = region_pixels(shards, regions)
    assert set(np.unique(whole.region)) <= set(np.unique(regions[0]).tolist())
    # every pixel a region of its own: what is left shows one piece of surface, and nothing else that a centre shows
    own = [np.arange(1, len(ids) + 1, dtype=np.uint16) * (ids > 0) for ids in regions]
    alone = region_pixels(shards, own).region
    samples = shards[0].samples
    shown = samples.triangle[samples.offsets[:-1][samples.center > 0]]
    row, sample = samples.samples_of(alone - 1)
    assert (np.bincount(row, np.isin(samples.triangle[sample], shown)) <= 1).all()
    assert 0 < len(alone) <= len(whole.region)
