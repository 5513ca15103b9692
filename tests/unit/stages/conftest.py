"""The box room's results, made once for the tests of all stages."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fipt.scene.mesh import Mesh, write_ply
from tests import fitted, scenes


@pytest.fixture(scope="session")
def scene(backend: object, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of all verbs on the box room; tests do not change them."""
    return fitted.write_room(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="session")
def opened(backend: object, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without one wall, whose radiance the images show all the same: as if it were far outside."""
    root = tmp_path_factory.mktemp("opened")
    scenes.write_dataset(root / "dataset")
    mesh = scenes.room().mesh
    write_ply(root / "dataset" / "mesh.ply", Mesh(mesh.vertices, np.delete(mesh.triangles, [2, 3], axis=0)))
    return fitted.run_all(root)


@pytest.fixture
def work(scene: Path, tmp_path: Path) -> Path:
    """A copy of the results that a test may spoil."""
    return Path(shutil.copytree(scene, tmp_path / "scene"))


@pytest.fixture
def refused(work: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """A function that runs a verb, which must fail with one line and leave all files as they are; returns the line."""

    def refused(verb: str, *changed: object, settings: dict | None = None) -> str:
        before = fitted.content(work)
        folders = {path for path in work.rglob("*") if path.is_dir()}
        capsys.readouterr()
        assert fitted.call(verb, work, *changed, settings=settings) == 2
        error = [line for line in capsys.readouterr().err.splitlines() if "error" in line.lower()]
        assert len(error) == 1
        assert error[0].startswith("fipt: error: ")
        assert fitted.content(work) == before
        left = {path for path in work.rglob("*") if path.is_dir()} - folders
        assert not [path for path in left if "tmp" in path.name]
        return error[0]

    return refused
