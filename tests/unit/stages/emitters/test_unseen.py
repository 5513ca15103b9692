"""Light that no view shows: transport from unseen surface, the guess, and its refusal."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import BACK, Emitters, Undecided, emitter_facts, read_emitters, write_emitters
from fipt.scene.environment import NOTHING, constant
from fipt.scene.mesh import Mesh
from fipt.scene.surface_blocks import Blocks, blocks_of
from fipt.scene.voxels import facings, voxel_keys
from fipt.stages.emitters import unseen_guess, unseen_surface
from fipt.stages.emitters.extract import Extracted
from fipt.stages.emitters.unseen import Lights, Transport, seen_light, with_more_rays, with_patches
from fipt.stages.emitters.unseen_fit import Guess, SearchSpace, Start, explain, explained, witnessed
from fipt.stages.emitters.unseen_guess import _square_pixel
from fipt.stages.emitters.unseen_surface import Patches, hidden_triangles, patches_as_before, patches_of, small_parts
from tests import scenes

CENTER, SIDE, CELLS = np.array([0.0, 1.03, 0.0]), 8.0, 64


def cache_of(points, normals, radiance) -> dict[str, np.ndarray]:
    """A radiance cache of seen surface points (N, 3)."""
    key = voxel_keys(points, CENTER, SIDE, CELLS) * 6 + facings(normals)
    key, first = np.unique(key, return_index=True)
    return {
        "center": CENTER,
        "side": np.array(SIDE),
        "resolution": np.array(CELLS),
        "key": key // 6,
        "facing": (key % 6).astype(np.uint8),
        "point": points[first],
        "radiance": np.broadcast_to(np.float32(radiance), points.shape)[first],
        "count": np.ones(len(first), np.float32),
        "source": np.arange(len(first), dtype=np.int32),
    }


def all_patches(mesh, hidden, side=None) -> Patches:
    """Patches of a mesh without small parts."""
    return patches_of(mesh, hidden, np.full(len(mesh.triangles), -1), side)


@pytest.fixture(scope="module")
def floor_and_ceiling(backend):
    """A floor (triangles 0, 1) that views see, and a panel of 1 m2, 2 m above it, that none sees (2, 3)."""
    return scenes.joined(scenes.floor(), scenes.emitter_quad((-0.5, 0.5), 2.0, (-0.5, 0.5)))


def floor_samples(rng, count=400):
    position = np.column_stack([rng.uniform(-2, 2, count), np.zeros(count), rng.uniform(-2, 2, count)])
    triangle = np.where(position[:, 0] < position[:, 2], 0, 1)
    return scenes.samples_of(position.astype(np.float32), triangle, views=("a", "b"), shapes=[(1, count // 2)] * 2)


def lights(mesh, samples, radiance=0.4, environment=NOTHING):
    shards = scenes.observed(
        [samples],
        [np.zeros((len(samples.position), 1, 3))],
        [(samples.position * 0 + 0.2, np.ones(len(samples.position)))],
    )
    hidden = hidden_triangles(mesh, shards, Emitters.none())
    x, z = np.meshgrid(np.linspace(-3.99, 3.99, 160), np.linspace(-3.99, 3.99, 160))
    surface = np.column_stack([x.ravel(), 0 * x.ravel(), z.ravel()]).astype(np.float32)
    cache = cache_of(surface, np.tile(np.float32([0, 1, 0]), (x.size, 1)), radiance)
    return shards, hidden, Lights(mesh, hidden, cache, Emitters.none(), environment)


def test_what_no_pixel_shows_is_hidden(floor_and_ceiling, np_rng):
    _, hidden, _ = lights(floor_and_ceiling, floor_samples(np_rng))
    np.testing.assert_array_equal(np.flatnonzero(hidden[-2:]), [0, 1])
    assert not hidden[0]


@pytest.mark.parametrize(("radiance", "shown"), [(0.0, False), (0.2, True)], ids=["masked", "beside an opening"])
def test_a_masked_pixel_shows_nothing(floor_and_ceiling, np_rng, radiance, shown):
    """No pixel that shows the panel has a weight; masked ones are black."""
    below = floor_samples(np_rng)
    across = np_rng.uniform(-0.4, 0.4, (100, 2))
    position = np.float32(np.concatenate([below.position, np.insert(across, 1, 2.0, axis=1)]))
    triangle = np.concatenate([below.triangle, 2 + np.arange(100) % 2])
    panel = triangle >= 2
    normal = np.float32(np.where(panel[:, None], [0, -1, 0], [0, 1, 0]))
    image = np.where(panel[:, None], radiance, np.full((500, 3), 0.2))
    shards = scenes.observed(
        [scenes.samples_of(position, triangle, normal=normal)], [np.zeros((500, 1, 3))], [(image, np.float32(~panel))]
    )
    hidden = hidden_triangles(floor_and_ceiling, shards, Emitters.none())
    np.testing.assert_array_equal(hidden, [False, False, not shown, not shown])


def test_light_of_a_patch_is_that_of_its_form_factor(floor_and_ceiling, np_rng):
    """A square of side a above a point: the textbook's form factor of four rectangles that meet over it."""
    _, hidden, own = lights(floor_and_ceiling, floor_samples(np_rng))
    patches = all_patches(floor_and_ceiling, hidden & (np.arange(len(hidden)) >= len(hidden) - 2))
    assert patches.area.sum() == pytest.approx(1.0)
    x = 0.25
    corner = x / np.sqrt(1 + x**2) * np.arctan(x / np.sqrt(1 + x**2)) / np.pi
    given = own.given(patches, np.zeros((1, 3), np.float32), np.float32([[0, 1, 0]]))
    assert given.sum() == pytest.approx(4 * corner, rel=0.08)
    below = own.given(patches, np.zeros((1, 3), np.float32), np.float32([[0, -1, 0]]))
    assert below.sum() == 0


def test_rays_read_the_cache_and_know_what_they_do_not(floor_and_ceiling, np_rng):
    samples = floor_samples(np_rng, 4000)
    _, _, own = lights(floor_and_ceiling, samples)
    down = np.float32([[0, 1, 0]]), np.float32([[0, -1, 0]])
    known, outside = own.arriving(*down, 4096)
    assert known[0] == pytest.approx(0.4 * (1 - outside[0]), rel=0.15)
    known, outside = own.arriving(np.float32([[0, 0, 0]]), np.float32([[0, 1, 0]]), 4096)
    np.testing.assert_allclose(known, 0)  # the panel is not known, and nothing is outside
    assert outside[0] == pytest.approx(1 - 0.0768, abs=0.02)
    assert own.met[-2:].all()
    _, _, lit = lights(floor_and_ceiling, samples, environment=constant((2.0, 2.0, 2.0)))
    known, outside = lit.arriving(np.float32([[0, 0, 0]]), np.float32([[0, 1, 0]]), 4096)
    assert outside[0] == 0
    assert known[0, 0] == pytest.approx(2 * (1 - 0.0768), rel=0.02)


def test_blocks_are_means_of_pixels(floor_and_ceiling, np_rng):
    samples = floor_samples(np_rng)
    shards, _, own = lights(floor_and_ceiling, samples)
    box = {"center": np.zeros(3), "side": np.float64(8.0)}
    blocks = blocks_of(shards, floor_and_ceiling, np.zeros(len(floor_and_ceiling.triangles), bool), box)
    assert len(blocks.radiance)
    np.testing.assert_allclose(blocks.radiance, 0.2, rtol=1e-5)
    np.testing.assert_allclose(blocks.spread, 0, atol=1e-6)
    assert seen_light(blocks, own).seen.shape == (len(blocks.radiance), 3)


# --- the guess ------------------------------------------------------------------------------------


def problem(rng, emitted, noise=0.05, groups=30, per=20):
    """Blocks of a room whose light falls off from two of forty unseen patches, and their transport."""
    count, patches = groups * per, 40
    place = rng.uniform(0, 4, (count, 3))
    group = np.repeat(np.arange(groups), per)
    at = np.column_stack([rng.uniform(0, 4, (patches, 2)), np.full(patches, 4.0)])
    distance2 = ((place[:, None] - at) ** 2).sum(axis=-1)
    unseen = 0.2 / (np.pi * (distance2 + 0.1))
    seen = np.repeat(0.15 + 0.05 * np.sin(place[:, :1]), 3, axis=1)
    rho = np.exp(np.log(0.4) + 0.5 * rng.standard_normal(groups)).clip(0.03, 0.85)
    light = seen + (unseen @ emitted)[:, None]
    radiance = rho[group][:, None] * light * np.exp(noise * rng.standard_normal((count, 1)))
    normal = np.tile(np.float32([0, 0, 1]), (count, 1))
    blocks = Blocks(place[:, None].astype(np.float32), normal[:, None], radiance, np.zeros(count), group, group)
    number = np.full(100, -1)
    number[:patches] = np.arange(patches)
    return (
        blocks,
        Patches(number, at, np.full(patches, 0.2), np.full(patches, -1), 0.5, np.zeros(patches, bool), number),
        Transport(seen, unseen, unseen, np.zeros(count)),
    )


def test_missing_light_is_guessed(np_rng):
    emitted = np.zeros(40)
    emitted[[3, 17]] = 12, 6
    blocks, patches, transport = problem(np_rng, emitted)
    assert not explained(blocks, Transport.without(transport.seen, transport.open))
    guess = explain(blocks, patches, transport)
    assert guess.determined
    assert guess.radiance.mean(axis=1).sum() == pytest.approx(18, rel=0.3)
    assert guess.radiance[[3, 17]].sum() > 0.8 * guess.radiance.sum()
    assert guess.left < 0.07 < guess.before
    np.testing.assert_allclose(guess.radiance[3] / guess.radiance[3].mean(), 1, atol=0.1)


def test_a_room_without_missing_light_has_no_guess(np_rng):
    """Shading that is 10 % off, block by block, is no light."""
    blocks, patches, transport = problem(np_rng, np.zeros(40), noise=0.1)
    assert explained(blocks, Transport.without(transport.seen, transport.open))
    guess = explain(blocks, patches, transport)
    assert not guess.determined
    assert not guess.radiance.any() or guess.spread > 0.5


@pytest.mark.parametrize("leak", [1, 0.1, 0])
def test_a_lamp_behind_a_door_is_guessed_where_it_is_asked_for(np_rng, leak):
    """A lamp that lights 24 of 624 blocks, like that of a hallway: seen light explains half of the room and more.

    Little of its light (``leak``) arrives at the others, or none.
    """
    blocks, patches, transport = problem(np_rng, np.zeros(40))
    near = np.tile(np.linspace(6, 0.1, 8), 3)  # each of three surfaces goes away from it
    hallway = near[:, None] * np.eye(40)[[9]]  # light for each unit of radiance of patch 9 alone
    seen, reflectance = np.full((24, 3), 0.1), 0.7
    radiance = (
        reflectance * (seen + 0.5 * hallway[:, [9]]) * np.exp(0.05 * np.random.default_rng(3).normal(size=(24, 1)))
    )
    group = np.repeat([30, 31, 32], 8)
    place = np.random.default_rng(4).uniform(6, 8, (24, 1, 3)).astype(np.float32)
    far = Blocks(place, np.tile(blocks.normal[:1], (24, 1, 1)), radiance, np.zeros(24), group, group)
    columns = ("position", "normal", "radiance", "spread", "group", "triangle")
    both = Blocks(*(np.concatenate([getattr(blocks, name), getattr(far, name)]) for name in columns))
    unseen = np.concatenate([0.02 * transport.unseen, hallway])
    unseen[:600, 9] *= leak
    whole = Transport(np.concatenate([transport.seen, seen]), unseen, unseen, np.zeros(624))
    assert not explain(both, patches, whole).determined
    guess = explain(both, patches, whole, asked=True)
    assert guess.determined
    assert guess.radiance[9].mean() == pytest.approx(0.5, rel=0.3)
    assert np.delete(guess.radiance, 9, axis=0).sum() < 0.3 * guess.radiance.sum()


def test_how_bright_it_is_what_asks_for_light_is_no_witness(np_rng):
    """A lamp lights a room, or only surface that may emit, evenly or less and less away from it."""
    emitted = np.zeros(40)
    emitted[3] = 0.6
    blocks, patches, transport = problem(np_rng, emitted)
    chosen = replace(patches, kept=np.arange(40) == 3, piece=np.where(np.arange(40) == 3, 0, -1))
    found = Guess(emitted[:, None] * np.ones(3), determined=True, errors=(0.05, 1.0))
    asks = np.arange(len(blocks.radiance)) < 20
    assert witnessed(found, blocks, chosen, transport, asks) is found, "of all of the room"
    dark, _, unlit = problem(np.random.default_rng(0), np.zeros(40))
    for given, stays in ((np.full(20, 2.0), False), (np.geomspace(0.1, 5, 20), True)):
        unseen = np.zeros_like(unlit.unseen)
        unseen[asks, 3] = given
        light = unlit.seen.mean(axis=1)
        bright = dark.radiance * (1 + unseen[:, 3] * emitted[3] / light)[:, None]
        told = witnessed(found, replace(dark, radiance=bright), chosen, replace(unlit, unseen=unseen), asks)
        assert told.determined == stays
    none = Guess(np.zeros((40, 3)))
    assert witnessed(none, blocks, chosen, transport, asks) is none


def test_errors_that_surfaces_of_many_colours_share_are_no_light(np_rng):
    """Light that is off by a half either way, in places just as large as what patches light: a wrong mesh."""
    blocks, patches, transport = problem(np_rng, np.zeros(40))
    near = transport.unseen**2
    near /= np.quantile(near, 0.98, axis=0)
    wrong = np.exp(np.minimum(near, 1) @ np.where(np.arange(40) % 2, 0.5, -0.5))
    blocks = replace(blocks, radiance=blocks.radiance * wrong[:, None])
    # errors counted apart for each colour, this was 80 to 160 nats of evidence
    assert explain(blocks, patches, replace(transport, unseen=0.2 * near), asked=True).gain < 30


def test_no_light_is_guessed_that_drowns_what_is_seen(np_rng):
    """Seen light is off by a factor of 3 from block to block: ten times as much of another kind would hide that."""
    blocks, patches, transport = problem(np_rng, np.zeros(40), noise=0.05)
    unseen = transport.unseen.copy()
    unseen[:, 3] = 0.2  # an even light
    wrong = transport.seen * np.exp(np.random.default_rng(5).standard_normal((len(unseen), 1)))
    guess = explain(blocks, patches, replace(transport, seen=wrong, unseen=unseen), asked=True)
    assert guess.share > 0.8
    assert guess.gain > 100
    assert not guess.determined


def test_colour_of_the_guess(np_rng):
    emitted = np.zeros(40)
    emitted[5] = 15
    blocks, patches, transport = problem(np_rng, emitted)
    share = 1 - transport.seen[:, :1] / (transport.seen[:, :1] + (transport.unseen @ emitted)[:, None])
    warm = blocks.radiance * (1 + share * (np.array([1.2, 1.0, 0.8]) - 1))
    guess = explain(
        Blocks(blocks.position, blocks.normal, warm, blocks.spread, blocks.group, blocks.triangle), patches, transport
    )
    found = guess.radiance.sum(axis=0) / guess.radiance.mean(axis=1).sum()
    np.testing.assert_allclose(found, [1.2, 1.0, 0.8], atol=0.08)


def test_a_search_goes_on_from_what_larger_patches_told(np_rng):
    """It keeps what is worth its price, leaves out what is not, and finds the rest."""
    emitted = np.zeros(40)
    emitted[[3, 17]] = 12, 6
    blocks, patches, transport = problem(np_rng, emitted)
    alone = explain(blocks, patches, transport)
    told = Start((17, 30), alone.errors)
    guess = explain(blocks, patches, transport, start=told)
    np.testing.assert_allclose(guess.radiance, alone.radiance, rtol=0.02)
    assert guess.errors == alone.errors
    assert guess.gain == pytest.approx(alone.gain, rel=0.02)
    unsure = explain(blocks, patches, transport, start=Start((), (3 * alone.errors[0], alone.errors[1])))
    assert 0 < unsure.gain < 0.5 * alone.gain


def test_a_patch_that_was_chosen_early_is_exchanged_for_a_better_one(np_rng):
    """Patch 30 lights nearly what patch 3 lights: beside it, patch 3 is not worth its price."""
    blocks, patches, transport = problem(np_rng, np.where(np.arange(40) == 3, 12.0, 0))
    unseen = transport.unseen.copy()
    unseen[:, 30] = unseen[:, 3] * np.exp(0.03 * np_rng.standard_normal(len(unseen)))
    errors = explain(blocks, patches, transport).errors
    guess = explain(blocks, patches, replace(transport, unseen=unseen), start=Start((30,), errors))
    np.testing.assert_array_equal(np.flatnonzero(guess.radiance.any(axis=1)), [3])


@pytest.mark.parametrize("blocks_lit", [4, 16])
def test_what_few_blocks_alone_tell_is_no_lamp(np_rng, blocks_lit):
    """Four blocks are three times as bright as the light there explains; as many as three err alike."""
    blocks, patches, transport = problem(np_rng, np.zeros(40))
    lit = np.arange(blocks_lit) * 20  # each of another colour
    unseen = np.zeros_like(transport.unseen)
    unseen[lit, 3] = 0.4
    blocks.radiance[lit] *= 3
    errors = 0.05, 3.0
    near = replace(transport, unseen=unseen)
    assert explain(blocks, patches, near, True, Start((3,), errors)).radiance[3].any()
    guess = explain(blocks, patches, near, True, Start((3,), errors, measured=True))
    assert guess.determined == guess.radiance[3].any() == (blocks_lit > 4)


def test_who_looks_closer_pays_for_the_whole_search(np_rng):
    """A patch that is worth its price among forty is not among as many as an e to the power of its gain."""
    blocks, patches, transport = problem(np_rng, np.where(np.arange(40) == 3, 0.3, 0))
    chosen = replace(patches, kept=np.arange(40) == 3, piece=np.where(np.arange(40) == 3, 0, -1))
    found = explain(blocks, patches, transport, True)
    assert found.space == SearchSpace(40, patches.area.sum())
    start = Start.of_all(chosen, found)
    again = explain(blocks, chosen, transport, True, start, found.space)
    assert again.space == found.space
    assert again.gain == pytest.approx(found.gain, rel=0.1)
    alone = explain(blocks, chosen, transport, True, start)
    assert alone.space.choices == 1
    many = SearchSpace(int(np.exp(min(found.gain, 80)) * 41), 1e40)
    told = explain(blocks, chosen, transport, True, start, many)
    assert not told.radiance.any()
    assert told.space == many


def test_a_lamp_is_in_a_whole_cell_rather_than_in_a_scrap():
    """Of 9 m2 in ten patches: halves of the odds go by number and by area; a bulb is as likely as any."""
    area, part = np.array([3.0, *np.full(8, 0.75), 0.001]), np.arange(10) - 9
    patches = Patches(np.arange(10), np.zeros((10, 3)), area, np.arange(10), 1.0, np.zeros(10, bool), np.full(10, -1))
    space = SearchSpace().with_patches(patches, 10)
    odds = space.odds(patches, np.eye(10))
    np.testing.assert_allclose(np.exp(-odds), 0.5 / 10 + 0.5 * area / area.sum())
    assert np.exp(-odds).sum() == pytest.approx(1)
    assert odds[9] - odds[0] == pytest.approx(np.log((0.05 + 1.5 / 9.001) / 0.05), abs=0.01)
    bulb = replace(patches, part=np.maximum(part, -1))
    np.testing.assert_allclose(np.exp(-space.odds(bulb, np.eye(10)))[9], 0.1)
    # so is what is joined
    np.testing.assert_allclose(np.exp(-space.odds(patches, np.ones((10, 1)))), 0.1)


@pytest.mark.parametrize("area", [0.01, 4.0], ids=["a scrap", "a large cell"])
def test_where_blocks_do_not_tell_the_larger_of_two_cells_emits(np_rng, area):
    """Two cells that light alike are told by their areas alone."""
    blocks, patches, transport = problem(np_rng, np.where(np.arange(40) == 3, 0.3, 0))
    unseen = transport.unseen.copy()
    unseen[:, 5] = unseen[:, 3]
    areas = patches.area.copy()
    areas[3], areas[5] = area, 1.0
    patches = replace(patches, area=areas, part=np.full(len(patches.part), -1))
    guess = explain(blocks, patches, replace(transport, unseen=unseen), True)
    emits = guess.radiance.max(axis=1) > 0
    assert emits[5 if area < 1 else 3]
    assert not emits[3 if area < 1 else 5]


def test_nothing_unseen_is_no_guess(np_rng):
    blocks, _, transport = problem(np_rng, np.full(40, 5.0))
    number, none = np.full(100, -1), np.zeros(0)
    none = Patches(number, np.zeros((0, 3)), none, np.zeros(0, int), 0.0, np.zeros(0, bool), number)
    assert not explain(blocks, none, Transport.without(transport.seen, transport.open)).determined


# --- what comes of it -----------------------------------------------------------------------------


@pytest.fixture
def guessing(monkeypatch, floor_and_ceiling):
    """`with_guess` on the floor below its panel, with what `explain` should have found put in its place."""

    def run(
        guess: Guess,
        open_share: float = 0.0,
        is_explained: bool = False,
        extracted: Extracted | None = None,
        radiance: float = 5.0,
        asked: bool = False,
        at_most: float = np.inf,
    ):
        blocks = SimpleNamespace(
            radiance=np.full((50, 3), radiance),
            triangle=np.arange(50) % 2,
            brightest=radiance,
            white=2.5 * radiance,
            beyond=lambda *_: np.full((len(floor_and_ceiling.triangles), 2, 3), np.nan),
        )
        number = np.full(len(floor_and_ceiling.triangles), -1)
        number[-2:] = 0
        at, one, alone = np.array([[0.0, 2.0, 0.0]]), np.ones(1), np.full(len(number), -1)
        patches = Patches(number, at, one, np.array([0]), 100.0, np.zeros(1, bool), alone)
        known = Transport(np.ones((50, 3)), *np.ones((2, 50, 1)), np.full(50, open_share))
        for name, value in {
            "blocks_of": blocks,
            "_square_pixel": 0.0,
            "hidden_triangles": number >= 0,
            "Lights": SimpleNamespace(mesh=floor_and_ceiling, hidden=number >= 0, met=number >= 0),
            "seen_light": known,
            "explained": is_explained,
            "with_patches": known,
            "explain": guess,
            "witnessed": guess,
        }.items():
            monkeypatch.setattr(unseen_guess, name, lambda *_, value=value, **__: value)
        monkeypatch.setattr(unseen_guess, "_measured", lambda trial, *_: trial)
        monkeypatch.setattr(
            unseen_guess, "patches_of", lambda _, met, *__: replace(patches, number=np.where(met, number, -1))
        )
        most = np.where(number >= 0, at_most, np.inf)
        extracted = extracted or Extracted(Emitters.none(), Undecided.none())
        return unseen_guess.with_guess(floor_and_ceiling, [], extracted, {}, NOTHING, most, asked=asked)

    return run


@pytest.mark.parametrize(("at_most", "emits"), [(12.0, False), (13.0, True)], ids=["dark", "bright"])
def test_what_a_mirror_shows_to_be_dark_is_no_lamp(guessing, at_most, emits):
    """White surface would be 12.5 under the light of the room."""
    told = guessing(Guess(np.array([[9.0, 8.0, 7.0]]), 0.3, 0.6, 400.0, 0.06, 0.25, True), at_most=at_most)
    assert emits == (len(told.emitters.triangle) > 0)


def test_guessed_emitters_are_marked_and_named(guessing, floor_and_ceiling, tmp_path):
    told = guessing(Guess(np.array([[9.0, 8.0, 7.0]]), 0.3, 0.6, 400.0, 0.06, 0.25, True))
    found = told.emitters
    count = len(floor_and_ceiling.triangles)
    np.testing.assert_array_equal(found.triangle, [count - 2, count - 1])
    assert found.guessed.all()
    assert found.confidence.max() < 0.5
    (warning,) = told.warnings
    assert "100 % of the power of all emitters is guessed" in warning
    assert "photograph the ceiling near (0.00, 2.00, 0.00)" in warning
    write_emitters(tmp_path / "emitters.npz", found, floor_and_ceiling)
    again = read_emitters(tmp_path / "emitters.npz")
    np.testing.assert_array_equal(again.guessed, True)
    (fact,) = emitter_facts(again, floor_and_ceiling)
    assert fact["guessed"]
    assert fact["spread"] == pytest.approx(0.3)


def test_what_is_not_determined_is_said(guessing):
    nothing = Guess(np.zeros((1, 3)), before=0.4, left=0.4)
    told = guessing(nothing)
    assert len(told.emitters.triangle) == 0
    assert "not determined" in told.warnings[0]
    assert "photograph the openings" in guessing(nothing, open_share=0.4).warnings[0]


def test_a_room_that_seen_light_explains_is_left_alone(guessing):
    guess = Guess(np.ones((1, 3)), determined=True)
    told = guessing(guess, is_explained=True)
    assert len(told.emitters.triangle) == 0
    assert told.warnings == ()
    # its reflectances alone may hide what paths from its emitters lack
    assert guessing(guess, is_explained=True, asked=True).emitters.guessed.all()


def test_measured_emitters_are_not_guessed():
    found = Emitters.none()
    assert found.guessed.dtype == bool
    assert len(found.guessed) == len(found.spread) == 0


def test_a_mesh_without_unseen_surface_has_no_patches(floor_and_ceiling):
    assert len(all_patches(floor_and_ceiling, np.zeros(len(floor_and_ceiling.triangles), bool)).area) == 0


def test_a_plane_of_several_patches_is_a_candidate_of_its_own(floor_and_ceiling):
    """Two panels that touch at an edge, one 0.3 m lower: each is a piece."""
    wide = scenes.joined(*(scenes.emitter_quad((x, x + 1), 2.0, (0, 1)) for x in range(4)))
    low = scenes.joined(*(scenes.emitter_quad((x, x + 1), 1.7, (0, 1)) for x in range(4)))
    mesh = scenes.joined(wide, low)
    patches = all_patches(mesh, np.ones(len(mesh.triangles), bool))
    count = len(patches.area)
    candidates = patches.candidates
    np.testing.assert_array_equal(candidates[:, :count], np.eye(count))
    np.testing.assert_allclose(np.sort(patches.area @ candidates[:, count:]), [4, 4])


@pytest.fixture
def bulbs() -> Mesh:
    """A panel of 4 m (triangles 0, 1) and two boxes of 20 cm, of 12 triangles each."""
    boxes = (scenes.box((x, 1, 0), (x + 0.2, 1.2, 0.2)) for x in (0, 1))
    return scenes.joined(scenes.emitter_quad((0, 4), 2.0, (0, 4)), *boxes)


def test_a_small_part_is_hidden_altogether_and_met(bulbs):
    hidden, met = np.ones(26, bool), np.isin(np.arange(26), [0, 1, 5])
    part = small_parts(bulbs, hidden, met)
    np.testing.assert_array_equal(np.flatnonzero(part >= 0), np.arange(2, 14))  # no ray met the other box
    assert len(np.unique(part[2:14])) == 1
    hidden[9] = False  # a view shows one of its triangles
    assert (small_parts(bulbs, hidden, met) < 0).all()
    assert len(small_parts(bulbs, ~met & False, ~met & False)) == 26


def test_copies_of_a_small_part_are_one_candidate(bulbs):
    every = np.ones(38, bool)
    other = scenes.joined(bulbs, scenes.box((3, 1, 0), (3.1, 1.2, 0.1)))
    patches = patches_of(other, every, small_parts(other, every, every))
    own = np.isin(np.arange(len(patches.area)), patches.number[2:26])
    np.testing.assert_array_equal(patches.candidates[:, -1], own)
    enclosed = np.where(np.isin(np.arange(len(own)), patches.number[2:14]), -1, patches.piece)
    assert (replace(patches, piece=enclosed).candidates.sum(axis=0) < own.sum()).all()


def test_copies_that_shine_alike_are_emitters_of_their_own(bulbs):
    every = np.ones(26, bool)
    patches = patches_of(bulbs, every, small_parts(bulbs, every, every))
    guess = Guess(np.tile(5.0 * patches.of_small_parts[:, None], 3), determined=True)
    found = unseen_guess._added(bulbs, Emitters.none(), replace(patches, piece=0 * patches.piece), guess)
    np.testing.assert_array_equal(found.triangle, np.arange(2, 26))
    np.testing.assert_array_equal(found.emitter, np.repeat([0, 1], 12))


def test_of_many_small_parts_those_count_that_rays_meet_most(bulbs, monkeypatch):
    """And they do not make the cells of all else larger."""
    every, met = np.ones(26, bool), np.where(np.arange(26) < 14, 1, 2)
    both = small_parts(bulbs, every, met)
    side = patches_of(bulbs, every, both).side
    monkeypatch.setattr(unseen_surface, "_MOST_PATCHES", 2)
    assert patches_of(bulbs, every, both).side == side
    monkeypatch.setattr(unseen_surface, "_MOST_PARTS", 1)
    np.testing.assert_array_equal(np.flatnonzero(small_parts(bulbs, every, met) >= 0), np.arange(14, 26))


def test_a_part_of_less_area_than_a_cell_is_small(bulbs):
    """Two strips below a ceiling of 4 m, longer than a cell of it: one of 1 cm, one of 20 cm."""
    strips = (scenes.emitter_quad((0, 1.5), 1.9, (z, z + width)) for z, width in ((0, 0.01), (1, 0.2)))
    every = np.ones(30, bool)
    part = small_parts(scenes.joined(bulbs, *strips), every, every)
    np.testing.assert_array_equal(np.flatnonzero(part >= 0), np.arange(2, 28))


def test_a_small_part_is_a_candidate_as_a_whole(bulbs):
    """In cells that cut it, too, and once more in smaller ones, of which a part may lie at the border."""
    every = np.ones(26, bool)
    patches = patches_of(bulbs, every, small_parts(bulbs, every, every), 0.15)
    assert patches._around(np.arange(len(patches.area)) == patches.number[2], bulbs)[2:14].all()
    for each in (patches, patches.finer(np.isin(np.arange(len(patches.area)), patches.number[2:]), bulbs)):
        for box in (slice(2, 14), slice(14, 26)):
            own = np.isin(np.arange(len(each.area)), each.number[box])
            assert own.sum() > 1
            assert (each.candidates[own].all(axis=0) & ~each.candidates[~own].any(axis=0)).sum() == 1
            assert each.area[own].sum() == pytest.approx(6 * 0.2**2)
            (part,) = each.small(own)
            (column,) = each.columns_of(np.array([part]))
            np.testing.assert_array_equal(each.candidates[:, column], own)
            assert len(each.small(own & (np.arange(len(own)) != np.argmax(own)))) == 0  # not all of it


def test_a_small_part_lights_the_room_if_enough_of_it_does(bulbs):
    """One of three facings of the first box, where that of the panel counts for itself."""
    every = np.ones(26, bool)
    patches = patches_of(bulbs, every, small_parts(bulbs, every, every), 4.0)
    first = np.isin(np.arange(len(patches.area)), patches.number[2:14])
    assert first.sum() == 3
    arrives = np.where(np.arange(len(first)) == np.argmax(first), 2.0, 0.0) * patches.area
    np.testing.assert_array_equal(patches.lighting(arrives, 0.5), first)
    np.testing.assert_array_equal(patches.lighting(arrives, 0.7), np.zeros(len(first), bool))


def test_a_small_part_is_as_large_as_all_of_it(bulbs):
    """Its patches face three ways; what is less than a pixel hides in a gap of the mesh."""
    every = np.ones(26, bool)
    patches = patches_of(bulbs, every, small_parts(bulbs, every, every), 4.0)
    whole = patches.area[patches.of_small_parts].sum() / len(patches.small(patches.of_small_parts))
    np.testing.assert_array_equal(patches.at_least(0.99 * whole)[patches.of_small_parts], True)
    assert (patches.area[patches.of_small_parts] < 0.99 * whole).all()
    np.testing.assert_array_equal(patches.at_least(1.01 * whole), patches.area >= 1.01 * whole)


def test_a_pixel_shows_a_square_of_its_width(np_rng):
    footprint = np.full(9, 0.03, np.float32)
    samples = scenes.samples_of(np.zeros((9, 3)), np.zeros(9, np.int64), footprint=footprint)
    shading = np.zeros((9, SHADING_OUTPUTS, 3), np.float16)
    shards = scenes.observed([samples], [shading], [(np.ones((9, 3), np.float32), np.ones(9, np.float32))])
    assert _square_pixel(shards) == pytest.approx(9e-4)


def test_what_is_enclosed_is_no_part_of_a_pane(guessing, floor_and_ceiling, monkeypatch):
    """Two patches of one plane, of which one lights nothing that is seen."""
    offered = []
    none = Guess(np.zeros((2, 3)), before=0.4)
    guessing(none)
    alone = np.full(4, -1)
    two = Patches(alone, np.zeros((2, 3)), np.ones(2), np.zeros(2, int), 1.0, np.zeros(2, bool), alone)
    unseen = np.tile([1.0, 0.0], (50, 1))
    given = Transport(np.ones((50, 3)), unseen, unseen, np.zeros(50))
    monkeypatch.setattr(unseen_guess, "patches_of", lambda *_: two)
    monkeypatch.setattr(unseen_guess, "with_patches", lambda *_: given)
    monkeypatch.setattr(unseen_guess, "explain", lambda _blocks, patches, *_: offered.append(patches) or none)
    mesh, extracted = floor_and_ceiling, Extracted(Emitters.none(), Undecided.none())
    unseen_guess.with_guess(mesh, [], extracted, {}, NOTHING, np.full(len(mesh.triangles), np.inf))
    np.testing.assert_array_equal(offered[0].piece, [0, -1])


def test_what_emits_is_measured_by_more_rays(backend, np_rng):
    """A panel of radiance 5 above a floor, half of it above a board, whose edge few rays tell."""
    panel, board = scenes.emitter_quad((-0.5, 0.5), 2.0, (-0.5, 0.5)), scenes.emitter_quad((-0.9, 0), 1.8, (-1, 1))
    mesh = scenes.joined(scenes.floor(), panel, board)
    _, _, own = lights(mesh, floor_samples(np_rng))
    patches = all_patches(mesh, np.isin(np.arange(6), (2, 3)))
    place = np_rng.uniform(-1.5, 1.5, (300, 4, 3)).astype(np.float32) * (1, 0, 1)
    normal, none = np.tile(np.float32([0, 1, 0]), (300, 4, 1)), np.zeros(300, int)
    given = own.given(patches, place.reshape(-1, 3), normal.reshape(-1, 3), 2000).reshape(300, 4, -1).mean(axis=1)
    radiance = np.repeat(0.4 * (0.1 + 5 * given.sum(axis=1, keepdims=True)), 3, axis=1)
    blocks = Blocks(place, normal, radiance, np.zeros(300), none, none)
    known = Transport.without(np.full((300, 3), 0.1), np.zeros(300))
    few = with_patches(blocks, patches, own, known)
    several = with_more_rays(blocks, patches, own, few)
    assert abs(several.straight - given).sum() < 0.3 * abs(few.straight - given).sum()
    guess = Guess(np.full((len(patches.area), 3), 9.0), determined=True)
    found = unseen_guess._measured(unseen_guess._Trial(blocks, few, patches, guess), own, True)
    assert found.guess.determined
    np.testing.assert_allclose(found.guess.radiance, 5, rtol=0.05)
    assert len(np.unique(found.guess.radiance[:, 0])) == 1  # still one emitter
    searched = replace(guess, space=SearchSpace(10**40, 1e40))
    found = unseen_guess._measured(unseen_guess._Trial(blocks, few, patches, searched), own, True)
    assert not found.guess.determined, "it is not worth the price of so long a search"
    dark = replace(blocks, radiance=np.full((300, 3), 0.04))  # as without the panel
    found = unseen_guess._measured(unseen_guess._Trial(dark, few, patches, guess), own, True)
    assert not found.guess.determined
    assert not found.guess.radiance.any()


def test_light_goes_on_from_unseen_surface(backend, np_rng):
    """In a closed grey box each bounce has half of the light of the one before: in four 15/16 of the straight light."""
    mesh = scenes.joined(scenes.box((-1, 0, -1), (1, 2, 1)), scenes.emitter_quad((-0.1, 0.1), 1.0, (-0.1, 0.1)))
    _, hidden, own = lights(mesh, scenes.samples_of(np.float32([[9, 9, 9]] * 4), 0, views=("a",), shapes=[(1, 4)]))
    own.hidden = np.ones(len(hidden), bool)
    patches = all_patches(mesh, np.arange(14) >= 12)
    axis, side, across = np_rng.integers(0, 3, 1200), np_rng.choice([-1, 1], 1200), np_rng.uniform(-1, 1, (1200, 3))
    place = across.copy()
    place[np.arange(1200), axis] = side
    normal = np.zeros((1200, 3), np.float32)
    normal[np.arange(1200), axis] = -side
    place = (place + np.array([0, 1, 0])).astype(np.float32)
    none = np.zeros(300)
    blocks = Blocks(place.reshape(300, 4, 3), normal.reshape(300, 4, 3), np.ones((300, 3)), none, none, none)
    known = Transport(np.zeros((300, 3)), np.zeros((300, 1)), np.zeros((300, 1)), none)
    found = with_more_rays(blocks, patches, own, known)
    assert (found.unseen - found.straight).mean() == pytest.approx(15 / 16 * found.straight.mean(), rel=0.06)


def half_a_wall(axis, sign, count=20, off=0.0, radiance=0.3) -> tuple[Mesh, Blocks]:
    """Two squares of a wall, which faces along an axis from 2 m; blocks of the first, and ten of a floor elsewhere."""
    across = [k for k in range(3) if k != axis]
    corners = np.zeros((6, 3))
    corners[:, across] = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    corners[:, axis] = 2.0
    triangles = np.array([(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)])
    normal = np.zeros(3, np.float32)
    normal[axis] = sign
    if (Mesh(corners, triangles).normals[0] * normal).sum() < 0:
        triangles = triangles[:, ::-1].copy()
    place = np.full((count + 10, 1, 3), -3, np.float32)
    place[:count, 0, across] = np.column_stack([np.linspace(0, 1, count), np.full(count, 0.5)])
    place[:count, 0, axis] = 2.0 + off
    facing = np.tile(np.eye(3, dtype=np.float32)[(axis + 1) % 3], (count + 10, 1, 1))
    facing[:count] = normal
    none = np.zeros(count + 10, int)
    level = np.full((count + 10, 3), 9.0)
    level[:count] = radiance
    return Mesh(corners, triangles), Blocks(place, facing, level, none, none, none)


HALF = np.array([False, False, True, True])
BOX = {"side": np.array(SIDE)}


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("turned", [False, True])
def test_a_plane_goes_on_beyond_what_views_show(axis, sign, turned):
    """By the side that faces the room, however it is wound."""
    mesh, blocks = half_a_wall(axis, sign)
    if turned:
        mesh = Mesh(mesh.vertices, mesh.triangles[:, ::-1].copy())
    found = blocks.beyond(mesh, HALF, BOX)
    np.testing.assert_allclose(found[HALF, int(turned)], 0.3, rtol=1e-5)
    assert np.isnan(found[HALF, 1 - int(turned)]).all()
    assert np.isnan(found[~HALF]).all(), "these are seen"


@pytest.mark.parametrize(("off", "goes_on"), [(0.1, True), (-0.1, True), (0.15, False), (-0.15, False)])
def test_a_plane_is_as_thick_as_those_of_blocks(off, goes_on):
    mesh, blocks = half_a_wall(1, -1, off=off)  # an eighth of a metre
    assert np.isfinite(blocks.beyond(mesh, HALF, BOX)[2:, 0]).all() == goes_on


def test_a_small_face_is_no_plane_that_goes_on():
    """Three of 310 blocks are less than a hundredth, four are not."""
    for count in (3, 4):
        mesh, blocks = half_a_wall(1, -1, 300)
        blocks.position[count:300, 0, 1] = 1.0
        assert np.isfinite(blocks.beyond(mesh, HALF, BOX)[2:, 0]).all() == (count == 4)


def test_a_part_of_its_own_is_no_plane_that_goes_on():
    mesh, blocks = half_a_wall(1, -1)
    apart = scenes.joined(
        Mesh(mesh.vertices, mesh.triangles[:2]), Mesh(mesh.vertices + np.array([2, 0, 0]), mesh.triangles[:2])
    )
    assert np.isnan(blocks.beyond(apart, HALF, BOX)).all()


def test_a_plane_is_as_bright_as_it_is_nearby():
    """Brighter towards the unseen half; a wall that is nearer, and brighter still, is none of it."""
    mesh, blocks = half_a_wall(1, -1, 100)
    blocks.radiance[:100] = np.linspace(0.1, 0.2, 100)[:, None]
    blocks.position[100:, 0] = (1.2, 1.9, 0.5)
    found = blocks.beyond(mesh, HALF, BOX)[2:, 0]
    np.testing.assert_allclose(found, np.exp(np.log(blocks.radiance[96:100]).mean(axis=0)) * [[1], [1]], rtol=1e-5)


def test_what_goes_on_is_as_bright_as_what_is_seen_of_it(floor_and_ceiling, np_rng):
    """Of the cosine lobe 7.3 % meet the panel. It counts once: it does not reflect what arrives there as well."""
    _, hidden, _ = lights(floor_and_ceiling, floor_samples(np_rng, 4000))
    panel = np.arange(len(hidden)) >= len(hidden) - 2
    place, up = np.zeros((64, 4, 3), np.float32), np.tile(np.float32([0, 1, 0]), (64, 4, 1))
    none = np.zeros(64, int)
    blocks = Blocks(place, up, np.ones((64, 3)), none, none, none)
    patches, found = all_patches(floor_and_ceiling, hidden & panel), {}
    for side in (0, 1, None):
        _, _, own = lights(floor_and_ceiling, floor_samples(np_rng, 4000))
        if side is not None:
            own.beyond[panel, side] = 0.6
        found[side] = with_patches(blocks, patches, own, seen_light(blocks, own))
    front = int(floor_and_ceiling.normals[-1, 1] > 0)  # the side that faces the floor
    assert found[front].seen.mean() == pytest.approx(0.6 * 0.0735, rel=0.05)
    np.testing.assert_allclose(found[front].unseen, found[front].straight)
    # grey, and above a floor of 0.4 that fills most of what it faces
    assert 0.3 * 0.4 * 0.0735 < found[None].seen.mean() < 0.5 * 0.4 * 0.08
    assert found[1 - front].seen.mean() == pytest.approx(found[None].seen.mean(), rel=0.1)
    own.beyond[panel, front] = 0.6
    own.brightest = 0.2
    cut = seen_light(blocks, own)
    assert cut.seen.mean() == pytest.approx(0.2 * 0.0735, rel=0.05), "a block beside a lamp holds pixels of it"
    first, second = (with_patches(blocks, patches, own, cut).seen for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_light_goes_on_only_from_surface_that_is_not_known(backend, np_rng):
    """In the closed box each bounce halves the light; where rays find its walls known, these have sent it already."""
    mesh = scenes.joined(scenes.box((-1, 0, -1), (1, 2, 1)), scenes.emitter_quad((-0.1, 0.1), 1.0, (-0.1, 0.1)))
    _, hidden, own = lights(mesh, scenes.samples_of(np.float32([[9, 9, 9]] * 4), 0, views=("a",), shapes=[(1, 4)]))
    own.hidden, own.met[:] = np.ones(len(hidden), bool), 3
    patches = all_patches(mesh, np.arange(14) >= 12)
    place, normal = np.zeros((30, 4, 3), np.float32), np.tile(np.float32([0, 1, 0]), (30, 4, 1))
    none = np.zeros(30)
    blocks = Blocks(place, normal, np.ones((30, 3)), none, none, none)
    known = Transport(np.zeros((30, 3)), np.zeros((30, 1)), np.zeros((30, 1)), none)
    for black, sends in ((3, True), (2, True), (1, False)):
        own.black[:] = black
        found = with_more_rays(blocks, patches, own, known)
        assert (found.unseen > found.straight).any() == sends


def test_light_is_measured_with_the_planes_that_go_on(backend, np_rng, monkeypatch):
    """A ceiling of 2 m2, of which views show one half."""
    ceiling, _ = half_a_wall(1, -1)
    mesh = scenes.joined(scenes.floor(), Mesh(ceiling.vertices - np.array([0, 0, 0.5]), ceiling.triangles))
    below = floor_samples(np_rng)
    above = np.insert(np_rng.uniform((0, -0.5), (1, 0.5), (400, 2)), 1, 2.0, axis=1)
    position = np.float32(np.concatenate([below.position, above]))
    triangle = np.concatenate([below.triangle, np.where(above[:, 0] > above[:, 2] + 0.5, 2, 3)])
    normal = np.float32(np.where(triangle[:, None] < 2, [0, 1, 0], [0, -1, 0]))
    samples = scenes.samples_of(position, triangle, normal=normal)
    shards = scenes.observed([samples], [np.zeros((800, 1, 3))], [(np.full((800, 3), 0.2), np.ones(800, np.float32))])
    known = []

    def measured(blocks, own):
        known.append((own.hidden.copy(), own.beyond.copy()))
        return seen_light(blocks, own)

    monkeypatch.setattr(unseen_guess, "seen_light", measured)
    none = np.zeros(len(mesh.triangles), bool)
    arguments = (mesh, shards, Emitters.none(), cache_of(position, normal, 0.2), NOTHING, none, np.full(len(none), -1))
    unseen_guess._trial(*arguments)
    hidden, beyond = known[0]
    np.testing.assert_array_equal(np.flatnonzero(hidden), [4, 5])
    np.testing.assert_allclose(beyond[4:, 0], 0.2, rtol=1e-5)


def test_a_pane_is_found_as_a_whole(np_rng):
    emitted = np.zeros(40)
    emitted[8:16] = 4
    blocks, patches, transport = problem(np_rng, emitted)
    piece = np.full(40, -1)
    piece[8:16] = 0
    guess = explain(blocks, replace(patches, piece=piece), transport)
    assert guess.determined
    pane = guess.radiance[8:16].mean(axis=1)
    np.testing.assert_allclose(pane, pane[0], rtol=1e-9)
    assert pane[0] == pytest.approx(4, rel=0.3)


def test_patches_are_smaller_around_those_that_emit():
    """A row of 16 panels of 1 m, of which the fifth emits."""
    mesh = scenes.joined(*(scenes.emitter_quad((x, x + 0.99), 2.0, (0, 0.99)) for x in range(16)))
    coarse = all_patches(mesh, np.ones(32, bool), 2.0)
    assert coarse.side == 2.0
    assert len(coarse.area) == 8
    fine = coarse.finer(np.isin(np.arange(8), coarse.number[8]), mesh)
    assert fine.side == 1.0
    assert fine.area.sum() == pytest.approx(coarse.area.sum())
    # within a cell of it, by centres, patches are of a metre; farther ones come in twos
    assert fine.area[fine.number[8:12]].max() < 1.5
    np.testing.assert_array_equal(fine.number[20:24], fine.number[20])
    same = coarse.finer(np.zeros(8, bool), mesh)
    np.testing.assert_allclose(same.center, coarse.center)


def test_each_guess_of_the_round_before_is_one_candidate():
    """A row of 16 panels of 1 m, of which the fifth was guessed, and half of the sixth."""
    mesh = scenes.joined(*(scenes.emitter_quad((x, x + 0.99), 2.0, (0, 0.99)) for x in range(16)))
    before = np.full(32, -1)
    before[[8, 9, 10]] = 7, 7, 9
    single = np.full(32, -1)
    patches = patches_as_before(mesh, np.ones(32, bool), single, before)
    assert patches.area.sum() == pytest.approx(mesh.areas.sum())
    np.testing.assert_array_equal(np.flatnonzero(patches.kept[patches.number]), [8, 9, 10])
    np.testing.assert_allclose(patches.area @ patches.candidates, [0.99**2, 0.99**2 / 2], rtol=1e-5)
    alone = patches_as_before(mesh, before >= 0, single, before)
    assert alone.kept.all()


@pytest.mark.parametrize(("emitted", "stays"), [(0.15, True), (0.0, False)])
def test_a_guess_of_the_round_before_need_not_be_chosen_again(np_rng, emitted, stays):
    """It is too weak to be chosen from forty patches."""
    blocks, patches, transport = problem(np_rng, np.where(np.arange(40) == 3, emitted, 0), noise=0.1)
    assert not explain(blocks, patches, transport, asked=True).determined
    own = np.arange(40) == 3
    guess = explain(blocks, replace(patches, kept=own, piece=np.where(own, 0, -1)), transport, asked=True)
    assert guess.determined == stays
    assert (guess.radiance[3].mean() > 0.1) == stays
    assert not guess.radiance[~own].any()


def test_an_enclosed_guess_of_the_round_before_makes_no_other_surface_a_candidate(np_rng):
    """Patch 7 shines; patch 3 was guessed before, and lies in a gap."""
    blocks, patches, transport = problem(np_rng, np.where(np.arange(40) == 7, 9.0, 0))
    guess = explain(blocks, replace(patches, kept=np.arange(40) == 3), transport, asked=True)
    assert not guess.radiance.any()
    assert guess.gain == 0


def evenly(patches: int) -> Transport:
    """So many patches light 50 blocks alike."""
    return Transport(np.ones((50, 3)), *np.ones((2, 50, patches)), np.zeros(50))


@pytest.mark.parametrize(("gain", "radiance"), [(None, 7), (3.0, 7), (9.0, 2)])
def test_what_was_guessed_before_stays_unless_another_guess_gains_more(
    guessing, floor_and_ceiling, monkeypatch, gain, radiance
):
    """It gains 4; the panel is offered as hidden surface too, and gains nothing, less or more."""
    space = SearchSpace(33, 5.0)
    none = Guess(np.zeros((1, 3)), before=0.4, space=space)
    guessing(none)

    asked = []

    def told_of(patches, _transport, _asked, _start=None, given=None):
        asked.append((patches.kept.any(), given))
        if (patches.number < 0).all():
            return Guess(np.zeros((len(patches.area), 3)))
        if patches.kept.any():
            return Guess(np.tile(7.0 * patches.kept[:, None], (1, 3)), 0.3, 0.1, 4.0, 0.06, 0.25, True)
        return (
            none
            if gain is None
            else Guess(np.full((len(patches.area), 3), 2.0), 0.3, 0.1, gain, 0.06, 0.25, True, space=space)
        )

    monkeypatch.setattr(unseen_guess, "explain", lambda _, *given: told_of(*given))
    monkeypatch.setattr(unseen_guess, "with_patches", lambda _, patches, *__: evenly(len(patches.area)))
    mesh, extracted = floor_and_ceiling, Extracted(Emitters.none(), Undecided.none())
    before, unknown = np.array([-1, -1, 5, 5]), np.full(4, np.inf)
    told = unseen_guess.with_guess(mesh, [], extracted, {}, NOTHING, unknown, before)
    np.testing.assert_array_equal(told.emitters.triangle, [2, 3])
    np.testing.assert_array_equal(told.emitters.radiance, radiance)
    assert told.emitters.guessed.all()
    assert {given for kept, given in asked if kept} == {space}, "it pays for the new search"
    rejected = np.where(before >= 0, 0, np.inf)
    nothing = unseen_guess.with_guess(mesh, [], extracted, {}, NOTHING, rejected, before).emitters
    assert len(nothing.triangle) == 0  # a person rejected it


@pytest.mark.parametrize(
    ("gains", "radiance"),
    [((400.0, 300.0, None), 7), ((400.0, 300.0, 200.0), 7), ((400.0, 200.0, 300.0), 9), ((400.0, None), 2)],
    ids=["not determined", "gains less", "gains more", "never determined"],
)
def test_cells_are_halved_as_long_as_a_guess_is_determined(guessing, floor_and_ceiling, monkeypatch, gains, radiance):
    """That of large cells gains most, but shines beside the lamp; of smaller ones the best is taken."""
    found = Guess(np.full((1, 3), 2.0), 0.3, 0.6, 400.0, 0.06, 0.25, True)
    guessing(found)
    sides = []
    none = Guess(np.zeros((1, 3)))
    made = zip((2.0, 7.0, 9.0), gains, strict=False)
    guesses = iter(
        [none if gain is None else replace(found, radiance=np.full((1, 3), k), gain=gain) for k, gain in made]
    )
    monkeypatch.setattr(unseen_guess, "explain", lambda _, patches, *__: sides.append(patches.side) or next(guesses))
    extracted = Extracted(Emitters.none(), Undecided.none())
    told = unseen_guess.with_guess(floor_and_ceiling, [], extracted, {}, NOTHING, np.full(4, np.inf))
    assert sides == [100.0, 50.0, 25.0][: len(gains)]
    np.testing.assert_array_equal(told.emitters.radiance, radiance)


@pytest.mark.parametrize(
    ("radiance", "power", "stays"),
    [(5.0, 9.0, False), (5.0, 2.0, True), (0.6, 0.2, False), (0.6, 0.02, True)],
    ids=["lit", "too bright", "dark but lit", "dark and not lit"],
)
def test_what_guessed_light_explains_is_no_emitter(guessing, radiance, power, stays):
    """The floor seems to emit; white surface there would send out 1, and 1 more for each unit of the guess."""
    triangles = np.arange(2, dtype=np.int32)
    ones, floor = np.ones(2, np.float32), np.zeros(2, np.int32)
    seems = Emitters(
        triangles, np.full((2, 3), radiance, np.float32), 32 * ones, floor, floor, ones, 0 * ones, np.zeros(2, bool)
    )
    doubtful = Undecided(triangles, floor, *(ones[:1] for _ in range(3)))
    guess = Guess(np.full((1, 3), power), 0.3, 0.6, 400.0, 0.06, 0.25, True)
    found = guessing(guess, extracted=Extracted(seems, doubtful), radiance=radiance).emitters
    assert np.isin(triangles, found.triangle).all() == stays
    assert found.guessed.sum() == 2


@pytest.mark.parametrize(
    ("radiance", "price", "stays"),
    [(0.6, 5, False), (5.0, 5, True), (0.6, 50, True)],
    ids=["lit", "too bright", "even"],
)
def test_what_seen_light_explains_is_no_emitter(guessing, radiance, price, stays):
    """The floor seems to emit under the traced light; white surface there would send out 1 under what views show.

    Emission explains it better by 29, by its brightness if that is more than the price.
    """
    triangles, floor, ones = np.arange(2, dtype=np.int32), np.zeros(2, np.int32), np.ones(2, np.float32)
    level = np.full((2, 3), radiance, np.float32)
    seems = Emitters(triangles, level, ones, floor, floor, ones, 0 * ones, np.zeros(2, bool))
    doubtful = Undecided(triangles, floor, *np.array([[30], [1], [price]], np.float32))
    told = guessing(Guess(np.zeros((1, 3))), is_explained=True, extracted=Extracted(seems, doubtful), radiance=radiance)
    assert len(told.emitters.triangle) == 2 * stays
    assert len(told.emitters.undecided.triangle) == 0
    assert any("light is missing: 64.00 m2" in warning for warning in told.warnings) == (not stays)


def test_an_emitter_that_stays_is_not_guessed_once_more(guessing, floor_and_ceiling):
    """A doubtful emitter of the floor and one triangle of the panel; light is guessed on the panel."""
    panel = len(floor_and_ceiling.triangles) - 1
    triangles, ones, number = np.array([0, 1, panel], np.int32), np.ones(3, np.float32), np.zeros(3, np.int32)
    seems = Emitters(
        triangles, np.full((3, 3), 5, np.float32), 32 * ones, number, number, ones, 0 * ones, np.zeros(3, bool)
    )
    guess = Guess(np.full((1, 3), 2.0), 0.3, 0.6, 400.0, 0.06, 0.25, True)
    doubtful = Undecided(triangles, number, *(ones[:1] for _ in range(3)))
    found = guessing(guess, extracted=Extracted(seems, doubtful)).emitters
    np.testing.assert_array_equal(found.triangle, [0, 1, panel - 1, panel])
    np.testing.assert_array_equal(found.guessed, [False, False, True, False])


def test_a_guess_on_a_doubtful_emitter_adds_nothing(guessing, floor_and_ceiling):
    """The panel is a doubtful emitter, and the guess on it does not light it."""
    triangles, ones, number = np.array([2, 3], np.int32), np.ones(2, np.float32), np.zeros(2, np.int32)
    seems = Emitters.plain(floor_and_ceiling, triangles, np.full((2, 3), 5.0), number)
    guess = Guess(np.full((1, 3), 2.0), 0.3, 0.6, 400.0, 0.06, 0.25, True)
    told = guessing(guess, extracted=Extracted(seems, Undecided(triangles, number, *(ones[:1] for _ in range(3)))))
    np.testing.assert_array_equal(told.emitters.triangle, triangles)
    assert not told.emitters.guessed.any()
    assert told.warnings == ()


@pytest.mark.parametrize("first", [2, 4])
def test_numbers_of_guessed_emitters_have_no_gap(first):
    """Light is guessed on two panels, of which one is an emitter already."""
    panels = (scenes.emitter_quad((k, k + 1), 2.0, (0, 1)) for k in (0, 2))
    mesh = scenes.joined(scenes.floor(), *panels)
    found = Emitters.plain(mesh, np.array([first, first + 1]), np.full((2, 3), 5.0), np.zeros(2, int))
    patches = all_patches(mesh, np.arange(6) >= 2, 1.0)
    guess = Guess(1.0 + np.tile(np.arange(len(patches.area))[:, None], 3), determined=True)
    together = unseen_guess._added(mesh, found, patches, guess)
    np.testing.assert_array_equal(together.triangle, [2, 3, 4, 5])
    np.testing.assert_array_equal(np.unique(together.emitter), np.arange(together.emitter.max() + 1))
    assert len(emitter_facts(together, mesh)) == together.emitter.max() + 1


def test_a_small_emitter_lights_what_is_below_it(backend):
    """A spot of 2 cm, 2 m above the floor, which one ray of 30,000 meets by chance."""
    mesh = scenes.joined(scenes.floor(), scenes.emitter_quad((-0.01, 0.01), 2.0, (-0.01, 0.01)))
    triangle, floor = np.array([2, 3], np.int32), np.zeros(2, np.int32)
    ones = np.ones(2, np.float32)
    radiance = np.full((2, 3), 1000, np.float32)
    spot = Emitters(triangle, radiance, mesh.areas[2:4].astype(np.float32), floor, floor, ones, ones, np.zeros(2, bool))
    point = np.zeros((1, 3), np.float32)
    cache = cache_of(point, np.float32([[0, 1, 0]]), 0.0)
    own = Lights(mesh, np.zeros(4, bool), cache, spot, constant([0, 0, 0]))
    known, outside = own.arriving(point, np.float32([[0, 1, 0]]), 256)
    np.testing.assert_allclose(known, 1000 * 0.02**2 / (np.pi * 2.0**2), rtol=0.01)
    assert outside == 0
    # a large one is met in both ways, and counted once
    near = np.float32([[0, 1.99, 0]])
    known, _ = own.arriving(near, np.float32([[0, 1, 0]]), 4096)
    np.testing.assert_allclose(known, 1000 * 0.554, rtol=0.05)
    # neither way finds light where it shines to the other side
    up = replace(spot, sides=np.full(2, BACK, np.int8))
    known, _ = Lights(mesh, np.zeros(4, bool), cache, up, constant([0, 0, 0])).arriving(
        near, np.float32([[0, 1, 0]]), 256
    )
    np.testing.assert_array_equal(known, 0)


def test_a_record_beside_a_lamp_is_no_brighter_than_surface(backend):
    """The lamp's light is counted once, and not as much more as its record holds other surface."""
    mesh = scenes.joined(scenes.floor(), scenes.emitter_quad((-0.5, 0.5), 2.0, (-0.5, 0.5)))
    point, up = np.zeros((1, 3), np.float32), np.float32([[0, 1, 0]])
    ceiling = np.float32([[x, 2.0, z] for x in (-0.3, 0.3) for z in (-0.3, 0.3)])
    cache = cache_of(ceiling, np.tile(np.float32([0, -1, 0]), (4, 1)), 500.0)
    given = [
        Lights(mesh, np.zeros(4, bool), cache, Emitters.none(), constant([0, 0, 0]), brightest).arriving(point, up, 256)
        for brightest in (np.inf, 500.0, 5.0)
    ]
    np.testing.assert_array_equal(given[0][0], given[1][0])
    np.testing.assert_allclose(given[2][0], given[0][0] / 100, rtol=1e-5)


def test_what_may_be_lit_by_missing_light_is_undecided(guessing):
    triangles, floor, ones = np.arange(2, dtype=np.int32), np.zeros(2, np.int32), np.ones(2, np.float32)
    seems = Emitters(triangles, np.full((2, 3), 5, np.float32), ones, floor, floor, ones, ones, np.zeros(2, bool))
    doubtful = Undecided(triangles, floor, *(ones[:1] for _ in range(3)))
    told = guessing(Guess(np.zeros((1, 3)), before=0.4), extracted=Extracted(seems, doubtful)).emitters
    assert len(told.triangle) == 0
    np.testing.assert_array_equal(told.undecided.triangle, triangles)
    sound = guessing(Guess(np.zeros((1, 3))), is_explained=True, extracted=Extracted(seems, doubtful)).emitters
    assert len(sound.triangle) == 2
    white = guessing(Guess(np.zeros((1, 3)), before=0.05), extracted=Extracted(seems, doubtful)).emitters
    assert len(white.triangle) == 2, "its light is even: the room is whiter than others, and no light is missing"
    unknown = guessing(Guess(np.zeros((1, 3))), extracted=Extracted(seems, doubtful)).emitters
    assert len(unknown.triangle) == 0, "too few blocks tell whether it is even"


@pytest.mark.parametrize(
    ("power", "is_explained", "emits", "undecided", "warned"),
    [
        (2.0, True, [0], [], True),
        (0.01, True, [0], [1], False),
        (0.01, False, [0], [1], True),
        (None, True, [0], [1], False),
        (None, False, [], [0, 1], True),
    ],
    ids=["lit by a guess", "not lit by it", "not lit by it, and light is missing", "explained", "light is missing"],
)
def test_what_has_no_edge_does_not_emit(guessing, monkeypatch, power, is_explained, emits, undecided, warned):
    """Two doubtful emitters, brighter than white under any guess; the second one fades."""
    monkeypatch.setattr(unseen_guess, "without_edge", lambda *_: np.array([1]))
    triangles, ones, both = np.arange(2, dtype=np.int32), np.ones(2, np.float32), np.arange(2, dtype=np.int32)
    seems = Emitters(triangles, np.full((2, 3), 5, np.float32), ones, both, both, ones, 0 * ones, np.zeros(2, bool))
    costs = np.array([3, 4], np.float32)
    nothing = Guess(np.zeros((1, 3)), before=0.4)
    guess = nothing if power is None else Guess(np.full((1, 3), power), 0.3, 0.6, 400.0, 0.06, 0.25, True)
    extracted = Extracted(seems, Undecided(triangles, both, *[costs] * 3))
    told = guessing(guess, is_explained=is_explained, extracted=extracted)
    found = told.emitters
    np.testing.assert_array_equal(found.triangle[~found.guessed], emits)
    own = found.undecided
    assert len(own.price) == len(undecided)
    assert dict(zip(own.triangle.tolist(), own.price[own.region].tolist(), strict=True)) == {
        k: 3 + k for k in undecided
    }
    said = any("cannot explain the photographs" in warning for warning in told.warnings)
    assert said == warned
    assert found.guessed.any() == (warned and power is not None)


def test_light_that_nothing_explains_where_nothing_is_hidden(backend, np_rng):
    """Two views show all of a closed box, brighter to one side; no triangle is left that could emit unseen."""
    mesh = scenes.box((-2, 0, -2), (2, 2, 2))
    triangle = np_rng.integers(0, 12, 6000)
    share = np_rng.dirichlet((1, 1, 1), 6000)
    place = (mesh.corners[triangle] * share[..., None]).sum(axis=1).astype(np.float32)
    normal = mesh.normals[triangle]
    normal = np.float32(normal * np.sign(((np.array([0, 1, 0]) - place) * normal).sum(axis=1))[:, None])
    samples = scenes.samples_of(
        place,
        triangle,
        normal=normal,
        footprint=np.full(len(place), 0.03, np.float32),
        views=("a", "b"),
        shapes=[(1, 3000)] * 2,
    )
    radiance = np.repeat(0.02 * np.exp(place[:, :1]), 3, axis=1).astype(np.float32)
    shading = np.zeros((len(place), SHADING_OUTPUTS, 3), np.float32)
    shards = scenes.observed([samples], [shading], [(radiance, np.ones(len(place), np.float32))])
    cache = cache_of(place, normal, 0.0) | {"radiance": cache_of(place, normal, 0.0)["radiance"] + 0.02}
    found = unseen_guess.with_guess(
        mesh, shards, Extracted(Emitters.none(), Undecided.none()), cache, NOTHING, np.full(12, np.inf)
    )
    assert len(found.emitters.triangle) == 0
    assert found.figures["guess"]["patches"] == 0
    assert any("cannot explain the photographs" in warning for warning in found.warnings)


def test_regions_of_some_triangles_keep_their_costs():
    three = np.arange(3, dtype=np.float32)
    regions = Undecided(
        np.array([4, 5, 6, 7], np.int32), np.array([0, 1, 2, 2], np.int32), three, three + 10, three + 20
    )
    some = regions.of(np.array([7, 5, 9]))
    np.testing.assert_array_equal(some.triangle, [5, 7])
    np.testing.assert_array_equal(some.region, [0, 1])
    np.testing.assert_array_equal(some.reflects, [1, 2])
    np.testing.assert_array_equal(some.price, [21, 22])
