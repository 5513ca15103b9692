"""Pieces that have the shape of an emitter emit as it does, unless pixels say otherwise."""

from dataclasses import replace

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.review import ReviewDecisions
from fipt.stages.emitters.completion import Seen
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.emitter_copies import copied, copies_in_words, with_copies
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


def shards(light: float, share: float = 0.5, wall: float = 0.0, clipped: bool = False):
    """Four pixels of which the copy has a share, and a wall (triangle 6) the rest."""
    triangle, weight = np.tile([2, 6, 3, 6], 2), np.tile([share, 1 - share], 4)
    samples = scenes.samples_of(np.zeros((8, 3)), triangle, weight, np.full(4, 2))
    shading = np.zeros((8, SHADING_OUTPUTS, 3), np.float16)
    image = np.full((4, 3), light * share + wall * (1 - share), np.float32)
    full = [np.full(4, True)] if clipped else None
    return scenes.observed([samples], [shading], [(image, np.ones(4, np.float32))], full)


def shown(mesh: Mesh, alone=(), wall: float = np.nan) -> Seen:
    """What pixels show alone, and a wall's radiance."""
    count = len(mesh.triangles)
    radiance = np.where(np.arange(count)[:, None] == 6, wall, np.full((count, 3), np.nan))
    return Seen(np.isin(np.arange(count), alone), np.zeros((count, 2), bool), radiance)


def added(mesh: Mesh, seen=(), certain=True, guess=True, alone=(), wall=np.nan, decisions=None) -> Emitters:
    found = Emitters.plain(mesh, np.array([0, 1]), np.tile(RADIANCE, (2, 1)), np.zeros(2))
    decided = Decided.of(decisions or ReviewDecisions(), len(mesh.triangles))
    return with_copies(
        mesh, seen, found, np.array([] if certain else [0, 1], int), shown(mesh, alone, wall), decided, guess
    )


def test_an_unseen_copy_is_guessed_and_other_sizes_and_turned_ones_are_not(mesh):
    emitters = added(mesh)
    assert emitters.triangle.tolist() == [0, 1, 2, 3]
    assert emitters.emitter.tolist() == [0, 0, 1, 1]
    assert emitters.guessed.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(emitters.radiance, np.tile(RADIANCE, (4, 1)))
    assert (emitters.confidence[2:] < 0.5).all()
    np.testing.assert_array_equal(copied(mesh, emitters), emitters.guessed)
    (words,) = copies_in_words(mesh, emitters, np.array([2, 3]))
    assert "no view shows 1 of what" in words
    assert "50 % of the power" in words
    assert copies_in_words(mesh, emitters, np.array([], int)) == ()


def test_what_is_guessed_of_the_piece_of_an_emitter_is_no_copy_of_it(mesh):
    """In a scan walls, ceiling and window are one piece."""
    emitters = Emitters.plain(mesh, np.array([4, 5]), np.tile(RADIANCE, (2, 1)), np.zeros(2))
    assert not copied(mesh, replace(emitters, guessed=np.array([False, True]))).any()


@pytest.mark.parametrize(("light", "emits"), [(7.0, True), (1.0, False)])
def test_pixels_tell_whether_a_copy_shines(mesh, light, emits):
    emitters = added(mesh, shards(light), guess=False)
    assert emitters.triangle.tolist() == ([0, 1, 2, 3] if emits else [0, 1])
    assert not emitters.guessed.any(), "a view shows it"
    assert emitters.views.tolist()[2:] == [1, 1][: 2 * emits]


def test_what_stands_behind_a_dark_copy_does_not_make_it_shine(mesh):
    assert added(mesh, shards(0.5, wall=6.0), wall=6.0).triangle.tolist() == [0, 1]
    assert added(mesh, shards(7.0, wall=6.0), wall=6.0).triangle.tolist() == [0, 1, 2, 3]


def test_clipped_pixels_alone_tell_nothing(mesh):
    assert added(mesh, shards(7.0, clipped=True)).triangle.tolist() == [0, 1]


def test_unseen_copies_of_a_shape_that_is_mostly_dark_are_not_guessed(mesh):
    spots = scenes.joined(mesh, *(scenes.quad((x, 2.9, 2), *SPOT) for x in (1, 2)))
    one = added(spots, alone=[8, 9])
    assert one.triangle.tolist() == [0, 1], "one emits, one is dark"
    assert added(spots).triangle.tolist() == [0, 1, 2, 3, 8, 9, 10, 11]


def test_a_sliver_of_a_pixel_tells_nothing(mesh):
    assert added(mesh, shards(0.0, share=0.1)).guessed.any()


@pytest.mark.parametrize(
    "given",
    [
        {"certain": False},
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
    seen, certain, decided = shown(spots), np.zeros(0, int), Decided.of(ReviewDecisions(), 10)
    assert with_copies(spots, (), found, certain, seen, decided, True) is found
    alike = replace(found, radiance=np.tile(RADIANCE, (4, 1)))
    assert with_copies(spots, (), alike, certain, seen, decided, True).triangle.tolist() == [0, 1, 2, 3, 8, 9]
