"""Emitters no brighter than paint: as bright where the room's light is weak as where it is strong."""

import numpy as np
import pytest

from fipt.stages.emitters.texture import FEWEST, TextureOdds, deviation
from tests.unit.stages.emitters.test_regions import LEVELS, WIDTH, Seen

TILE = 0.2
"""Side of a tile of the wall, metres."""


class Tiled(Seen):
    """A wall of tiles of many greys under light from one side; shading is off by a slope in each tile."""

    def __init__(self, rng, heavy=False):
        super().__init__(rng, pixels=9000)
        tile = (np.floor(self.place[:, 0] / TILE) * 100 + np.floor(self.place[:, 1] / TILE)).astype(int)
        grey = rng.uniform(0.2, 0.5, 2000)
        slope = 0.1 * (np.clip(rng.standard_cauchy(2000), -6, 6) if heavy else rng.standard_normal(2000))
        light = 0.3 * np.exp(2.5 * self.place[:, 0] / WIDTH)
        inside = (self.place[:, 0] / TILE) % 1 - 0.5
        self.image[:] = (grey[tile] * light)[:, None]
        self.shading[:, : 1 + LEVELS] = (light * np.exp(2 * slope[tile] * inside))[:, None, None]
        self.light = light


def test_an_emitter_dimmer_than_white_is_found_by_its_evenness(np_rng):
    wall = Tiled(np_rng)
    wall.image[wall.panel] = 0.6
    assert (wall.light[wall.panel] > 0.6).all()
    assert wall.overlap(wall.found(noise=0.01)) > 0.9


def test_paint_of_one_grey_follows_the_light_and_is_none(np_rng):
    wall = Tiled(np_rng)
    wall.image[wall.panel] = 0.6 * wall.light[wall.panel, None]
    assert len(wall.found(noise=0.01).triangle) == 0


def test_where_shading_is_often_wrong_evenness_tells_little(np_rng):
    wall = Tiled(np_rng, heavy=True)
    wall.image[wall.panel] = 0.6
    assert len(wall.found(noise=0.01).triangle) == 0


def test_few_regions_tell_nothing(np_rng):
    """A wall of one grey: nothing to compare the panel with."""
    wall = Seen(np_rng, pixels=9000)
    light = 0.3 * np.exp(2.5 * wall.place[:, 0] / WIDTH)[:, None]
    wall.image[:], wall.shading[:, : 1 + LEVELS] = 0.4 * light, light[:, None]
    wall.image[wall.panel] = 0.6
    assert len(wall.found(noise=0.01).triangle) == 0


def test_odds_of_an_exponential_are_its_tail(np_rng):
    x = np.where(np_rng.random(20_000) < 0.3, np_rng.exponential(0.2, 20_000), -1.0)
    odds = TextureOdds.of(x)
    assert odds.shape < 0.05
    np.testing.assert_allclose(odds(np.array([-1.0, 0.6])), [0, 3 - np.log(0.3)], rtol=0.1)


def test_a_heavy_tail_tells_less(np_rng):
    light, heavy = np_rng.exponential(0.2, 5000), 0.1 * (np_rng.random(5000) ** -0.5 - 1) / 0.5
    assert TextureOdds.of(heavy).shape == pytest.approx(0.5, abs=0.1)
    assert TextureOdds.of(heavy)(np.array([2.0]))[0] < 0.7 * TextureOdds.of(light)(np.array([2.0]))[0]


def test_deviation_needs_pieces(np_rng):
    values, region = np.log(np.tile([1.0, 1.2], FEWEST)), np.repeat([0, 1], [FEWEST - 1, FEWEST + 1])
    first, second = deviation(values, np.ones(2 * FEWEST), region, 2)
    assert first == 0
    assert second == pytest.approx(np.hypot(np.log(1.2) / 2, 0.01), rel=0.05)
