"""Values that somebody wrote, checked against a settings class: one line that names the key, or the settings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from functools import cache
from types import UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from fipt.errors import FiptError

_PLAIN = ("str", "list[str]")
"""What pydantic puts into the place of an error for the members of a union of plain types."""


class Kinds(NamedTuple):
    """A union whose members are told apart by a key.

    Attributes
    ----------
    key
        The key, such as ``source``.
    members
        Its value -> the settings class.
    """

    key: str
    members: dict[str, type[BaseModel]]


class _Place(NamedTuple):
    """Where an error is.

    Attributes
    ----------
    path
        Keys from the top, as a person wrote them.
    parents
        Settings classes on the way, each with the union it was chosen from and the value that chose it.
    """

    path: list[str]
    parents: list[tuple[type[BaseModel], Kinds | None, str]]


def checked(model: Any, values: Any, where: str = "", root: str = "") -> Any:
    """Return ``values`` as ``model``.

    Parameters
    ----------
    model
        A settings class, or a union of some.
    values
        As read from YAML or JSON.
    where
        Put before the message.
    root
        Key below which the values stand.

    Raises
    ------
    FiptError
        One line that names the key's path and what is allowed.
    """
    try:
        return _adapter(model).validate_python(values)
    except ValidationError as error:
        # An unknown key explains more than the missing or wrong values that follow from it.
        problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
        message, remedy = _explained(model, problems[0], [root] if root else [])
        raise FiptError(where + message, remedy) from error


@cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    """What checks values of a model; making one costs more than to check most values."""
    return TypeAdapter(model)


def of_another_kind(key: str, chooser: str, owners: Iterable[str], chosen: str) -> PydanticCustomError:
    """Error of a validator: ``key`` is of other members of a union than the one that ``chooser`` chose."""
    names = list(owners)
    said = f"is only for {chooser} {' or '.join(names)}; {chooser} is {chosen}"
    return PydanticCustomError("of_another_kind", "{said}", {"key": key, "said": said, "set": f"{chooser}: {names[0]}"})


def explain(error: ValidationError, where: str) -> str:
    """Return one line for the first problem of a pydantic error: key path, what is allowed, what was found."""
    problem = error.errors()[0]
    path = ".".join([where, *(str(part) for part in problem["loc"])])
    if problem["type"] == "value_error":  # keys that do not go together
        return f"{path}: {problem.get('ctx', {})['error']}"
    if problem["type"] == "extra_forbidden":
        return f"unknown key {path}"
    text = problem["msg"]
    return f"{path}: {text[0].lower()}{text[1:]}; found {problem.get('input')!r}"


def kinds_of(annotation: Any) -> Kinds | None:
    """Members of a union of settings classes that are told apart by a key; None for everything else."""
    members = [kind for kind in _options(annotation) if _is_model(kind)]
    if len(members) < 2 or len(members) != len(_options(annotation)):
        return None
    for key in members[0].model_fields:
        tags = [_tags(member, key) for member in members]
        several = [tag for own in tags for tag in own]
        if all(tags) and len(set(several)) == len(several):
            return Kinds(key, {tag: member for own, member in zip(tags, members, strict=True) for tag in own})
    return None


def inner_model(annotation: Any) -> type[BaseModel] | None:
    """Return the settings class that a key holds, on its own, optionally or in a list; None for plain values."""
    if isinstance(annotation, type):
        return annotation if _is_model(annotation) else None
    return next((model for kind in get_args(annotation) if (model := inner_model(kind)) is not None), None)


def _explained(model: Any, problem: Any, root: Sequence[str]) -> tuple[str, str]:
    """Message and remedy for one problem that pydantic reports."""
    kind, found = problem["type"], problem.get("input")
    path, parents = _place(model, problem["loc"], root)
    text = ".".join(path) or "the configuration"
    if path and path[-1] == "[key]":
        return (
            f"{'.'.join(path[:-2])}: names must be text; found {found!r}",
            "put it in quotes: YAML reads no, off, yes, on and numbers as other things",
        )
    if kind == "extra_forbidden":
        return _unknown(path, parents)
    if kind == "truth_value":
        said = problem["ctx"]
        return f"{_joined(path, said['key'])}: must be no truth value; found {said['said']}", _SEE
    if kind == "of_another_kind":
        said = problem["ctx"]
        return f"{_joined(path, said['key'])} {said['said']}", f"remove it, or set {_joined(path, said['set'])}"
    if kind == "union_tag_not_found":
        key = problem["ctx"]["discriminator"].strip("'")
        return f"{_joined(path, key)} is missing", f"it says which keys there are, see {_README}"
    if kind == "union_tag_invalid":
        key, allowed = problem["ctx"]["discriminator"].strip("'"), problem["ctx"]["expected_tags"]
        return f"{_joined(path, key)}: input should be {allowed}; found {problem['ctx']['tag']!r}", _SEE
    if kind == "missing" and path[-1] in parents[-1][0].model_fields:
        return f"{text} is missing", _needed(path[-1], parents[-1])
    said = problem["msg"].removeprefix("Value error, ")
    shown = "" if kind == "value_error" else f"; found {found!r}"
    return f"{text}: {said[0].lower()}{said[1:]}{shown}", _SEE


_README = "config/README.md"
_SEE = f"{_README} explains every key"


def _unknown(path: list[str], parents: list[tuple[type[BaseModel], Kinds | None, str]]) -> tuple[str, str]:
    """Message and remedy for a key that is not there: misspelt, or of another kind."""
    key, (parent, kinds, tag) = path[-1], parents[-1]
    if kinds is not None:
        owners = [name for name, member in kinds.members.items() if key in member.model_fields]
        if owners:
            only = f"{'.'.join(path)} is only for {kinds.key} {' or '.join(owners)}; {kinds.key} is {tag}"
            return only, f"remove {'.'.join(path)}"
    allowed = list(parent.model_fields)
    close = get_close_matches(key, allowed, n=1)
    hint = f" (did you mean {close[0]}?)" if close else ""
    inside = ".".join(path[:-1]) or "the top level"
    return f"unknown key {'.'.join(path)}{hint}", f"allowed in {inside}: {', '.join(allowed)}"


def _needed(key: str, parent: tuple[type[BaseModel], Kinds | None, str]) -> str:
    """What a missing key should say."""
    model, kinds, tag = parent
    what = f"{key}: {model.model_fields[key].description}"
    return f"give {what}" if kinds is None else f"{kinds.key}: {tag} needs {what}"


def _place(model: Any, location: Sequence[int | str], root: Sequence[str]) -> _Place:
    """Follow pydantic's location of an error: it names the chosen members of unions as if they were keys."""
    path, parents = list(root), []
    annotation, chosen = model, (None, "")
    for part in location:
        kinds = kinds_of(annotation)
        if kinds is not None and part in kinds.members:
            annotation, chosen = kinds.members[str(part)], (kinds, str(part))
            continue
        if part in _PLAIN:
            continue
        path.append(str(part))
        own = next((kind for kind in _options(annotation) if _is_model(kind)), None)
        if own is not None:
            parents.append((own, *chosen))
        annotation, chosen = _below(annotation, part), (None, "")
    return _Place(path, parents)


def _below(annotation: Any, part: int | str) -> Any:
    """Type of what stands below ``part`` (field, name or index) in a value of ``annotation``; None where unknown."""
    for kind in _options(annotation):
        if _is_model(kind):
            field = kind.model_fields.get(str(part))
            return None if field is None else field.annotation
        inner = [one for one in get_args(kind) if one is not Ellipsis]
        if get_origin(kind) in (dict, tuple, list) and inner:
            return inner[-1]
    return None


def _options(annotation: Any) -> list[Any]:
    """Members of a union, without None; a plain type is the only member of itself."""
    return list(_members(annotation))


def _members(annotation: Any) -> Iterator[Any]:
    if hasattr(annotation, "__metadata__"):
        yield from _members(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, UnionType):
        for kind in get_args(annotation):
            yield from _members(kind)
    elif annotation is not type(None) and annotation is not None:
        yield annotation


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _tags(member: type[BaseModel], key: str) -> tuple[str, ...]:
    """Values of a key that choose a member of a union; none where the key is no choice."""
    field = member.model_fields.get(key)
    if field is None or get_origin(field.annotation) is not Literal:
        return ()
    return get_args(field.annotation)


def _joined(path: Sequence[str], key: str) -> str:
    return ".".join([*path, key])
