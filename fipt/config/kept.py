"""What a run reads is never cleared: inputs are compared with the folders of results before anything runs.

The workflow removes what a job will write, and a stage replaces whole folders. So nothing that the configuration names
may lie in results/SCENE, whatever it is called there: by its path, by a link, or on a disk that ignores case.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from fipt.config.layout import RESULTS, Layout
from fipt.config.reading import Configuration
from fipt.config.scene import SceneConfig
from fipt.config.sources.base import ESTIMATED, RECONSTRUCTED
from fipt.errors import FiptError
from fipt.formats.files import manifest_beside
from fipt.formats.manifests import manifest_stage
from fipt.formats.places import OwnedPlaces, same_place, with_folders
from fipt.settings import dumped
from fipt.stages.import_results.files import result_folders

PATHS = re.compile(r"(.*\.)?(file|given|mesh|model|path|poses|prior|reference|scan)|segments")
"""Keys whose values are paths; those of other keys are words, whatever is called like them."""

_WRITTEN = "|".join(
    sorted(
        {
            re.sub(r"\\{\w+\\}", ".+", re.escape(text.split("/")[2]))
            for text in Layout.patterns().values()
            if "/" in text
        }
    )
)
"""Regular expression of the names in results/SCENE that a run writes."""


def check_kept(config: Configuration) -> None:
    """Refuse a configuration whose run would clear what it reads.

    Raises
    ------
    FiptError
        One line that names the key, the file and the folder of results that it lies in.
    """
    owned = _owned(config)
    for scene, key, path in _common_paths(config):
        for file in (path, *_links(path)):
            _check_input(scene, key, file, owned)
    for scene in config.scenes.values():
        files = scene.given_files()
        for key, path in named_paths(scene):
            # of what is known file by file, other links are not read
            for file in (path, *([] if key == "path" and files else _links(path))):
                _check_input(scene, key, file, owned)
        for file in files:
            _check_input(scene, "path", file, owned)
        for key, folder in _results_of_others(scene):
            for file in (folder, *_links(folder)):
                _check_input(scene, key, file, owned)
    for name in config.scenes:
        _check_foreign(Path(RESULTS, name))


def check_files(config: Configuration, files: Iterable[str | Path]) -> None:
    """Refuse files of the configuration itself that lie in what its run would clear."""
    owned = _owned(config)
    for file in files:
        found = owned.owner(file)
        if found is not None:
            where = f"{RESULTS}/{found[0]}"
            raise FiptError(
                f"the configuration file {file} lies in {where}{_through(*found)}: a run would clear it",
                f"move it out of {where}",
            )


def _owned(config: Configuration) -> OwnedPlaces:
    return OwnedPlaces(((name, Path(RESULTS, name)) for name in config.scenes), _WRITTEN)


def _through(owner: str, place: Path) -> str:
    """The link in the results of a scene by which a path lies there, in words."""
    return "" if place == Path(RESULTS, owner) else f", through the link {place}"


def _results_of_others(scene: SceneConfig) -> Iterator[tuple[str, str]]:
    """Key and folder of what other programs estimated of a scene: it may lie deep below the folder that is named."""
    for name, card in scene.methods.cards.items():
        settings = scene.methods.run(name).settings["import_results"] if card.estimator == "imported" else None
        if settings is None or settings.path is None:
            continue
        key = f"methods.{name}.settings.import_results.path"
        try:
            placed = settings.model_copy(update={"path": scene.place.path(settings.path, key)})
        except FiptError:  # no data_root: told where it is needed
            continue
        yield from ((key, str(folder)) for folder in result_folders(placed, scene.name) if folder.is_dir())


def _check_input(scene: SceneConfig, key: str, path: str, owned: OwnedPlaces) -> None:
    found = owned.owner(path)
    if found is None:
        return
    owner, place = found
    made = place == Path(RESULTS, owner) and _is_made(path, place)
    if made and (owner != scene.name or _is_photographed(scene, path)):
        return
    if made:
        raise FiptError(
            f"scene {scene.name}: {key} names {path}, a result of the scene itself: a run may write it anew",
            f"copy it out of {RESULTS}/{owner} and name the copy in {key}",
        )
    real = Path(path).resolve()
    shown = "" if real == Path.cwd() / path else f" (that is {real})"
    through = _through(owner, place)
    raise FiptError(
        f"scene {scene.name}: {key} names {path}{shown}; it lies in {RESULTS}/{owner}{through}: a run would clear it",
        f"move it out of {RESULTS}/{owner} and correct {key}",
    )


def _is_made(path: str | Path, results: Path) -> bool:
    """Whether a run made what lies there: views.json or a manifest of ours in a folder from it up to the results, or
    beside one. What merely lies in the results of a scene that ran may be somebody's own.
    """
    root = results.resolve()
    folders = [place for place in with_folders(path) if root in place.parents]
    return any((folder / "views.json").is_file() or any(map(manifest_stage, _manifests(folder))) for folder in folders)


def _manifests(folder: Path) -> Iterator[Path]:
    """What may be manifests of a folder: in it, beside it, beside it of a shard."""
    yield from folder.glob("*.manifest.json")
    yield manifest_beside(folder)
    yield from folder.parent.glob(f"{glob.escape(folder.name)}.*.manifest.json")


def _is_photographed(scene: SceneConfig, path: str) -> bool:
    """Whether it is of the room that a simulated camera takes, which is made before anything reads it."""
    return scene.source.simulated and Path(path).resolve().is_relative_to(Path(scene.layout.room_folder).resolve())


def _check_foreign(results: Path) -> None:
    """Refuse a dataset that somebody put where the program's own would go."""
    dataset = results / "dataset"
    if (dataset / "transforms.json").is_file() and not _is_made(dataset, results):
        raise FiptError(
            f"{dataset} holds a transforms.json that no run wrote: a run would clear it",
            f"move it out of {RESULTS}, and name it as the path of the scene",
        )


def _common_paths(config: Configuration) -> Iterator[tuple[SceneConfig, str, str]]:
    """Any scene, key and path of what the configuration names for all of them: the sheet of rooms, cards of methods."""
    scene = next(iter(config.scenes.values()))
    if config.sheet is not None:
        yield scene, "scenes", config.sheet.path
    for key, path in _existing(scene, {"methods": config.plain.get("methods") or {}}):
        yield scene, key, path


def named_paths(scene: SceneConfig) -> Iterator[tuple[str, str]]:
    """Key and text of every value of a scene that is the path of something that exists."""
    values: dict[str, Any] = dict(scene.said)
    values |= {f"settings.{section}": dumped(value) for section, value in scene.settings.items()}
    values |= {f"setups.{name}": dumped(setup) for name, setup in scene.given_setups.items()}
    yield from _existing(scene, values)


def files_in_folders(scene: SceneConfig) -> list[str]:
    """Files that jobs read of folders that a scene names: photographs under setups, ids of views, depth maps."""
    found: list[str] = []
    with suppress(FiptError):  # a run may end before it needs them
        found += scene.setups.reference_files()
    with suppress(FiptError):
        found += scene.segmentation.files() if scene.segmentation.by_view() else []
    with suppress(FiptError):
        found += [*scene.given_depth(), *scene.given_prior()] if scene.source.reconstructed else []
    return found


def _existing(scene: SceneConfig, values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Key and path of every such value; ``scene`` tells what {data_root} stands for."""
    for key, text in _texts(values, ""):
        if not PATHS.fullmatch(key) or text in (ESTIMATED, RECONSTRUCTED):
            continue
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
