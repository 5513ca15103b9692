"""Files of a results folder as the page reads them."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED


def read_json(path: Path) -> Any:
    """Content of a JSON file; None where it is missing."""
    if not path.is_file():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except MALFORMED as error:
        raise FiptError(f"{path} is not JSON ({error})", "delete it and run its stage again") from error


@contextmanager
def of_form(path: Path) -> Iterator[None]:
    """Tell what cannot be taken out of files of the results as one line that names them."""
    try:
        yield
    except MALFORMED as error:
        raise FiptError(
            f"{path} does not hold what its stage writes ({error!r})", "delete it and run its stage again"
        ) from error


def round_folders(results: Path) -> list[Path]:
    """Return the folders round-0, round-1, ... in order."""
    folders = [path for path in results.glob("round-*/") if path.name[6:].isdigit()]
    return sorted(folders, key=lambda path: int(path.name[6:]))
