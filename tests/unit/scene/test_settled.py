"""How far the loop has come, on disk."""

import pytest

from fipt.errors import FiptError
from fipt.scene.settled import RoundState, read_state, write_state


def test_state_of_a_round(tmp_path):
    state = RoundState(2, 2, 0.03, 0.05, 0.01, kept=0.3)
    write_state(tmp_path / "settled.json", state)
    assert read_state(tmp_path / "settled.json") == state
    assert read_state(None) is None
    assert not state.copied
    assert state.after() == RoundState(3, 2, 0.03, 0.05, 0.01, kept=0.3)
    assert state.after().copied
    assert not RoundState(3).copied


@pytest.mark.parametrize("text", ["", "[]", '{"rounds": 2}'])
def test_a_damaged_state(tmp_path, text):
    (tmp_path / "settled.json").write_text(text)
    with pytest.raises(FiptError, match=r"settled\.json is damaged"):
        read_state(tmp_path / "settled.json")
    with pytest.raises(FiptError, match="is missing"):
        read_state(tmp_path / "other.json")
