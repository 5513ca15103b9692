"""The one exception for failures that a user can mend."""

from __future__ import annotations

#: Exit code of the command line for every `FiptError`, and for wrong usage.
EXIT_CODE = 2


class FiptError(Exception):
    """An anticipated failure: one line that says what is wrong and what to do about it.

    The command line prints it as ``fipt: error: <message>; <remedy>`` and exits with code 2.
    Anything that is not a `FiptError` is a mistake in the program and keeps its traceback.

    Parameters
    ----------
    message : str
        What must hold and what was found instead (name the file, the key, the count).
    remedy : str, optional
        What the user can do about it.

    Attributes
    ----------
    message, remedy : str
        The two parts, each on one line.
    """

    def __init__(self, message: str, remedy: str = "") -> None:
        self.message = _one_line(message)
        self.remedy = _one_line(remedy)
        # Both arguments go to Exception, so that the error survives pickling between processes.
        super().__init__(self.message, self.remedy)

    def __str__(self) -> str:
        return f"{self.message}; {self.remedy}" if self.remedy else self.message


def _one_line(text: str) -> str:
    """Join lines and runs of blanks: messages of other libraries may span several lines."""
    return " ".join(str(text).split())
