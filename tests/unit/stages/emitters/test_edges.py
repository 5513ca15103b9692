"""Emitters whose rim has no edge: light on a wall, and what is no such thing."""

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS, SUB_POSITIONS
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import FootprintSamples
from fipt.stages.emitters.edges import without_edge

SIZE, WIDTH = 24, 0.03
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]
BLOCK = (abs(ROW - 11.5) < 4) & (abs(COLUMN - 11.5) < 4)
LIGHT = 4 * np.exp(-((ROW - 11.5) ** 2 + (COLUMN - 11.5) ** 2) / 200)


def wall(radiance: np.ndarray, depth: np.ndarray | float = 0.0, tilted: np.ndarray | bool = False) -> ObservedShard:
    """One view of a wall of which every pixel shows a triangle of its own; ``tilted`` pixels face upwards.

    Triangles are numbered from the last pixel to the first one.
    """
    count = SIZE * SIZE
    tilted = np.broadcast_to(tilted, ROW.shape).ravel()
    place = np.stack([COLUMN * WIDTH, ROW * WIDTH, np.broadcast_to(depth, ROW.shape)], axis=-1).reshape(-1, 3)
    samples = FootprintSamples(
        views=("view",),
        shapes=((SIZE, SIZE),),
        offsets=np.arange(count + 1),
        center=np.ones(count, np.uint8),
        position=place.astype(np.float32),
        normal=np.where(tilted[:, None], [0, 1, 0], [0, 0, 1]).astype(np.float32),
        triangle=np.arange(count, dtype=np.int32)[::-1],
        footprint=np.full(count, WIDTH, np.float32),
        weight=np.ones(count, np.float32),
        sub=np.zeros((count, SUB_POSITIONS, 3), np.float16),
        sub_triangle=np.zeros((count, SUB_POSITIONS), np.int32),
    )
    light = np.repeat(radiance.reshape(-1, 1), 3, axis=1).astype(np.float32)
    return ObservedShard(
        samples, np.zeros((count, SHADING_OUTPUTS, 3), np.float32), light, np.ones(count, np.float32), light[:, 0] < 0
    )


def found(shard: ObservedShard, emits: np.ndarray = BLOCK) -> np.ndarray:
    return without_edge([shard], np.where(emits, 0, -1).ravel()[::-1])


def test_light_that_fades_on_a_wall_is_no_emitter() -> None:
    np.testing.assert_array_equal(found(wall(LIGHT)), [0])


def test_a_screen_ends_at_an_edge() -> None:
    assert len(found(wall(np.where(BLOCK, 3.0, 1.0)))) == 0


def test_a_screen_whose_picture_grows_dark_on_one_side_emits() -> None:
    assert len(found(wall(np.where(BLOCK, 3.0, np.where((COLUMN < 8) & (abs(ROW - 11.5) < 4), 2.9, 1.0))))) == 0


@pytest.mark.parametrize("beyond", [{"depth": np.where(BLOCK, 0.0, -0.2)}, {"tilted": ~BLOCK}], ids=["step", "crease"])
def test_surface_that_does_not_go_on_is_no_border_of_light(beyond) -> None:
    assert len(found(wall(LIGHT, **beyond))) == 0


@pytest.mark.parametrize(
    "radiance",
    [
        np.where(BLOCK, 1.0, 3.0),
        np.where(BLOCK, 3.0, np.where((abs(ROW - 11.5) < 9) & (abs(COLUMN - 11.5) < 9), 1.5, 0.4)),
        np.where(BLOCK, 1.25, 1.0),
    ],
    ids=["darker than its wall", "in a frame before a dark wall", "a dim panel in a bright ceiling"],
)
def test_what_has_any_edge_emits(radiance) -> None:
    assert len(found(wall(radiance))) == 0


def test_a_wide_screen_whose_picture_grows_dark_below_emits() -> None:
    screen = (abs(ROW - 11.5) < 4) & (abs(COLUMN - 11.5) < 8)
    below = (ROW >= 12) & (abs(COLUMN - 11.5) < 8)
    assert len(found(wall(np.where(screen, 3.0, np.where(below, 2.9, 1.0))), screen)) == 0


def test_clipped_pixels_tell_no_missing_edge() -> None:
    shard = wall(np.ones(ROW.shape))
    assert len(found(shard)) == 1
    shard.clipped[:] = True
    assert len(found(shard)) == 0


def test_an_emitter_that_a_picture_cuts_is_told_by_what_is_seen_of_it() -> None:
    assert len(found(wall(np.where(ROW < 8, 3.0, 1.0)), ROW < 8)) == 0


def test_what_emits_beside_is_no_border() -> None:
    """Two halves of one panel, each by itself: between them there is no edge, around them there is."""
    panel = (abs(ROW - 11.5) < 8) & (abs(COLUMN - 11.5) < 4)
    emitter = np.where(panel, np.where(COLUMN < 12, 0, 1), -1).ravel()[::-1]
    assert len(without_edge([wall(np.where(panel, 3.0, 1.0))], emitter)) == 0


def test_what_shows_little_of_its_rim_on_one_surface_emits() -> None:
    """Light that fades, but three of its four sides end at a step of depth."""
    assert len(found(wall(LIGHT, depth=np.where((abs(ROW - 11.5) < 4) & (COLUMN < 16), 0.0, -0.2)))) == 0


def test_few_pixels_tell_nothing() -> None:
    assert len(found(wall(LIGHT), (ROW == 12) & (COLUMN == 12))) == 0


def test_pixels_that_count_for_nothing_tell_no_missing_edge() -> None:
    shard = wall(LIGHT)
    shard.weight[~BLOCK.ravel()] = 0
    assert len(found(shard)) == 0


def test_no_emitter_is_none() -> None:
    assert len(without_edge([wall(LIGHT)], np.full(SIZE * SIZE, -1))) == 0
