"""The samples stage on a dataset: what it writes, and views that do not see the mesh."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.manifests import read_manifest
from fipt.scene.cameras import write_transforms
from fipt.scene.dataset import Dataset, write_views
from fipt.scene.mesh import write_ply
from fipt.scene.samples import clipped_of, pixels_of, read_samples
from fipt.stages.samples.settings import SamplesSettings
from fipt.stages.samples.stage import SamplesInputs, run
from tests import scenes

SETTINGS = SamplesSettings(grid=2)


@pytest.fixture
def write(backend, tmp_path):
    def write(cameras, mesh=None):
        root = scenes.write_dataset(tmp_path / "dataset")
        write_transforms(root / "transforms.json", cameras)
        if mesh is not None:
            write_ply(root / "mesh.ply", mesh)
        names = tuple(camera.name for camera in cameras)
        return run(SamplesInputs(dataset=root, views=names, out=tmp_path / "samples" / "train-000"), SETTINGS)

    return write


def outward():
    """A camera outside the room that looks away from it."""
    return scenes.look_at("lost", (10, 1, 1), (20, 1, 1))


def test_a_shard_of_views(write, tmp_path, caplog):
    figures = write(scenes.cameras()[:2])
    samples = read_samples(tmp_path / "samples" / "train-000")
    assert samples.views == ("a", "b")
    assert samples.shapes == ((12, 16),) * 2
    covered = np.bincount(np.repeat(np.arange(384), np.diff(samples.offsets)), samples.weight)
    np.testing.assert_allclose(covered, 1)
    assert figures["views_mostly_off_mesh"] == []
    assert 1 < figures["samples_per_pixel"] < 2
    manifest = read_manifest(tmp_path / "samples" / "train-000.manifest.json", "samples")
    assert "train-000/views.json" in manifest["files"]
    assert len(manifest["files"]) == 10
    assert manifest["settings"]["grid"] == 2
    assert not [record for record in caplog.records if record.levelname == "WARNING"]
    # triangles agree with what the dataset's pictures show at pixel centres
    for index, camera in enumerate(scenes.cameras()[:2]):
        _, wall = scenes.image(camera)
        first = samples.offsets[samples.pixels(index)]
        lamp = np.isin(samples.triangle[first], scenes.room().triangle)
        np.testing.assert_array_equal(lamp, wall.ravel() == 7)


def test_a_view_that_sees_nothing_is_named(write, tmp_path):
    with pytest.raises(FiptError, match="view lost: all rays miss the mesh; check the camera's pose"):
        write([scenes.cameras()[0], outward()])
    assert not (tmp_path / "samples").exists()


def test_views_that_see_little_are_warned_of(write, tmp_path, caplog):
    """A floor of 8 m seen from a height of 1 m, from above and near its horizon."""
    down = scenes.look_at("down", (0, 1, 0.5), (0, 0, 0))
    level = scenes.look_at("level", (0, 1, 0), (2, 1.1, 0))
    figures = write([down, level], scenes.floor())
    samples = read_samples(tmp_path / "samples" / "train-000")
    level_counts = np.diff(samples.offsets)[samples.pixels(1)]
    assert 0 < (level_counts > 0).mean() < 0.5
    assert figures["views_mostly_off_mesh"] == ["level"]
    assert "more than half of the pixels miss the mesh in level" in caplog.messages


@pytest.mark.parametrize(("views", "rejected"), [(("a", "b"), "b"), (("a",), "a")])
def test_rejected_views_are_left_out(backend, tmp_path, views, rejected):
    """A plan is made before the checks: it names views that have nothing from there on, perhaps a whole shard."""
    root = scenes.write_dataset(tmp_path / "dataset")
    write_views(root / "views.json", ["a", "b", "c"], {rejected: "its bracket is incomplete"})
    data = Dataset(root)
    run(SamplesInputs(dataset=root, views=views, out=tmp_path / "samples" / "train-000"), SETTINGS)
    samples = read_samples(tmp_path / "samples" / "train-000")
    assert samples.views == tuple(view for view in views if view != rejected)
    assert len(pixels_of(data, samples)[0]) == len(clipped_of(data, samples)) == 192 * len(samples.views)
