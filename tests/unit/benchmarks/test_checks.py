"""The cost of checks is that of functions that exist: one that moved would count as nothing."""

from pathlib import Path

import pytest

import fipt
from benchmarks.checks import CHECKS

FILES = {f"/{path.as_posix()}": path for path in Path(fipt.__file__).parent.rglob("*.py")}


@pytest.mark.parametrize("place", [place for places in CHECKS.values() for place in places])
def test_the_functions_are_there(place):
    file, name = place.split(":")
    texts = [path.read_text(encoding="utf-8") for end, path in FILES.items() if end.endswith(f"/{file}")]
    assert any(f"def {name}(" in text for text in texts)
