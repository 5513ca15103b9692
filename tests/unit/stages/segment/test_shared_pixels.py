"""Pixels that regions share: what the others there reflect is taken off."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.model.reflectance import line_in_base_color
from fipt.scene.dataset import Dataset
from fipt.scene.observed import ObservedShard, read_observed
from fipt.scene.samples import segments_of, segments_of_triangles
from fipt.stages.segment import region_pixels as gathering
from fipt.stages.segment.material_evidence import BestMaterials, color_pieces, measure
from fipt.stages.segment.region_pixels import region_pixels, shared_pixels


@pytest.fixture
def observed(scene: Path) -> tuple[ObservedShard, np.ndarray]:
    """A shard as a room of matte surfaces would look, and the region of each of its pixels."""
    data = Dataset(scene / "dataset")
    (shard,) = read_observed(data, [scene / "samples" / "train-000"], [scene / "round-0" / "shading" / "train-000"])
    samples = shard.samples
    ids = segments_of(data, samples, "part")
    # the region of a triangle is that of most centres; here it is that of all
    seen = np.diff(samples.offsets) > 0
    first = samples.triangle[samples.offsets[:-1][seen]]
    of_triangle = segments_of_triangles([samples], [ids])[1]
    ids[seen] = of_triangle[first]
    of_triangle = segments_of_triangles([samples], [ids])[1]
    row, sample = samples.samples_of(np.arange(len(ids)))
    weight = samples.weight[sample]
    weight = weight / np.bincount(row, weight, len(ids))[row]
    reflected = looks(of_triangle[samples.triangle[sample]], shard.shading[sample])
    radiance = np.stack([np.bincount(row, weight * channel, len(ids)) for channel in reflected.T], axis=1)
    return replace(shard, radiance=radiance.astype(np.float32)), ids


def looks(region, shading):
    """Radiance of matte regions, each of a grey of its own."""
    offset, slope = line_in_base_color(np.asarray(shading, np.float32), 1.0, 0.0)
    return offset + slope * ((1 + region % 7) / 10)[:, None]


def test_the_pixels_that_are_used_are_of_all_columns(observed, monkeypatch):
    shard, ids = observed
    width, chosen = shard.samples.shapes[0][1], []

    def noted(shard, pixel, region_of):
        chosen.append(pixel)
        return gathering._filled(shard, pixel, region_of)

    monkeypatch.setattr(gathering, "_MOST", len(ids) // (width // 2))
    gathering._gathered([shard], [ids], noted)
    usable = len(gathering._usable(shard))
    assert abs(len(chosen[0]) - usable / (width // 2)) <= 1
    assert len(np.unique(chosen[0] % width)) > width / 4


def test_a_shared_pixel_shows_what_its_largest_region_reflects(observed):
    shard, ids = observed
    found = shared_pixels([shard], [ids], lambda region, place, normal, shading: looks(region, shading))
    assert len(found.region) > 20
    assert ((found.share > 0.5) & (found.share < 1)).all()
    np.testing.assert_allclose(found.radiance, looks(found.region, found.shading), rtol=2e-3, atol=1e-4)


def test_a_pixel_that_shows_something_unknown_is_left_out(observed):
    shard, ids = observed
    unknown = int(np.bincount(ids[ids > 0]).argmax())

    def known(region, place, normal, shading):
        return np.where(np.isin(region, [0, unknown])[:, None], np.nan, looks(region, shading))

    every = shared_pixels([shard], [ids], lambda region, place, normal, shading: looks(region, shading))
    found = shared_pixels([shard], [ids], known)
    assert np.isfinite(found.radiance).all()
    assert 0 < len(found.region) < len(every.region)
    assert len(shared_pixels([shard], [np.minimum(ids, 1)], known).region) == 0  # one region fills all


def test_the_best_materials_reflect_what_the_pixels_show(observed):
    shard, ids = observed
    pixels = region_pixels([shard], [ids])
    known, place = np.unique(pixels.region, return_inverse=True)
    pieces = color_pieces(pixels, place.reshape(-1), len(known), np.zeros(3), 20.0)
    materials = BestMaterials.of(known, pieces, measure(pieces, len(known)), np.zeros(3), 20.0)
    again = materials.radiance(pixels.region, pixels.place, pixels.normal, pixels.shading)
    assert np.median(np.abs(again - pixels.radiance) / (pixels.radiance + 0.05)) < 0.02
    nobody = materials.radiance(pixels.region * 0 + 60000, pixels.place, pixels.normal, pixels.shading)
    assert np.isnan(nobody).all()
