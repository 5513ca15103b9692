"""One name, one thing: words that the glossary replaced stay out of identifiers."""

import re
import tokenize
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
# Blender's script uses Blender's names.
SOURCES = sorted(set((REPOSITORY / "fipt").rglob("*.py")) - {REPOSITORY / "fipt/stages/export/blender_scene.py"})

RETIRED = {
    "lamp": "emitter",
    "picture": "image",
    "hit": "footprint sample (samples)",
    "background": "environment",
    "told": "the name of what is known",
    "silent": "the name of what is missing",
    "sight": "the name of what is seen, such as SurfaceInteraction",
    "sighting": "the name of what is seen",
    "matter": "the property that counts",
    "sure": "confidence",
    "pull": "the prior's name",
    "apart": "separate",
    "ballot": "votes",
    "look": "view, appearance (look_at and look_up may stay)",
    "standing": "viewpoints",
    "filmed": "setups_with_cameras",
    "shine": "emit",
    "colour": "color, as all libraries have it (prose is British)",
    "coloured": "colored",
}
"""Retired word -> what the field calls it; plurals and third persons as well."""
SINGULAR_STAYS = {"hit"}
"""Words of which only the plural is retired: a ray hits a surface, and `hit` says whether it does."""
FOREIGN = {"LOG_LEVEL_SILENT"}
"""Names of other libraries."""


def words(identifier: str) -> list[str]:
    """Words of a snake_case or CamelCase name, in lower case."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+", identifier)]


def retired(identifier: str) -> set[str]:
    """The retired words in a name."""
    if identifier in FOREIGN:
        return set()
    plain = re.sub(r"look_?(at|up)", "", identifier, flags=re.IGNORECASE)
    forms = {form for word in RETIRED for form in ({word, f"{word}s"} - (SINGULAR_STAYS & {word}))}
    return forms & set(words(plain))


@pytest.mark.parametrize(
    ("identifier", "expected"),
    [
        ("lamp_gain", {"lamp"}),
        ("EmitterLamps", {"lamps"}),
        ("_write_pictures", {"pictures"}),
        ("look_at", set()),
        ("LookAtCamera", set()),
        ("lookup", set()),
        ("new_look", {"look"}),
        ("hit", set()),
        ("hits", {"hits"}),
        ("measure", set()),
        ("HDRPicture", {"picture"}),
        ("clamp", set()),
    ],
)
def test_words_are_found(identifier: str, expected: set[str]) -> None:
    assert retired(identifier) == expected


def test_identifiers_use_the_words_of_the_field() -> None:
    guilty = {}
    for path in SOURCES:
        with tokenize.open(path) as file:
            names = {token.string for token in tokenize.generate_tokens(file.readline) if token.type == tokenize.NAME}
        if found := sorted(name for name in names if retired(name)):
            guilty[str(path.relative_to(REPOSITORY))] = found
    assert guilty == {}
