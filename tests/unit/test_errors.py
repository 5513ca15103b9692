"""FiptError: one line, with the remedy."""

import pickle

import pytest

from fipt.errors import FiptError


def test_text_is_message_and_remedy() -> None:
    error = FiptError("views must be named once, view_3 occurs twice", "rename one of them")
    assert str(error) == "views must be named once, view_3 occurs twice; rename one of them"
    assert str(FiptError("only this")) == "only this"


@pytest.mark.parametrize("part", ["message", "remedy"])
def test_text_is_always_one_line(part: str) -> None:
    parts = {"message": "first", "remedy": "last"} | {part: "two\n  lines\n"}
    assert "\n" not in str(FiptError(**parts))
    assert "two lines" in str(FiptError(**parts))


def test_survives_pickling_between_processes() -> None:
    copy = pickle.loads(pickle.dumps(FiptError("what", "how")))  # noqa: S301 - our own bytes
    assert (copy.message, copy.remedy, str(copy)) == ("what", "how", "what; how")
