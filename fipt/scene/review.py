"""emitters_review.yaml: the emitters that were found, and what a person decides about them.

The file is no input of any stage. The decisions in it, keyed by triangles, are parameters: emitters change their
numbers between rounds and runs, triangles do not. An entry about which something was decided keeps its triangles; the
others are written anew by every run.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, ValidationError, field_validator

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.yaml import read_yaml
from fipt.settings import Count, Settings
from fipt.validation import explain

FILE = "emitters_review.yaml"

Triangles = frozenset[int]

_RESERVED = re.compile(r"(?:lamp|emitter)[-_ ]?\d+|rest|outside|surface", re.IGNORECASE)
"""Names that the program gives itself."""
_LONGEST = 60
_MOST = 10_000_000
"""Triangles of an emitter: a set of so many takes a gigabyte."""
_RANGE = re.compile(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?")

_KEYS = ("mesh_triangles", "emitters")
_REMEDY = f"its keys are {', '.join(_KEYS)}; delete the file to have it written anew"
_RENAMED = "write emitters: for lamps: and in each entry emitter: emitter-N for lamp: lamp-N, or delete the file"

_HEAD = """\
# The emitters that were found. You decide, the next run takes it up; what you decide is kept, the rest is written anew.
#   verdict: auto     the photographs decide
#            accept   these triangles emit in every round, with the radiance that the photographs show
#            reject   these triangles never emit
#   question: the photographs do not tell what this is: look at its image, then accept (an emitter) or reject (a mirror,
#             metal, paint); with auto it does not emit
#   name: what this emitter is called in light setups, the report and the export
#   merge_with: name, emitter-N or triangles of another entry: both are one emitter with one radiance
# docs/stages/emitters.md says more. Comments that you add are lost.
"""


class ReviewEntry(Settings):
    """One emitter of the file: what a person decides, then the facts of the last run that found it."""

    emitter: str | None = None
    question: str | None = Field(None, description="what the photographs do not tell; null for emitters")
    verdict: Literal["auto", "accept", "reject"] = "auto"
    name: str | None = None
    merge_with: str | None = None
    triangles: str
    area: float | None = Field(None, description="square metres")
    power: float | None = Field(None, description="mean of red, green and blue")
    share: float | None = Field(None, description="of the power of all emitters")
    confidence: float | None = None
    views: Count | None = None
    guessed: bool | None = Field(None, description="no view shows it: it explains the light of what views show")
    thumbnail: str | None = None

    @field_validator("triangles", mode="before")
    @classmethod
    def _one_triangle(cls, value: Any) -> Any:
        """A single triangle is a number for YAML."""
        return str(value) if type(value) is int else value

    @field_validator("name")
    @classmethod
    def _usable(cls, name: str | None) -> str | None:
        if name is None:
            return None
        if name != name.strip() or not name.isprintable() or not 0 < len(name) <= _LONGEST:
            raise ValueError(f"a name must have 1 to {_LONGEST} printable characters, no blanks around them")
        if _RESERVED.fullmatch(name):
            raise ValueError("names like emitter-3, rest, outside and surface are the program's own")
        return name

    @property
    def decided(self) -> bool:
        """Whether a person said something about it."""
        return self.verdict != "auto" or self.name is not None or self.merge_with is not None


@dataclass(frozen=True)
class Review:
    """What the file holds.

    Attributes
    ----------
    mesh_triangles
        Triangles of the mesh that the numbers belong to.
    entries
        In the file's order.
    triangles
        Of each entry; no two share one.
    partner
        For each entry the number of the one that it is merged with, or None.
    """

    mesh_triangles: int
    entries: tuple[ReviewEntry, ...] = ()
    triangles: tuple[Triangles, ...] = ()
    partner: tuple[int | None, ...] = ()

    def groups(self) -> list[list[int]]:
        """Entries that are one emitter, with a decision about any; the one that others are merged with comes first."""
        root = list(range(len(self.entries)))
        for number, other in enumerate(self.partner):
            if other is not None:
                root = [root[other] if r == root[number] else r for r in root]
        kept = [n for n, entry in enumerate(self.entries) if entry.verdict != "reject"]
        groups = [[n for n in kept if root[n] == r] for r in dict.fromkeys(root[n] for n in kept)]
        groups = [sorted(group, key=lambda n: self.partner[n] is not None) for group in groups]
        return [group for group in groups if len(group) > 1 or self.entries[group[0]].decided]

    def names(self) -> dict[str, Triangles]:
        """Name that a person gave -> triangles of that emitter."""
        found = {}
        for group in self.groups():
            given = next((self.entries[n].name for n in group if self.entries[n].name), None)
            if given:
                found[given] = frozenset().union(*(self.triangles[n] for n in group))
        return found

    def emission(self) -> str:
        """What decides which triangles emit, as sorted JSON for ``--decisions``; empty where a person left it alone."""

        def of(verdict: str) -> list[str]:
            pairs = zip(self.entries, self.triangles, strict=True)
            return sorted(ranges(own) for entry, own in pairs if entry.verdict == verdict)

        merged = [sorted(ranges(self.triangles[n]) for n in group) for group in self.groups() if len(group) > 1]
        return self._json(accept=of("accept"), reject=of("reject"), merge=sorted(merged))

    def listing(self) -> str:
        """What decides how emitters are listed, as `emission`: their names, and what was rejected."""
        rejected = [own for entry, own in zip(self.entries, self.triangles, strict=True) if entry.verdict == "reject"]
        return self._json(
            names={name: ranges(own) for name, own in self.names().items()},
            reject=sorted(map(ranges, rejected)),
        )

    def _json(self, **values: Any) -> str:
        given = {key: value for key, value in values.items() if value}
        return json.dumps({"mesh_triangles": self.mesh_triangles, **given}, sort_keys=True) if given else ""


class ReviewDecisions(Settings):
    """The JSON of ``--decisions``; triangles as ranges."""

    mesh_triangles: Count = 0
    accept: tuple[str, ...] = ()
    reject: tuple[str, ...] = ()
    merge: tuple[tuple[str, ...], ...] = ()
    names: dict[str, str] = Field(default_factory=dict)


def parse_decisions(text: str, mesh_triangles: int) -> ReviewDecisions:
    """Parse the JSON of ``--decisions``; nothing is decided where it is empty.

    Raises
    ------
    FiptError
        If it is no such JSON, or belongs to a mesh with another number of triangles.
    """
    if not text:
        return ReviewDecisions()
    try:
        found = ReviewDecisions.model_validate_json(text)
    except ValidationError as error:
        raise FiptError(explain(error, "decisions"), f"they come from {FILE}; see docs/stages/emitters.md") from error
    if found.mesh_triangles != mesh_triangles:
        raise FiptError(
            f"{FILE} numbers the triangles of a mesh of {found.mesh_triangles}; the mesh has {mesh_triangles}",
            "delete that file, or bring the mesh back",
        )
    for part in (*found.accept, *found.reject, *(part for group in found.merge for part in group)):
        numbers(part, mesh_triangles)
    for part in found.names.values():
        numbers(part, mesh_triangles)
    return found


# --- triangles as text ----------------------------------------------------------------------------


def ranges(triangles: Iterable[int]) -> str:
    """Return triangle numbers as text, such as ``5-16, 20``."""
    parts: list[list[int]] = []
    for number in sorted(int(t) for t in triangles):
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(str(first) if first == last else f"{first}-{last}" for first, last in parts)


def numbers(text: str, limit: int) -> Triangles:
    """Triangle numbers of such a text; all must be below ``limit``."""
    found: set[int] = set()
    for part in text.split(","):
        match = _RANGE.fullmatch(part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first:
            raise FiptError(f"triangles must be like 5-16, 20; found {text!r}", "write numbers and ranges")
        if last >= limit:
            raise FiptError(f"there is no triangle {last}", f"triangles go from 0 to {limit - 1}")
        if len(found) + last - first >= _MOST:
            raise FiptError(f"an emitter must have fewer than {_MOST} triangles; found {text[:80]!r}", "list fewer")
        found.update(range(first, last + 1))
    return frozenset(found)


# --- reading --------------------------------------------------------------------------------------


def read_review(path: str | Path) -> Review | None:
    """Read the file; None where there is none.

    Raises
    ------
    FiptError
        If it is no such file, or its decisions contradict each other: one line that names the entry.
    """
    path = Path(path)
    if not path.exists():
        return None
    total, emitters = _top(path, read_yaml(path, "the review", _REMEDY))
    entries = [_entry(path, place, values) for place, values in enumerate(emitters)]
    labels = [_label(entry, place) for place, entry in enumerate(entries)]
    triangles: list[Triangles] = []
    for entry, label in zip(entries, labels, strict=True):
        try:
            own = numbers(entry.triangles, total)
        except FiptError as error:
            raise FiptError(f"{path}: {label}: {error.message}", error.remedy) from error
        for other, taken in zip(labels, triangles, strict=False):
            if own & taken:
                raise FiptError(
                    f"{path}: {label} and {other} both have triangle {min(own & taken)}", "remove it from one of them"
                )
        triangles.append(own)
    _check_names(path, entries)
    partner = _partners(path, entries, labels, triangles)
    return Review(total, tuple(entries), tuple(triangles), tuple(partner))


def _top(path: Path, content: Mapping[str, Any]) -> tuple[int, Sequence[Any]]:
    if "lamps" in content:
        raise FiptError(f"{path}: the key lamps is called emitters now", _RENAMED)
    for key in content:
        if key not in _KEYS:
            raise FiptError(f"{path}: unknown key {key}", _REMEDY)
    total, emitters = content.get("mesh_triangles"), content.get("emitters")
    if type(total) is not int or total < 0:
        raise FiptError(f"{path}: mesh_triangles must be a number of triangles; found {total!r}", _REMEDY)
    if not isinstance(emitters, list):
        raise FiptError(f"{path}: emitters must be a list; found {emitters!r}", _REMEDY)
    return total, emitters


def _entry(path: Path, place: int, values: Any) -> ReviewEntry:
    if not isinstance(values, dict):
        raise FiptError(f"{path}: entry {place + 1} must hold keys; found {values!r}", "see docs/stages/emitters.md")
    try:
        return ReviewEntry.model_validate(values)
    except ValidationError as error:
        where = f"{values.get('name') or values.get('emitter') or f'entry {place + 1}'}"
        allowed = "a person sets verdict (auto, accept, reject), name, merge_with"
        raise FiptError(f"{path}: {explain(error, where)}", allowed) from error


def _label(entry: ReviewEntry, place: int) -> str:
    """What messages call an entry."""
    return entry.name or entry.emitter or f"entry {place + 1}"


def _check_names(path: Path, entries: Sequence[ReviewEntry]) -> None:
    seen: dict[str, str] = {}
    for entry in entries:
        if entry.name is None:
            continue
        other = seen.setdefault(entry.name.casefold(), entry.triangles)
        if other != entry.triangles:
            raise FiptError(
                f"{path}: two emitters are named {entry.name!r} (triangles {other} and {entry.triangles})",
                "give one of them another name, or merge them with merge_with",
            )


def _partners(
    path: Path, entries: Sequence[ReviewEntry], labels: Sequence[str], triangles: Sequence[Triangles]
) -> list[int | None]:
    """For each entry the number of the one that it is merged with."""
    known: dict[str, int] = {}
    for calls in (lambda n: ranges(triangles[n]), lambda n: entries[n].emitter, lambda n: entries[n].name):
        known |= {call: n for n in range(len(entries)) if (call := calls(n))}
    found: list[int | None] = []
    for number, (entry, label) in enumerate(zip(entries, labels, strict=True)):
        other = None if entry.merge_with is None else known.get(entry.merge_with)
        found.append(other)
        if entry.merge_with is None:
            continue
        if other is None:
            near = closest(entry.merge_with, [call for n, call in enumerate(labels) if n != number])
            raise FiptError(
                f"{path}: {label} is to merge with {entry.merge_with!r}, which is no emitter", f"there are {near}"
            )
        if other == number:
            raise FiptError(f"{path}: {label} is to merge with itself", "name another emitter")
        for rejected in (number, other):
            if entries[rejected].verdict == "reject":
                raise FiptError(
                    f"{path}: {label} is to merge with {labels[other]}, but {labels[rejected]} is rejected",
                    "remove merge_with, or the verdict",
                )
    return found


_NAMED = 12
"""Names that a message holds at most."""


def closest(wanted: str, there: Sequence[str]) -> str:
    """Return names as one line, those most like ``wanted`` first; no more than `_NAMED`."""
    from difflib import SequenceMatcher

    def unlike(name: str) -> float:
        return -SequenceMatcher(None, wanted.casefold(), name.casefold()).ratio()

    names = sorted(there, key=unlike)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (", ".join(names[:_NAMED]) or "no emitters") + more


# --- writing --------------------------------------------------------------------------------------


def refreshed(
    review: Review | None,
    emitters: Sequence[Mapping[str, Any]],
    mesh_triangles: int,
    rejected: Mapping[Triangles, str | None] | None = None,
) -> Review:
    """Return the file's content after a run: decided entries keep their triangles, all other emitters are listed anew.

    Parameters
    ----------
    review
        What the file held.
    emitters
        Facts of each emitter that was found, and of each surface that may emit: keys of `ReviewEntry`, ``triangles`` as
        a set, no two of which share one; in the order of the list.
    rejected
        Triangles of an emitter that was rejected -> its image.
    """
    images = rejected or {}
    old = review or Review(mesh_triangles)
    groups = old.groups()
    kept = sorted({n for group in groups for n in group} | {n for n, e in enumerate(old.entries) if e.decided})
    together = [frozenset().union(*(old.triangles[n] for n in group)) for group in groups]
    found = matched(together, [emitter["triangles"] for emitter in emitters])
    own = {groups[group][0]: emitter for group, emitter in found.items()}
    frozen = frozenset().union(*(old.triangles[n] for n in kept))
    rows: list[tuple[ReviewEntry, Triangles, int | None]] = []
    heads = {emitter: head for head, emitter in own.items()}
    for number, emitter in enumerate(emitters):
        head, left = heads.get(number), frozenset(emitter["triangles"]) - frozen
        if head is not None:
            facts = {key: value for key, value in emitter.items() if key != "triangles"}
            rows.append((old.entries[head].model_copy(update=facts), old.triangles[head], head))
        elif left:
            rows.append((ReviewEntry(**{**emitter, "triangles": ranges(left)}), left, None))
    for n in kept:
        if n not in own:
            facts = {"emitter": None, "question": None, "thumbnail": images.get(old.triangles[n])}
            rows.append((old.entries[n].model_copy(update=facts), old.triangles[n], n))
    place = {n: at for at, (_, _, n) in enumerate(rows) if n is not None}
    others = [None if n is None else old.partner[n] for _, _, n in rows]
    partner = [None if other is None else place[other] for other in others]
    entries = [
        entry if other is None else entry.model_copy(update={"merge_with": _reference(*rows[other][:2])})
        for (entry, _, _), other in zip(rows, partner, strict=True)
    ]
    return Review(mesh_triangles, tuple(entries), tuple(own for _, own, _ in rows), tuple(partner))


def _reference(entry: ReviewEntry, triangles: Triangles) -> str:
    """What another entry calls this one."""
    return entry.name or entry.emitter or ranges(triangles)


def matched(wanted: Sequence[Triangles], there: Sequence[Iterable[int]]) -> dict[int, int]:
    """Number in ``wanted`` -> number in ``there`` with which it shares most triangles; each is taken once."""
    emitter_of = {int(t): number for number, own in enumerate(there) for t in own}
    shared: dict[tuple[int, int], int] = {}
    for number, triangles in enumerate(wanted):
        for t in triangles & emitter_of.keys():
            pair = number, emitter_of[t]
            shared[pair] = shared.get(pair, 0) + 1
    found: dict[int, int] = {}
    for (number, emitter), _ in sorted(shared.items(), key=lambda item: (-item[1], item[0])):
        if number not in found and emitter not in found.values():
            found[number] = emitter
    return found


def write_review(path: str | Path, review: Review) -> None:
    """Write the file, whole or not at all; nothing where it already says so. A link to it stays one."""
    path = Path(path).resolve()
    emitters = [
        entry.model_dump() | {"triangles": ranges(own)}
        for entry, own in zip(review.entries, review.triangles, strict=True)
    ]
    body = {"mesh_triangles": review.mesh_triangles, "emitters": emitters}
    text = _HEAD + yaml.safe_dump(body, sort_keys=False, allow_unicode=True, width=120)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        write_text(path, text)
