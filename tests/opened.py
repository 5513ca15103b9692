"""Which files of a folder a piece of work opens and changes, seen by the system: native libraries and children too."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

_OPENED, _OVERFLOW, _DIRECTORY = 0x20, 0x4000, 0x40000000
_NONBLOCK = os.O_NONBLOCK
"""Of linux/inotify.h."""


@dataclass
class Opened:
    """Paths below the folder: those that were there before and were opened, and those that are new or changed."""

    read: set[Path] = field(default_factory=set)
    written: set[Path] = field(default_factory=set)


@contextmanager
def opened(folder: Path) -> Iterator[Opened]:
    """Watch a folder while the body runs; what it yields is filled in at the end (Linux only)."""
    seen, before = Opened(), _states(folder)
    libc = ctypes.CDLL(None, use_errno=True)
    events = libc.inotify_init1(_NONBLOCK)
    assert events >= 0, os.strerror(ctypes.get_errno())
    places = {}
    for place in {folder, *(path for path in folder.rglob("*") if path.is_dir())}:
        watch = libc.inotify_add_watch(events, os.fsencode(place), _OPENED)
        assert watch >= 0, os.strerror(ctypes.get_errno())
        places[watch] = place
    try:
        yield seen
        paths = {places[watch] / name for watch, name in _read(events)}
    finally:
        os.close(events)
    after = _states(folder)
    seen.written = {path for path, state in after.items() if before.get(path) != state}
    seen.read = (paths & before.keys()) - seen.written


def _states(folder: Path) -> dict[Path, tuple[int, int, int]]:
    """Inode, time and size of every file below a folder."""
    found = {path: path.stat() for path in folder.rglob("*") if path.is_file()}
    return {path: (state.st_ino, state.st_mtime_ns, state.st_size) for path, state in found.items()}


def _read(events: int) -> Iterator[tuple[int, str]]:
    """Watch and name of each file that was opened."""
    while True:
        try:
            data = os.read(events, 1 << 20)
        except BlockingIOError:
            return
        while data:
            watch, mask, _, length = struct.unpack_from("iIII", data)
            assert not mask & _OVERFLOW, "more files were opened than the system notes"
            if not mask & _DIRECTORY and length:
                yield watch, os.fsdecode(data[16 : 16 + length].rstrip(b"\0"))
            data = data[16 + length :]
