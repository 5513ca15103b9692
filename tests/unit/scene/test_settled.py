"""How far the loop has come, on disk."""

import pytest

from fipt.errors import FiptError
from fipt.scene.settled import (
    RoundState,
    ShadingChange,
    read_change,
    read_state,
    write_change,
    write_state,
)


def test_every_shard_says_the_same_change(tmp_path):
    change = ShadingChange(0.1, 0.2, 0.1, 400)
    for name in "ab":
        (tmp_path / name).mkdir()
        write_change(tmp_path / name, change)
    (tmp_path / "baked").mkdir()
    assert read_change([tmp_path / name for name in "ab"]) == change
    assert read_change([tmp_path / "baked"]) is None
    assert read_change([]) is None
    with pytest.raises(FiptError, match="is of another refinement than"):
        read_change([tmp_path / "a", tmp_path / "baked"])


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
