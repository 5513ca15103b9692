"""`fipt findings` from end to end: the files of the box room, sound and spoiled."""

import json
import shutil

import pytest

from fipt.errors import FiptError
from fipt.formats.images import decoded
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import Emitters, write_emitters
from fipt.scene.findings import read_findings, read_measured
from tests.fitted import call


def test_a_run_without_its_emitters(work):
    write_emitters(work / "round-0/emitters.npz", Emitters.none(), Dataset(work / "dataset").mesh())
    assert call("findings", work, stats=work / "stats/findings.json") == 0
    found = {each.id: each for each in read_findings(work / "findings.json")}
    first = next(iter(found))
    assert first == "no-emitter"
    assert found[first].severity == "serious"
    assert found[first].file == "findings/no-emitter.png"
    assert decoded(work / found[first].file, 1).shape[2] == 3
    assert json.loads((work / "stats/findings.json").read_text())["findings"]["no-emitter"] == "serious"


def test_measures_stand_in_the_file_also_where_nothing_is_wrong(scene):
    measured = {measure.name for measure in read_measured(scene / "findings.json")}
    assert "directions from the surface that meet nothing" in measured
    assert "emitters found" in measured
    assert "no-emitter" not in {found.id for found in read_findings(scene / "findings.json")}


def test_options_that_may_be_left_out(work):
    earlier = shutil.copytree(work / "round-0/shading", work / "before") / "train-000"
    assert call("findings", work, "--held-out", work / "samples/val-000", "--earlier", earlier) == 0
    names = {measure.name for measure in read_measured(work / "findings.json")}
    assert "held-out pixels that no training view shows" in names


def test_shading_of_the_round_before_is_of_all_shards(work, refused):
    two = f"{work}/round-0/shading/train-000,{work}/samples/val-000"
    assert "--samples and --earlier must name as many shards; 1 and 2 given" in refused("findings", "--earlier", two)


def test_a_file_that_is_none(tmp_path):
    path = tmp_path / "findings.json"
    path.write_text('{"findings": 3}')
    with pytest.raises(FiptError, match="is not a list of findings"):
        read_findings(path)
    with pytest.raises(FiptError, match="is not a list of findings"):
        read_measured(path)
    with pytest.raises(FiptError, match="the findings"):
        read_findings(tmp_path / "none.json")
