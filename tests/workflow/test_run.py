"""``fipt run`` without numerics: what it calls, what it skips, what it never takes for finished."""

import json
from pathlib import Path

import pytest

from fipt.config.legacy import load
from fipt.errors import FiptError
from fipt.run import locked, run

CONFIG = {
    "scenes": {"room": {"source": "procedural", "setups": {"off": {"emitters": [{"scale": 0}]}}}},
    "rounds": 1,
}


class Verbs:
    """Stands in for the verbs: writes what a job promises and notes its label."""

    def __init__(self, fail_in=None):
        self.called = []
        self.fail_in = fail_in

    def __call__(self, job):
        self.called.append(job.label)
        for path in job.folders:
            Path(path).mkdir(parents=True)
        if job.label == self.fail_in:
            raise KeyboardInterrupt
        inputs = [Path(path).read_text() for path in job.inputs]
        for path in job.outputs:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text(json.dumps([job.options, hash(tuple(inputs))]))


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def called(config=CONFIG, **keys):
    verbs = Verbs()
    run(load({**config, **keys}).scenes["room"], verbs)
    return verbs.called


def test_a_second_run_has_nothing_to_do():
    first = called()
    assert first[0] == "synthesize"
    assert first[-1] == "report"
    assert called() == []


def test_other_settings_run_the_stage_and_what_follows():
    first = called()
    after = called(fit={"steps": 3})
    assert after == first[first.index("fit.round-0") :]
    assert called(fit={"steps": 3}, report={"width": 9}) == ["report"]


def test_another_round_keeps_the_finished_ones():
    called()
    more = called(rounds=2)
    assert [label for label in more if "round-" in label] == [
        "refine.round-2.train-000",
        "refine.round-2.train-001",
        "fit.round-2",
        "emitters.round-2",
    ]


def test_emitters_of_the_first_round_only():
    labels = called(emitters={"every_round": False})
    assert [label for label in labels if label.startswith("emitters")] == ["emitters.round-0"]


def test_missing_and_changed_outputs_are_made_again():
    called()
    Path("results/room/cache.npz").write_text("damaged")
    assert called()[0] == "cache"
    Path("results/room/metrics.json").unlink()
    assert called() == ["metrics"]  # with the same content, the page stays


def test_what_a_stopped_job_left_is_not_taken_for_finished():
    called()
    verbs = Verbs(fail_in="bake.round-0.train-000")
    changed = load({**CONFIG, "bake": {"seed": 3}}).scenes["room"]
    with pytest.raises(KeyboardInterrupt):
        run(changed, verbs)
    assert not Path("results/room/round-0/shading/train-000.manifest.json").exists()
    assert called(bake={"seed": 3})[0] == "bake.round-0.train-000"


def test_an_output_that_is_missing_is_an_error():
    with pytest.raises(FiptError, match="an output of synthesize is missing"):
        run(load(CONFIG).scenes["room"], lambda job: None)


def test_one_run_at_a_time():
    with (
        locked("room"),
        pytest.raises(FiptError, match="another run works on scene room"),
        locked("room"),
    ):
        pytest.fail("two runs at a time")
    with locked("room"):
        pass


def test_a_given_file_that_is_missing_is_told_before_anything_runs():
    verbs = Verbs()
    scene = load({**CONFIG, "environment": {"mode": "given", "file": "none.exr"}}).scenes["room"]
    with pytest.raises(FiptError, match=r"an input of background is missing: none\.exr"):
        run(scene, verbs)
    assert verbs.called == []
