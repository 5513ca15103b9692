"""Emission as a hypothesis of a region: a wall with panels, by what is seen of it and the shading there."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.scene.emitters import emitter_facts, read_emitters, undecided_facts, write_emitters
from fipt.scene.mesh import Mesh
from fipt.scene.review import ReviewDecisions, numbers, ranges
from fipt.stages.emitters.extract import extract
from fipt.stages.emitters.hypotheses import _UNMEASURED, RegionEvidence, _spread, judge
from fipt.stages.emitters.observations import Observations, observations
from fipt.stages.emitters.regions import find_regions
from fipt.stages.emitters.settings import EmittersSettings
from tests import scenes

WIDTH, HEIGHT = 3.0, 2.0
VIEWS = ("a", "b", "c", "d", "e", "f")
LEVELS = len(ROUGHNESS_LEVELS)
FOOTPRINT = 0.04
"""Width of a pixel, metres."""
WHITE = 0.5
"""Ld of the wall: what a white surface would show."""
WALL = 0.3
PANEL = (1.0, 1.8, 0.6, 1.4)
"""x and y from and to."""


def wall(cell):
    """A wall in the plane z = 0 of square cells, two triangles each, all connected."""
    nx, ny = round(WIDTH / cell), round(HEIGHT / cell)
    x, y = np.meshgrid(np.arange(nx + 1) * cell, np.arange(ny + 1) * cell, indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)).reshape(-1)
    first = np.stack([corner, corner + ny + 1, corner + ny + 2], axis=1)
    second = np.stack([corner, corner + ny + 2, corner + 1], axis=1)
    return Mesh(vertices, np.stack([first, second], axis=1).reshape(-1, 3).astype(np.int32))


def on_panel(place, panel=PANEL):
    x0, x1, y0, y1 = panel
    return (place[:, 0] > x0) & (place[:, 0] < x1) & (place[:, 1] > y0) & (place[:, 1] < y1)


class Seen:
    """Pixels of six views on the wall, which is grey and evenly lit unless a test says otherwise."""

    def __init__(self, rng, cell=0.05, pixels=2000):
        self.mesh, self.rng = wall(cell), rng
        nx, ny = round(WIDTH / cell), round(HEIGHT / cell)
        count = pixels * len(VIEWS)
        self.place = rng.uniform((0, 0), (WIDTH, HEIGHT), (count, 2))
        i, j = np.minimum((self.place / cell).astype(int), (nx - 1, ny - 1)).T
        inside = self.place / cell - np.stack([i, j], axis=1)
        self.triangle = 2 * (i * ny + j) + (inside[:, 1] > inside[:, 0])
        self.view = np.repeat(np.arange(len(VIEWS)), pixels)
        self.image = np.full((count, 3), WALL)
        self.shading = np.zeros((count, SHADING_OUTPUTS, 3), np.float32)
        self.shading[:, 0] = WHITE
        self.shading[:, 1 : 1 + LEVELS] = WHITE
        self.panel = on_panel(self.place)

    def found(self, noise=0.03, decisions=None):
        """Emitters; image and shading noisy by a relative amount."""
        noisy = self.image * np.exp(noise * self.rng.standard_normal((len(self.image), 1)))
        return extract(self.mesh, self.shards(noisy), None, EmittersSettings(), decisions).emitters

    def shards(self, image):
        place = np.concatenate([self.place, np.zeros((len(self.place), 1))], axis=1)
        normal, footprint = np.tile(np.float32([0, 0, 1]), (len(place), 1)), np.full(len(place), np.float32(FOOTPRINT))
        shapes = [(1, len(place) // len(VIEWS))] * len(VIEWS)
        arrays = {"normal": normal, "footprint": footprint, "views": VIEWS, "shapes": shapes}
        samples = scenes.samples_of(place, self.triangle, **arrays)
        image = image.astype(np.float32)
        return scenes.observed([samples], [self.shading], [(image, np.ones(len(image), np.float32))])

    def overlap(self, emitters, panel=PANEL):
        """Intersection over union, by area, of what emits and the panel."""
        emits = np.zeros(len(self.mesh.triangles), bool)
        emits[emitters.triangle] = True
        true, area = on_panel(self.mesh.corners.mean(axis=1), panel), self.mesh.areas
        return area[emits & true].sum() / area[emits | true].sum()


@pytest.mark.parametrize("shown", ["masked", "beside the mesh"])
def test_a_view_that_shows_nothing_does_no_harm(np_rng, shown):
    seen = Seen(np_rng)
    seen.image[seen.panel] = 3.0
    (shard,) = seen.shards(seen.image)
    own = shard.samples.pixels(0)
    if shown == "masked":
        weight = np.array(shard.weight)
        weight[own] = 0
        shard = replace(shard, weight=weight)
    else:  # a seventh view, whose pixels have no sample
        samples, count = shard.samples, own.stop - own.start
        samples = replace(
            samples,
            views=(*samples.views, "g"),
            shapes=[*samples.shapes, (1, count)],
            offsets=np.concatenate([samples.offsets, np.full(count, samples.offsets[-1])]),
            center=np.concatenate([samples.center, np.zeros(count, np.asarray(samples.center).dtype)]),
        )
        whole = np.concatenate([shard.radiance, np.ones((count, 3), np.float32)])
        shard = replace(
            shard,
            samples=samples,
            radiance=whole,
            weight=np.ones(len(whole), np.float32),
            clipped=np.zeros(len(whole), bool),
        )
    found = extract(seen.mesh, [shard], None, EmittersSettings()).emitters
    assert seen.overlap(found) > 0.9


def test_a_dim_emitter_is_brighter_than_white(np_rng):
    """It is dimmer than a mirror could be, whose picture here and there shows a window."""
    seen = Seen(np_rng)
    seen.image[seen.panel] = (1.2, 1.3, 1.5)
    window = seen.panel & (seen.place[:, 0] > 1.1 + 0.1 * seen.view) & (seen.place[:, 0] < 1.3 + 0.1 * seen.view)
    seen.shading[window, 1] = 20.0
    found = seen.found()
    assert seen.overlap(found) > 0.97
    (facts,) = emitter_facts(found, seen.mesh)
    np.testing.assert_allclose(facts["radiance"], (1.2, 1.3, 1.5), rtol=0.02)
    assert 0 < max(facts["error"]) < 0.05
    assert facts["views"] == len(VIEWS)
    assert len(found.undecided.price) == 0


@pytest.mark.parametrize(("times", "doubtful"), [(1.3, 1), (3.0, 1), (6.0, 0)])
def test_a_lamp_nearby_may_light_a_panel_up_to_four_times_as_much_as_all_that_is_known(np_rng, times, doubtful):
    seen = Seen(np_rng)
    seen.image[seen.panel] = times * WHITE
    extracted = extract(seen.mesh, seen.shards(seen.image), None, EmittersSettings())
    assert seen.overlap(extracted.emitters) > 0.97
    assert np.isin(extracted.emitters.triangle, extracted.doubtful.triangle).mean() == pytest.approx(doubtful, abs=0.1)


def test_a_mesh_whose_triangles_all_are_well_seen(np_rng):
    """None asks its neighbours for the radiance that it lacks."""
    seen = Seen(np_rng, cell=0.2, pixels=4000)
    seen.image[seen.panel] = 3.0
    assert seen.overlap(seen.found()) > 0.97


def test_a_mirror_is_none_though_it_is_brighter_than_white(np_rng):
    """Its picture moves with the viewer, as the shading says."""
    seen = Seen(np_rng)
    picture = 0.8 + 0.6 * np.sin(7 * seen.place[:, 0] + 1.1 * seen.view)
    seen.image[seen.panel] = 0.9 * picture[seen.panel, None]
    for level in range(LEVELS):
        seen.shading[seen.panel, 1 + level] = picture[seen.panel, None] * (1 - level / LEVELS) + 0.8 * level / LEVELS
    assert (seen.image[seen.panel] > 1.5 * WHITE).any()
    assert len(seen.found().triangle) == 0


def test_a_white_wall_is_none(np_rng):
    seen = Seen(np_rng)
    seen.image[seen.panel] = 0.98 * WHITE
    assert len(seen.found().triangle) == 0


def test_a_little_more_than_white_is_a_question(np_rng, tmp_path):
    """The shading may be that wrong; a person is asked."""
    seen = Seen(np_rng)
    lamp = on_panel(seen.place, (0.2, 0.6, 0.2, 0.6))
    seen.image[lamp] = 3.0
    seen.image[seen.panel] = 1.2 * WHITE
    seen.shading[:, 0] *= np.exp(0.1 * np.sin(5 * seen.place[:, :1]))  # what shading and radiance disagree by here
    found = seen.found()
    assert seen.overlap(found, (0.2, 0.6, 0.2, 0.6)) > 0.97
    (question,) = undecided_facts(found.undecided, seen.mesh)
    assert question["area"] == pytest.approx(0.64, rel=0.05)
    assert question["evidence"]["reflects"] > question["evidence"]["emits"]
    write_emitters(tmp_path / "emitters.npz", found, seen.mesh)
    again = read_emitters(tmp_path / "emitters.npz")
    np.testing.assert_array_equal(again.possible, found.possible)
    assert len(again.possible) > len(again.triangle)


@pytest.mark.parametrize("cell", [0.02, 0.04])
def test_a_scan_gives_no_speckles(np_rng, cell):
    """Triangles half as wide as a pixel, of which many are seen by none; pixels at the edge mix both sides."""
    seen = Seen(np_rng, cell, pixels=3000)
    x0, x1, y0, y1 = PANEL
    across = np.minimum(seen.place - (x0, y0), (x1, y1) - seen.place).min(axis=1) / FOOTPRINT + 0.5
    seen.image += (12.0 - WALL) * across.clip(0, 1)[:, None]
    found = seen.found(noise=0.1)
    assert seen.overlap(found) > 0.9
    assert found.emitter.max() == 0
    assert found.area.sum() == pytest.approx(0.64, rel=0.1)
    np.testing.assert_allclose(found.radiance, 12.0, rtol=0.05)


def test_a_textured_emitter_has_a_texture(np_rng):
    """A shade that is brighter towards its lamp."""
    seen = Seen(np_rng, 0.1, pixels=4000)
    light = 4.0 + 2.0 * (seen.place[:, 1] - 1.0) / 0.4
    seen.image[seen.panel] = light[seen.panel, None]
    found = seen.found()
    assert seen.overlap(found) > 0.97
    true = 4.0 + 2.0 * (seen.mesh.corners[found.triangle].mean(axis=1)[:, 1] - 1.0) / 0.4
    np.testing.assert_allclose(found.radiance[:, 0], true, rtol=0.15)


def test_an_even_emitter_has_none(np_rng):
    seen = Seen(np_rng, 0.1)
    seen.image[seen.panel] = 4.0
    assert len(np.unique(seen.found().radiance, axis=0)) == 1


def test_what_a_person_decides_goes_first(np_rng):
    seen = Seen(np_rng, 0.1)
    seen.image[seen.panel] = 4.0
    panel = np.flatnonzero(on_panel(seen.mesh.corners.mean(axis=1)))
    text = ", ".join(map(str, panel))
    rejected = ReviewDecisions(mesh_triangles=len(seen.mesh.triangles), reject=[text])
    assert len(seen.found(decisions=rejected).triangle) == 0
    accepted = ReviewDecisions(mesh_triangles=len(seen.mesh.triangles), accept=["0-1"])
    found = seen.found(decisions=accepted)
    np.testing.assert_array_equal(found.triangle, [0, 1, *panel])
    np.testing.assert_allclose(found.radiance[:2], WALL, rtol=0.05)


PANELS = [(0.2, 0.8, 0.6, 1.4), (1.1, 1.7, 0.6, 1.4), (2.0, 2.6, 0.6, 1.4)]


def panels(seen, levels):
    """Triangles of panels of these levels, as text; they are put in the images."""
    centers = seen.mesh.corners.mean(axis=1)
    for panel, level in zip(PANELS, levels, strict=False):
        seen.image[on_panel(seen.place, panel)] = level
    return tuple(ranges(np.flatnonzero(on_panel(centers, panel))) for panel in PANELS[: len(levels)])


@pytest.mark.parametrize(("merged", "doubtful"), [(False, True), (True, False)])
def test_what_is_merged_with_an_accepted_emitter_is_not_doubtful(np_rng, merged, doubtful):
    """Two panels that a lamp nearby might light; the first is accepted."""
    seen = Seen(np_rng, 0.1)
    own = panels(seen, (1.4, 1.4))
    merge = (own,) if merged else ()
    decided = ReviewDecisions(mesh_triangles=len(seen.mesh.triangles), accept=own[:1], merge=merge)
    extracted = extract(seen.mesh, seen.shards(seen.image), None, EmittersSettings(), decided)
    assert len(np.unique(extracted.emitters.emitter)) == 2 - merged
    assert (len(extracted.doubtful.triangle) > 0) == doubtful
    assert not np.isin(extracted.doubtful.triangle, sorted(numbers(own[0], len(seen.mesh.triangles)))).any()


@pytest.mark.parametrize("levels", [(3.0, 4.0, 5.0), (3.0, 5.0)])
def test_merged_emitters_have_one_radiance(np_rng, levels):
    """Panels of different radiance are one emitter; it has no texture."""
    seen = Seen(np_rng, 0.1)
    merged = ReviewDecisions(mesh_triangles=len(seen.mesh.triangles), merge=(panels(seen, levels),))
    assert len(np.unique(seen.found(decisions=merged).radiance, axis=0)) == 1


@pytest.mark.parametrize(("clipped_views", "bound"), [(0, False), (4, False), (6, True)])
def test_clipped_pixels_are_bounds_in_a_texture(np_rng, clipped_views, bound):
    """A shade of a radiance of up to 10, clipped at 7 in some views."""
    seen = Seen(np_rng, 0.1, pixels=4000)

    def shade(place):
        return 10 * np.exp(-((place[:, 0] - 1.4) ** 2 + (place[:, 1] - 1.0) ** 2) / (2 * 0.35**2))

    seen.image[seen.panel] = shade(seen.place)[seen.panel, None]
    clipped = seen.panel & (seen.view < clipped_views) & (seen.image[:, 0] > 7)
    seen.image[clipped] = 7
    (shard,) = seen.shards(seen.image * np.exp(0.02 * np_rng.standard_normal((len(seen.image), 1))))
    found = extract(seen.mesh, [replace(shard, clipped=clipped)], None, EmittersSettings(sides="both")).emitters
    true = shade(seen.mesh.corners[found.triangle].mean(axis=1))
    middle, rim = true > 8, true < 6
    assert found.radiance[middle].mean() == pytest.approx(7.0 if bound else true[middle].mean(), rel=0.07)
    assert found.lower_bound[middle].all() == bound
    assert not found.lower_bound[rim].any()


def test_nothing_seen(np_rng):
    seen = Seen(np_rng, 0.5, pixels=0)
    assert len(seen.found().triangle) == 0


def test_a_few_pixels_brighter_than_any_reflection_are_an_emitter():
    """Three regions of few pixels, and a fourth that emits for sure."""
    nothing, price = np.zeros(4), np.array([7.2, 7.2, 7.2, 4.0])
    excess = np.array([True, False, True, True])
    costs = {"reflects": np.array([6.9, 6.9, 6.9, 60.0]), "emits": nothing, "ordinary": nothing}
    others = {"texture": nothing, "compared": 0, "level": np.zeros((4, 3)), "certain": excess}
    evidence = RegionEvidence(price=price, excess=excess, pixels=np.array([3, 3, 3, 900]), **costs, **others)
    touching = np.array([[2], [3]])
    # the second may reflect; the third touches the fourth, and pays the lower price of that
    assert evidence.emitting(touching).tolist() == [True, False, True, True]
    rim = replace(evidence, reflects=np.array([3.0, 3.0, 0.5, 60.0]), price=np.array([7.2, 7.2, 0.8, 4.0]))
    assert rim.emitting(touching).tolist() == [False, False, False, True]
    assert evidence.undecided.tolist() == [False, True, False, False]


KIN = {"level": 3.02, "lead": 3.5, "price": 6.0}
"""A region in bright light: ln 101 of rarity, and a little more than half of the price of its own."""


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, True),
        ({"lead": 2.5}, False),  # less than half of the price
        ({"lead": 0.0, "texture": 3.5}, True),
        ({"lead": -0.1, "texture": 3.5}, False),  # a material explains it better
        ({"level": 0.5, "lead": 0.0, "texture": 6.1}, True),  # more even than paint, whatever its radiance
        ({"level": 0.5, "lead": -3.0, "texture": 6.1}, False),  # so much that paint explains better counts against it
        ({"level": 0.5, "lead": -3.0, "texture": 9.1}, True),
        ({"price": 10.0, "lead": 5.5}, False),  # not rare enough for half of that
        ({"level": 3.4}, False),  # no emitter has that radiance
        ({"level": 0.5, "certain": 0.5}, False),  # nor is it rare where ordinary surface has it
        ({"certain_excess": False}, False),  # the other one may be no emitter
        ({"pixels": 7}, False),
    ],
    ids=str,
)
def test_the_radiance_of_a_certain_emitter_is_worth_half_of_the_price(changed, expected):
    """A region, one that emits for sure, and a hundred of another radiance that reflect."""
    case = {"texture": 0.0, "certain": 3.0, "certain_excess": True, "pixels": 100} | KIN | changed
    first = np.arange(102) == 0
    level = np.full((102, 3), 0.5)
    level[:2] = np.array([case["certain"], case["level"]])[:, None]
    nothing = np.zeros(102)
    reflects, texture, pixels = np.where(first, 60.0, 0.0), nothing.copy(), np.full(102, 100)
    reflects[1], texture[1], pixels[1] = case["lead"], case["texture"], case["pixels"]
    excess = first & case["certain_excess"]
    evidence = RegionEvidence(
        reflects=reflects, emits=nothing, texture=texture, compared=0, price=np.full(102, case["price"]),
        excess=excess, certain=excess, ordinary=nothing, pixels=pixels, level=level,
    )  # fmt: skip
    emits = evidence.emitting(np.zeros((2, 0), int))
    assert emits[0]
    assert emits[1] == expected
    assert not emits[2:].any()


@pytest.mark.parametrize(("mirrored", "expected"), [(0.5, True), (20.0, False)])
def test_what_a_mirror_could_show_is_no_excess(np_rng, mirrored, expected):
    seen = Seen(np_rng)
    seen.image[seen.panel] = 20.0
    seen.shading[seen.panel, 1 : 1 + LEVELS] = mirrored
    shards = seen.shards(seen.image)
    pixels = Observations.joined(observations(shards, ratios=False))
    surface = find_regions(seen.mesh, shards, pixels)
    inside = on_panel(seen.mesh.corners.mean(axis=1), (1.1, 1.7, 0.7, 1.3))
    excess = judge(shards, pixels, surface).excess
    assert excess[np.unique(surface.region[inside])].any() == expected
    assert not excess[np.unique(surface.region[~on_panel(seen.mesh.corners.mean(axis=1), (0.9, 1.9, 0.5, 1.5))])].any()


def test_shading_that_nothing_measures_is_not_taken_for_perfect():
    assert _spread(np.full(3, 0.001), 0.02) == _UNMEASURED
    assert _spread(np.full(100, 0.001), 0.02) == 0.02
    assert _spread(np.full(100, 0.2), 0.02) == pytest.approx(0.29652)
