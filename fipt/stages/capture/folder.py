"""Which files of a folder are its photographs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fipt.errors import FiptError
from fipt.stages.capture.raw import LDR_SUFFIXES, MERGED_SUFFIXES, RAW_SUFFIXES


def photographs(folder: Path) -> tuple[str, list[Path]]:
    """Kind and files of a folder's photographs; where RAW files lie beside JPEGs of the same shots, the RAW files."""
    files = _files(folder)
    for kind, suffixes in (("raw", RAW_SUFFIXES), ("merged", MERGED_SUFFIXES), ("ldr", LDR_SUFFIXES)):
        found = [path for path in files if path.suffix.lower() in suffixes]
        if found:
            return kind, found
    raise FiptError(
        f"{folder} must hold photographs (RAW, EXR, HDR, JPEG or PNG); it holds {len(files)} other files",
        "check the path; photographs in subfolders are not looked for",
    )


def others(folder: Path, read: Sequence[Path]) -> tuple[list[str], list[str]]:
    """Names of photographs beside those that are ``read``: with a name of these but for the ending, and the others."""
    suffixes, stems = RAW_SUFFIXES | MERGED_SUFFIXES | LDR_SUFFIXES, {path.stem.casefold() for path in read}
    beside = [path for path in _files(folder) if path.suffix.lower() in suffixes and path not in read]
    paired = [path.name for path in beside if path.stem.casefold() in stems]
    return paired, [path.name for path in beside if path.stem.casefold() not in stems]


def _files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
