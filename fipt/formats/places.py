"""Whether two paths are one place on the disk, whatever they are called: links, ``..``, disks that ignore case."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

Identity = tuple[int, int]
"""Device and number of a file or folder: what the system itself tells places apart by."""


def identity(path: str | Path) -> Identity | None:
    """Identity of what a path leads to, links followed; None where there is nothing, or nothing that can be read."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):  # a text with a null byte is no path
        return None
    return found.st_dev, found.st_ino


def with_folders(path: str | Path) -> Iterator[Path]:
    """Yield what a path leads to, links followed, and every folder above it."""
    try:
        real = Path(path).resolve()
    except (OSError, ValueError, RuntimeError):
        return
    yield real
    yield from real.parents


def same_place(first: str | Path, second: str | Path) -> bool:
    """Whether two paths lead to one existing file or folder."""
    found = identity(first)
    return found is not None and found == identity(second)


def links_below(folder: str | Path) -> Iterator[Path]:
    """Yield every symbolic link in a folder and the folders in it; none is followed."""
    for place, folders, files in os.walk(folder):
        yield from (path for name in (*folders, *files) if (path := Path(place, name)).is_symlink())


class OwnedPlaces:
    """Folders, and what links in them lead to: places whose content may be replaced.

    Parameters
    ----------
    folders
        Name -> folder; one that does not exist owns nothing yet.
    written
        Regular expression of the names in such a folder that may be replaced: links elsewhere in it are followed by
        nobody.
    """

    def __init__(self, folders: Iterable[tuple[str, Path]], written: str = ".*") -> None:
        self._known: dict[Path, Identity | None] = {}
        self._owners: dict[Identity, tuple[str, Path]] = {}
        names = re.compile(written, re.IGNORECASE)  # some disks ignore case
        for name, folder in folders:
            links = (link for link in links_below(folder) if names.fullmatch(link.relative_to(folder).parts[0]))
            for path in (folder, *links):
                found = identity(path)
                if found is not None:
                    self._owners.setdefault(found, (name, path))

    def owner(self, path: str | Path) -> tuple[str, Path] | None:
        """Name of the folder that a path lies in, and the folder or the link in it by which it does; None: in none."""
        if not self._owners:
            return None
        for place in with_folders(path):
            if place not in self._known:  # many files lie in few folders
                self._known[place] = identity(place)
            found = self._known[place]
            if found in self._owners:
                return self._owners[found]
        return None
