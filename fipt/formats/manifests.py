"""Manifests: what a stage wrote, with which settings; and the figures of its run."""

import hashlib
import json
import os
import resource
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.files import existing_file, manifest_beside, write_text
from fipt.formats.text import MALFORMED
from fipt.registry import VERSIONS


def file_hash(path: str | Path) -> str:
    """SHA-256 of a file's content, as hex."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def withdraw_manifest(path: Path) -> None:
    """Remove a manifest before what it lists is exchanged: it must vouch neither for that nor against it meanwhile."""
    path.unlink(missing_ok=True)


def write_manifest(path: str | Path, stage: str, files: Iterable[Path], settings: Mapping[str, Any]) -> None:
    """Write the manifest of a stage's output: file names relative to it, hashes, settings, stage version.

    It holds no time stamp, so that unchanged content reruns nothing downstream.
    """
    path = Path(path)
    content = {
        "stage": stage,
        "version": VERSIONS[stage],
        "settings": dict(settings),
        "files": {str(file.relative_to(path.parent)): file_hash(file) for file in sorted(files)},
    }
    write_text(path, json.dumps(content, indent=1, sort_keys=True) + "\n")


def read_manifest(path: str | Path, stage: str) -> dict[str, Any]:
    """Read a manifest and check that this version of ``stage`` wrote it.

    Raises
    ------
    FiptError
        If it is missing, damaged, of another stage or another stage version.
    """
    existing_file(path, f"the manifest of stage {stage}")
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        found = (content["stage"], content["version"])
    except MALFORMED as error:
        raise FiptError(f"{path} is not a manifest ({error})", "delete it and run its stage again") from error
    if found != (stage, VERSIONS[stage]):
        raise FiptError(
            f"{path} must be of stage {stage} version {VERSIONS[stage]}; found {found[0]} version {found[1]}",
            "run that stage again",
        )
    return content


class ListedFiles:
    """What manifests say of the files below a folder: a file that is read must be the one that was written.

    Parameters
    ----------
    folder
        What is read. Its manifest is FOLDER.manifest.json, or stands in it. Of several that list a file, one must be
        right; files that none lists are not checked.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._listed: dict[str, dict[str, Path]] | None = None
        self._checked: set[tuple[str, int, int]] = set()

    def check(self, path: str | Path) -> Path:
        """Return the path of a file of the folder, once its content is what its stage wrote.

        Raises
        ------
        FiptError
            If it is cut, changed or of another run.
        """
        path = Path(path)
        listed = self._entries().get(os.path.realpath(path))
        if not listed or not path.is_file():
            return path  # a missing file is told by what reads it
        state = path.stat()
        key = (str(path), state.st_size, state.st_mtime_ns)
        if key not in self._checked and file_hash(path) not in listed:
            newest = max(listed.values(), key=lambda manifest: manifest.stat().st_mtime_ns)
            raise FiptError(
                f"{path} is not what its stage wrote: its content differs from that of {newest.name}",
                f"delete {newest} and run again",
            )
        self._checked.add(key)
        return path

    def lists(self, path: str | Path) -> bool:
        """Whether a manifest lists a file, there or not."""
        return os.path.realpath(path) in self._entries()

    def _entries(self) -> dict[str, dict[str, Path]]:
        """Real path -> hash -> manifest. Shards that are cut in another way leave manifests of what was."""
        if self._listed is None:
            self._listed = {}
            for manifest in (manifest_beside(self.folder), *sorted(self.folder.glob("*.manifest.json"))):
                for name, value in listed_files(manifest).items():
                    self._listed.setdefault(os.path.realpath(manifest.parent / name), {})[str(value)] = manifest
        return self._listed


def listed_files(manifest: Path) -> dict[str, Any]:
    """Names and hashes of a manifest; none where there is no manifest, or none that can be read."""
    try:
        return listed_in(manifest.read_bytes())
    except OSError:
        return {}


def listed_in(content: bytes) -> dict[str, Any]:
    """Names and hashes in the content of a manifest; none where it is none."""
    try:
        return dict(json.loads(content)["files"])
    except MALFORMED:
        return {}


def manifest_stage(path: str | Path) -> str | None:
    """Stage that wrote a manifest; None where there is none, or it is damaged."""
    try:
        return str(json.loads(Path(path).read_text(encoding="utf-8"))["stage"])
    except (OSError, *MALFORMED):
        return None


Stats = dict[str, Any]
"""Figures of one run of a stage, for stats/."""


@contextmanager
def recorded(path: str | Path | None, stage: str, settings: Mapping[str, Any]) -> Iterator[Stats]:
    """Time a stage's run; write wall time, peak memory, the figures set in it, settings and versions to ``path``."""
    from fipt import __version__

    stats: Stats = {}
    start = time.perf_counter()
    yield stats
    if path is None:
        return
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    content = {
        "stage": stage,
        "version": VERSIONS[stage],
        "fipt": __version__,
        "wall_s": round(time.perf_counter() - start, 3),
        "peak_memory_bytes": peak,
        **stats,
        "settings": dict(settings),
    }
    write_text(path, json.dumps(content, indent=1, sort_keys=True, default=str) + "\n")
