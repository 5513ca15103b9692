"""A region that holds two materials is cut where they meet."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fipt.model.reflectance import line_in_base_color
from fipt.robust import NORMAL
from fipt.stages.segment import divide
from fipt.stages.segment.divide import materials_of
from fipt.stages.segment.material_evidence import HALF, TRIALS, color_pieces
from tests.unit.stages.segment.test_regroup import RED, WHITE, pixels

DARK = (0.2, 0.2, 0.2)


@pytest.mark.parametrize("second", [(WHITE, 0.1, 1.0), (DARK, 0.8, 0.0)], ids=["a mirror", "a darker colour"])
def test_a_region_of_two_materials_is_cut_where_they_meet(np_rng, second):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), second, (WHITE, 0.8, 0.0), (RED, 0.8, 0.0)], grid=12)
    region = np.maximum(found.region - 1, 0)  # the first two are one
    pieces = color_pieces(found, region, 3, np.zeros(3), 8.0)
    cuts, _ = materials_of(pieces)
    assert [number for number, _, _ in cuts] == [0]
    _, own, label = cuts[0]
    right = pieces.place[own, 0] > 1
    assert label.max() == 1
    assert np.mean(label == label[right][0]) == pytest.approx(0.5, abs=0.05)
    assert np.mean((label == label[right][0]) == right) > 0.95


def test_a_wall_whose_shading_drifts_stays_whole(np_rng):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), (RED, 0.8, 0.0)], grid=12)
    drift = np.exp(1.2 * (found.place[:, :1] - 1)).astype(np.float32)  # as much as between two colours, but gradual
    found = replace(found, radiance=found.radiance * drift)
    assert materials_of(color_pieces(found, found.region, 2, np.zeros(3), 8.0))[0] == []


@pytest.mark.parametrize(
    ("second", "width", "count"),
    [((WHITE, 0.1, 1.0), 0.15, 1), ((DARK, 0.8, 0.0), 0.2, 0), ((WHITE, 0.1, 1.0), 0.3, 0)],
    ids=["a mirror", "a darker colour", "what only slowly seems to be one"],
)
def test_nothing_fades_from_paint_to_metal(np_rng, second, width, count):
    """Pixels along the border hold some of both: a mirror is cut out all the same, what fades into dark stays."""
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), second, (RED, 0.8, 0.0)], grid=12)
    color, roughness, metallic = second
    lines = [line_in_base_color(found.shading, *of) for of in ((0.8, 0.0), (roughness, metallic))]
    left, right = (offset + slope * np.array(of) for (offset, slope), of in zip(lines, (WHITE, color), strict=True))
    share = np.clip((found.place[:, :1] - 1) / width + 0.5, 0, 1)  # of the second material; a piece is 0.08 wide
    radiance = np.where(found.region[:, None] < 2, (1 - share) * left + share * right, found.radiance)
    found = replace(found, radiance=radiance.astype(np.float32))
    pieces = color_pieces(found, np.maximum(found.region - 1, 0), 2, np.zeros(3), 8.0)
    cuts, _ = materials_of(pieces)
    assert [number for number, _, _ in cuts] == [0] * count
    for _, own, label in cuts:
        place = pieces.place[own, 0]
        sides = label[place < 0.8], label[place > 1.2]
        assert np.ptp(sides[0]) == np.ptp(sides[1]) == 0
        assert sides[0][0] != sides[1][0]


def of_two_kinds(dielectric: np.ndarray | float, metal: float, alike: float = 1.0, usual: float = 0.01) -> bool:
    """Whether a cut is one of two kinds: what either leaves of 40 pieces, while 40 others are clearly a dielectric."""
    left = np.full((80, len(TRIALS)), 0.1)
    left[:40, 0], left[:40, HALF] = dielectric, metal
    left[40:, 0] = 0.005
    row = np.c_[np.arange(80), np.zeros((80, 2))].astype(np.int64)
    pieces: Any = SimpleNamespace(left=left, color=np.zeros((80, len(TRIALS), 3)), voxel=row, number=np.full(80, 50.0))
    region = divide._Region(pieces, np.arange(80), usual * NORMAL, np.ones(3))
    return region._of_two_kinds(np.arange(80), np.arange(80) < 40, alike)


def test_both_kinds_must_be_certain():
    chance = 0.014 + np.where(np.arange(40) % 2, -0.04, 0.05)  # 0.005 on average, by less than its standard error
    assert of_two_kinds(0.020, 0.014)
    assert not of_two_kinds(0.020, 0.014, alike=20)
    assert not of_two_kinds(chance, 0.014)
    assert not of_two_kinds(0.020, 0.0185), "less than a tenth"
    assert not of_two_kinds(0.020, 0.014, usual=0.1), "shading errs by more"
    assert not of_two_kinds(0.0004, 0.0002, usual=0.0001), "it shows nowhere"


@pytest.mark.parametrize("turned", [False, True], ids=["straight", "at 45 degrees"])
def test_a_border_costs_what_its_length_is(turned):
    """ln 3 for each piece of its length, whichever way it runs over a plane of voxels."""
    side = 41
    across, along = np.divmod(np.arange(side**2), side)
    voxel = np.c_[across, along, np.zeros(side**2)].astype(np.int64)
    one = np.zeros((side**2, 1))
    pieces: Any = SimpleNamespace(left=one, color=np.zeros((side**2, 1, 3)), voxel=voxel, number=one[:, 0])
    region = divide._Region(pieces, np.arange(side**2), 1.0, np.ones(3))
    second = across > along if turned else across > side // 2
    pairs = float((region.near @ second.astype(float))[~second].sum())
    length = side * np.sqrt(2) if turned else side
    assert region._border * pairs == pytest.approx(np.log(3) * length, rel=0.1)


@pytest.mark.parametrize("ids", [(7, 9, 10), (7, 65534, 65535), (7, 65535, 1)])
def test_cuts_take_ids_that_are_free(np_rng, monkeypatch, ids):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), (WHITE, 0.1, 1.0), (RED, 0.8, 0.0)], grid=12)
    region = np.where(found.region < 2, *ids[:2]).astype(np.uint16)
    monkeypatch.setattr(divide, "region_pixels", lambda *_: replace(found, region=region.astype(np.int64)))
    monkeypatch.setattr(divide, "scene_box", lambda _: (np.zeros(3), 8.0))
    shards: Any = [SimpleNamespace(samples=SimpleNamespace(offsets=np.arange(len(region) + 1), position=found.place))]
    (after,), cuts, _ = divide.divided(shards, [region])
    assert cuts == 1
    assert set(after.tolist()) == set(ids)


def test_pixels_take_the_material_of_the_nearest_piece_and_ids_stay_apart(np_rng, monkeypatch):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), (WHITE, 0.1, 1.0), (RED, 0.8, 0.0)], grid=12)
    region = np.where(found.region < 2, 7, 9).astype(np.uint16)
    monkeypatch.setattr(divide, "region_pixels", lambda *_: replace(found, region=region.astype(np.int64)))
    monkeypatch.setattr(divide, "scene_box", lambda _: (np.zeros(3), 8.0))
    # one pixel more, which shows no surface
    samples = SimpleNamespace(offsets=np.r_[np.arange(len(region) + 1), len(region)], position=found.place)
    before = np.r_[region, 7].astype(np.uint16)
    shards: Any = [SimpleNamespace(samples=samples)]
    (after,), cuts, alike = divide.divided(shards, [before])
    assert cuts == 1
    assert alike >= 1
    assert (after[:-1][region == 9] == 9).all()
    assert after[-1] == 7
    assert set(after[:-1][region == 7].tolist()) == {7, 10}
    mirror = after[:-1][found.region == 1]
    assert np.mean(mirror == np.median(mirror)) > 0.95
