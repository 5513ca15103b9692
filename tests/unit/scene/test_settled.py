"""How far the loop has come, on disk."""

import pytest

from fipt.errors import FiptError
from fipt.scene.settled import (
    RoundState,
    ShadingChange,
    read_changes,
    read_state,
    together,
    write_change,
    write_state,
)


def test_changes_of_shards_go_together(tmp_path):
    few, many = ShadingChange(0.1, 0.2, 0.1, 100), ShadingChange(0.0, 0.1, 0.5, 300)
    for name, change in (("a", few), ("b", many)):
        (tmp_path / name).mkdir()
        write_change(tmp_path / name, change)
    (tmp_path / "baked").mkdir()
    read = read_changes([tmp_path / name for name in ("a", "b", "baked")])
    assert read == [few, many]
    both = together(read)
    assert both.change == pytest.approx(0.05)
    assert both.noise == pytest.approx((0.25 * 0.04 + 0.75 * 0.01) ** 0.5)
    assert (both.kept, both.samples) == (pytest.approx(0.4), 400)
    assert together([]) is None


def test_state_of_a_round(tmp_path):
    state = RoundState(2, 2, 0.03, 0.05, 0.01)
    write_state(tmp_path / "settled.json", state)
    assert read_state(tmp_path / "settled.json") == state
    assert read_state(None) is None
    assert not state.copied
    assert state.after() == RoundState(3, 2, 0.03, 0.05, 0.01)
    assert state.after().copied
    assert not RoundState(3).copied


@pytest.mark.parametrize("text", ["", "[]", '{"rounds": 2}'])
def test_a_damaged_state(tmp_path, text):
    (tmp_path / "settled.json").write_text(text)
    with pytest.raises(FiptError, match=r"settled\.json is damaged"):
        read_state(tmp_path / "settled.json")
    with pytest.raises(FiptError, match="is missing"):
        read_state(tmp_path / "other.json")
