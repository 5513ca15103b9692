"""What makes plans of many rooms quick, and that the plans are those of Snakemake alone."""

import os
import re

import pytest
from snakemake.io import IOFile
from snakemake.iocontainers import Namedlist

from benchmarks.jobs import REPOSITORY
from fipt.workflow.plans import FilesByEnding, OneGuard
from tests.workflow.planned import changed
from tests.workflow.prepared import run

PLAIN = "import fipt.workflow.plans as plans; plans.plan_quickly = open('plain', 'w').close"
"""As ``sitecustomize``: Snakemake's own ways in place of ours; a file tells that it was read."""

OTHERS = """
from fipt.workflow.plans import plan_quickly

plan_quickly()

rule all:
    input:
        "last.txt",
        lambda wildcards: "given.txt",
        "a.copy",

rule first:
    output:
        one="made/first.txt",
        two="made/second.txt",
    shell:
        "touch {output}"

rule last:
    input:
        ancient("given.txt"),
        rules.first.output.two,
        unpack(lambda wildcards: {"one": "made/first.txt", "pair": ["given.txt", "made/second.txt"]}),
    output:
        "last.txt",
    shell:
        "cat {input.one} {input.pair} > {output}"

rule copy:
    input:
        lambda wildcards: ["{name}.txt", ancient("given.txt")],
        pair=["{name}.txt", "{name}.txt"],
    output:
        "{name}.copy",
    shell:
        "cat {input.pair} > {output}"
"""
"""Inputs of other kinds than our rules have."""

NESTED = """
from fipt.workflow.plans import plan_quickly

plan_quickly()

rule all:
    input:
        "made",
        "made-up/file",
        "made/inside/file",

rule folder:
    output:
        directory("made"),

rule file:
    output:
        "{name}/file",
"""
"""A rule writes into the folder of another; a third name lies between both in the alphabet."""


class MakingRule:
    """Stands in for a rule that makes files."""

    def __init__(self, *patterns):
        self.patterns = patterns

    def products(self):
        return [IOFile(pattern) for pattern in self.patterns]


def test_rules_are_found_by_the_ends_of_names():
    samples = MakingRule("results/{scene}/samples/{shard,val-0}", "results/{scene}/samples/{shard}.json")
    other = MakingRule("results/{scene}/cache.npz", "results/all.json", "elsewhere/{scene}.json")
    index = FilesByEnding([samples, other])
    for name, found in {
        "results/room/samples/val-0": [samples],
        "results/room/samples/val-1": [],  # its wildcard may not be that
        "results/room/samples/val-1.json": [samples],
        "results/room/cache.npz": [other],
        "results/all.json": [other],
        "elsewhere/room.json": [other],
        "nowhere/room.json": [],
        "z": [],
    }.items():
        assert index.match_producers(name) == set(found), name


def told(text):
    """What a dry run says of every job, in one order: that of jobs, and of files in a reason, depends on their sets."""
    jobs = re.findall(r"^rule (\w+):\n(.*?)\n\n", text, re.MULTILINE | re.DOTALL)
    lines = [[name, *(sorted(re.split(r"[ ,;]+", line)) for line in body.split("\n"))] for name, body in jobs]
    return sorted([[line for line in job if "jobid:" not in line] for job in lines], key=str)


@pytest.fixture
def plans(tmp_path_factory):
    """A function that plans in a working directory with Snakemake's own ways, and with ours."""
    patch = tmp_path_factory.mktemp("patch")
    (patch / "sitecustomize.py").write_text(PLAIN)

    def both(here, *options):
        own = here.environment["PYTHONPATH"]
        texts = []
        for path in (f"{own}{os.pathsep}{patch}", own):
            here.environment["PYTHONPATH"] = path
            texts.append(told(here.snakemake("--dry-run", *options)))
        assert texts[0]
        assert (here.root / "plain").exists()
        return texts

    return both


@pytest.mark.slow
def test_plans_are_those_of_snakemake_alone(workspace, plans):
    here = workspace(changed(compare={"methods": ["irradiance", "converged"], "seeds": 1}))
    for target in ("report", "compare"):
        plain, ours = plans(here, target)
        assert ours == plain
    here.snakemake()
    here.configure(changed(fit={"steps": 7}, rounds=2))
    (here.root / "results/room/cache.npz").unlink()
    (here.root / "results/room/samples/train-000.manifest.json").write_text("other samples")
    plain, ours = plans(here)
    assert len(plain) > 10
    assert ours == plain


def planned(folder, text):
    """A dry run of a workflow."""
    (folder / "Snakefile").write_text(text)
    return run("snakemake", ["--dry-run", "--printshellcmds"], folder, os.environ | {"PYTHONPATH": str(REPOSITORY)})


def test_inputs_of_other_kinds_are_snakemakes(tmp_path):
    (tmp_path / "a.txt").touch()
    (tmp_path / "a.copy").touch()
    os.utime(tmp_path / "a.copy", (1, 1))
    (tmp_path / "given.txt").touch()
    ours = planned(tmp_path, OTHERS)
    assert ours.returncode == 0, ours.stdout + ours.stderr
    assert "cat made/first.txt given.txt made/second.txt > last.txt" in ours.stdout
    assert "reason: Updated input files: a.txt\n" in ours.stdout  # not the other, which is ancient
    plain = planned(tmp_path, OTHERS.replace("\nplan_quickly()", ""))
    assert told(ours.stdout) == told(plain.stdout) != []


def test_outputs_in_folders_of_other_jobs_are_refused(tmp_path):
    done = planned(tmp_path, NESTED)
    assert done.returncode != 0
    assert "made/inside/file" in done.stdout + done.stderr
    assert "child" in (done.stdout + done.stderr).lower()
    fine = planned(tmp_path, NESTED.replace("made/inside/file", "made.up/file"))
    assert fine.returncode == 0, fine.stdout + fine.stderr


def test_lists_of_files_have_their_guards_in_common(monkeypatch):
    monkeypatch.setattr("snakemake.iocontainers.AttributeGuard", OneGuard)
    one, other = Namedlist(["a"]), Namedlist(["b"])
    assert one.sort is other.sort is not one.index
    assert one.get("sort", "nothing of that name") == "nothing of that name"
    with pytest.raises(AttributeError, match=r"sort\(\)"):
        other.sort()
