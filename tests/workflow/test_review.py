"""emitters_review.yaml, which is no input of any job: what a person decides there reruns what depends on it alone.

With a stand-in for ``fipt``.
"""

import copy
import re
from collections import Counter

import pytest
import yaml

from fipt.config import load
from fipt.errors import FiptError
from fipt.scene.review import refreshed, write_review

CONFIG = {
    "scenes": {
        "room": {
            "source": "procedural",
            "setups": {"off": {"emitters": [{"index": 0, "off": True}]}},
            "settings": {"synthesize": {"train_views": 3, "val_views": 2}},
        }
    },
    "rounds": 1,
    "views_per_shard": 2,
    "export": {"enabled": True},
}
NAMED = copy.deepcopy(CONFIG)
NAMED["scenes"]["room"]["setups"]["desk"] = {"emitters": [{"names": ["desk lamp", "emitter-0"], "off": True}]}

LAST = {"material_maps": 3, "render_views": 1, "olat_views": 1, "export_room": 1, "check_export": 1}
AFTER_EMITTERS = {"emitters": 2, "refine": 2, "fit": 2, "review": 1, "relight_views": 1, **LAST}
AFTER_EMITTERS |= {"scene_metrics": 1, "findings": 1, "scene_report": 1}
"""All that depends on what emits; samples, cache, background and bake do not."""


def lamps(*triangles):
    return [{"emitter": f"emitter-{n}", "triangles": frozenset(own), "power": 1.0} for n, own in enumerate(triangles)]


class File:
    """The file of two lamps, as a run of the pipeline writes it, and what a person changes in it."""

    def __init__(self, root):
        self.path = root / "results" / "room" / "emitters_review.yaml"
        write_review(self.path, refreshed(None, lamps({4, 5}, {8, 9}), 20))

    def decide(self, lamp, **values):
        content = yaml.safe_load(self.path.read_text())
        content["emitters"][lamp] |= values
        self.path.write_text(yaml.safe_dump(content))


def test_what_is_decided_reruns_what_depends_on_it(workspace, monkeypatch):
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)
    here.snakemake()
    file = File(here.root)
    assert here.planned() == {}  # an untouched file is as good as none

    file.decide(1, name="desk lamp")
    assert here.planned() == {"review": 1, "export_room": 1, "check_export": 1, "scene_report": 1}

    file.decide(1, name=None, verdict="reject")
    text = here.snakemake("--dry-run")
    because = re.findall(r"^(?:local)?rule (\w+):\n(?:    .*\n)*?    reason: (.*)\n", text, re.MULTILINE)
    assert Counter(rule for rule, _ in because if rule != "all") == AFTER_EMITTERS
    # the decision itself is the reason for these jobs, for all others it is the files that they write
    assert {rule for rule, reason in because if "Params have changed" in reason} == {"emitters"}
    here.snakemake()
    assert here.planned() == {}
    calls = [call for call in here.calls() if "--decisions" in call]
    assert [call[0] for call in calls] == ["emitters", "emitters", "review"]


def test_names_reach_the_setups_that_use_them(workspace, monkeypatch):
    here = workspace(NAMED)
    monkeypatch.chdir(here.root)
    config = here.root / "config" / "config.yaml"
    config.write_text(config.read_text().replace("'off': true", "off: true"))  # a key that YAML takes for false
    file = File(here.root)
    file.decide(0, verdict="accept")
    file.decide(1, name="desk lamp", merge_with="emitter-0")
    relit = {job.label: "--emitter-names" in job.options for job in here.jobs() if job.verb == "relight"}
    assert relit == {"relight.off.val-000": False, "relight.desk.val-000": True}
    here.fipt_run()
    assert here.planned() == {}


def test_a_wrong_file_ends_the_run_before_anything_runs(workspace, monkeypatch):
    here = workspace(CONFIG)
    monkeypatch.chdir(here.root)
    File(here.root).decide(1, merge_with="emitter-3")
    said = "emitter-1 is to merge with 'emitter-3', which is no emitter; there are emitter-0"
    text = here.snakemake(succeeds=False)
    assert any(said in line for line in text.splitlines())
    assert "Traceback" not in text
    assert said in here.fipt_run(code=2)
    assert not (here.root / "calls.txt").exists()


def test_a_setup_may_only_use_names_that_were_given(workspace, monkeypatch):
    here = workspace(NAMED)
    monkeypatch.chdir(here.root)
    said = "setups.desk of scene room names the emitter 'desk lamp', and none has this name"
    assert said in here.snakemake("--dry-run", succeeds=False)
    file = File(here.root)
    file.decide(1, name="desk lmp")
    with pytest.raises(FiptError, match=re.escape(said) + ".*there are desk lmp, emitter-N"):
        assert load(NAMED).scenes["room"].decisions.review
    file.decide(1, name="desk lamp")
    assert load(NAMED).scenes["room"].decisions.review
