"""The paths that the rules write out are those of the layout."""

import re
from pathlib import Path

import pytest

from fipt.config.layout import Layout

RULES = sorted((Path(__file__).resolve().parents[3] / "fipt" / "workflow" / "rules").glob("*.smk"))
KINDS = ("stats", "log", "benchmark")


def literals(text):
    """Paths of a rules file as patterns: the text in quotes, with the wildcards of f-strings as they are meant."""
    without_docs = re.sub(r'"""[\s\S]*?"""', "", text)
    for literal in re.findall(r'"(results/[^"]*)"', without_docs):
        yield literal.replace("{{", "{").replace("}}", "}")


def matches(literal, pattern):
    """Whether a literal is a pattern, whose wildcards may be filled in."""
    return re.fullmatch(re.sub(r"\\{\w+\\}", r"[^/]+", re.escape(pattern)), literal) is not None


PATTERNS = Layout.patterns()
USED = {literal for path in RULES for literal in literals(path.read_text())}


@pytest.mark.parametrize("literal", sorted(USED))
def test_every_path_of_the_rules_is_in_the_layout(literal):
    exact = [pattern for name, pattern in PATTERNS.items() if name not in KINDS]
    together = Layout.together(Path(literal).name)
    said = [pattern for pattern in (*exact, Layout().root, together) if literal == pattern]
    filled = [PATTERNS[kind] for kind in KINDS if matches(literal, PATTERNS[kind])]
    round_0 = [pattern for pattern in exact if literal == pattern.replace("{round}", "0")]
    assert said or filled or round_0, f"{literal} is not in fipt/config/layout.py"


@pytest.mark.parametrize("name", sorted(set(PATTERNS) - set(KINDS)))
def test_every_path_of_the_layout_is_written(name):
    """Each is in a rule, but for what functions of the configuration give the rules."""
    assert PATTERNS[name] in USED, f"no rule has {PATTERNS[name]}; remove it from fipt/config/layout.py"


def test_paths_of_a_scene():
    layout = Layout("room")
    assert layout.root == "results/room"
    assert layout.report == "results/room/report.html"
    assert layout.relit.format(setup="night", shard="val-000") == "results/room/relight/night.val-000.manifest.json"
