"""The hits stage on a dataset: what it writes, and views that do not see the mesh."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.io.cameras import write_transforms
from fipt.io.dataset import Dataset, write_views
from fipt.io.hits import clipped_of, pixels_of, read_hits
from fipt.io.manifests import Stats, read_manifest
from fipt.io.meshes import write_ply
from fipt.settings import Hits as HitsSettings
from tests import scenes

SETTINGS = HitsSettings(grid=2)


@pytest.fixture
def write(backend, tmp_path):
    from fipt.shading.hits import write_shard

    def write(cameras, mesh=None):
        root = scenes.write_dataset(tmp_path / "dataset")
        write_transforms(root / "transforms.json", cameras)
        if mesh is not None:
            write_ply(root / "mesh.ply", mesh)
        stats = Stats()
        write_shard(
            Dataset(root), [camera.name for camera in cameras], tmp_path / "hits" / "train-000", SETTINGS, stats
        )
        return stats.figures

    return write


def outward():
    """A camera outside the room that looks away from it."""
    return scenes.look_at("lost", (10, 1, 1), (20, 1, 1))


def test_a_shard_of_views(write, tmp_path, capsys):
    figures = write(scenes.cameras()[:2])
    hits = read_hits(tmp_path / "hits" / "train-000")
    assert hits.views == ("a", "b")
    assert hits.shapes == ((12, 16),) * 2
    covered = np.bincount(np.repeat(np.arange(384), np.diff(hits.offsets)), hits.weight)
    np.testing.assert_allclose(covered, 1)
    assert figures["views_mostly_off_mesh"] == []
    assert 1 < figures["hits_per_pixel"] < 2
    manifest = read_manifest(tmp_path / "hits" / "train-000.manifest.json", "hits")
    assert "train-000/views.json" in manifest["files"]
    assert len(manifest["files"]) == 9
    assert manifest["settings"]["grid"] == 2
    assert "warning" not in capsys.readouterr().out
    # triangles agree with what the dataset's pictures show at pixel centres
    for index, camera in enumerate(scenes.cameras()[:2]):
        _, wall = scenes.picture(camera)
        first = hits.offsets[hits.pixels(index)]
        lamp = np.isin(hits.triangle[first], scenes.room().triangle)
        np.testing.assert_array_equal(lamp, wall.ravel() == 7)


def test_a_view_that_sees_nothing_is_named(write, tmp_path):
    with pytest.raises(FiptError, match="view lost: all rays miss the mesh; check the camera's pose"):
        write([scenes.cameras()[0], outward()])
    assert not (tmp_path / "hits").exists()


def test_views_that_see_little_are_warned_of(write, tmp_path, capsys):
    """A floor of 8 m seen from a height of 1 m, from above and near its horizon."""
    down = scenes.look_at("down", (0, 1, 0.5), (0, 0, 0))
    level = scenes.look_at("level", (0, 1, 0), (2, 1.1, 0))
    figures = write([down, level], scenes.floor())
    hits = read_hits(tmp_path / "hits" / "train-000")
    level_counts = np.diff(hits.offsets)[hits.pixels(1)]
    assert 0 < (level_counts > 0).mean() < 0.5
    assert figures["views_mostly_off_mesh"] == ["level"]
    assert "warning: more than half of the pixels miss the mesh in level\n" in capsys.readouterr().out


@pytest.mark.parametrize("rejected", [("b",), ("a", "b")])
def test_rejected_views_are_left_out(backend, tmp_path, rejected):
    """A plan is made before the checks: it names views that have nothing from there on, perhaps a whole shard."""
    from fipt.shading.hits import write_shard

    root = scenes.write_dataset(tmp_path / "dataset")
    write_views(root / "views.json", ["a", "b", "c"], dict.fromkeys(rejected, "its bracket is incomplete"))
    data = Dataset(root)
    write_shard(data, ["a", "b"], tmp_path / "hits" / "train-000", SETTINGS, Stats())
    hits = read_hits(tmp_path / "hits" / "train-000")
    assert hits.views == tuple(view for view in ("a", "b") if view not in rejected)
    assert len(pixels_of(data, hits)[0]) == len(clipped_of(data, hits)) == 192 * len(hits.views)
