"""Pieces that have the shape of an emitter emit as it does, unless pixels say otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.review import ReviewDecisions
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.lamp_copies import copies_in_words, with_copies
from tests import scenes

RADIANCE = np.float32([12, 6, 3])
SPOT = ((0.05, 0, 0), (0, 0, 0.05))


@pytest.fixture
def mesh() -> Mesh:
    """Spots of a ceiling, two triangles each: one that emits, a copy, one half as wide again, and one on a wall."""
    wider = ((0.075, 0, 0), (0, 0, 0.05))
    places = ((1, 2.9, 1), (2, 2.9, 1), (3, 2.9, 1))
    spots = [scenes.quad(place, *sides) for place, sides in zip(places, (SPOT, SPOT, wider), strict=True)]
    return scenes.joined(*spots, scenes.quad((0, 1, 1), (0, 0.05, 0), (0, 0, 0.05)))


def shards(light: float, share: float = 0.5, pixels: int = 4):
    """Pixels of which the copy has a share; the rest of each is black."""
    samples = scenes.samples_of(np.zeros((pixels, 3)), np.tile([2, 3], pixels // 2), share)
    shading = np.zeros((pixels, SHADING_OUTPUTS, 3), np.float16)
    image = np.full((pixels, 3), light * share, np.float32)
    return scenes.observed([samples], [shading], [(image, np.ones(pixels, np.float32))])


def added(mesh: Mesh, seen=(), sure=True, guess=True, alone=(), decisions=None) -> Emitters:
    found = Emitters.plain(mesh, np.array([0, 1]), np.tile(RADIANCE, (2, 1)), np.zeros(2))
    told = np.isin(np.arange(len(mesh.triangles)), alone)
    decided = Decided.of(decisions or ReviewDecisions(), len(mesh.triangles))
    return with_copies(mesh, seen, found, np.full(2, sure), told, decided, guess)


def test_an_unseen_copy_is_guessed_and_other_sizes_and_turned_ones_are_not(mesh):
    emitters = added(mesh)
    assert emitters.triangle.tolist() == [0, 1, 2, 3]
    assert emitters.emitter.tolist() == [0, 0, 1, 1]
    assert emitters.guessed.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(emitters.radiance, np.tile(RADIANCE, (4, 1)))
    (words,) = copies_in_words(mesh, emitters)
    assert "1 pieces" in words
    assert "50 % of the power" in words


@pytest.mark.parametrize(("light", "shines"), [(7.0, True), (1.0, False)])
def test_pixels_tell_whether_a_copy_shines(mesh, light, shines):
    emitters = added(mesh, shards(light), guess=False)
    assert emitters.triangle.tolist() == ([0, 1, 2, 3] if shines else [0, 1])
    assert not emitters.guessed.any(), "a view shows it"
    assert emitters.views.tolist()[2:] == [1, 1][: 2 * shines]


def test_a_sliver_of_a_pixel_tells_nothing(mesh):
    assert added(mesh, shards(0.0, share=0.1)).guessed.any()


@pytest.mark.parametrize(
    "given",
    [
        {"sure": False},
        {"guess": False},
        {"alone": [2, 3]},
        {"decisions": ReviewDecisions(reject=["3"])},
    ],
)
def test_no_copy_is_guessed_where_something_speaks_against_it(mesh, given):
    assert added(mesh, **given).triangle.tolist() == [0, 1]


def test_emitters_of_one_shape_that_differ_are_no_set(mesh):
    spots = scenes.joined(mesh, scenes.quad((4, 2.9, 1), *SPOT))
    found = Emitters.plain(spots, np.array([0, 1, 8, 9]), RADIANCE * np.repeat([1.0, 3.0], 2)[:, None], [0, 0, 1, 1])
    nothing, decided = np.zeros(10, bool), Decided.of(ReviewDecisions(), 10)
    assert with_copies(spots, (), found, ~nothing[:4], nothing, decided, True) is found
    alike = replace(found, radiance=np.tile(RADIANCE, (4, 1)))
    assert with_copies(spots, (), alike, ~nothing[:4], nothing, decided, True).triangle.tolist() == [0, 1, 2, 3, 8, 9]
