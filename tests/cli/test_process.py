"""Messages of the command line: records as plain lines."""

import logging

import pytest

from fipt.cli.process import configure_logging


@pytest.fixture(autouse=True)
def _handlers():
    log = logging.getLogger("fipt")
    before, level = list(log.handlers), log.level
    yield
    log.handlers[:] = before
    log.setLevel(level)


def test_information_has_no_prefix_and_warnings_have_one(capsys) -> None:
    configure_logging()
    configure_logging()
    log = logging.getLogger("fipt.stages.some")
    log.info("read %d views", 3)
    log.warning("one is dark")
    assert capsys.readouterr().err == "read 3 views\nwarning: one is dark\n"


@pytest.mark.parametrize(("level", "shown"), [("warning", ""), ("info", "seen\n"), ("nonsense", "seen\n")])
def test_the_environment_chooses_the_level(capsys, monkeypatch, level, shown) -> None:
    monkeypatch.setenv("FIPT_LOG", level)
    configure_logging()
    logging.getLogger("fipt.stages.some").info("seen")
    assert capsys.readouterr().err == shown
