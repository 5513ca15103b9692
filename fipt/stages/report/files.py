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


def read_figures(path: Path) -> tuple[dict[str, Any], float]:
    """Figures of metrics.json by split, and the exposure of renderings; none where there is no such file.

    Raises
    ------
    FiptError
        If it holds something else.
    """
    found = read_json(path)
    found = {} if found is None else found
    if not isinstance(found, dict) or not all(
        isinstance(found.get(key) or {}, dict) for key in ("train", "val", "relight", "emitters")
    ):
        raise FiptError(f"{path} does not hold the figures of a scene", "delete it and run fipt metrics again")
    with of_form(path):
        return found, float((found.get("val") or {}).get("render_exposure_scale") or 1.0)


def round_folders(results: Path) -> list[Path]:
    """Return the folders round-0, round-1, ... in order."""
    folders = [path for path in results.glob("round-*/") if path.name[6:].isdigit()]
    return sorted(folders, key=lambda path: int(path.name[6:]))
