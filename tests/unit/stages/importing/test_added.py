"""Round lamps that a mesh lacks are added by the import."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fipt.formats.exr import write_exr
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.mesh import write_ply
from fipt.stages.importing.build import import_scene
from fipt.stages.importing.settings import ImportSettings
from tests.lit_ball import CENTER, RADIUS, WALLS, ball, cameras, shown, with_shining

pytestmark = pytest.mark.usefixtures("backend")


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A dataset whose views show a ball, and whose mesh has none."""
    root = tmp_path / "source"
    (root / "images").mkdir(parents=True)
    views = cameras()
    radiance = shown(*with_shining(WALLS, ball()), views)
    for view in views:
        image, _ = radiance(view.name)
        write_exr(root / "images" / f"{view.name}.exr", {"": image.astype(np.float32)})
    write_transforms(root / "transforms.json", views, origin=np.zeros(3), radiance_scale=1.0)
    write_views(root / "views.json", [view.name for view in views])
    write_ply(root / "mesh.ply", WALLS)
    return root


def test_a_lamp_that_the_mesh_lacks_is_added_and_told(source: Path, tmp_path: Path) -> None:
    done = import_scene(source, "fipt", tmp_path / "dataset", ImportSettings(overlay=False))
    (row,) = done.mesh["added_emitters"]
    np.testing.assert_allclose(row["center"], CENTER, atol=0.01)
    assert row["radius"] == pytest.approx(RADIUS, rel=0.1)
    assert any("round lamps that the mesh lacks, or has in scraps (1)" in warning for warning in done.mesh["warnings"])
    mesh = Dataset(tmp_path / "dataset").mesh()
    np.testing.assert_array_equal(mesh.triangles[: len(WALLS.triangles)], WALLS.triangles)
    assert len(mesh.triangles) == len(WALLS.triangles) + 320
    assert json.loads((tmp_path / "dataset/prepare.json").read_text())["added_emitters"] == [row]


def test_scraps_of_a_noisy_scan_give_way(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """How far they may lie from the lamp, the sides of the scan's triangles tell."""
    rest = ball(radius=1.2 * RADIUS)
    scan, _ = with_shining(WALLS, replace(rest, triangles=rest.triangles[::2]))
    count = len(scan.triangles)

    def prepared(mesh, cameras, radiance, settings):
        return scan, {"prepared": True, "triangles": count} | sides

    monkeypatch.setattr("fipt.meshing.prepare.prepared", prepared)
    for name, sides in (("modelled", {}), ("scanned", {"side_mm": 20.0})):
        done = import_scene(source, "fipt", tmp_path / name, ImportSettings(overlay=False, mask_occluders=False))
        assert len(done.mesh.get("added_emitters", [])) == bool(sides)
        mesh = Dataset(tmp_path / name).mesh()
        assert len(mesh.triangles) == (len(WALLS.triangles) + 320 if sides else count)


def test_none_is_added_where_nobody_wants_it(source: Path, tmp_path: Path) -> None:
    settings = ImportSettings(overlay=False, add_emitters=False)
    done = import_scene(source, "fipt", tmp_path / "dataset", settings)
    assert "added_emitters" not in done.mesh
    assert len(Dataset(tmp_path / "dataset").mesh().triangles) == len(WALLS.triangles)
