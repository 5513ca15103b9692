"""`fipt mesh` with a method: what it writes, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.settings import validate
from fipt.stages.geometry.mesh_settings import GeometrySettings, MonosdfGeometry
from tests.unit.stages.geometry.test_two_steps import SETTINGS, off_the_walls, write_room

FIT = {"iterations": 20, "rays": 256, "samples": 6, "levels": 4, "finest": 64, "table_log2": 12, "width": 16}


@pytest.mark.usefixtures("open3d")
def test_a_fused_surface_is_fitted_to_the_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_room(tmp_path, errors=False)
    settings = json.dumps(SETTINGS | FIT | {"method": "sdf"})
    arguments = ["mesh", "--dataset", "views", "--depth", "depth", "--settings", settings, "--out", "geometry"]
    assert main([*arguments, "--stats", "stats.json"]) == 0
    about = json.loads((tmp_path / "geometry" / "geometry.json").read_text())
    assert about["method"] == "sdf"
    assert set(about["volume"]["loss"]) == {"color", "depth", "normal", "eikonal", "smooth"}
    assert json.loads((tmp_path / "stats.json").read_text())["volume"]["steps_per_s"] > 0
    assert np.percentile(off_the_walls(tmp_path / "geometry" / "mesh.ply"), 95) < 0.02


def test_keys_of_another_method_are_refused() -> None:
    with pytest.raises(FiptError, match=r"geometry.prior is only for method monosdf; method is sdf"):
        validate(GeometrySettings, "geometry", {"method": "sdf", "prior": "folder"})
    with pytest.raises(FiptError, match=r"geometry.scan is only for method auto or depth; method is mvs"):
        validate(GeometrySettings, "geometry", {"method": "mvs", "scan": "scan.ply"})
    chosen = validate(GeometrySettings, "geometry", {"method": "monosdf", "iterations": 7})
    assert isinstance(chosen, MonosdfGeometry)
    assert (chosen.iterations, chosen.width) == (7, 256)
