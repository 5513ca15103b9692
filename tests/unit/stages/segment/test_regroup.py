"""Regions of one material become one part, those of two do not."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.formats.images import read_ids, write_png
from fipt.formats.manifests import read_manifest
from fipt.model.reflectance import line_in_base_color
from fipt.scene.dataset import Dataset
from fipt.scene.metals import JudgedMetals
from fipt.scene.settled import RoundState, write_state
from fipt.stages.fit.part_search import estimate_parts
from fipt.stages.segment import regroup
from fipt.stages.segment.material_evidence import (
    HALF,
    TRIALS,
    BestMaterials,
    MaterialEvidence,
    _ColorNoise,
    best_trials,
    color_pieces,
    is_dielectric,
    is_metal,
    measure,
)
from fipt.stages.segment.region_pixels import RegionPixels
from fipt.stages.segment.regroup import _metals, _mostly_counted, joined, with_likely_metals
from fipt.stages.segment.regroup_stage import RegroupInputs, run
from fipt.stages.segment.settings import RegroupSettings
from tests import scenes

_LEVELS = len(ROUGHNESS_LEVELS)


def pixels(
    rng: np.random.Generator, materials: list[tuple[tuple[float, float, float], float, float]], grid: int = 6
) -> RegionPixels:
    """Regions of 1 m x 1 m side by side, one for each (base colour, roughness, metallic), of 400 pixels or more.

    Shading is wrong by some percent, slowly over the surface; highlights move with the pixel. There are several pixels
    at each of grid x grid places.
    """
    count = max(400, 8 * grid**2)
    parts = []
    for k, (color, roughness, metallic) in enumerate(materials):
        spots = (rng.integers(0, grid, (count, 2)) + 0.5) / grid
        place = np.c_[k + spots[:, 0], spots[:, 1], np.zeros(count)].astype(np.float32)
        shading = np.zeros((count, SHADING_OUTPUTS, 3), np.float32)
        shading[:, 0] = 1
        # what a smooth surface reflects varies much between pixels, what a matte one does hardly
        mirrored = rng.gamma(0.3, 3, (count, 1))
        for level in range(_LEVELS):
            share = (1 - level / (_LEVELS - 1)) ** 2
            light = share * mirrored + (1 - share)
            shading[:, 1 + level], shading[:, 1 + _LEVELS + level] = 0.9 * light, 0.05 * light
        offset, slope = line_in_base_color(shading, roughness, metallic)
        error = 1 + 0.04 * np.sin(3 * (place[:, :1] + place[:, 1:2])) + rng.normal(0, 0.01, (count, 1))
        triangle = k * grid**2 + (spots // (1 / grid)) @ [1, grid]
        radiance = ((offset + slope * np.array(color)) * error).astype(np.float32)
        parts.append((radiance, shading, place, np.tile([0, 0, 1], (count, 1)), np.full(count, k), triangle))
        parts[-1] += (np.ones(count, np.float32),)
    return RegionPixels(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


RED, ORANGE, WHITE = (0.6, 0.2, 0.2), (0.6, 0.3, 0.2), (0.7, 0.7, 0.7)


@pytest.mark.parametrize(
    ("materials", "expected"),
    [
        ([(RED, 0.8, 0.0)] * 3, [0, 0, 0]),
        ([(RED, 0.8, 0.0), (ORANGE, 0.8, 0.0), (RED, 0.8, 0.0)], [0, 1, 0]),
        ([(WHITE, 0.1, 0.0), (WHITE, 0.8, 0.0), (WHITE, 0.1, 0.0)], [0, 1, 0]),
        ([(WHITE, 0.2, 1.0), (WHITE, 0.8, 0.0), (WHITE, 0.2, 1.0)], [0, 1, 0]),
    ],
    ids=["one material", "two colours", "two roughnesses", "metal and plaster"],
)
def test_regions_of_one_material_join(np_rng, materials, expected):
    found = pixels(np_rng, materials)
    label = joined(
        measure(color_pieces(found, found.region, len(materials), np.array([1.5, 0.5, 0.0]), 3.0), len(materials))
    )
    first = {k: int(label[k]) for k in reversed(range(len(label)))}
    assert [int(np.flatnonzero(label == first[k])[0]) for k in range(len(label))] == expected


def test_a_region_of_few_looks_joins_the_colour_that_is_its_own(np_rng):
    found = pixels(np_rng, [(RED, 0.8, 0.0), (ORANGE, 0.8, 0.0), (RED, 0.8, 0.0)])
    few = np.r_[np.arange(802), 1100]
    found = RegionPixels(*(values[few] for values in vars(found).values()))
    label = joined(measure(color_pieces(found, found.region, 3, np.array([1.5, 0.5, 0.0]), 3.0), 3))
    assert label[2] == label[0] != label[1]


def test_what_lies_between_two_colours_does_not_join_them(np_rng):
    # the largest region lies between two others that differ: it takes the nearer one, and both stay apart
    materials = [((0.7, 0.7, level), 0.8, 0.0) for level in (0.60, 0.61, 0.66, 0.70)]
    found = pixels(np_rng, materials)
    evidence = measure(
        color_pieces(found, found.region, len(materials), np.array([2.0, 0.5, 0.0]), 4.0), len(materials)
    )
    hue = evidence.color[0, 0, 2] - evidence.color[3, 0, 2]
    noise = np.full_like(evidence.variance, (hue / 6) ** 2)  # the first and the largest alone would agree
    largest = replace(evidence, variance=noise, pixels=np.array([400.0, 400, 4000, 400]))
    assert joined(largest).tolist() == [0, 0, 1, 1]


def test_evidence_names_the_trial_and_the_metal(np_rng):
    found = pixels(np_rng, [(WHITE, 0.2, 1.0), (WHITE, 0.2, 0.0)])
    evidence = measure(color_pieces(found, found.region, 2, np.array([1.0, 0.5, 0.0]), 2.0), 2)
    assert evidence.metal.tolist() == [True, False]
    assert TRIALS[evidence.left[0].argmin()] == (1.0, 0.2)
    assert TRIALS[evidence.left[1, :HALF].argmin()] == (0.0, 0.2)
    assert evidence.pixels.tolist() == [400, 400]


@pytest.mark.parametrize(("scale", "metal"), [(0.05, True), (0.005, False)])
def test_where_a_dielectric_explains_all_that_shows_there_is_no_metal(scale, metal):
    """Metal leaves an eighth less: of 13 steps of an 8-bit picture, or of one."""
    left = 10_000 * scale * np.where(np.arange(2 * HALF) < HALF, 1, 0.87)[None]
    assert is_metal(left, np.array([10_000]), np.zeros(1)).tolist() == [metal]


@pytest.mark.parametrize(("usual", "metal"), [(0.002, True), (0.01, False)])
def test_what_shading_errs_by_proves_no_metal(usual, metal):
    """Metal leaves a fifth less: of much more than pieces usually leave, or of as much."""
    left, judged = 10_000 * np.where(np.arange(2 * HALF) < HALF, 0.010, 0.008)[None], np.array([10_000])
    assert is_metal(left, judged, usual * judged).tolist() == [metal]
    assert is_dielectric(left[:, ::-1], judged, usual * judged).tolist() == [metal]


@pytest.mark.parametrize(("error", "metal"), [(0.0, True), (0.3, False)])
def test_a_weak_metal_is_none_where_the_room_errs_by_more(np_rng, error, metal):
    """The noise is in two other regions alone."""
    found = pixels(np_rng, [(WHITE, 0.6, 1.0), (RED, 0.8, 0.0), (ORANGE, 0.8, 0.0)])
    noise = np.exp(error * np_rng.normal(size=(len(found.region), 1)) * (found.region[:, None] > 0)).astype(np.float32)
    pieces = color_pieces(replace(found, radiance=found.radiance * noise), found.region, 3, np.zeros(3), 8.0)
    evidence = measure(pieces, 3)
    assert evidence.metal[0] == metal
    np.testing.assert_allclose(evidence.usual / evidence.judged, (evidence.usual / evidence.judged)[0])


def test_a_region_that_judges_nothing_is_what_the_room_is(np_rng):
    found = pixels(np_rng, [(WHITE, 0.8, 0.0), (RED, 0.8, 0.0)])
    found = found.of((found.region == 0) | (np.arange(len(found.region)) % 200 == 0))
    center, side = np.array([1.0, 0.5, 0.0]), 2.0
    pieces = color_pieces(found, found.region, 2, center, side)
    evidence = measure(pieces, 2)
    assert not evidence.left[1].any()
    materials = BestMaterials.of(np.array([1, 2]), pieces, evidence, center, side)
    assert [TRIALS[k] for k in materials.trial] == [(0.0, 0.8)] * 2


def test_the_room_decides_between_equal_trials_alone():
    room = np.array([3.0, 2, 1, 9])
    left = np.array([[0.0, 0, 0, 0], [1, 1, 2, 2], [1, 1 + 1e-9, 2, 2]])
    assert best_trials(left, room, slice(None)).tolist() == [2, 1, 0]
    assert best_trials(left, room, slice(2, None)).tolist() == [2, 2, 2]


def test_a_region_that_proves_nothing_is_the_metal_that_another_proves(np_rng):
    """Steel, steel, gold, grey paint; only the first has the pixels to prove that it is metal."""
    steel, gold, grey = (0.55, 0.55, 0.55), (0.9, 0.6, 0.2), (0.55, 0.55, 0.55)
    found = pixels(np_rng, [(steel, 0.2, 1.0), (steel, 0.2, 1.0), (gold, 0.2, 1.0), (grey, 0.8, 0.0)])
    evidence = measure(color_pieces(found, found.region, 4, np.array([2.0, 0.5, 0.0]), 4.0), 4)
    one = replace(evidence, metal=np.array([True, False, False, False]))
    assert likely(one).metal.tolist() == [True, True, False, False]
    none = replace(evidence, metal=np.zeros(4, bool))
    assert not likely(none).metal.any()


def test_parts_are_judged_by_all_their_regions(np_rng):
    """Two regions of steel that join, one of grey paint whose pixels say so, one of which there are too few."""
    grey = (0.55, 0.55, 0.55)
    found = pixels(np_rng, [(grey, 0.2, 1.0), (grey, 0.2, 1.0), (grey, 0.8, 0.0), (RED, 0.8, 0.0)])
    found = found.of((found.region < 3) | (np.arange(len(found.region)) % 400 < 3))
    evidence = measure(color_pieces(found, found.region, 4, np.array([2.0, 0.5, 0.0]), 4.0), 4)
    label = np.array([0, 0, 1, 2])
    metals = _metals(evidence, label, np.ones(4, bool))
    assert metals == JudgedMetals({1: 0.2}, frozenset({2}))
    beside_emitters = _metals(evidence, label, np.array([False, False, True, False]))
    assert beside_emitters == JudgedMetals({1: 0.2}, frozenset({2, 3})), "what is proved stays; what is not is none"


def likely(evidence: MaterialEvidence) -> MaterialEvidence:
    """With likely metals, no region of which is beside an emitter."""
    return with_likely_metals(evidence, np.ones(len(evidence.pixels), bool))


def steels(np_rng, *others):
    """Evidence of two regions of steel that prove it, one that does not, and of ``others``.

    The third is not told apart: a dielectric explains it a little better, by less than one standard error.
    """
    steel = (0.55, 0.55, 0.55)
    materials = [(steel, 0.2, 1.0)] * 3 + list(others)
    found = pixels(np_rng, materials)
    evidence = measure(
        color_pieces(found, found.region, len(materials), np.array([2.0, 0.5, 0.0]), 4.0), len(materials)
    )
    proved = np.arange(len(materials)) < 2
    left, products = evidence.left.copy(), evidence.products.copy()
    metal = HALF + left[0, HALF:].argmin()
    left[2] += 20
    left[2, 0] = left[2, metal] - 0.5
    products[2] = np.eye(len(TRIALS)) / 2
    return replace(evidence, metal=proved, left=left, products=products)


def test_a_region_that_is_not_told_apart_is_the_metal_whose_colour_only_metal_has(np_rng):
    assert likely(steels(np_rng)).metal.tolist() == [True, True, True]


def test_a_few_pixels_away_from_emitters_do_not_speak_for_the_bars_of_a_window(np_rng):
    evidence = steels(np_rng)
    assert with_likely_metals(evidence, np.array([True, True, False])).metal.tolist() == [True, True, False]
    better = evidence.left.copy()
    better[2, HALF:] = better[2].min() - 0.1
    counted = np.zeros(3, bool)
    assert with_likely_metals(replace(evidence, left=better), counted).metal.all(), "what is left speaks for metal"


def test_a_region_tells_if_half_of_its_pixels_are_away_from_emitters():
    regions = [np.array([1, 1, 1, 2, 2, 0]), np.array([1, 3, 3, 3, 3, 3])]
    shards = [
        SimpleNamespace(weight=np.array([1.0, 0, 0, 1, 0, 1])),
        SimpleNamespace(weight=np.array([0, 1, 0, 0, 1, 0])),
    ]
    assert _mostly_counted(shards, regions, np.array([1, 2, 3])).tolist() == [False, True, False]


def test_a_region_that_is_not_told_apart_stays_where_the_colour_alone_proves_little(np_rng):
    evidence = steels(np_rng)
    one = replace(evidence, metal=np.array([True, False, False]))
    assert not likely(one).metal[2], "one region may look like metal by chance"
    many = replace(evidence, pixels=np.array([400.0, 400, 900]))
    assert likely(many).metal[2], "of nearly one colour"
    most = replace(evidence, pixels=np.array([400.0, 400, 1700]))
    assert not likely(most).metal[2], "what proves it is less than half of what asks for it"
    color = evidence.color.copy()
    color[2, HALF:, 0] += np.sqrt(4 * (evidence.variance[2, 0] + evidence.variance[0, 0]))
    off = replace(evidence, color=color, pixels=np.array([400.0, 400, 600]))
    assert likely(off).metal[2]
    off = replace(off, pixels=many.pixels)
    assert not likely(off).metal[2], "of a colour that is further off, and more asks for it than proves it"
    clearly = evidence.left.copy()
    clearly[2, 0] -= 0.7
    assert not likely(replace(evidence, left=clearly)).metal[2], "worse by more than one standard error"
    proved = evidence.left.copy()
    proved[2, :HALF] *= 0.8
    noisy = replace(evidence, left=proved, products=evidence.products * 1e6)
    assert not likely(noisy).metal[2], "a dielectric leaves clearly less, however noisy that is"


def test_a_colour_that_paint_has_too_does_not_make_a_metal(np_rng):
    """The fourth region looks like steel, and clearly is not."""
    evidence = steels(np_rng, ((0.55, 0.55, 0.55), 0.2, 1.0))
    left = evidence.left.copy()
    left[3, 0] = left[3].min() - 1e6
    evidence = replace(evidence, left=left)
    assert likely(evidence).metal.tolist() == [True, True, False, False]
    rare = replace(evidence, pixels=np.array([4000.0, 4000, 400, 400]))
    assert likely(rare).metal.tolist() == [True, True, True, False], "one in twenty is chance"


def test_thin_regions_have_an_error_of_their_own(np_rng):
    """The colours of twelve regions drift along them, of the six thin ones by three times as much."""
    noise, along = _ColorNoise(), np.linspace(0, 1, 20)[:, None]
    thin = np.arange(12) >= 6
    for each in thin:
        drift = (0.3 if each else 0.1) * np_rng.standard_normal(3)
        noise.add(along * drift + 0.01 * np_rng.standard_normal((20, 3)), along * (1, 0, 0), bool(each))
    wide, narrow = np.sqrt(noise.variance(np.array([20.0, 20.0]), np.array([False, True])))
    assert (narrow > 1.5 * wide).all()
    few = _ColorNoise()
    for each in (False, False, True):
        few.add(along * 0.1 * np_rng.standard_normal(3), along * (1, 0, 0), each)
    one, other = few.variance(np.array([20.0, 20.0]), np.array([False, True]))
    np.testing.assert_array_equal(one, other)


def test_what_looks_like_common_paint_is_no_metal_by_its_colour(np_rng):
    """White paint in the dark has the colour of steel, were it metal; there is more such paint than steel."""
    evidence = steels(np_rng, (RED, 0.2, 0.0))
    left, color = evidence.left.copy(), evidence.color.copy()
    left[3, 0] = left[3].min() - 1e6
    color[3, :HALF] = color[2, :HALF]
    evidence = replace(evidence, left=left, color=color)
    paint = replace(evidence, pixels=np.array([400.0, 400, 400, 4000]))
    assert likely(paint).metal.tolist() == [True, True, False, False]
    rare = replace(evidence, pixels=np.array([400.0, 400, 400, 40]))
    assert likely(rare).metal.tolist() == [True, True, True, False]
    color[3, :HALF, 0] += np.sqrt(16 * (evidence.variance[2, 0] + evidence.variance[3, 0]))
    other = replace(paint, color=color)
    assert likely(other).metal.tolist() == [True, True, True, False], "paint of another colour says nothing"


def test_a_weak_proof_does_not_make_a_metal_of_common_paint(np_rng):
    """One tile of a hundred looks a little like metal; the others have its colour, and clearly are paint."""
    evidence = steels(np_rng, (RED, 0.2, 0.0))
    left, color = evidence.left.copy(), evidence.color.copy()
    left[2, 0] = left[2].min() + 1.5
    left[3, 0] = left[3].min() - 1e6
    color[3, :HALF] = color[2, :HALF]
    color[2, HALF:] += 1  # of no steel
    evidence = replace(evidence, left=left, color=color, metal=np.array([True, True, True, False]))
    for others, metal in ((4500.0, False), (3500.0, True)):
        tiles = replace(evidence, pixels=np.array([400.0, 400, 400, others]))
        assert likely(tiles).metal[2] == metal, "its own pixels tell too: ten times as many must tell otherwise"
    tiles = replace(evidence, pixels=np.array([400.0, 400, 400, 4500]))
    left[2, 0] += 1
    assert likely(replace(tiles, left=left)).metal[2], "better by more than chance"
    left[2, 0] -= 1
    color[3, :HALF, 0] += np.sqrt(16 * (evidence.variance[2, 0] + evidence.variance[3, 0]))
    assert likely(replace(tiles, color=color)).metal[2], "paint of another colour says nothing"


def test_the_verb_joins_segments_whole_and_loses_none(scene: Path, tmp_path: Path):
    data, cut = Dataset(scene / "dataset"), tmp_path / "cut"
    for view in data.views("train"):
        part = data.segments(view, "part")
        right = np.arange(part.shape[1]) >= part.shape[1] // 2
        write_png(cut / "part" / f"{view}.png", (part + 10 * right * (part > 0)).astype(np.uint16))
    inputs = RegroupInputs(
        dataset=data.root,
        samples=(scene / "samples" / "train-000",),
        shading=(scene / "round-0" / "shading" / "train-000",),
        segments=cut,
        emitters=scene / "round-0" / "emitters.npz",
        out=tmp_path / "segments",
        manifest=tmp_path / "segments.manifest.json",
    )
    figures = run(inputs, RegroupSettings(divide=False, borders=False))
    assert figures["materials"] <= figures["parts"] < figures["segments"]
    paths = [Path("part") / f"{view}.png" for view in data.views("train")]
    before, after = (np.concatenate([read_ids(root / path) for path in paths]) for root in (cut, inputs.out))
    assert ((after > 0) == (before > 0)).all()
    pairs = np.unique(np.stack([before.ravel(), after.ravel()]), axis=1)
    assert len(np.unique(pairs[0])) == pairs.shape[1]
    assert inputs.manifest.is_file()


def test_the_verb_joins_classes_where_there_are_no_parts(scene: Path, tmp_path: Path):
    data, classes = Dataset(scene / "dataset"), tmp_path / "classes"
    for view in data.views("train"):
        write_png(classes / "semantic" / f"{view}.png", data.segments(view, "part"))
    inputs = RegroupInputs(
        dataset=data.root,
        samples=(scene / "samples" / "train-000",),
        shading=(scene / "round-0" / "shading" / "train-000",),
        segments=classes,
        out=tmp_path / "segments",
        manifest=tmp_path / "segments.manifest.json",
    )
    assert run(inputs, RegroupSettings(divide=False, borders=False))["segments"] > 1
    assert Dataset(scene / "dataset", inputs.out).segment_kind() == "part"


def inputs_of(scene: Path, folder: Path) -> RegroupInputs:
    return RegroupInputs(
        dataset=scene / "dataset",
        samples=(scene / "samples" / "train-000",),
        shading=(scene / "round-0" / "shading" / "train-000",),
        out=folder / "segments",
        manifest=folder / "segments.manifest.json",
    )


def test_the_verb_asks_what_is_around(scene: Path, tmp_path: Path, monkeypatch):
    """As if clear metal were around every region."""

    def metal(evidence, mesh, region, known, counted):
        assert len(region) <= len(mesh.triangles)
        assert len(known) == len(counted) == len(evidence.pixels)
        return replace(evidence, metal=np.ones(len(known), bool))

    monkeypatch.setattr("fipt.stages.segment.regroup.with_surrounded", metal)
    inputs = inputs_of(scene, tmp_path)
    figures = run(inputs, RegroupSettings())
    assert len(Dataset(scene / "dataset", inputs.out).metals().roughness) == figures["materials"] > 0


def test_the_verb_asks_what_copies_tell(scene: Path, tmp_path: Path, monkeypatch):
    """As if each two triangles were of one shape, and copies made everything metal."""
    asked = []

    def metal(evidence, copies):
        asked.append(copies)
        return replace(evidence, metal=np.ones(len(evidence.pixels), bool))

    monkeypatch.setattr("fipt.stages.segment.regroup.first_copies", lambda mesh: np.arange(len(mesh.triangles)) % 2)
    monkeypatch.setattr("fipt.stages.segment.regroup.judged_with_copies", metal)
    inputs = inputs_of(scene, tmp_path)
    figures = run(inputs, RegroupSettings())
    (copies,) = asked
    assert copies.shape[1] > 0
    metals = Dataset(scene / "dataset", inputs.out).metals()
    assert len(metals.roughness) == figures["materials"] > 0
    told, parts = figures["materials"], figures["parts"]
    assert 0 < told < parts, "a region shows in no pixel of its own"
    assert set(metals.roughness) == set(range(1, told + 1))
    assert metals.dielectric == set(range(told + 1, parts + 1))


def test_parts_stay_once_the_loop_has_settled(scene: Path, tmp_path: Path, monkeypatch):
    write_state(tmp_path / "settled.json", RoundState(2, settled=2))
    first = RegroupInputs(
        dataset=scene / "dataset",
        samples=(scene / "samples" / "train-000",),
        shading=(scene / "round-0" / "shading" / "train-000",),
        out=tmp_path / "before" / "segments",
        manifest=tmp_path / "before" / "segments.manifest.json",
    )
    run(first, RegroupSettings())
    after = tmp_path / "after"
    inputs = replace(
        first,
        out=after / "segments",
        manifest=after / "segments.manifest.json",
        settled=tmp_path / "settled.json",
        previous=first.out,
    )
    monkeypatch.setattr("fipt.scene.observed.read_observed", None)  # nothing is computed
    assert run(inputs, RegroupSettings()) == {"copied": True, "settled_in_round": 2}
    assert inputs.manifest.read_text() == first.manifest.read_text(), "the same files with the same content"
    assert read_manifest(inputs.manifest, "regroup")["files"].keys() >= {"segments/metals.json"}

    write_state(tmp_path / "settled.json", RoundState(2))
    with pytest.raises(TypeError):  # it has not settled, so that parts are looked for
        run(inputs, RegroupSettings())


def test_the_verb_keeps_segments_where_every_pixel_shows_an_emitter(scene: Path, tmp_path: Path, monkeypatch):
    data = Dataset(scene / "dataset")
    triangles = np.arange(len(data.mesh().triangles))
    monkeypatch.setattr("fipt.scene.emitters.read_emitters", lambda _: SimpleNamespace(possible=triangles))
    inputs = RegroupInputs(
        dataset=data.root,
        samples=(scene / "samples" / "train-000",),
        shading=(scene / "round-0" / "shading" / "train-000",),
        emitters=scene / "round-0" / "emitters.npz",
        out=tmp_path / "segments",
        manifest=tmp_path / "segments.manifest.json",
    )
    figures = run(inputs, RegroupSettings())
    parts = frozenset(range(1, figures["parts"] + 1))
    assert Dataset(scene / "dataset", inputs.out).metals() == JudgedMetals(dielectric=parts), "nothing tells a metal"
    assert Dataset(scene / "dataset").metals() == JudgedMetals(), "ids that no join made"
    (inputs.out / "metals.json").unlink()
    with pytest.raises(FiptError, match="metals"):
        Dataset(scene / "dataset", inputs.out).metals()
    assert figures["materials"] == 0
    assert figures["parts"] == figures["segments"] > 0


@pytest.mark.parametrize("weight", [1.0, 0.98, 0.5])
def test_weights_that_are_alike_tell_as_much_as_full_ones(np_rng, weight):
    """Two mirrors of one colour, each a part: they prove to be metal, in the search of the fit as well."""
    found = pixels(np_rng, [(WHITE, 0.2, 1.0), (WHITE, 0.2, 1.0)])
    samples = scenes.samples_of(found.place, triangle=found.region, normal=np.float32(found.normal))
    ids = (found.region + 1).astype(np.uint16)
    image = [(found.radiance, np.full(len(ids), weight, np.float32))]
    parts = regroup.regrouped(scenes.observed([samples], [found.shading], image), [ids], scenes.floor())
    assert (parts.materials, list(parts.metals.roughness)) == (1, [1])
    training = scenes.training_pixels([samples], [found.shading], image, [ids])
    searched = estimate_parts(training, np.array([1, 0.5, 0.0]), 2.1, 1.5)
    np.testing.assert_array_equal(searched.metallic[1:], 1)
