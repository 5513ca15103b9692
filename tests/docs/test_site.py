"""The site: every page is built, every link and every name in the API leads somewhere."""

import os
import re
import subprocess
import sys

import pytest

from fipt.registry import SECTIONS, VERBS
from tests.docs.samples import ROOT

MOST_TERMS = 60


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    pages = {path.name: path.read_text(encoding="utf-8") for path in (tmp_path / "site").rglob("*.html")}
    assert all(f"fipt {verb}" in pages["cli.html"] for verb in VERBS)
    assert all(f"<code>{section}</code>" in pages["configuration.html"] for section in SECTIONS)
    assert "fipt.scene.cameras.Camera" in pages["scene.html"]


def test_every_stage_has_a_page() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "docs" / "stages").glob("*.md"))
    hand = {"run", "init", "view", "doctor"}
    assert not [verb for verb in VERBS if verb not in hand and f"`{verb}`" not in text and f"fipt {verb}" not in text]


def test_the_glossary_is_short_and_says_a_word_once() -> None:
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    terms = [row for row in re.findall(r"^\| ([^|]+) \|", text, re.M) if row != "term"]
    assert len(terms) == len(set(terms)) <= MOST_TERMS
