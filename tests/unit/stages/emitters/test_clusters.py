"""Emitters that give more light than was found of them: what tells it, what does not, which of them are one cluster."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.scene.emitters import Emitters, Undecided
from fipt.scene.environment import NOTHING, constant
from fipt.scene.surface_blocks import Blocks
from fipt.stages.emitters.clusters import _clusters, _rims, beyond, with_what_they_light
from fipt.stages.emitters.extract import Extracted
from fipt.stages.emitters.unseen import Lights
from tests import scenes
from tests.unit.stages.emitters.test_unseen import cache_of

UP, LOW = np.float32([0, 1, 0]), 0.15
NONE = np.zeros(2, bool)


def room(rng, factors, noise=0.05, groups=30, per=20):
    """Blocks lit by an even light and by two lamps, of which each gives ``factors`` times what was found of it."""
    count = groups * per
    place, group = rng.uniform(0, 4, (count, 3)), np.repeat(np.arange(groups), per)
    at = np.array([[1.0, 1, 4], [3, 3, 4]])
    clusters = 0.3 / (((place[:, None] - at) ** 2).sum(axis=-1) + 0.1)
    rho = np.exp(np.log(0.4) + 0.5 * rng.standard_normal(groups)).clip(0.03, 0.85)
    light = LOW + clusters @ factors
    radiance = rho[group] * light * np.exp(noise * rng.standard_normal(count))
    normal = np.tile(UP, (count, 1, 1))
    blocks = Blocks(
        place[:, None].astype(np.float32), normal, np.tile(radiance[:, None], 3), np.zeros(count), group, group
    )
    return blocks, np.tile((LOW + clusters.sum(axis=1))[:, None], 3), np.tile(clusters[:, :, None], 3)


def test_a_lamp_that_gives_twice_its_light_is_found(np_rng):
    more = beyond(*room(np_rng, [2.0, 1.0]), np.ones(2), NONE)
    assert more[0] == pytest.approx(1, rel=0.15)
    assert more[1] == 0


@pytest.mark.parametrize("factors", [[1.0, 1.0], [0.5, 1.0], [1.02, 1.0]], ids=["right", "less", "hardly more"])
def test_lamps_that_give_no_more_are_left_alone(np_rng, factors):
    assert not beyond(*room(np_rng, factors), np.ones(2), NONE).any()


def test_a_lamp_the_size_of_which_is_sure_is_left_alone(np_rng):
    assert not beyond(*room(np_rng, [1.3, 1.0], noise=0.2), np.array([0.02, 1.0]), NONE).any()


def test_a_lamp_that_was_raised_stays_so_where_it_would_not_be_anew():
    """The gain is 4.2 nats: more than the price of a patch, and less than that and the odds against it."""
    doubt = room(np.random.default_rng(0), [1.2, 1.0], noise=0.2)
    assert not beyond(*doubt, np.ones(2), NONE).any()
    assert beyond(*doubt, np.ones(2), ~NONE)[0] == pytest.approx(0.2, abs=0.1)


def test_few_blocks_tell_nothing(np_rng):
    assert not beyond(*room(np_rng, [2.0, 1.0], groups=2, per=14), np.ones(2), NONE).any()
    assert not beyond(*room(np_rng, [2.0, 1.0], groups=60, per=1), np.ones(2), NONE).any()


def quad_above_a_floor(side=0.1):
    """A floor (triangles 0, 1), and a square lamp of radiance 200 a metre above it, that shines down."""
    half = side / 2
    mesh = scenes.joined(scenes.floor(), scenes.emitter_quad((-half, half), 1.0, (-half, half)))
    number = np.zeros(2, np.int32)
    return mesh, Emitters.plain(mesh, np.array([2, 3], np.int32), np.full((2, 3), 200.0), number)


def straight_below(x, z, side=0.1):
    """Irradiance over pi of the floor by that lamp."""
    distance2 = x**2 + z**2 + 1
    return 200.0 * side**2 / (np.pi * distance2**2)


@pytest.mark.parametrize("side", [0.1, 1.0, 2.0])
def test_light_that_comes_straight(backend, side):
    mesh, found = quad_above_a_floor(side)
    lights = Lights(mesh, np.zeros(4, bool), cache_of(np.float32([[9, 9, 9]]), UP[None], 0.0), found, NOTHING)
    place, up = np.float32([[0, 0, 0], [1, 0, 0.5]]), np.tile(UP, (2, 1))
    light = lights.straight(place, up, np.array([2, 3]), 1024)
    np.testing.assert_allclose(light[:, 0], lights.arriving(place, up, 4096)[0][:, 0], rtol=0.05)
    if side < 1:
        np.testing.assert_allclose(light[:, 0], straight_below(place[:, 0], place[:, 2]), rtol=0.05)
    assert not lights.straight(place, np.tile(UP, (2, 1)), np.array([0, 1]), 16).any()


@pytest.fixture
def lit_floor(backend, np_rng):
    """`with_what_they_light` of the quad, that lights the floor ``factor`` times as much as its surface does."""

    def run(factor, change=lambda extracted: extracted, accepted=False, back="none"):
        mesh, found = quad_above_a_floor()
        if back != "none":
            mesh = replace(mesh, triangles=np.concatenate([mesh.triangles, mesh.triangles[2:, ::-1]]))
            shines = np.arange(2, 6 if back == "shines" else 4, dtype=np.int32)
            found = Emitters.plain(mesh, shines, np.full((len(shines), 3), 200.0), np.zeros(len(shines), np.int32))
        place = np.float32(np.insert(np_rng.uniform(-1.5, 1.5, (8000, 2)), 1, 0, axis=1))
        triangle = np.where(place[:, 0] < place[:, 2], 0, 1)
        light = 0.3 + factor * straight_below(place[:, 0], place[:, 2])
        samples = scenes.samples_of(
            place, triangle, views=("a", "b"), shapes=[(1, 4000)] * 2, footprint=np.full(8000, 0.03, np.float32)
        )
        image = np.tile(0.5 * light[:, None], 3)
        shards = scenes.observed([samples], [np.zeros((8000, 1, 3))], [(image, np.ones(8000))])
        cache = cache_of(place, np.tile(UP, (8000, 1)), image)
        extracted, count = change(Extracted(found, Undecided.none())), len(mesh.triangles)
        return with_what_they_light(
            mesh, shards, extracted, cache, constant((0.3, 0.3, 0.3)), np.zeros(count, bool), np.full(count, accepted)
        )

    return run


def test_an_emitter_is_as_bright_as_what_it_lights(lit_floor):
    brighter, words = lit_floor(2.5)
    np.testing.assert_allclose(brighter.radiance, 200 * 2.5, rtol=0.15)
    np.testing.assert_allclose(brighter.raised, brighter.radiance[:, 0] / 200 - 1, rtol=1e-5)
    assert "the lamp near (0.00, 1.00, 0.00) lights its surroundings 2." in words[0]


def test_a_lamp_that_is_whole_stays_as_it_is(lit_floor):
    found, words = lit_floor(2.5, back="shines")
    assert (found.radiance == 200).all()
    assert not found.raised.any()
    assert words == ()


def test_a_lamp_that_is_a_part_of_a_closed_thing_may_lack_a_part(lit_floor):
    found, _ = lit_floor(2.5, back="dark")
    np.testing.assert_allclose(found.radiance, 200 * 2.5, rtol=0.15)


def with_radiance(radiance):
    """A change of the triangles' radiance."""
    return lambda extracted: replace(extracted, emitters=replace(extracted.emitters, radiance=radiance))


@pytest.mark.parametrize("radiance", [[400.0, 0.0], [0.0, 400.0]])
def test_an_emitter_of_which_a_triangle_is_black(lit_floor, radiance):
    """The other one is twice as bright, and so they light the floor nearly as two do."""
    black = np.float32(radiance)[:, None] * np.ones(3, np.float32)
    found, _ = lit_floor(2.5, with_radiance(black))
    np.testing.assert_allclose(found.radiance, 2.5 * black, rtol=0.15)
    np.testing.assert_array_equal(found.raised > 0, black[:, 0] > 0)


def in_doubt(extracted):
    """Both triangles of the quad are in doubt."""
    return replace(
        extracted, doubtful=Undecided(np.array([2, 3], np.int32), np.zeros(2, np.int32), *np.zeros((3, 1), np.float32))
    )


@pytest.mark.parametrize(
    ("factor", "change"),
    [
        (1.0, lambda extracted: extracted),
        (2.5, in_doubt),
        (2.5, lambda extracted: replace(extracted, emitters=replace(extracted.emitters, guessed=np.ones(2, bool)))),
        (2.5, with_radiance(np.zeros((2, 3)))),
        (2.5, lambda extracted: replace(extracted, emitters=Emitters.none())),
    ],
    ids=["right", "in doubt", "guessed", "dark", "none"],
)
def test_emitters_that_stay_as_they_are(lit_floor, factor, change):
    found, words = lit_floor(factor, change)
    _, given = quad_above_a_floor()
    np.testing.assert_array_equal(found.radiance, change(Extracted(given, Undecided.none())).emitters.radiance)
    assert not found.raised.any()
    assert words == ()


def test_lamps_near_each_other_are_one():
    side = 0.05
    quads = [scenes.emitter_quad((x, x + side), 1.0, (0, side)) for x in (0.0, 0.2, 3.0)]
    mesh = scenes.joined(*quads)
    found = Emitters.plain(
        mesh, np.arange(6, dtype=np.int32), np.full((6, 3), 5.0), np.repeat(np.arange(3), 2).astype(np.int32)
    )
    cluster = _clusters(mesh, found, 0.4)
    np.testing.assert_array_equal(cluster, [0, 0, 0, 0, 1, 1])  # the strongest first
    rim = np.sqrt(4 * np.pi) * 0.01 / side
    np.testing.assert_allclose(_rims(found, cluster, 0.01), [rim, rim], rtol=1e-4)
    assert (_rims(found, cluster, 1.0) == 1).all()


def test_what_a_person_accepted_has_the_radiance_that_views_show(lit_floor):
    found, words = lit_floor(2.5, accepted=True)
    np.testing.assert_array_equal(found.radiance, 200)
    assert words == ()


def test_emitters_on_the_same_place_are_one():
    mesh = scenes.joined(*[scenes.emitter_quad((0, 0.05), 1.0, (0, 0.05))] * 40)
    found = Emitters.plain(mesh, np.arange(80, dtype=np.int32), np.ones((80, 3)), np.repeat(np.arange(40), 2))
    assert not _clusters(mesh, found, 0.4).any()


def test_the_strongest_clusters_are_asked_about():
    quads = [scenes.emitter_quad((x, x + 0.05), 1.0, (0, 0.05)) for x in range(70)]
    radiance = np.repeat(np.arange(1.0, 71), 2)[:, None] * np.ones(3)
    mesh = scenes.joined(*quads)
    found = Emitters.plain(mesh, np.arange(140, dtype=np.int32), radiance, np.repeat(np.arange(70), 2))
    cluster = _clusters(mesh, found, 0.4)
    np.testing.assert_array_equal(cluster[::2], np.concatenate([np.full(6, -1), np.arange(63, -1, -1)]))
    assert _rims(found, cluster, 0.01).shape == (64,)
