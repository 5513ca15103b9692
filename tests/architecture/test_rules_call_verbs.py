"""Every rule's command line fits the inputs of its verb."""

import re
from dataclasses import MISSING, fields
from importlib import import_module
from inspect import signature
from pathlib import Path

import pytest

import fipt
from fipt.inputs import POSITIONAL
from fipt.registry import VERBS

RULES = Path(fipt.__file__).parent / "workflow" / "rules"
BY_HAND = {"check-capture", "photograph-images"}
"""Stages that no rule calls: people do."""


def commands() -> list[tuple[str, str, str]]:
    """Rule, verb and the text of its command line with that of the params, which may hold options."""
    found = []
    for path in sorted(RULES.glob("*.smk")):
        for rule, body in re.findall(r"^rule (\w+):\n(.*?)(?=^\S|\Z)", path.read_text(), re.MULTILINE | re.DOTALL):
            called = re.search(r'"fipt ([\w-]+)', body)
            if called:
                found.append((rule, called[1], body))
    return found


def test_every_stage_is_called_by_a_rule() -> None:
    stages = {name for name, verb in VERBS.items() if verb.section is not None}
    assert {verb for _, verb, _ in commands()} == stages - BY_HAND


@pytest.mark.parametrize(("rule", "verb", "body"), commands(), ids=[rule for rule, *_ in commands()])
def test_options_are_fields(rule: str, verb: str, body: str) -> None:
    inputs = fields(signature(import_module(VERBS[verb].module).run).parameters["inputs"].annotation)
    options = {"--" + field.name.replace("_", "-") for field in inputs if POSITIONAL not in field.type.__metadata__}
    given = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", body))
    assert given <= options | {"--settings", "--stats"}
    assert {"--settings", "--stats"} <= given
    needed = {
        "--" + field.name.replace("_", "-")
        for field in inputs
        if field.default is MISSING and POSITIONAL not in field.type.__metadata__
    }
    elsewhere = {"--source", "--format"} if verb == "import" else set()  # params.source: what is imported
    assert needed <= given | elsewhere


@pytest.mark.parametrize(("rule", "verb", "body"), commands(), ids=[rule for rule, *_ in commands()])
def test_rules_that_trace_rays_state_a_gpu_and_threads(rule: str, verb: str, body: str) -> None:
    if VERBS[verb].rays:
        assert "        gpu=GPUS,\n" in body
        assert "    threads: THREADS\n" in body


def test_a_model_is_made_again_when_models_have_another_version() -> None:
    """Whichever rule wrote it: it holds the fit's version, and is refused with another."""
    writers = {
        rule: body for rule, _, body in commands() if re.search(r'^ +model="[^"]*model\.safetensors"', body, re.M)
    }
    assert {"fit", "irradiance", "inverse_trace"} <= set(writers)
    assert [rule for rule, body in writers.items() if 'VERSIONS["fit"]' not in body] == []
