"""What measures plans of many rooms."""

import re
import subprocess
import sys

import pytest

from benchmarks.jobs import REPOSITORY

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("options", "plans"), [((), ["all of 2", "one of 2"]), (("--done",), ["all of 2"])])
def test_plans_are_measured(options, plans):
    # by itself: the memory of a process counts from that of the one that it was forked from
    command = [sys.executable, "-m", "benchmarks.plans", "2", *options]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True)
    told = re.findall(r"^(.+): ([\d.]+) s, (\d+) MB$", done.stdout, re.MULTILINE)
    assert [label for label, *_ in told] == plans
    assert all(0.1 < float(seconds) < 60 and 50 < float(memory) < 500 for _, seconds, memory in told)
