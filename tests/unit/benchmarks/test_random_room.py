"""Furnished rooms by a seed, as scene files."""

from benchmarks.random_room import write_room
from fipt.synthetic.modelled import modelled
from fipt.synthetic.settings import SynthesizeSettings


def test_a_room_has_its_lamps_and_a_seed_tells_its_books(tmp_path, backend):
    one, again, other = (write_room(tmp_path / name, seed) for name, seed in (("a", 1), ("b", 1), ("c", 2)))
    assert one.read_bytes() == again.read_bytes() != other.read_bytes()
    assert (one.parent / "floor.png").read_bytes() != (other.parent / "floor.png").read_bytes()
    room = modelled(one, SynthesizeSettings(width=32, height=24))
    assert len(room.emitters) == 6  # window, three pendants, shade, screen
    assert len(room.parts) == one.read_text().count("<shape ")
