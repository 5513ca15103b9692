"""Memory and time that jobs asked for, against what they used."""

import json

import pytest

from benchmarks.asked import main, read_usage
from fipt.config.resources import WORKFLOW
from fipt.errors import FiptError


def record(results, label, rule, used, seconds=60.0, copied=False):
    """What the workflow writes of a job that asked for a gigabyte and ten minutes."""
    for folder in ("benchmarks", "stats"):
        (results / folder).mkdir(parents=True, exist_ok=True)
    content = {"rule_name": rule, "max_rss": used, "s": seconds}
    content["resources"] = {"mem_mb": 1000 + WORKFLOW, "runtime": 10}
    (results / "benchmarks" / f"{label}.jsonl").write_text(json.dumps(content) + "\n")
    (results / "stats" / f"{label}.json").write_text(json.dumps({"copied": True} if copied else {}))


def test_the_job_that_used_most_stands_for_its_rule(tmp_path, capsys):
    record(tmp_path, "fit.round-0", "fit", 500.0)
    record(tmp_path, "fit.round-1", "fit", 700.0, seconds=120.0)
    record(tmp_path, "fit.round-2", "fit", 10.0, copied=True)
    record(tmp_path, "fuse", "fuse", 200.0)
    assert main([str(tmp_path)]) == 0
    fit, fuse = (line.split() for line in capsys.readouterr().out.splitlines()[1:])
    assert fit == ["fit", "2", "1000", "700", "0.70", "10", "2.0"]
    assert fuse[-2:] == ["much", "memory"]


@pytest.mark.parametrize(("used", "seconds", "said"), [(950.0, 60.0, "too little memory"), (500.0, 590.0, "time")])
def test_a_job_that_used_more_than_it_may(tmp_path, capsys, used, seconds, said):
    record(tmp_path, "fit.round-0", "fit", used, seconds)
    assert main([str(tmp_path)]) == 1
    assert said in capsys.readouterr().out


def test_a_room_that_did_not_run(tmp_path):
    with pytest.raises(FiptError, match="holds no records of jobs"):
        read_usage(tmp_path)
