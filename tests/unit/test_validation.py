"""What is wrong is told in one line: the key's path, what was found, what is allowed."""

import re
from typing import Annotated, Literal

import pytest
from pydantic import Field, TypeAdapter

from fipt.errors import FiptError
from fipt.settings import Positive, Settings, by_mode, layer_of
from fipt.validation import checked, inner_model, kinds_of


class _Any(Settings):
    """A thing of the test."""


class Off(_Any):
    """Nothing."""

    mode: Literal["off"] = "off"


class On(_Any):
    """Something."""

    mode: Literal["on"] = "on"
    file: str = Field(description="which one")
    size: Positive = Field(default=3, le=9, description="how large")


THING = Off | On
Thing = Annotated[THING, Field(discriminator="mode"), by_mode(THING)]


class Whole(Settings):
    """Holds things in every way."""

    one: Thing = Field(default=Off(), description="one")
    many: tuple[Thing, ...] = Field(default=(), description="many")
    named: dict[str, On] | None = Field(default=None, description="by name")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"one": {"mode": "on"}}, "one.file is missing; mode: on needs file: which one"),
        ({"one": {"mode": "in"}}, "one.mode: input should be 'off', 'on'; found 'in'"),
        ({"one": {"mode": ["on"]}}, "one.mode"),
        ({"one": {"file": "a"}}, "one.file is only for mode on; mode is off; remove it, or set one.mode: on"),
        ({"one": {"siz": 3}}, "unknown key one.siz; allowed in one: mode"),
        (
            {"many": [{}, {"mode": "on", "file": "a", "size": 10}]},
            "many.1.size: input should be less than or equal to 9",
        ),
        (
            {"named": {"a": {"fil": 3}}},
            "unknown key named.a.fil (did you mean file?); allowed in named.a: mode, file, size",
        ),
        ({"named": {"a": {}}}, "named.a.file is missing; give file: which one"),
        ({"named": {3: {"file": "a"}}}, "named: names must be text; found 3; put it in quotes"),
        ([], "the configuration: input should be"),
    ],
)
def test_what_is_wrong(values, said):
    with pytest.raises(FiptError, match=re.escape(said)) as caught:
        checked(Whole, values)
    assert "\n" not in str(caught.value)


def test_where_and_root_stand_before():
    with pytest.raises(FiptError, match=r"^here: one\.thing\.file is missing"):
        checked(Thing, {"mode": "on"}, "here: ", "one.thing")


def test_a_mode_leaves_out_what_tunes_another():
    assert checked(Thing, {"size": 4}) == Off()
    assert checked(Thing, {"file": None, "mode": "off"}) == Off()
    assert checked(Thing, {"size": 4, "file": "a", "mode": "on"}) == On(file="a", size=4)
    assert TypeAdapter(Thing).validate_python(On(file="a")) == On(file="a")


def test_a_layer_says_any_key_of_any_mode():
    layer = layer_of(Thing)
    assert list(layer.model_fields) == ["mode", "file", "size"]
    assert layer.model_validate({"size": 4}).model_dump(exclude_unset=True) == {"size": 4}
    assert layer.model_fields["mode"].description == "`off`: nothing; `on`: something"
    with pytest.raises(FiptError, match="size: input should be less than or equal to 9"):
        checked(layer, {"size": 10})
    assert layer_of(On) is On


def test_unions_and_what_they_hold():
    kinds = kinds_of(Thing)
    assert kinds is not None
    assert (kinds.key, kinds.members) == ("mode", {"off": Off, "on": On})
    assert kinds_of(On) is None
    assert kinds_of(int | str) is None
    assert inner_model(dict[str, On] | None) is On
    assert inner_model(tuple[int, ...]) is None
