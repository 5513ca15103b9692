"""A lock on a folder that ends with the process that holds it, however that ends."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from fipt.errors import FiptError

log = logging.getLogger(__name__)

LOCK = ".lock"
"""Name of the file in a scene's results; it is as new as the begin of their last run."""

_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS)
"""What a disk of the network says that has no locks."""


@contextmanager
def all_locked(folders: Iterable[Path]) -> Iterator[None]:
    """Lock several folders; see `locked`."""
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(locked(folder))
        yield


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Let one run at a time work in a scene's folder of results.

    The system releases the lock when the process ends, killed or not: nothing is left to be removed by hand.

    Parameters
    ----------
    folder : Path
        The scene's results, ``results/SCENE``; made if it is missing.

    Raises
    ------
    FiptError
        If another run holds the lock, or the folder cannot be written.
    """
    path = folder / LOCK
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = path.open("a")  # never truncated: it may be a link
    except OSError as error:
        raise FiptError(f"{path} cannot be written ({error.strerror})", "check the folder's permissions") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FiptError(f"another run works on scene {folder.name}", "wait for it to end, or stop it") from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            log.warning("%s: this disk has no locks; run one workflow at a time", folder)
        os.utime(path)
        yield


def held(folder: Path) -> bool:
    """Whether a run works in a scene's folder of results; False where the disk has no locks."""
    try:
        with (folder / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # no run has been here, or nobody can know
        return False
    return False
