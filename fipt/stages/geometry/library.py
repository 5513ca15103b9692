"""Whether open3d can be used: it is an extra, and expects libraries of the system. This module imports little."""

import subprocess
import sys
from importlib.util import find_spec
from typing import Any

from fipt.errors import FiptError

_REMEDY = "pip install 'fipt[geometry]', or give a mesh; fipt doctor tells more"
_SECONDS = 120
"""After which an import counts as hanging."""


def tried() -> tuple[bool, str]:
    """Whether open3d can be imported, in a process of its own since libraries may crash; its version, or why not."""
    try:
        process = subprocess.run(
            [sys.executable, "-c", "import open3d; print(open3d.__version__)"],
            capture_output=True,
            text=True,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False, f"its import did not end within {_SECONDS} s"
    if process.returncode == 0:
        return True, process.stdout.strip().splitlines()[-1]
    words = process.stderr.strip().splitlines()
    return False, words[-1] if words else f"exit code {process.returncode}"


def cannot_fuse(why: str) -> FiptError:
    """What is said where open3d is missing."""
    return FiptError(f"open3d must be importable to make a mesh of photographs ({why})", _REMEDY)


def check_importable() -> None:
    """Raise FiptError unless open3d can be imported."""
    works, said = tried()
    if not works:
        raise cannot_fuse(said)


def check_installed() -> None:
    """Raise FiptError unless open3d is there; that it can be imported is told later, as it takes seconds."""
    if find_spec("open3d") is None:
        raise cannot_fuse("it is not installed")


def import_open3d() -> Any:
    """Return open3d, in the process that uses it; FiptError where it cannot be imported."""
    try:
        import open3d
    except (ImportError, OSError) as error:  # OSError: a library of the system is missing
        raise cannot_fuse(str(error)) from error
    return open3d
