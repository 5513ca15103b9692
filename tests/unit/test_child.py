"""Calls in a process of their own: arrays go and come back, hangs and crashes are survived and told."""

import logging
import os
import time

import numpy as np
import pytest

from fipt.child import run_in_child
from fipt.errors import FiptError
from tests import planted


def test_arrays_numbers_and_text_go_and_come_back():
    values = np.arange(6, dtype=np.float32).reshape(2, 3)
    found = run_in_child(planted.doubled, {"values": values, "text": "Grüße"}, limit=60)
    np.testing.assert_array_equal(found["values"], 2 * values)
    assert found["values"].dtype == np.float32
    assert str(found["text"]) == "Grüße!"


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system does not bind processes to CPUs")
def test_a_process_is_bound_to_so_many_cpus():
    usable = os.sched_getaffinity(0)
    assert len(run_in_child(planted.own_cpus, {}, limit=60, cpus=1)["cpus"]) == 1
    assert set(run_in_child(planted.own_cpus, {}, limit=60)["cpus"].tolist()) == usable
    assert os.sched_getaffinity(0) == usable


@pytest.mark.parametrize(
    ("failure", "limit", "fate"),
    [
        ("hang", 6, "did not end within 6 s"),
        ("crash", 60, "was ended by SIGSEGV"),
        ("abort", 60, "was ended by SIGABRT"),
    ],
)
def test_a_hang_and_a_crash_are_survived_and_told(tmp_path, caplog, failure, limit, fate):
    arguments = {"folder": str(tmp_path), "failure": failure, "failures": 1}
    with caplog.at_level(logging.WARNING, "fipt"):
        found = run_in_child(planted.failing, arguments, limit=limit)
    assert found["attempt"] == 2
    assert caplog.messages == [f"tests.planted:failing {fate} in attempt 1 of 3; it is tried again"]


@pytest.mark.parametrize(("failure", "limit", "fate"), [("hang", 5, "did not end"), ("crash", 60, "SIGSEGV")])
def test_when_every_attempt_fails_one_line_says_so(tmp_path, failure, limit, fate):
    arguments = {"folder": str(tmp_path), "failure": failure, "failures": 9}
    with pytest.raises(FiptError, match=rf"failing .*{fate}.* in each of 2 attempts") as caught:
        run_in_child(planted.failing, arguments, limit=limit, attempts=2)
    assert "\n" not in str(caught.value)
    assert len(list(tmp_path.iterdir())) == 2


def test_errors_that_trying_again_would_not_mend_come_at_once(caplog):
    with pytest.raises(FiptError, match="the charts do not fit; raise the limit"):
        run_in_child(planted.refusing, {}, limit=60)
    with pytest.raises(RuntimeError, match=r"(?s)mistaken failed in its process.*ValueError: a mistake"):
        run_in_child(planted.mistaken, {}, limit=60)
    assert caplog.messages == []


def test_a_destructor_that_hangs_never_runs():
    begin = time.monotonic()
    assert run_in_child(planted.destructor_that_hangs, {}, limit=60)["done"]
    assert time.monotonic() - begin < 30


def test_nothing_is_pickled():
    with pytest.raises(RuntimeError, match="nothing is pickled"):
        run_in_child(planted.objects, {}, limit=60)
    with pytest.raises(ValueError, match="nothing is pickled"):
        run_in_child(planted.doubled, {"values": np.array([{}], dtype=object), "text": ""}, limit=60)


def test_a_folder_does_not_bring_modules(tmp_path, monkeypatch):
    """A file numpy.py in the working folder, which may hold anybody's data, is not run."""
    (tmp_path / "numpy.py").write_text("raise SystemExit('executed')")
    monkeypatch.chdir(tmp_path)
    assert run_in_child(planted.doubled, {"values": np.ones(1), "text": ""}, limit=60)["values"] == [2]
