"""The wheel alone, outside a clone: it holds the workflow, presets, templates and the demo."""

import json
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from benchmarks.jobs import REPOSITORY

pytestmark = pytest.mark.slow

TINY = [
    "rounds=0",
    "synthesize={train_views: 2, val_views: 1, width: 32, height: 24, spp: 2, denoise: false}",
    "samples={grid: 1}",
    "cache={resolution: 32}",
    "bake={diffuse_spp: 4, specular_spp: 2, smooth_spp: 2, denoise: false}",
    "fit={steps: 10, batch: 128, levels: 4, table_log2: 10}",
    "emitters={points: 20}",
    "render={spp: 2, denoise: false}",
    "relight={spp: 2, denoise: false}",
    "olat={spp: 2, denoise: false}",
]


def call(*command, cwd: Path) -> str:
    """Run a program that must succeed, without this clone on its path; what it says."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    text = list(map(str, command))
    done = subprocess.run(text, cwd=cwd, env=environment, text=True, capture_output=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """Folder of the programs of an environment with the wheel, which borrows all other packages from this one."""
    folder = tmp_path_factory.mktemp("wheel")
    sources = folder / "sources"
    shutil.copytree(REPOSITORY / "fipt", sources / "fipt", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / name, sources)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    call(*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, sources, cwd=folder)
    (wheel,) = folder.glob("fipt-*.whl")

    venv.create(folder / "venv", symlinks=True)
    python = folder / "venv" / "bin" / "python"
    call(*pip, "--python", python, "install", "--no-deps", "--no-index", wheel, cwd=folder)
    (site,) = (folder / "venv" / "lib").glob("python*/site-packages")
    others = [path for path in sys.path if path.endswith("site-packages")]
    (site / "others.pth").write_text("\n".join(others) + "\n")
    found = call(python, "-c", "import fipt; print(fipt.__file__)", cwd=folder)
    assert Path(found.strip()).is_relative_to(site)
    return python.parent


def test_the_demo_runs_in_an_empty_folder(programs, tmp_path):
    said = call(programs / "fipt", "run", "demo", *(text for pair in TINY for text in ("--config", pair)), cwd=tmp_path)
    results = tmp_path / "results" / "demo"
    assert "report: " in said
    assert "<html" in (results / "report.html").read_text()
    assert json.loads((results / "metrics.json").read_text())["val"]["kd_psnr"] > 0
    assert {path.name for path in tmp_path.iterdir()} == {"results", ".snakemake"}


def test_a_new_room_has_a_configuration_that_says_what_is_missing(programs, tmp_path):
    call(programs / "fipt", "init", "my_room", cwd=tmp_path)
    (written,) = tmp_path.rglob("*.yaml")
    command = [str(programs / "fipt"), "run", "my_room", "--dry-run"]
    done = subprocess.run(command, cwd=written.parents[1], text=True, capture_output=True)
    assert done.returncode == 2
    assert done.stderr.startswith("fipt: error: ")
