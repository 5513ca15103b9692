"""Code samples of the documentation: Python runs, configurations are valid, commands exist."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from fipt.config import read
from fipt.registry import SECTIONS
from tests.docs.samples import ROOT, Sample, commands, problem, samples

DEMO = {"source": "procedural", "preset": "demo"}


@pytest.mark.parametrize("sample", samples("python"), ids=str)
def test_python_runs(sample: Sample, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(sample.text, str(sample), "exec"), {"__name__": "sample"})


@pytest.mark.parametrize("sample", samples("json"), ids=str)
def test_json_is_json(sample: Sample) -> None:
    json.loads(sample.text)


@pytest.mark.parametrize("sample", samples("yaml"), ids=str)
def test_configurations_are_valid(sample: Sample, tmp_path: Path, monkeypatch) -> None:
    values = yaml.safe_load(sample.text)
    if "mesh_triangles" in values:
        from fipt.scene.review import read_review

        path = tmp_path / "emitters_review.yaml"
        path.write_text(sample.text, encoding="utf-8")
        read_review(path)
        return
    path = tmp_path / "sample.yaml"
    path.write_text(yaml.safe_dump(configuration(values)), encoding="utf-8")
    monkeypatch.chdir(ROOT)
    read([path], [f"data_root={tmp_path}"])


def configuration(values: dict[str, Any]) -> dict[str, Any]:
    """A whole configuration around a sample: setups and sections become those of a scene."""
    if "scenes" in values:
        return values
    if "setups" in values:
        return {"scenes": {"sample": DEMO | values}}
    assert values.keys() <= SECTIONS.keys(), "a sample is a configuration, setups, or sections"
    return {"scenes": {"sample": DEMO | {"settings": values}}}


def test_there_are_samples() -> None:
    assert len(samples("yaml")) > 10
    assert len(samples("sh")) > 15


@pytest.mark.parametrize("sample", samples("sh"), ids=str)
def test_commands_exist(sample: Sample) -> None:
    found = {" ".join(words): problem(words) for words in commands(sample.text)}
    assert not {line: wrong for line, wrong in found.items() if wrong}


@pytest.mark.parametrize(
    ("line", "wrong"),
    [
        ("fipt backe --out x", "no verb backe"),
        ("fipt view --colour x", "no option --colour"),
        ("fipt cache --dataset D", "needs --samples"),
        ("fipt run demo nowhere", "no target nowhere"),
        ("snakemake --cores 1 nowhere", "no target nowhere"),
        ("make nothing", "no target nothing"),
    ],
)
def test_wrong_commands_are_found(line: str, wrong: str) -> None:
    assert wrong in str(problem(commands(line)[0]))
