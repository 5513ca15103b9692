"""A wrong configuration is one line with the file and the place, whatever front reads it."""

import re
from pathlib import Path
from typing import Any

import pytest

from fipt.config import read
from fipt.config.kept import check_kept
from fipt.errors import FiptError
from fipt.registry import SECTIONS, validated
from tests.faults.faults import Fault, named, refused
from tests.layouts import write_nerfstudio
from tests.workflow.conftest import Workspace

FILE = Path("config/config.yaml")
SCENE = "scenes: {room: {source: procedural}}\n"


@pytest.fixture(autouse=True)
def _working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    FILE.parent.mkdir()


def written(text: str | bytes) -> None:
    """Write the configuration."""
    FILE.write_bytes(text.encode() if isinstance(text, str) else text)


def dataset(path: str) -> None:
    write_nerfstudio(Path(path))
    written(f"scenes: {{x: {{source: dataset, format: nerfstudio, path: '{path}'}}}}\n")


def image_with_braces() -> None:
    dataset("src")
    content = Path("src/transforms.json").read_text().replace("images/", "a{b}c/")
    Path("src/transforms.json").write_text(content)
    Path("src/images").rename("src/a{b}c")


def fault(name: str, text: str | bytes, said: str) -> Fault:
    return Fault(name, lambda: written(text), said)


LAUGHS = "a0: &a0 [1, 1]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12))
FAULTS = [
    fault("rounds is true", SCENE + "rounds: true\n", "rounds: must be no truth value; found yes"),
    fault("rounds is off", SCENE + "rounds: off\n", "rounds: must be no truth value; found no"),
    fault("a truth value in a list", SCENE + "synthesize: {raw: {board: [true, 6]}}\n",
          "synthesize.raw.board: must be no truth value"),
    fault("a truth value in a scene", "scenes: {room: {source: procedural, settings: {fit: {steps: yes}}}}\n",
          "scenes.room.settings.fit.steps: must be no truth value"),
    fault("rounds is text", SCENE + "rounds: many\n", "rounds: input should be a valid integer"),
    fault("a number that YAML takes for octal", SCENE + "fit: {steps: 010}\n", "010 means another number to YAML"),
    fault("a number that YAML takes for minutes", SCENE + "fit: {steps: 1:30}\n", "1:30 means another number to YAML"),
    fault("scenes that differ by case", "scenes: {room: {source: procedural}, Room: {source: procedural}}\n",
          "scenes: room and Room differ by case alone"),
    fault("setups that differ by case", SCENE + "setups: {a: {}, A: {}}\n", "setups: a and A differ by case alone"),
    fault("a scene that is called as the list of all", "scenes: {index.html: {source: procedural}}\n",
          "a scene must not be called 'index.html'"),
    fault("no scene is asked for", SCENE + "only: []\n", "only: no scene is named"),
    fault("two numbers for a colour", "scenes: {x: {source: procedural, setups: {a: {emitters: [{color: [1, 1]}]}}}}\n",
          "scenes.x.setups.a.emitters.0.color.2: field required"),
    fault("rounds is a list", SCENE + "rounds: [1]\n", "rounds: input should be a valid integer"),
    fault("rounds is not a number", SCENE + "rounds: .nan\n", "rounds: input should be"),
    fault("rounds is negative", SCENE + "rounds: -1\n", "rounds: input should be greater"),
    fault("rounds of 10^30", SCENE + f"rounds: {10**30}\n", "rounds: "),
    fault("a number of 5000 digits", SCENE + "rounds: " + "9" * 5000 + "\n", "config/config.yaml is not YAML"),
    fault("seed of 2^80", SCENE + f"fit: {{seed: {2**80}}}\n", "fit.seed: must be at most 4294967295"),
    fault("seed of 2^32", SCENE + f"refine: {{seed: {2**32}}}\n", "refine.seed: must be at most 4294967295"),
    fault("10^12 samples", SCENE + f"refine: {{diffuse_spp: {10**12}}}\n", "refine.diffuse_spp: must be at most"),
    fault("10^12 pixels", SCENE + f"synthesize: {{width: {10**12}}}\n", "synthesize.width: must be at most"),
    fault("equal keys", SCENE + "rounds: 1\nfit: {steps: 3}\nrounds: 2\n",
          "config/config.yaml is not YAML (the key 'rounds' of line 2 is there again in line 4, column 1"),
    fault("equal keys below", SCENE + "fit:\n  seed: 1\n  steps: 3\n  seed: 2\n",
          "the key 'seed' of line 3 is there again in line 5"),
    fault("equal scenes", "scenes:\n  a: {source: procedural}\n  a: {source: raw}\n", "the key 'a' of line 2 is"),
    fault("an alias of itself", SCENE + "setups: &a {b: *a}\n", "an alias refers to what holds it"),
    fault("aliases that explode", SCENE + LAUGHS, "its aliases make it too large"),
    fault("nested a thousand deep", SCENE + "fit: " + "[" * 3000 + "]" * 3000 + "\n", "nested too deeply"),
    fault("not UTF-8", SCENE.encode() + b"only: \xff\xfe\n", "config/config.yaml must be UTF-8 text; byte"),
    fault("a null byte", SCENE + "only: a\0b\n", "config/config.yaml is not YAML"),
    fault("code", SCENE + "only: !!python/object/apply:os.system ['touch hacked']\n", "config/config.yaml is not YAML"),
    fault("tabs", "scenes:\n\troom: {source: procedural}\n", "config/config.yaml is not YAML"),
    fault("a list", "[1, 2]\n", "config/config.yaml must hold keys at its top level"),
    fault("text", "room\n", "config/config.yaml must hold keys at its top level"),
    fault("a date", SCENE + "rounds: 2026-99-99\n", "config/config.yaml is not YAML"),
    fault("no scenes", "scenes: {}\n", "scenes: "),
    fault("scenes is a list", "scenes: [room]\n", "scenes: "),
    fault("a scene is text", "scenes: {room: procedural}\n", "scenes.room: "),
    fault("a scene's name is a path", "scenes: {../room: {source: procedural}}\n", "scene '../room' cannot be used"),
    fault("a scene's name is a number", "scenes: {3: {source: procedural}}\n", "names must be text"),
    fault("a scene's name has braces", "scenes: {'{a}': {source: procedural}}\n", "cannot be used as a file name"),
    fault("another scene is asked for", SCENE + "only: attic\n", "there is no scene 'attic'"),
    fault("misspelt", SCENE + "round: 2\n", "unknown key round (did you mean rounds?)"),
    Fault("a folder", FILE.mkdir, "the config file must be a file; config/config.yaml is a folder"),
]  # fmt: skip


@named(FAULTS)
def test_a_wrong_configuration_is_one_line(fault: Fault) -> None:
    fault.plant()
    with pytest.raises(FiptError) as caught:
        read()
    assert fault.said in str(caught.value).replace("  ", " ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 1000
    assert not Path("hacked").exists()


NO_BRACES = "scenes.x.path: paths must hold no braces or control characters; found "
PATHS = [
    Fault("braces in the path", lambda: dataset("src{x}"), NO_BRACES + "'src{x}'"),
    fault("a path of 5000 letters", f"scenes: {{x: {{source: dataset, format: nerfstudio, path: {'a' * 5000}}}}}\n",
          "scenes.x.path: paths must have at most 4095 bytes"),
    Fault("braces in an image", image_with_braces, NO_BRACES + "'src/a{b}c"),
    Fault("a path of a user that there is not", lambda: written(
        "scenes: {x: {source: dataset, format: nerfstudio, path: ~no_user/a}}\n"), "scenes.x.path is ~no_user/a"),
]  # fmt: skip


@named(PATHS)
def test_a_path_that_the_workflow_cannot_name_is_one_line(fault: Fault) -> None:
    fault.plant()
    with pytest.raises(FiptError) as caught:
        planned()
    assert fault.said in str(caught.value)


GIVEN = "scenes: {room: {source: procedural, settings: {segment: {mode: given, path: ids}}}}\n"
WEIGHTS = "scenes: {room: {source: procedural, settings: {segment: {mode: mask2former, model: ./net}}}}\n"
LATE = [
    fault("ids that are nothing", GIVEN, "segment.path ids does not exist; name a folder of ids"),
    Fault(
        "ids of no view",
        lambda: (Path("ids").mkdir(), written(GIVEN))[1],
        "ids must hold VIEW.png or VIEW.exr of every training view; train_000",
    ),
    fault("weights that are nothing", WEIGHTS, "segment.model net does not exist"),
    Fault("weights without files", lambda: (Path("net").mkdir(), written(WEIGHTS))[1], "needs the files config.json"),
]


@named(LATE)
def test_what_is_read_late_is_looked_for_when_it_is_planned(fault: Fault) -> None:
    fault.plant()
    with pytest.raises(FiptError, match=re.escape(fault.said)):
        read().check(read=True)


def planned() -> Any:
    """What both fronts do before a scene is run."""
    found = read()
    check_kept(found)
    found.scenes["x"].check()
    return found.scenes["x"].source.views, found.scenes["x"].source.imported_files()


@pytest.mark.parametrize("front", ["fipt run", "snakemake"])
def test_both_fronts_say_the_same(front: str, tmp_path: Path) -> None:
    here = Workspace(tmp_path, {}, stand_in=False)
    written(SCENE + "rounds: 1\nrounds: 2\n")
    said = here.fipt_run(code=2) if front == "fipt run" else here.snakemake(succeeds=False)
    assert "the key 'rounds' of line 2 is there again" in said
    assert "config/config.yaml" in said
    assert "Traceback" not in said
    assert not Path("results").exists()


def test_ordinary_yaml_is_read() -> None:
    written(
        "\ufeffscenes:\n  a: &room {source: procedural}\n  b:\n    <<: *room\n    preset: demo\n"
        "fit: {seed: 4294967295}\n"
    )
    found = read()
    assert list(found.scenes) == ["a", "b"]
    assert found.scenes["b"].settings["fit"].seed == 2**32 - 1


@pytest.mark.parametrize("section", SECTIONS)
def test_verbs_refuse_truth_values_too(section: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every number of every section, as JSON for a verb."""
    defaults = validated(section, {}).model_dump(mode="json")
    for key, value in defaults.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            with pytest.raises(FiptError, match=f"{section}.{key}: must be no truth value"):
                validated(section, {key: True})


def test_a_verb_refuses_settings_that_are_no_json(capsys: pytest.CaptureFixture[str]) -> None:
    bake = ("bake", "--dataset", "d", "--samples", "s", "--cache", "c", "--out", "o", "--settings")
    for text in ("{", "[1]", "3", '{"seed": 1e999}', '{"seed": ' + "9" * 5000 + "}", "[" * 100000):
        assert refused(capsys, *bake, text)
    assert "the key 'seed' is there twice" in refused(capsys, *bake, '{"seed": 1, "seed": 2}')
