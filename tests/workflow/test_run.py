"""``fipt run``: what it says and leaves, with a stand-in for the verbs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.jobs import WORKFLOW
from fipt.cli.run import STOPPING_POINTS, _record, asked_for
from fipt.config import load
from fipt.errors import FiptError
from fipt.lock import locked
from fipt.provenance import read_provenance
from fipt.tidy import tidy

CONFIG = {"scenes": {"room": {"source": "procedural"}}, "rounds": 0, "synthesize": {"train_views": 2, "val_views": 1}}


def told(text):
    """The line that says what is wrong; it is one line."""
    (line,) = [line for line in text.splitlines() if line.startswith("fipt: ")]
    assert "Traceback" not in text
    return line


def test_a_run_then_nothing_to_do(workspace):
    here = workspace(CONFIG)
    first = here.fipt_run()
    lines = first.splitlines()
    assert lines[0].startswith("[1/19] synthesize")
    assert "[19/19] report" in lines
    assert (here.root / "results/room/report.html").is_file()
    assert "report.html" in read_provenance(here.root / "results/room")["files"]
    assert here.planned() == {}
    assert here.fipt_run() == "everything is up to date\nfipt: nothing was found wrong\n"


def test_plain_snakemake_goes_on_where_it_ended(workspace):
    here = workspace(CONFIG)
    here.fipt_run("materials")
    assert not (here.root / "results/room/report.html").exists()
    assert here.planned().keys() & {"material_maps", "fit", "bake"} == set()


def test_a_dry_run_lists_the_jobs(workspace):
    here = workspace(CONFIG)
    said = here.fipt_run("--dry-run", "--config", "fit={steps: 7}")
    assert "fit.round-0: Missing output files" in said
    assert not (here.root / "results").exists()


def test_targets_are_those_of_the_workflow():
    rules = (WORKFLOW / "rules" / "targets.smk").read_text()
    assert [line[5:-1] for line in rules.splitlines() if line.startswith("rule ")] == list(STOPPING_POINTS)


def test_several_scenes_and_a_target():
    known = ("a", "b", "materials")
    assert asked_for(["a"], known) == (["a"], "report")
    assert asked_for(["materials"], known) == (["materials"], "report")
    assert asked_for(["a", "b"], known) == (["a", "b"], "report")
    assert asked_for(["a", "b", "a", "compare"], known) == (["a", "b"], "compare")
    assert asked_for(["b", "materials"], known) == (["b"], "materials")
    assert asked_for(["b", "results/b/cache.npz"], known) == (["b"], "results/b/cache.npz")
    assert asked_for(["all"], known) == (list(known), "report")
    assert asked_for(["all", "materials"], known) == (list(known), "materials")
    assert asked_for(["all", "results/b/cache.npz"], known) == (list(known), "results/b/cache.npz")
    assert asked_for(["all"], ("a", "all")) == (["all"], "report")
    with pytest.raises(FiptError, match=r"results/a/cache\.npz is of scene a, which is not asked for; fipt run a "):
        asked_for(["b", "results/a/cache.npz"], known)


def test_several_scenes_are_compared_together(workspace):
    here = workspace({**CONFIG, "scenes": {name: {"source": "procedural"} for name in ("a", "b")}})
    wanted = ("compare", "--config", "compare={methods: [irradiance]}", "--dry-run")
    assert "rooms-page: Missing output files: results/compare/page.html" in here.fipt_run("b", *wanted, scene="a")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--config", "fit={stepz: 3}"], "fipt: error: unknown key fit.stepz (did you mean steps?); allowed in fit: "),
        (["reprt"], "fipt: error: there is no target 'reprt'; targets: capture, dataset, "),
        (["materials", "--quick"], "fipt: error: --quick is of the target compare; this is materials; fipt run room"),
        (
            ["compare", "--config", "compare={methods: [ours]}"],
            "fipt: error: compare.methods: there is no method 'ours'",
        ),
        (["results/room/nothing"], "fipt: error: No rule to produce results/room/nothing"),
        (["--configfile", "none.yaml"], "fipt: error: the config file is missing: none.yaml; check the path"),
    ],
)
def test_what_the_user_can_mend_is_one_line(workspace, options, said):
    here = workspace(CONFIG)
    text = here.fipt_run(*options, code=2)
    assert told(text).startswith(said)
    assert not (here.root / "calls.txt").exists()


def test_an_unknown_scene(workspace):
    here = workspace({**CONFIG, "scenes": {"attic": {"source": "procedural"}}})
    assert told(here.fipt_run(code=2)) == "fipt: error: there is no scene 'room'; scenes: attic"


@pytest.mark.parametrize("done", [False, True])
def test_a_given_file_that_is_missing_is_told_before_anything_runs(workspace, done):
    here = workspace(CONFIG)
    if done:
        here.fipt_run()
        (here.root / "calls.txt").unlink()
    said = told(here.fipt_run("--config", "environment={mode: given, file: none.exr}", code=2))
    assert "none.exr" in said
    assert not (here.root / "calls.txt").exists()


FAILING = """#!{python}
import sys
{body}
"""


def break_verbs(here, body):
    """Put another program in the place of the verbs."""
    (here.root / "bin" / "fipt").write_text(FAILING.format(python=sys.executable, body=body))


def test_the_line_of_a_verb_is_what_the_user_sees(workspace):
    here = workspace(CONFIG)
    break_verbs(here, "print('warning: dark'); sys.exit('fipt: error: the mesh has no triangles; repair it')")
    said = here.fipt_run(code=2)
    assert told(said) == "fipt: error: the mesh has no triangles; repair it"
    assert "synthesize: warning: dark" in said
    assert "snakemake" not in said.lower()


def test_a_mistake_of_ours_shows_the_log(workspace):
    here = workspace(CONFIG)
    break_verbs(here, "1 / 0")
    said = here.fipt_run(code=1)
    assert "ZeroDivisionError: division by zero" in said
    assert said.endswith("fipt: error: synthesize failed; the whole log is results/room/logs/synthesize.log\n")


def asleep_in(here, verb):
    """Start ``fipt run`` and wait until a verb sleeps; the run and the verb's process id."""
    running = subprocess.Popen(
        [sys.executable, "-m", "fipt.cli.main", "run", "room"],
        cwd=here.root,
        env=here.environment | {"SLEEP": verb},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    )
    asleep = here.root / "sleeping.pid"
    end = time.monotonic() + 120
    while not (asleep.exists() and asleep.read_text()):
        assert time.monotonic() < end
        time.sleep(0.1)
    return running, int(asleep.read_text())


def ended(pid):
    """Whether a process ends within some seconds."""
    end = time.monotonic() + 20
    while time.monotonic() < end:
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z":
            return True
        time.sleep(0.1)
    return False


def test_two_runs_refuse_each_other_and_a_killed_one_is_completed(workspace):
    here = workspace(CONFIG)
    running, _ = asleep_in(here, "bake")
    assert told(here.fipt_run(code=2)) == (
        "fipt: error: another run works on scene room; wait for it to end, or stop it"
    )
    assert "another run works on scene room" in here.snakemake(succeeds=False)
    os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
    assert here.planned()["bake"] == 1
    assert "bake.round-0.train-000" in here.fipt_run()
    assert here.planned() == {}


def test_ctrl_c_ends_the_run_and_its_job(workspace):
    here = workspace(CONFIG)
    running, verb = asleep_in(here, "bake")
    running.send_signal(signal.SIGINT)  # to the run alone: a terminal would send it to the verb as well
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130
    assert said.endswith("fipt: interrupted\n")
    assert ended(verb)
    assert "bake.round-0.train-000" in here.fipt_run()


@pytest.mark.skipif(sys.platform != "linux", reason="the system kills a child with its parent on Linux")
def test_no_job_outlives_a_run_that_is_killed(tmp_path):
    """With the real ``fipt``, which asks for it."""
    ask = "import os, time; from fipt.cli.process import end_with_parent, is_job"
    ask += "; assert is_job(); end_with_parent(os.getppid())"
    script = f"{ask}; print(os.getpid(), flush=True); time.sleep(60)"
    start = (
        "import os, subprocess, sys, time; os.environ['FIPT_RUN'] = str(os.getpid());"
        f"subprocess.Popen([sys.executable, '-c', {script!r}]); time.sleep(60)"
    )
    run = subprocess.Popen([sys.executable, "-c", start], cwd=WORKFLOW.parents[1], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    job = int(run.stdout.readline())
    run.kill()
    run.wait()
    assert ended(job)
    run.stdout.close()


def test_the_lock_ends_with_its_holder(tmp_path):
    with (
        locked(tmp_path / "room"),
        pytest.raises(FiptError, match="another run works on scene room"),
        locked(tmp_path / "room"),
    ):
        pytest.fail("two runs at a time")
    with locked(tmp_path / "room"):
        pass


SHEET = (
    "name\tsource\tsettings.synthesize.train_views\nhall\tprocedural\t2\nroom\tprocedural\t3\nattic\tprocedural\t2\n"
)
BROKEN = """
import sys
if "results/room/dataset" in " ".join(sys.argv) and "synthesize-views" in sys.argv:
    sys.exit("fipt: error: the disk of this room is full; free some space")
"""


def test_a_room_that_fails_does_not_stop_the_others(workspace):
    here = workspace({**CONFIG, "scenes": "rooms.tsv"})
    (here.root / "rooms.tsv").write_text(SHEET)
    fipt = here.root / "bin" / "fipt"
    whole = fipt.read_text()
    first, rest = whole.split("\n", 1)
    fipt.write_text(first + BROKEN + rest)
    said = here.fipt_run("metrics", "--cores", "2", scene="all", code=2)
    lines = said.splitlines()
    begin = lines.index("fipt: 1 room failed, the others went on:")
    log = "results/room/logs/synthesize.train-000.log"
    why = f"synthesize.train-000: the disk of this room is full; free some space  ({log})"
    assert f"  room  {why}" in lines[begin:]
    assert "Traceback" not in said
    results = here.root / "results"
    assert [(results / name / "metrics.json").is_file() for name in ("hall", "room", "attic")] == [True, False, True]
    assert (results / "hall" / "provenance.json").is_file()
    assert not (results / "room" / "provenance.json").exists()
    fipt.write_text(whole)
    said = here.fipt_run("metrics", scene="room")
    assert "failed" not in said
    assert (results / "room" / "provenance.json").is_file()


def test_a_run_that_makes_nothing_records_nothing(workspace):
    here = workspace({**CONFIG, "rounds": 1, "scenes": {name: {"source": "procedural"} for name in ("room", "attic")}})
    here.fipt_run("attic", "materials")
    files = [here.root / "results" / name / "provenance.json" for name in ("room", "attic")]
    before = [file.read_bytes() for file in files]
    other = ("attic", "materials", "--config", "rounds=0")
    with locked(here.root / "results" / "attic"):
        assert "another run works on scene attic" in told(here.fipt_run(*other, code=2))
    assert [file.read_bytes() for file in files] == before
    missing = ("--config", "setups={evening: {environment: {file: none.exr}}}")
    assert "none.exr" in told(here.fipt_run(*other, *missing, code=2))
    assert [file.read_bytes() for file in files] == before


def test_photographs_under_a_setup_are_recorded(tmp_path):
    photograph = tmp_path / "evening" / "val_000.exr"
    results = tmp_path / "results" / "room"
    for folder in (photograph.parent, results):
        folder.mkdir(parents=True)
    photograph.write_bytes(b"exr")
    room = CONFIG["scenes"]["room"] | {"setups": {"evening": {"reference": str(photograph.parent)}}}
    _record(load({**CONFIG, "scenes": {"room": room}}).scenes["room"], CONFIG, results)
    assert list(read_provenance(results)["inputs"]) == [str(photograph)]


def test_a_tidied_room_is_up_to_date_and_is_made_again_where_it_must(workspace):
    here = workspace(CONFIG)
    here.fipt_run()
    tidy(here.root / "results" / "room", dry=False)
    assert not list((here.root / "results/room").glob("samples/*/"))
    assert here.planned() == {}
    assert here.planned("--config", "report={width: 100}") == {"scene_report": 1}
    for manifest in here.root.glob("results/room/*/**/train-*.manifest.json"):
        manifest.unlink()  # as fipt.tidy.restore does of manifests that list files; those of the stand-in do not
    assert here.planned() == {}
    again = here.planned("--config", "fit={steps: 7}")
    assert {"samples", "bake", "fit"} <= again.keys()
    assert "synthesize_views" not in again


FAILS = """
if sys.argv[1] == "{verb}" and "slow" in " ".join(sys.argv):
    sys.exit("fipt: error: no surface at 1, 2, 3; move it")
"""
"""Goes into the stand-in for the verbs."""


def test_a_method_that_fails_is_a_row_of_the_table(workspace):
    slow = {"label": "Slow", "kind": "ablation", "source": "here", "settings": {"fit": {"steps": 9}}}
    here = workspace(
        {**CONFIG, "methods": {"slow": slow, "two": slow}, "compare": {"methods": ["slow", "two"], "seeds": 1}}
    )
    verbs = here.root / "bin" / "fipt"
    works = verbs.read_text()
    verbs.write_text(works.replace("flags = ", FAILS.format(verb="materials") + "flags = ", 1))
    said = here.fipt_run("compare")
    assert "failed: slow; the comparison goes on" in said
    called = next(call for call in here.calls() if call[0] == "compare")
    methods = called[called.index("--methods") + 1].split(",")
    assert methods == ["results/room/methods/fipt/method.json", "results/room/methods/two/method.json"]
    failed = called[called.index("--failed") + 1]
    assert failed.startswith("slow=materials.")
    assert failed.endswith(": no surface at 1, 2, 3; move it")
    verbs.write_text(works)  # it is tried again
    assert "compare" in here.fipt_run("compare")
    called = [call for call in here.calls() if call[0] == "compare"][-1]
    assert "--failed" not in called
    assert not list((here.root / "results/room/methods").glob("*/failed.json"))
