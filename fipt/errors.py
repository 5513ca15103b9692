"""The one exception for failures that a user can mend."""

from __future__ import annotations

import errno
import re

_NO_MEMORY = re.compile(r"std::bad_alloc|can(not|'t) allocate memory|out of memory", re.IGNORECASE)
_QUOTA = re.compile(r"quota exceeded", re.IGNORECASE)
_LARGE = re.compile(r"file too large", re.IGNORECASE)
_FULL = re.compile(r"no space left on device", re.IGNORECASE)
_CUT = re.compile(r"^\d+ requested and \d+ written$")

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


def shortage(error: BaseException, path: object = "") -> FiptError | None:
    """Say that memory, the disk or a quota was too small, if an error says so in the way of some library; else None.

    NumPy's writer gives no number of the system, libraries in C++ raise `RuntimeError`.

    Parameters
    ----------
    error
        What was raised.
    path
        What was written.
    """
    number, text = getattr(error, "errno", None), str(error)
    place = path or getattr(error, "filename", None)
    writing = f" while writing {place}" if place else ""
    if isinstance(error, MemoryError) or number == errno.ENOMEM or _NO_MEMORY.search(text):
        why = f" ({text})" if text else ""
        return FiptError(f"there is too little memory{why}", "close other programs, or use smaller images")
    if number == errno.EDQUOT or _QUOTA.search(text):
        return FiptError(f"the quota of the disk is used up{writing}", "free some space and run again")
    if number == errno.EFBIG or _LARGE.search(text):
        return FiptError(
            f"a file is larger than the system allows{writing}", "raise the limit (ulimit -f), or use another disk"
        )
    if number == errno.ENOSPC or _FULL.search(text):
        return FiptError(f"the disk is full{writing}", "free some space and run again")
    if _CUT.search(text):
        return FiptError(f"the disk is full{writing}, or a quota or limit is reached", "free some space and run again")
    return None


def unloadable(error: ImportError) -> FiptError | None:
    """Say that a package is missing or broken; None where a module of ours is: a mistake in the program."""
    name = (error.name or "").partition(".")[0]
    if name == "fipt":
        return None
    return FiptError(
        f"the package {name or 'that is needed'} cannot be loaded ({error})",
        "install what requirements.lock lists (make setup); fipt doctor says what is missing",
    )


def unreadable(path: object, error: BaseException, found: str, remedy: str) -> FiptError:
    """Say that a file is ``found``, unless it was memory that failed: then it may be sound."""
    if isinstance(error, MemoryError):
        return FiptError(
            f"{path} cannot be read: memory is too small, or a size in it is absurd ({error})",
            f"close other programs, or {remedy}",
        )
    return FiptError(f"{path} {found}", remedy)


def _one_line(text: str) -> str:
    """Join lines and runs of blanks: messages of other libraries may span several lines."""
    return " ".join(str(text).split())
