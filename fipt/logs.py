"""Log records as plain lines on standard error, for the command line."""

import logging
import sys

_PREFIX = {logging.WARNING: "warning: ", logging.ERROR: "error: ", logging.CRITICAL: "error: "}


class _PlainLines(logging.Handler):
    """Writes to whatever standard error is at the moment: tests and notebooks exchange it."""

    def emit(self, record: logging.LogRecord) -> None:
        sys.stderr.write(_PREFIX.get(record.levelno, "") + record.getMessage() + "\n")


def show_logs() -> None:
    """Show records of the package from ``info`` on; calling it again changes nothing."""
    log = logging.getLogger("fipt")
    log.setLevel(logging.INFO)
    if not any(isinstance(handler, _PlainLines) for handler in log.handlers):
        log.addHandler(_PlainLines())
