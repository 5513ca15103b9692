"""Files that are either complete or absent, and names that stay inside their folder."""

import errno
import logging
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from fipt.conventions import NAME_PATTERN
from fipt.errors import FiptError, shortage

log = logging.getLogger(__name__)


def _explained(error: OSError | RuntimeError, path: Path) -> Exception:
    """What a user can mend, as a FiptError; other errors as they are."""
    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return FiptError(f"{path} cannot be written ({os.strerror(number)})", "check the folder's permissions")
    if number in (errno.ENOTDIR, errno.EEXIST):
        return FiptError(f"{path} cannot be written: a file stands where a folder must", "choose another place")
    if number == errno.ENOENT and Path(str(getattr(error, "filename", ""))).parent == path.parent:
        return FiptError(f"{path} cannot be written ({os.strerror(errno.ENOENT)})", "choose another place")
    if number == errno.EISDIR:
        return FiptError(f"{path} cannot be written: a folder stands where a file must", "choose another name")
    return shortage(error, path) or error


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; rename it to ``path`` when the block ends well.

    The temporary name keeps the suffix, since some writers choose the format by it.

    Raises
    ------
    FiptError
        If the folder cannot be written or the disk is full.
    """
    path = Path(path)
    if path.name in ("", ".."):
        raise FiptError(f"the file to write has no name: {path}", "name it")
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        if (explained := _explained(error, path)) is error:
            raise
        raise explained from error
    finally:
        with suppress(NotADirectoryError):
            temporary.unlink(missing_ok=True)


ANYTHING = ".*"
"""Names in a folder that may be replaced whatever it holds: its caller has looked at it."""


@contextmanager
def atomic_folder(path: str | Path, holds: str) -> Iterator[Path]:
    """Yield a fresh temporary folder beside ``path``; replace ``path`` by it when the block ends well.

    Parameters
    ----------
    path
        Folder to write.
    holds
        Regular expression of the names that may lie in the folder that is replaced: what its writer leaves there. A
        caller that has looked itself gives `ANYTHING`.

    Raises
    ------
    FiptError
        If the folder holds something else, is a link or a file, or cannot be written.
    """
    path = Path(path)
    check_replaced(path, holds)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir(parents=True)
        yield temporary
        if path.exists():
            shutil.rmtree(path)
        os.replace(temporary, path)
    except (OSError, RuntimeError) as error:
        if (explained := _explained(error, path)) is error:
            raise
        raise explained from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def check_replaced(path: Path, holds: str) -> None:
    """Refuse to replace a folder that has no name, is a link or holds names other than ``holds`` and hidden ones.

    Raises
    ------
    FiptError
        One line that names what would be lost.
    """
    if path.name in ("", ".."):
        raise FiptError(f"the folder {path} is replaced, but has no name of its own", "name it from the folder above")
    if path.is_symlink():
        raise FiptError(f"the folder {path} is replaced, but is a link to {path.readlink()}", "remove the link")
    if not path.is_dir():
        return  # a file in its place is told by the system
    foreign = sorted(file.name for file in path.iterdir() if not re.fullmatch(rf"{holds}|\..*", file.name))
    if foreign:
        raise FiptError(f"the folder {path} is replaced, but holds {foreign[0]}", "choose another folder")


def copy_file(source: str | Path, path: str | Path) -> None:
    """Copy a file, whole or not at all; the copy is as new as it is, so that nothing is done again for its age."""
    with atomic(path) as temporary:
        shutil.copyfile(existing_file(source, "a file to copy"), temporary)


def link_folder(source: str | Path, path: str | Path, holds: str) -> list[Path]:
    """Make ``path`` a folder of the same files as ``source``, hard-linked where the disk can; return them.

    ``holds`` as for `atomic_folder`.
    """
    source, path = Path(source), Path(path)
    names = sorted(file.name for file in source.iterdir() if file.is_file())
    with atomic_folder(path, holds) as folder:
        for name in names:
            try:
                os.link(source / name, folder / name)
            except OSError:
                shutil.copyfile(source / name, folder / name)
    return [path / name for name in names]


def make_folder(path: str | Path) -> None:
    """Make a folder and those above it where they are missing.

    Raises
    ------
    FiptError
        If a file stands there, or the folder above cannot be written.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _explained(error, Path(path)) from error


@contextmanager
def nameless(folder: str | Path, size: int) -> Iterator[IO[bytes]]:
    """Yield an open file of ``size`` bytes on the disk of ``folder``; it goes away when nothing refers to it any more.

    Raises
    ------
    FiptError
        If the folder cannot be written or the disk is too full.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, size)  # a disk that is full says so now
            yield file
    except OSError as error:
        raise _explained(error, folder) from error


def write_text(path: str | Path, text: str) -> None:
    """Write ``text`` (UTF-8) to ``path``, whole or not at all."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def existing_file(path: str | Path, what: str) -> Path:
    """Return ``path`` if it is a file, else raise an error that names it and ``what`` it should be."""
    path = Path(path)
    try:
        there = path.is_file()
    except (OSError, ValueError) as error:  # longer than the system allows, or with a null byte
        raise FiptError(f"{what} cannot be at {str(path)[:200]} ({error})", "check the path") from error
    if not there and path.is_dir():
        raise FiptError(f"{what} must be a file; {path} is a folder", "check the path")
    if not there:
        again = next(_listing(path), None)
        raise FiptError(
            f"{what} is missing: {path}",
            f"delete {again} and run again" if again else "check the path, or run the stage that writes it",
        )
    return path


def manifest_beside(folder: str | Path) -> Path:
    """Path of the manifest beside a folder, ``FOLDER.manifest.json``; ``.`` and ``..`` are called by their names."""
    folder = Path(folder)
    if folder.name in ("", ".."):
        folder = folder.resolve()
    return folder.parent / f"{folder.name}.manifest.json"


def made_again(path: str | Path) -> str:
    """Remedy for a damaged result: what to delete, so that the workflow makes it again.

    The workflow knows the files of a folder by their manifest only, which lies beside the folder or above it.
    """
    path = Path(path)
    for folder in list(path.parents)[:4]:
        for manifest in (manifest_beside(folder), *_listing_in(folder, path)):
            if manifest.is_file():
                return f"delete {manifest} and run again"
    return f"delete {path} and run again"


def _listing(path: Path) -> Iterator[Path]:
    """Manifests in the folders above a file that list it, the nearest first."""
    for folder in list(path.parents)[:4]:
        yield from _listing_in(folder, path)


def _listing_in(folder: Path, path: Path) -> list[Path]:
    """Manifests in a folder that list a file, sorted."""
    return sorted(manifest for manifest in folder.glob("*.manifest.json") if _lists(manifest, path))


def _lists(manifest: Path, path: Path) -> bool:
    """Whether a manifest names a file, by its text alone."""
    try:
        return f'"{path.relative_to(manifest.parent)}":' in manifest.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


def check_name(name: str, what: str) -> str:
    """Return ``name`` if it can become a file name inside the results folder.

    Raises
    ------
    FiptError
        If the name holds a path separator, starts with a dot, or is longer than 100 characters.
    """
    if not NAME_PATTERN.fullmatch(name) or ".." in name:
        raise FiptError(
            f"{what} {name!r} cannot be used as a file name",
            "use letters, digits, '_', '-' and '.', starting with a letter or digit",
        )
    return name


def check_distinct(names: Iterable[str], what: str) -> None:
    """Raise FiptError if names differ by case alone: their files would be one on disks that ignore case."""
    known: dict[str, str] = {}
    for name in names:
        other = known.setdefault(name.casefold(), name)
        if other != name:
            raise FiptError(
                f"{what}: {other} and {name} differ by case alone: some disks would give them one file or folder",
                "rename one of them",
            )


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key of names in which IMG_9 comes before IMG_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def check_disk(folder: str | Path, needed: int, what: str) -> None:
    """Raise FiptError unless the disk of ``folder`` has ``needed`` bytes free; log a gigabyte and more."""
    place = Path(folder)
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    if needed >= 1e9:
        log.info("%s takes %s; %s are free", what, _size(needed), _size(free))
    if free < needed * 1.05:
        raise FiptError(
            f"{what} needs {_size(needed)} in {folder}; {_size(free)} are free",
            "free some space or give another results folder",
        )


def _size(count: int) -> str:
    """A number of bytes for people."""
    return f"{count / 1e9:.2f} GB" if count >= 1e9 else f"{count / 1e6:.1f} MB"


def total_memory() -> int:
    """Bytes of main memory, limits of containers included."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    for limit in (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory/memory.limit_in_bytes")):
        text = limit.read_text().strip() if limit.is_file() else ""
        if text.isdigit():
            total = min(total, int(text))
    return total


def check_memory(needed: int, what: str, remedy: str) -> None:
    """Raise FiptError if ``what`` needs more bytes of memory than there are; log an estimate of a gigabyte and more."""
    total = total_memory()
    if needed > total:
        raise FiptError(f"{what} needs about {needed / 1e9:.0f} GB of memory; there are {total / 1e9:.0f} GB", remedy)
    if needed >= 1e9:
        log.info("%s takes about %.1f GB of memory; there are %.1f GB", what, needed / 1e9, total / 1e9)
