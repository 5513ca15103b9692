"""Furnished rooms by a seed, as scene files."""

import pytest

from benchmarks.random_attic import write_attic
from benchmarks.random_bath import write_bath
from benchmarks.random_bedroom import write_bedroom
from benchmarks.random_cafe import write_cafe
from benchmarks.random_hall import write_hall
from benchmarks.random_library import write_library
from benchmarks.random_loft import write_loft
from benchmarks.random_room import write_room
from benchmarks.random_salon import write_salon
from fipt.synthetic.modelled import modelled
from fipt.synthetic.settings import SynthesizeSettings


@pytest.mark.parametrize(
    ("write", "texture", "emitters"),
    [
        (write_room, "floor.png", 6),  # window, three pendants, shade, screen
        (write_loft, "marble.png", 17),  # window, five spots, eight bulbs, shade, strip, fire
        (write_bedroom, "planks.png", 3),  # two bulbs in shades, a ball below the ceiling; sun and sky are outside
        (write_hall, "panel.png", 9),  # window, two tubes, four spots, strip, lantern
        (write_cafe, "bricks.png", 35),  # two panes, four deep lamps, two tubes, 24 fields of a menu, three bulbs
        (write_salon, "slabs.png", 7),  # skylight, two strips, television, three globes
        (write_bath, "mosaic.png", 20),  # nine panes, four sides of a mirror's rim, five spots, a strip of two faces
        (write_library, "bone.png", 28),  # window, screen, desk lamp, twelve candles, eight sconces, five flames
        (write_attic, "bricks.png", 20),  # three windows, the hallway's, beside the bed, on the desk, 14 fairy lights
    ],
)
def test_a_room_has_its_lamps_and_a_seed_tells_its_small_things(tmp_path, backend, write, texture, emitters):
    one, again, other = (write(tmp_path / name, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
    assert one.read_bytes() == again.read_bytes() != other.read_bytes()
    assert (one.parent / texture).read_bytes() != (other.parent / texture).read_bytes()
    room = modelled(one, SynthesizeSettings(width=32, height=24))
    assert len(room.emitters) == emitters
    assert len(room.parts) == one.read_text().count("<shape ")
