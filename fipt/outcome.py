"""Which jobs of a scene did not end well, from what every job leaves: a log, and figures where it ended."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fipt.lock import LOCK, held

OUR_LINE = re.compile(r"^.*?fipt(?:: error|\.errors\.FiptError): (.+)$", re.MULTILINE)
"""What a verb, a rules file or the last line of a traceback says of something that the user can mend."""

_NOTHING_SAID = "it was stopped before it said anything"
STOPPED = re.compile(rf"^fipt: (interrupted|terminated)$|^{_NOTHING_SAID}$")
"""Line of a job that did not fail by itself."""

_ENDED = re.compile(r"^fipt: (interrupted|terminated)$|^Traceback \(most recent", re.MULTILINE)
"""... and of what nobody can mend."""


@dataclass(frozen=True)
class Failure:
    """A job that did not end well.

    Attributes
    ----------
    scene
        Name of its room.
    stage
        The job, as its log is called.
    line
        Why, in one line.
    log
        Its whole log.
    """

    scene: str
    stage: str
    line: str
    log: Path


def failures(results: Path, lock: Path | None = None) -> list[Failure]:
    """Jobs of the last run of a scene that have no figures, the last one first; while it goes on, also those at work.

    Parameters
    ----------
    results
        Folder of the scene, or of a run of a method on it.
    lock
        Of the scene, as new as the begin of the run by the clock of the disk; None: that in ``results``.
    """
    logs = [log for log in results.glob("logs/*.log") if not (results / "stats" / f"{log.stem}.json").is_file()]
    lock = results / LOCK if lock is None else lock
    since = lock.stat().st_mtime_ns if lock.is_file() else 0
    logs = [log for log in logs if log.stat().st_mtime_ns >= since]
    logs.sort(key=lambda log: (log.stat().st_mtime_ns, log.name), reverse=True)
    return [Failure(results.name, log.stem, why(log), log) for log in logs]


def failures_so_far(results: Path) -> list[Failure]:
    """As `failures`; while a run goes on, only the jobs whose logs say how they ended: the others are at work."""
    found = failures(results)
    return [each for each in found if _says_its_end(each.log)] if found and held(results) else found


def _says_its_end(log: Path) -> bool:
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    return any(pattern.search(text) for pattern in (OUR_LINE, _ENDED))


def why(log: Path) -> str:
    """Say in one line why a job failed: what it says itself, else the last line of its log."""
    text = log.read_text(encoding="utf-8", errors="replace") if log.is_file() else ""
    ours = OUR_LINE.findall(text)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return ours[-1] if ours else lines[-1] if lines else _NOTHING_SAID


def listed(folders: Sequence[Path]) -> str:
    """Name what failed in several rooms: how many rooms, then a line a job with its room, why, and the log.

    Nothing is said of one room, whose failed job has said it.
    """
    found = [each for results in folders for each in failures(results)] if len(folders) > 1 else []
    if not found:
        return ""
    rooms = len({each.scene for each in found})
    lines = [f"  {each.scene}  {each.stage}: {each.line}  ({each.log})" for each in found]
    head = f"fipt: {rooms} room{'s' if rooms > 1 else ''} failed, the others went on:"
    return "".join(f"{line}\n" for line in [head, *lines])
