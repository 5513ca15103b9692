"""Of which mesh, by which stage and version of it a file was made: written into what stages exchange, checked there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from pathlib import Path
from typing import Any

from fipt.errors import FiptError
from fipt.formats.files import made_again
from fipt.formats.manifests import file_hash
from fipt.registry import VERSIONS

_RUNNING: ContextVar[tuple[str, Path | None] | None] = ContextVar("stage that runs, mesh that it reads", default=None)


@contextmanager
def running(stage: str, dataset: Path | None) -> Iterator[None]:
    """Let what is written meanwhile say that ``stage`` made it, of the mesh of ``dataset``, where it reads one."""
    before = _RUNNING.set((stage, None if dataset is None else dataset / "mesh.ply"))
    try:
        yield
    finally:
        _RUNNING.reset(before)


def origin() -> dict[str, Any]:
    """What a file that is written now says of itself; nothing outside a stage."""
    now = _RUNNING.get()
    if now is None:
        return {}
    mesh = _mesh_now()
    return {"stage": now[0], "version": VERSIONS[now[0]], **({"mesh": mesh} if mesh else {})}


def check_origin(path: str | Path, said: Any) -> None:
    """Refuse a file of another mesh than the running stage reads, or of another version of its stage.

    Parameters
    ----------
    path
        The file.
    said
        What it says of itself; files that say nothing are taken as they are.

    Raises
    ------
    FiptError
        One line that says of what it is.
    """
    if not isinstance(said, Mapping) or _RUNNING.get() is None:
        return
    stage, version, mesh = said.get("stage"), said.get("version"), _mesh_now()
    if stage in VERSIONS and version != VERSIONS[stage]:
        raise FiptError(
            f"{path} was written by version {version} of the stage {stage}; this is version {VERSIONS[stage]}",
            made_again(path),
        )
    if mesh and said.get("mesh", mesh) != mesh:
        raise FiptError(
            f"{path} belongs to another mesh than {_mesh_path()}: it was made before that was exchanged, or of "
            "another scene",
            made_again(path),
        )


def _mesh_path() -> Path | None:
    now = _RUNNING.get()
    return None if now is None else now[1]


def _mesh_now() -> str | None:
    """Hash of the mesh that the running stage reads; None where there is none."""
    path = _mesh_path()
    if path is None or not path.is_file():
        return None
    state = path.stat()
    return _hash_of(path, state.st_size, state.st_mtime_ns)


@cache
def _hash_of(path: Path, size: int, changed: int) -> str:
    """Hash of a file, computed once as long as it stays what it is."""
    return file_hash(path)
