"""Decisions of people as options of verbs."""

from types import SimpleNamespace
from typing import Any

import pytest

from fipt.config.decisions import SceneDecisions
from fipt.errors import FiptError


@pytest.mark.parametrize("count", [1000, 40_000])
def test_decisions_that_no_command_line_holds_are_refused(tmp_path, count):
    """Linux ends a job whose command has 128 KiB or more with "Argument list too long"."""
    path = tmp_path / "emitters_review.yaml"
    own = ", ".join(str(2 * k) for k in range(count))
    path.write_text(f"mesh_triangles: 100000\nemitters:\n- {{emitter: a, verdict: reject, triangles: '{own}'}}\n")
    setups: Any = SimpleNamespace(given={})
    decisions = SceneDecisions("room", setups, setups, path)
    for option in (decisions.emission, decisions.listing):
        if count == 1000:
            assert option()[0] == "--decisions"
        else:
            with pytest.raises(FiptError, match="decisions must be of at most 100000 characters"):
                option()
