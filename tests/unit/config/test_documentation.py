"""The generated parts of the configuration's documentation are in step with the settings."""

import json

import jsonschema
import pytest

from fipt.config.documentation import README, SCHEMA, schema_text, with_tables
from fipt.config.schema import SceneEntry
from fipt.config.sections import LAYERS
from fipt.scene.setup import EmitterEdit, EnvironmentEdit, MeshLight, QuadLight, RelightSetup, SphereLight, SpotLight
from fipt.validation import kinds_of

LIGHTS = (QuadLight, SphereLight, MeshLight, SpotLight)
ENTRIES = tuple(kinds_of(SceneEntry).members.values())
REMEDY = "run: python -m fipt.config.documentation"


def test_schema_is_in_step():
    assert SCHEMA.read_text(encoding="utf-8") == schema_text(), REMEDY


def test_tables_are_in_step():
    text = README.read_text(encoding="utf-8")
    assert text == with_tables(text), REMEDY


@pytest.mark.parametrize("model", [*LAYERS.values(), RelightSetup, EnvironmentEdit, EmitterEdit, *LIGHTS, *ENTRIES])
def test_every_key_is_described(model):
    assert [name for name, field in model.model_fields.items() if not field.description] == []


@pytest.mark.parametrize(
    ("config", "valid"),
    [
        ({}, True),
        ({"fit": {"steps": 3}, "only": ["room"]}, True),
        ({"fit": {"steps": 0}}, False),
        ({"fit": {"stepz": 3}}, False),
        ({"scenes": {}}, False),
        ({"scenes": {"room": {"source": "mitsuba"}}}, False),
        ({"scenes": {"room": {"source": "procedural", "path": "a"}}}, False),
        ({"segment": {"exposure": 2}}, True),
        ({"setups": {"a": {"lights": [{"shape": "spot", "radiance": [1, 1, 1]}]}}}, False),
        ({"setups": {"a": {"emitters": [{"color": [1, 2]}]}}}, False),
    ],
)
def test_schema_says_what_the_settings_say(config, valid):
    schema = json.loads(SCHEMA.read_text(encoding="utf-8"))
    room = {"scenes": {"room": {"source": "procedural"}}}
    assert jsonschema.Draft202012Validator(schema).is_valid({**room, **config}) is valid
