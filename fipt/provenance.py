"""results/SCENE/provenance.json: of what a result was made, and the hash of every file, so that changes are found.

Hashes that a manifest has are taken from it. Others, of single files and of inputs, are computed once: a file whose
size and time are those of the last record keeps its hash, so that what decays is found and not recorded anew.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from fipt import __version__
from fipt.errors import FiptError
from fipt.formats.files import total_memory, write_text
from fipt.formats.manifests import file_hash, listed_files, manifest_stage
from fipt.formats.text import MALFORMED, read_json
from fipt.registry import SECTIONS

NAME = "provenance.json"
_FORMAT = 1
_PASSING = re.compile(
    r"(methods/[^/]+/)?(stats|logs|benchmarks)/.*|provenance\.json|ro-crate-metadata\.json|.*\.checkpoint-[^/]*|.*\.tmp[^/]*|(.*/)?\.[^/]*|poses/work/.*|\.records/.*"
)
"""Files that tell of times, or come and go."""
_SINGLE = {
    r"cache\.npz": "cache",
    r"environment\.npz": "environment",
    r"dataset/check_poses\.json": "check_poses",
    r"round-\d+/emitters\.(npz|json)": "emitters",
    r"round-\d+/(model\.safetensors|confidence\.npz|settled\.json)": "fit",
    r"emitters_review\.yaml": "review",
    r"metrics\.json": "metrics",
    r"findings(\.json|/.*)": "findings",
    r"report\.html": "report",
}
"""Files that no manifest lists -> their stage; others go by the name of their folder."""


@dataclass(frozen=True)
class Difference:
    """What is wrong with one file.

    Attributes
    ----------
    path
        Below the results, or of an input as it is named.
    stage
        Which wrote it; ``inputs``.
    kind
        ``missing``, ``changed`` (its time is another too), ``decayed`` (size and time are as they were) or ``new``.
    """

    path: str
    stage: str
    kind: str


def record(results: Path, configuration: Mapping[str, Any], inputs: Iterable[str]) -> Path:
    """Write provenance.json of a folder of results.

    Parameters
    ----------
    results
        Folder of the scene.
    configuration
        As it was given, JSON types.
    inputs
        Files outside the results that the configuration names.
    """
    before = _known(results / NAME)
    listed = dict(_listed(results))
    files = {}
    for name in _files(results):
        stage, hashes = listed.get(name, (_stage(name), set()))
        old = before.get("files", {}).get(name)
        files[name] = {"stage": stage} | _state(results / name, old, hashes)
    for name, row in before.get("files", {}).items():
        if row.get("tidied"):  # what it was is still known
            files.setdefault(name, row)
    content = {
        "format": _FORMAT,
        "fipt": __version__,
        "python": platform.python_version(),
        "packages": _packages(),
        "machine": _machine(),
        "configuration": dict(configuration),
        "stages": _stages(results),
        "inputs": {
            name: _state(path, before.get("inputs", {}).get(name), set())
            for name in sorted(set(inputs))
            if (path := input_path(results, name)).is_file()
        },
        "files": files,
    }
    write_text(results / NAME, json.dumps(content, indent=1, sort_keys=True) + "\n")
    return results / NAME


def input_path(results: Path, name: str) -> Path:
    """Where an input of a run lies: paths of a configuration are relative to the folder that holds results/."""
    above = results.absolute().parent
    return (above.parent if above.name == "results" else Path.cwd()) / name  # a copy of results lies anywhere


def mark_tidied(results: Path, names: Iterable[str]) -> None:
    """Note in the provenance that files are removed on purpose.

    Raises
    ------
    FiptError
        As `read_provenance`.
    """
    content = read_provenance(results)
    for name in names:
        if name in content["files"]:
            content["files"][name]["tidied"] = True
    write_text(results / NAME, json.dumps(content, indent=1, sort_keys=True) + "\n")


def read_provenance(results: Path) -> dict[str, Any]:
    """Read the provenance of a folder of results.

    Raises
    ------
    FiptError
        If there is none, or it is damaged.
    """
    path, remedy = results / NAME, f"finish the run: fipt run {results.name}"
    if not path.is_file():
        raise FiptError(f"{path} does not exist: nothing says what {results} was", remedy)
    content = read_json(path, "the provenance of a run", remedy)
    if not _is_whole(content):
        raise FiptError(f"{path} is not the provenance of a run", remedy)
    return content


def _is_whole(content: Any) -> bool:
    """Whether a record has its form, and names only files of the results as theirs."""
    if not isinstance(content, dict) or content.get("format") != _FORMAT or not isinstance(content.get("fipt"), str):
        return False
    if not all(isinstance(content.get(key), dict) for key in ("packages", "machine", "stages", "inputs", "files")):
        return False
    rows = [*content["inputs"].values(), *content["files"].values()]
    if not all(isinstance(row, dict) and isinstance(row.get("sha256"), str) for row in rows):
        return False
    numbers = [row.get(key) for row in rows for key in ("size", "mtime_ns")]
    if not all(type(number) is int and abs(number) < 2**63 for number in numbers):
        return False
    names = [(PurePosixPath(name), row.get("stage")) for name, row in content["files"].items()]
    return all(isinstance(stage, str) and not path.is_absolute() and ".." not in path.parts for path, stage in names)


def changes(results: Path) -> list[Difference]:
    """Hash every file again; say what is not as it was recorded, in the order of the stages.

    Raises
    ------
    FiptError
        As `read_provenance`.
    """
    known = read_provenance(results)
    listed = dict(_listed(results))
    found = []
    for name, row in known["inputs"].items():
        found += _judged(input_path(results, name), name, "inputs", row)
    for name, row in known["files"].items():
        found += _judged(results / name, name, row["stage"], row)
    for name in _files(results):
        if name not in known["files"]:
            found.append(Difference(name, listed.get(name, (_stage(name), set()))[0], "new"))
    return sorted(found, key=lambda each: (_order(each.stage), each.path))


def compared(one: Mapping[str, Any], other: Mapping[str, Any]) -> Iterator[str]:
    """Tell two runs apart: a line for what they ran on, for their inputs, and for each stage.

    Parameters
    ----------
    one, other
        As `read_provenance` returns them.
    """
    for key in ("fipt", "python", "packages", "machine"):
        if parts := list(_unequal(one.get(key), other.get(key), key)):
            yield f"{key}: {'; '.join(parts)}"
    yield _content("inputs", one["inputs"], other["inputs"], [])
    kept = [[(row["stage"], name, row) for name, row in each["files"].items()] for each in (one, other)]
    for stage in sorted({stage for rows in kept for stage, _, _ in rows}, key=_order):
        own = [{name: row for known, name, row in rows if known == stage} for rows in kept]
        said = list(_unequal(one["stages"].get(stage), other["stages"].get(stage), ""))
        yield _content(stage, own[0], own[1], said)


def _content(stage: str, one: Mapping[str, Any], other: Mapping[str, Any], said: list[str]) -> str:
    """One line on the files and settings of a stage of two runs."""
    both = one.keys() & other.keys()
    differ = sorted(name for name in both if one[name]["sha256"] != other[name]["sha256"])
    parts = [*said]
    if differ:
        shown = ", ".join(differ[:3]) + (", ..." if len(differ) > 3 else "")
        parts.append(f"{len(differ)} of {len(both)} files differ ({shown})")
    for names, where in ((one.keys() - both, "first"), (other.keys() - both, "second")):
        if names:
            parts.append(f"{len(names)} files only in the {where} ({min(names)})")
    return f"{stage}: {'; '.join(parts) or f'the same bytes, {len(both)} files'}"


def _unequal(one: Any, other: Any, key: str) -> Iterator[str]:
    """Values that differ, by their dotted keys."""
    if isinstance(one, dict) and isinstance(other, dict):
        for name in sorted(one.keys() | other.keys()):
            yield from _unequal(one.get(name), other.get(name), f"{key}.{name}".strip("."))
    elif one != other:
        yield f"{key} {json.dumps(one)} -> {json.dumps(other)}".strip()


def _judged(path: Path, name: str, stage: str, row: Mapping[str, Any]) -> list[Difference]:
    """What is wrong with a file; nothing where its content is as recorded."""
    try:
        there = path.is_file()
    except OSError:  # of a name that no disk has
        there = False
    if not there:
        return [] if row.get("tidied") else [Difference(name, stage, "missing")]
    state = path.stat()
    try:
        if state.st_size == row["size"] and file_hash(path) == row["sha256"]:
            return []
    except OSError:  # of a disk that no longer gives what it was given
        return [Difference(name, stage, "decayed")]
    same = (state.st_size, state.st_mtime_ns) == (row["size"], row["mtime_ns"])
    return [Difference(name, stage, "decayed" if same else "changed")]


def _state(path: Path, old: Mapping[str, Any] | None, listed: set[str]) -> dict[str, Any]:
    """Size, time and hash of a file: of the last record or of a manifest, where one tells it."""
    state = path.stat()
    own = {"size": state.st_size, "mtime_ns": state.st_mtime_ns}
    if old is not None and own.items() <= old.items():
        return own | {"sha256": old["sha256"]}
    return own | {"sha256": next(iter(listed)) if len(listed) == 1 else file_hash(path)}


def _known(path: Path) -> dict[str, Any]:
    """Return the last record; nothing where there is none that can be used."""
    try:
        return read_provenance(path.parent)
    except FiptError:
        return {}


def _files(results: Path) -> list[str]:
    """Names of the files of a folder of results, sorted; those that come and go left out."""
    found = (str(path.relative_to(results)) for path in results.rglob("*") if path.is_file())
    return sorted(name for name in found if not _PASSING.fullmatch(name))


def _listed(results: Path) -> Iterator[tuple[str, tuple[str, set[str]]]]:
    """Name of every file that a manifest lists -> stage, and the hashes that manifests have of it."""
    found: dict[str, tuple[str, set[str]]] = {}
    for manifest in sorted(results.rglob("*.manifest.json")):
        stage = manifest_stage(manifest)
        if stage is None:
            continue
        found[str(manifest.relative_to(results))] = (stage, set())
        for name, value in listed_files(manifest).items():
            path = os.path.relpath(manifest.parent / name, results)
            found.setdefault(path, (stage, set()))[1].add(str(value))
    yield from found.items()


def _stage(name: str) -> str:
    """Stage of a file that no manifest lists."""
    return next((stage for pattern, stage in _SINGLE.items() if re.fullmatch(pattern, name)), name.split("/")[0])


def _order(stage: str) -> tuple[int, str]:
    names = ["inputs", "room", "raw", "capture", "poses", "dataset", *SECTIONS]
    return (names.index(stage) if stage in names else len(names), stage)


def _stages(results: Path) -> dict[str, Any]:
    """Stage -> its version and settings, as the figures of its runs have them."""
    found: dict[str, Any] = {}
    for path in sorted(results.glob("stats/*.json")):
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            found[content["stage"]] = {"version": content["version"], "settings": content["settings"]}
        except (OSError, *MALFORMED):
            continue  # of a program that is no stage
    return found


def _packages() -> dict[str, str]:
    """Name -> version of the packages that are installed here."""
    return dict(sorted((each.name.lower(), each.version) for each in importlib.metadata.distributions()))


def _machine() -> dict[str, Any]:
    """Where a run was made, as far as results may depend on it."""
    cpu = Path("/proc/cpuinfo")
    text = cpu.read_text(encoding="utf-8") if cpu.is_file() else ""
    models = Counter(re.findall(r"^model name\s*: (.*)$", text, re.MULTILINE))
    return {
        "system": platform.platform(),
        "processor": next(iter(models), platform.processor()),
        "cores": os.cpu_count(),
        "memory_gb": round(total_memory() / 2**30, 1),
        "backend": os.environ.get("FIPT_BACKEND", "auto"),
    }
