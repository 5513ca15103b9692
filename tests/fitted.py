"""The box room of `tests.scenes` taken through all stages, by calls that are derived from the stages' inputs.

A stage's field is filled by its name: `COMMON` says where a file lies that several stages share, `OWN` what only one
of them has. What a stage writes stands in no list here: its ``out``, ``manifest`` and the manifest's files say it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

from fipt.cli.main import main
from fipt.registry import VERBS
from tests import scenes

FEW = {"diffuse_spp": 4, "specular_spp": 4, "smooth_spp": 4}
FIT = {
    "steps": 60,
    "batch": 128,
    "levels": 4,
    "table_log2": 10,
    "learning_rate": 0.01,
    "emission_weight": 0.1,
}
NIGHT = {
    "emitters": [{"scale": 0}],
    "lights": [{"shape": "sphere", "center": [1.2, 0.8, 2.0], "radius": 0.2, "radiance": [5, 0, 0]}],
}
SETTINGS: dict[str, dict[str, Any]] = {
    "samples": {"grid": 3},
    "cache": {"resolution": 32},
    "environment": {},
    "bake": FEW,
    "fit": FIT,
    "emitters": {"decide": "mask", "points": 20},  # its walls have colours that no light gives
    "review": {"width": 96},
    "refine": FEW | {"max_depth": 3},
    "materials": {},
    "render": {"spp": 16, "max_depth": 3},
    "relight": {"spp": 16, "max_depth": 3},
    "olat": {"spp": 16, "max_depth": 3},
    "findings": {"views": 2, "width": 16, "spp": 8, "max_depth": 3, "pixels": 1000},
}
"""Verb -> settings, in the order of the pipeline."""

SHADING = Path("round-0/shading/train-000")
COMMON = {
    "dataset": Path("dataset"),
    "samples": Path("samples/train-000"),
    "environment": Path("environment.npz"),
    "cache": Path("cache.npz"),
    "shading": SHADING,
    "model": Path("round-0/model.safetensors"),
    "emitters": Path("round-0/emitters.npz"),
    "confidence": Path("round-0/confidence.npz"),
    "views": "c",
    "rays_per_side": 3,
}
"""Field -> file below the scene's folder, or text."""

OWN: dict[str, dict[str, Any]] = {
    "samples": {"views": "a,b", "out": Path("samples/train-000")},
    "environment": {"out": Path("environment.npz")},
    "cache": {"out": Path("cache.npz")},
    "bake": {"out": SHADING},
    "fit": {"out": Path("round-0/model.safetensors"), "emitters": None},
    "emitters": {"out": Path("round-0/emitters.npz")},
    "review": {"out": Path("emitters"), "review": Path("emitters_review.yaml")},
    "refine": {"previous": SHADING, "out": Path("round-1/shading/train-000")},
    "materials": {"samples": Path("samples/val-000"), "out": Path("materials")},
    "render": {"out": Path("render")},
    "relight": {"out": Path("relight/night"), "setup": json.dumps(NIGHT)},
    "olat": {"out": Path("olat")},
    "findings": {"out": Path("findings.json")},
}
"""Verb -> fields whose value is its own."""


def values(verb: str) -> dict[str, Any]:
    """Field of the verb's inputs -> its value; a manifest stands beside the folder that it lists."""
    kind = signature(import_module(VERBS[verb].module).run).parameters["inputs"].annotation
    found = {field.name: (COMMON | OWN[verb]).get(field.name) for field in fields(kind)}
    if "manifest" in found:
        found["manifest"] = Path(f"{found['out']}.val-000.manifest.json")
    return {name: value for name, value in found.items() if value is not None}


def manifest_of(verb: str) -> Path | None:
    """Manifest of what a verb writes, below the scene's folder; None of one that writes single files."""
    found = values(verb)
    beside = None if found["out"].suffix else Path(f"{found['out']}.manifest.json")
    return found.get("manifest", beside)


def options(verb: str, root: Path, changed: dict[str, Any] | None = None) -> list[str]:
    """Command line of a verb, without settings; ``changed`` options replace others, those of None are left out."""
    found = {
        "--" + name.replace("_", "-"): root / value if isinstance(value, Path) else value
        for name, value in values(verb).items()
    }
    return [
        text for name, value in (found | (changed or {})).items() if value is not None for text in (name, str(value))
    ]


def call(
    verb: str,
    root: Path,
    *changed: Any,
    settings: dict[str, Any] | None = None,
    stats: Path | None = None,
) -> int:
    """Run a verb, with options replaced or added: ("--out", path, ...). Return the exit code."""
    pairs = dict(zip(changed[::2], changed[1::2], strict=True))
    line = [
        verb,
        *options(verb, root, pairs),
        "--settings",
        json.dumps(SETTINGS[verb] if settings is None else settings),
    ]
    with kept_threads():
        return main([*line, *(["--stats", str(stats)] if stats else [])])


def run_all(root: Path) -> Path:
    """Run every verb on the dataset of a folder, one round and a refinement; samples of the held-out view too."""
    for verb in SETTINGS:
        assert call(verb, root, stats=root / "stats" / f"{verb}.json") == 0, verb
        if verb == "samples":
            assert call(verb, root, "--views", "c", "--out", root / "samples" / "val-000") == 0
    return root


def write_room(root: Path) -> Path:
    """Write the box room as a dataset and take it through all stages."""
    scenes.write_dataset(root / "dataset")
    return run_all(root)


def content(root: Path, skip: str | tuple[str, ...] = ()) -> dict[str, bytes]:
    """Path -> bytes of all files below a folder."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and not str(path.relative_to(root)).startswith(skip or "\0")
    }


@contextmanager
def kept_threads() -> Iterator[None]:
    """Put back the number of threads of the whole process, which a verb's settings may change."""
    import drjit
    import torch

    before = torch.get_num_threads(), drjit.thread_count()
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        drjit.set_thread_count(before[1])
