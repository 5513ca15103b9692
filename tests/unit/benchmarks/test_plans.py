"""What measures plans of many rooms."""

import re

import pytest

from benchmarks.plans import main


@pytest.mark.parametrize(("options", "plans"), [((), ["all of 2", "one of 2"]), (("--done",), ["all of 2"])])
def test_plans_are_measured(capsys, options, plans):
    main(["2", *options])
    told = re.findall(r"^(.+): ([\d.]+) s, (\d+) MB$", capsys.readouterr().out, re.MULTILINE)
    assert [label for label, *_ in told] == plans
    assert all(0.1 < float(seconds) < 60 and 50 < float(memory) < 500 for _, seconds, memory in told)
