"""What a run reads is never cleared: inputs are compared with the folders of results before anything runs.

The workflow removes what a job will write, and a stage replaces whole folders. So nothing that the configuration names
may lie in results/SCENE, whatever it is called there: by its path, by a link, or on a disk that ignores case.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from fipt.config.layout import RESULTS
from fipt.config.reading import Configuration
from fipt.config.scene import SceneConfig
from fipt.config.sources.base import plain_path
from fipt.errors import FiptError
from fipt.formats.places import OwnedPlaces, same_place
from fipt.settings import dumped

_TRACES = (".lock", "logs", "stats")
"""What every run leaves in results/SCENE before it writes a dataset."""


def check_kept(config: Configuration) -> None:
    """Refuse a configuration whose run would clear what it reads.

    Raises
    ------
    FiptError
        One line that names the key, the file and the folder of results that it lies in.
    """
    owned = OwnedPlaces((name, Path(RESULTS, name)) for name in config.scenes)
    for name, scene in config.scenes.items():
        for key, path in _named(scene):
            for file in (path, *_links(path)):
                _check_input(scene, key, file, owned)
        for file in _files(scene):
            plain_path(file)
            _check_input(scene, "path", file, owned)
        _check_foreign(Path(RESULTS, name))


def _files(scene: SceneConfig) -> list[str]:
    with suppress(FiptError):  # a scene that nobody asked for needs no data
        return scene.source.given_files()
    return []


def _check_input(scene: SceneConfig, key: str, path: str, owned: OwnedPlaces) -> None:
    found = owned.owner(path)
    if found is None:
        return
    owner, place = found
    if place == Path(RESULTS, owner) and (place / "stats").is_dir() and _is_made(scene, owner, path):
        return
    real = Path(path).resolve()
    shown = "" if real == Path.cwd() / path else f" (that is {real})"
    through = "" if place == Path(RESULTS, owner) else f", through the link {place}"
    raise FiptError(
        f"scene {scene.name}: {key} names {path}{shown}; it lies in {RESULTS}/{owner}{through}: a run would clear it",
        f"move it out of {RESULTS}/{owner} and correct {key}",
    )


def _is_made(scene: SceneConfig, owner: str, path: str) -> bool:
    """Whether a run makes again what a scene reads there: another scene's results, the room that it photographs."""
    room = Path(scene.layout.room_folder).resolve()
    return owner != scene.name or (scene.source.simulated and Path(path).resolve().is_relative_to(room))


def _check_foreign(results: Path) -> None:
    """Refuse a dataset that somebody put where the program's own would go."""
    dataset = results / "dataset"
    if not (dataset / "transforms.json").is_file() or (dataset / "views.json").is_file():
        return
    if not any((results / name).exists() for name in _TRACES):
        raise FiptError(
            f"{dataset} holds a transforms.json that no run wrote: a run would clear it",
            f"move it out of {RESULTS}, and name it as the path of the scene",
        )


def _named(scene: SceneConfig) -> Iterator[tuple[str, str]]:
    """Key and text of every value of a scene that is the path of something that exists."""
    values: dict[str, Any] = dict(scene.said)
    values |= {f"settings.{section}": dumped(value) for section, value in scene.settings.items()}
    values |= {f"setups.{name}": dumped(setup) for name, setup in scene.given_setups.items()}
    for key, text in _texts(values, ""):
        try:
            path = scene.place.path(text, key)
            if Path(path).exists():
                yield key, path
        except (FiptError, ValueError, RuntimeError):  # no data_root, no path, no such user: told where it is needed
            continue


def _texts(values: Any, key: str) -> Iterator[tuple[str, str]]:
    if isinstance(values, dict):
        for name, value in values.items():
            yield from _texts(value, f"{key}.{name}".strip("."))
    elif isinstance(values, list):
        for value in values:
            yield from _texts(value, key)
    elif isinstance(values, str) and values:
        yield key, values


def _links(folder: str) -> Iterable[str]:
    """Links in a folder and in those directly below it: files of a source may lie elsewhere."""
    if not Path(folder).is_dir():
        return
    for entry in _entries(folder):
        if same_place(entry.path, RESULTS):
            continue
        if entry.is_symlink():
            yield entry.path
        elif entry.is_dir():
            yield from (inner.path for inner in _entries(entry.path) if inner.is_symlink())


def _entries(folder: str) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as found:
            return list(found)
    except OSError:  # told where it is read
        return []
