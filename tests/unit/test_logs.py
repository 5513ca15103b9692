"""Log records as plain lines."""

import logging

import pytest

from fipt.logs import show_logs


@pytest.fixture(autouse=True)
def _handlers():
    log = logging.getLogger("fipt")
    before, level = list(log.handlers), log.level
    yield
    log.handlers[:] = before
    log.setLevel(level)


def test_information_has_no_prefix_and_warnings_have_one(capsys) -> None:
    show_logs()
    show_logs()
    log = logging.getLogger("fipt.stages.some")
    log.info("read %d views", 3)
    log.warning("one is dark")
    assert capsys.readouterr().err == "read 3 views\nwarning: one is dark\n"
