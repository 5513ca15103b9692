"""Verbs derived from the inputs of a stage."""

import json
import subprocess
import sys
from dataclasses import dataclass, fields
from importlib import import_module
from inspect import signature
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any

import pytest

from fipt import registry
from fipt.cli import main as cli
from fipt.cli import verbs
from fipt.inputs import POSITIONAL, UNSPLIT
from tests.architecture.test_imports import HEAVY

STAGES = {name: verb for name, verb in registry.VERBS.items() if verb.section is not None}


@dataclass(frozen=True, kw_only=True)
class TryInputs:
    """Inputs of every type that an option can have."""

    folder: Annotated[Path, "A folder.", POSITIONAL]
    out: Annotated[Path, "A file to write."]
    held_out: Annotated[tuple[str, ...], "Names."] = ()
    shards: Annotated[tuple[Path, ...], "Folders."]
    setups: Annotated[tuple[str, ...] | None, "Names, or None."] = None
    reference: Annotated[tuple[str, ...], "Texts.", UNSPLIT] = ()
    quick: Annotated[bool, "Be quick."] = False
    count: Annotated[int | None, "A number."] = None
    mesh: Annotated[Path | None, "A file, perhaps."] = None


@pytest.fixture
def called(monkeypatch):
    """What a stage of the section cache was called with, when the verb ``try`` was."""
    seen = []

    def run(inputs: TryInputs, settings: Any) -> dict[str, Any]:
        """Try something.

        This is a second paragraph.

        Raises
        ------
        FiptError
            Never.
        """
        seen.append((inputs, settings))
        return {"tried": 3}

    monkeypatch.setitem(sys.modules, "fipt.stages.try_", SimpleNamespace(run=run))
    table = {"try": registry.Verb("A verb of this test.", "fipt.stages.try_", "cache")}
    for user in (cli, verbs):
        monkeypatch.setattr(user, "VERBS", table)
    return seen


def test_options_become_fields(called):
    needed = ["in", "--out", "x.npz", "--shards", "a,b", "--shards", "c"]
    assert cli.main(["try", *needed]) == 0
    ((inputs, settings),) = called
    assert inputs == TryInputs(folder=Path("in"), out=Path("x.npz"), shards=(Path("a"), Path("b"), Path("c")))
    assert settings == registry.parse("cache", "{}")
    more = ["--held-out", "v1,v2", "--setups", "", "--quick", "--count", "4", "--mesh", "m.ply"]
    more += ["--reference", "night=a,b", "--reference", "day=c"]
    assert cli.main(["try", *needed, *more, "--settings", '{"resolution": 9}']) == 0
    inputs, settings = called[-1]
    assert (inputs.held_out, inputs.setups, inputs.quick, inputs.count) == (("v1", "v2"), (), True, 4)
    assert inputs.mesh == Path("m.ply")
    assert inputs.reference == ("night=a,b", "day=c")
    assert settings.resolution == 9


def test_figures_of_a_run(called, tmp_path):
    stats = tmp_path / "stats.json"
    needed = ["in", "--out", "x.npz", "--shards", "a"]
    assert cli.main(["try", *needed, "--stats", str(stats)]) == 0
    content = json.loads(stats.read_text())
    assert (content["stage"], content["tried"]) == ("cache", 3)
    assert content["wall_s"] >= 0


def test_wrong_options_are_one_line(called, capsys):
    assert cli.main(["try", "in", "--shards", "a"]) == 2
    assert "--out" in capsys.readouterr().err
    assert cli.main(["try", "in", "--out", "x", "--shards", "a", "--settings", '{"cells": 7}']) == 2
    assert "unknown key cache.cells" in capsys.readouterr().err
    assert called == []


def test_help_is_the_docstring_without_its_sections(called, capsys):
    assert cli.main(["try", "--help"]) == 0
    text = capsys.readouterr().out
    assert "Try something." in text
    assert "second paragraph" in text
    assert "Raises" not in text
    for part in ("--held-out", "A folder.", "Be quick.", "--settings", "--stats"):
        assert part in text


def test_a_field_without_help(monkeypatch):
    @dataclass(frozen=True)
    class Bare:
        out: Path

    def run(inputs: Bare, settings: Any) -> dict[str, Any]:
        return {}

    with pytest.raises(TypeError, match="the field out needs a help"):
        verbs.derived(registry.VERBS["bake"], run)


@pytest.mark.parametrize("name", STAGES)
def test_stages_have_one_shape(name):
    """A frozen dataclass of files with help, and ``run(inputs, settings)``."""
    verb = STAGES[name]
    assert verb.section in registry.SECTIONS
    parameters = signature(import_module(verb.module).run).parameters
    assert list(parameters) == ["inputs", "settings"]
    kind = parameters["inputs"].annotation
    assert kind.__dataclass_params__.frozen
    assert fields(kind)
    assert verbs.derived(verb, import_module(verb.module).run).__doc__
    assert parameters["settings"].annotation == registry.SECTIONS[verb.section].model.partition(":")[2]


def test_deriving_every_verb_loads_nothing_heavy():
    """So that usage errors and ``fipt VERB --help`` come at once."""
    code = (
        "import sys; from fipt.cli.verbs import VERBS, command_of\n"
        "for name in VERBS: command_of(name)\n"
        "print(*{name.split('.')[0] for name in sys.modules})"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) & HEAVY == set()
