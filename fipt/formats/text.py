"""Text and JSON: one reader, whose failures are one line with the file's name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.files import existing_file
from fipt.strict_json import parse_json

MALFORMED = (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError)
"""What damaged content of a file raises, when it is parsed and when its values are taken out."""


def read_text(path: str | Path, what: str) -> str:
    """Read a file of UTF-8 text, with or without a mark of its order of bytes.

    Raises
    ------
    FiptError
        If it is missing, a folder, may not be read, or is not UTF-8.
    """
    existing_file(path, what)
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FiptError(f"{path} must be UTF-8 text; byte {error.start} is not", "save it as UTF-8") from error
    except OSError as error:
        raise FiptError(f"{path} cannot be read ({error.strerror})", "check its permissions") from error


def read_json(path: str | Path, what: str, remedy: str = "correct the file") -> Any:
    """Read a JSON file.

    Raises
    ------
    FiptError
        As `read_text`, or if it is no JSON: cut, nested too deeply, with a number of too many digits.
    """
    text = read_text(path, what)
    try:
        return parse_json(text)
    except RecursionError as error:
        raise FiptError(f"{path} is not JSON that can be read (nested too deeply)", remedy) from error
    except ValueError as error:
        raise FiptError(f"{path} is not JSON ({error})", remedy) from error
