"""What of a finished room may go: large files that a run makes again, and that nobody looks at.

Their manifests stay: for the workflow the room is up to date, and the record of the run keeps their hashes. A job that
needs what is gone says so. `restore` removes these manifests, and the next run makes again what they stood for.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.manifests import listed_files
from fipt.lock import locked
from fipt.outcome import failures
from fipt.provenance import mark_tidied, read_provenance

GOES = {
    "footprint samples": ("samples/*/",),
    "shading": ("round-*/shading/*/",),
    "depth maps": ("geometry/depth/",),
    "simulated photographs": ("raw/",),
    "work of the poses": ("poses/work/",),
    "checkpoints": ("round-*/*.checkpoint-*",),
}
"""What may go -> its patterns in results/SCENE. Nothing that a person, the report or another program looks at."""


@dataclass(frozen=True)
class Tidied:
    """What goes, or has gone.

    Attributes
    ----------
    sizes
        What it is -> bytes on the disk.
    before, after
        Bytes of all results.
    """

    sizes: dict[str, int]
    before: int
    after: int


def tidy(results: Path, dry: bool) -> Tidied:
    """Remove what may go from the results of a finished room.

    Parameters
    ----------
    results
        Folder of the scene.
    dry
        Remove nothing, only say what would go.

    Raises
    ------
    FiptError
        If the room is not done, or another run works on it.
    """
    if not (results / "report.html").is_file() or failures(results):
        raise FiptError(f"{results} is not done: only finished rooms are tidied", f"finish it: fipt run {results.name}")
    read_provenance(results)
    with locked(results):
        every = [path for path in results.rglob("*") if path.is_file()]
        found = {what: _places(results, patterns) for what, patterns in GOES.items()}
        gone: set[Path] = set()
        sizes = {}
        for what, places in found.items():
            files = {file for place in places for file in _files(place)}
            sizes[what] = _size(files)
            gone |= files
        before, after = _size(every), _size(set(every) - gone)
        if not dry:
            mark_tidied(results, [str(path.relative_to(results)) for path in gone])
            for place in (place for places in found.values() for place in places):
                shutil.rmtree(place) if place.is_dir() else place.unlink()
    return Tidied({what: size for what, size in sizes.items() if size}, before, after)


def restore(results: Path) -> list[str]:
    """Remove the manifests of what is gone, so that the next run makes it again; return their names.

    Raises
    ------
    FiptError
        If there are no results, or another run works on them.
    """
    if not results.is_dir():
        raise FiptError(f"there is no folder {results}", "check the name of the scene")
    with locked(results):
        gone = [path for path in sorted(results.rglob("*.manifest.json")) if _lacks(path)]
        for manifest in gone:
            manifest.unlink()
    return [str(manifest.relative_to(results)) for manifest in gone]


def _lacks(manifest: Path) -> bool:
    return not all((manifest.parent / name).exists() for name in listed_files(manifest))


def _places(results: Path, patterns: tuple[str, ...]) -> list[Path]:
    """Folders and files of patterns; no links, since what they lead to is somebody's own."""
    return [path for pattern in patterns for path in sorted(results.glob(pattern)) if not path.is_symlink()]


def _files(place: Path) -> list[Path]:
    return [place] if place.is_file() else [path for path in place.rglob("*") if path.is_file()]


def _size(files: Iterable[Path]) -> int:
    """Bytes of files on the disk; those with several names count once."""
    return sum({(state.st_dev, state.st_ino): state.st_size for state in map(Path.stat, files)}.values())
