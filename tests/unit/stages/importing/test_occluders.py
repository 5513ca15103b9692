"""Pixels that show what a scan, or a mesh of photographs, lacks lose their weight in the import."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from fipt.conventions import FLAG_NOISE, FLAG_SATURATED
from fipt.formats.exr import read_exr, write_exr
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.mesh import write_ply
from fipt.stages.importing.build import Imported, import_scene
from fipt.stages.importing.settings import ImportSettings
from tests.lit_ball import PLACES, WALLS, box, cameras, of, shown, with_shining

pytestmark = pytest.mark.usefixtures("backend")

WALL, DARK = 0.3, 0.03
CLIPPED = "train_2"
"""A view whose dark pixels are lower bounds."""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A dataset whose views show a dark rod, and whose mesh has none; the last view is held out."""
    root = tmp_path / "source"
    (root / "images").mkdir(parents=True)
    views = cameras(places=[*PLACES, (3.0, 0.8, 0.6)])
    views[-1] = replace(views[-1], split="val", name="val_0")
    radiance = shown(*with_shining(WALLS, box((0.05, 1.0, 0.05), (2.1, 1.5, 1.4))), views, level=DARK, wall=WALL)
    for view in views:
        image, valid = radiance(view.name)
        valid[0, 0] = view.name != "train_0"
        dark = image[..., 0] < 0.5 * WALL
        flags = np.where(dark & (view.name == CLIPPED), FLAG_SATURATED, FLAG_NOISE).astype(np.uint32)
        channels = {"": image.astype(np.float32), "valid.Y": np.float32(valid), "flags.Y": flags}
        write_exr(root / "images" / f"{view.name}.exr", channels)
    write_transforms(root / "transforms.json", views, origin=np.zeros(3), radiance_scale=1.0)
    write_views(root / "views.json", [view.name for view in views])
    write_ply(root / "mesh.ply", WALLS)
    return root


def imported(source: Path, of_photographs: bool = True, **settings) -> tuple[Dataset, dict, Imported]:
    folder, views = source.parent / "dataset", source / "transforms.json" if of_photographs else None
    done = import_scene(source, "fipt", folder, ImportSettings(overlay=False, **settings), mesh_views=views)
    return Dataset(folder), json.loads((folder / "prepare.json").read_text()), done


def test_they_have_no_weight(source: Path) -> None:
    dataset, facts, done = imported(source)
    lost = rod = 0
    for view in dataset.views("train"):
        radiance, valid = dataset.image(view)
        assert set(np.unique(valid)) <= {0.0, 1.0}
        assert valid[0, 0] == (view != "train_0"), "weights that were given stay"
        original, _ = Dataset(source).image(view)
        lost += (valid == 0).sum()
        rod += (original[..., 0] < 0.5 * WALL).sum()
        np.testing.assert_array_equal(radiance[valid > 0], original[valid > 0])
        before, after = (read_exr(root / "images" / f"{view}.exr")["flags.Y"] for root in (source, dataset.root))
        np.testing.assert_array_equal(before, after)
        assert after.dtype == np.uint32
    assert lost > 0.5 * rod > 0
    assert facts["occluded"] == pytest.approx((lost - 1) / (5 * 80 * 60), abs=1e-5)
    assert not any("far darker" in warning for warning in done.mesh["warnings"])


def test_lower_bounds_and_held_out_views_stay(source: Path) -> None:
    dataset, _, _ = imported(source)
    for view in (CLIPPED, "val_0"):
        dark = Dataset(source).image(view)[0][..., 0] < 0.5 * WALL
        assert dark.any()
        assert (dataset.image(view)[1][dark] == 1).all()


def test_a_prepared_scan_is_asked(source: Path) -> None:
    fine = trimesh.Trimesh(WALLS.vertices, WALLS.triangles)
    for _ in range(6):
        fine = fine.subdivide()
    write_ply(source / "mesh.ply", of(fine))
    dataset, facts, _ = imported(source, of_photographs=False)
    assert facts["prepared"]
    assert facts["occluded"] > 0
    assert any((dataset.image(view)[1] == 0).sum() > 12 for view in dataset.views("train"))


def test_averaged_images_are_compared(source: Path) -> None:
    """A block of pixels of which some have a weight, and which shows the wall, keeps its part of a weight."""
    dataset, facts, _ = imported(source, downscale=2)
    assert facts["occluded"] > 0
    assert dataset.image("train_0")[1][0, 0] == pytest.approx(0.75)


def test_a_view_of_somewhere_else_is_named(source: Path) -> None:
    path = source / "images" / "train_1.exr"
    channels = read_exr(path)
    stripes = np.where(np.arange(80) % 20 < 6, 0.1, 1.0)[None].astype(np.float32)
    write_exr(path, {name: channels[name] * (stripes if name in "RGB" else 1) for name in ("R", "G", "B")})
    dataset, _, done = imported(source)
    (warning,) = (warning for warning in done.mesh["warnings"] if "far darker" in warning)
    assert "1 training views (train_1)" in warning
    assert (dataset.image("train_1")[1] == 1).all()


@pytest.mark.parametrize(
    ("of_photographs", "settings"), [(False, {}), (True, {"mask_occluders": False}), (True, {"prepare": "never"})]
)
def test_a_mesh_of_a_modeller_is_believed(source: Path, of_photographs: bool, settings: dict) -> None:
    """As is any that a person says to be as it should."""
    dataset, facts, _ = imported(source, of_photographs, **settings)
    assert "occluded" not in facts
    assert sum((dataset.image(view)[1] == 0).sum() for view in dataset.views("train")) == 1
