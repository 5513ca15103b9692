"""Runs of methods that failed: why, kept beside them, so that a comparison goes on without them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.text import read_json
from fipt.lock import LOCK
from fipt.outcome import STOPPED, Failure, failures

if TYPE_CHECKING:
    from fipt.config.scene import SceneConfig

NOTE = "failed.json"
"""In the folder of a run."""


def note_failures(scenes: Iterable[SceneConfig]) -> None:
    """Keep of every run of a method why its first job failed in the last run of the workflow, if one did."""
    for scene in scenes:
        results = Path(scene.layout.root)
        judged = {each.stage: each for each in failures(results)}
        for run in scene.methods.runs():
            own = results / "methods" / run.name
            found = [*failures(own, results / LOCK), *filter(None, [judged.get(f"score.{run.name}")])]
            found = [each for each in found if not STOPPED.search(each.line)]
            if own.is_dir() and found and run != run.parent:
                _note(own / NOTE, found[-1], scene.methods.card_json(run.name))


def _note(path: Path, failure: Failure, card: str) -> None:
    content = {"stage": failure.stage, "why": failure.line, "log": str(failure.log), "card": json.loads(card)}
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def why_failed(scene: SceneConfig, run: str) -> str | None:
    """Why a run of a method failed with the settings that it has now; None: it has not, or nobody has tried."""
    path = Path(scene.layout.root, "methods", run, NOTE)
    if not path.is_file():
        return None
    try:
        found = read_json(path, "why a method failed", "delete it: the method is tried again")
        same = found["card"] == json.loads(scene.methods.card_json(run))
        return f"{found['stage']}: {found['why']}" if same else None
    except (KeyError, TypeError) as error:
        raise FiptError(f"{path} does not say why a method failed ({error!r})", "delete it") from error


def forget_failures(scene: SceneConfig) -> None:
    """Forget what failed: every method is tried again."""
    for name in noted(scene):
        Path(scene.layout.root, "methods", name, NOTE).unlink(missing_ok=True)


def noted(scene: SceneConfig) -> list[str]:
    """Names of the runs of which is noted why they failed."""
    return sorted(path.parent.name for path in Path(scene.layout.root, "methods").glob(f"*/{NOTE}"))
