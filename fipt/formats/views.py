"""views.json: which views are accepted, and why others are not."""

import json
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED


def read_rejected(path: str | Path) -> dict[str, str]:
    """Read views.json, or a check's file of its form; return rejected view -> reason. A missing file rejects none."""
    path = Path(path)
    if not path.is_file():
        return {}
    try:
        views = json.loads(path.read_text(encoding="utf-8"))["views"]
        return {name: state["reason"] for name, state in views.items() if not state["accepted"]}
    except MALFORMED as error:
        raise FiptError(f"{path} is not a {path.name} ({error!r})", "run what wrote it again") from error
