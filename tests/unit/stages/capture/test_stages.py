"""Photographs to a dataset by the verbs calibrate, develop, qa and import, one view of them broken."""

import json

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.conventions import FLAG_SATURATED
from fipt.scene.dataset import Dataset
from tests import captures
from tests.layouts import room, write_ply


def call(*arguments):
    """Exit code of a verb."""
    return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A capture of four views, whose first is truncated, with a lamp that the shortest exposure clips."""
    root = tmp_path_factory.mktemp("photographs")
    captures.write(root / "raw", views=4, faults=("truncated",), white_radiance=15.0)
    write_ply(root / "mesh.ply", room())
    assert call("calibrate", "--capture", root / "raw", "--out", root / "capture" / "calibration.json") == 0
    return root


def developed(root, *more):
    views = "train_000,val_001,train_002,train_003"
    options = ("--capture", root / "raw", "--views", views, "--calibration", root / "capture" / "calibration.json")
    settings = ("--settings", '{"downscale": 2, "board_square": 0.03}')
    out = ("--out", root / "capture", "--manifest", root / "capture" / "hdr.manifest.json")
    return call("develop", *options, *out, *settings, *more)


def test_a_broken_view_stops_development_or_is_rejected(folder, capsys):
    assert developed(folder) == 2
    assert "truncated" in capsys.readouterr().err
    assert developed(folder, "--keep-going") == 0
    assert "warning: view train_000 is rejected" in capsys.readouterr().err
    files = json.loads((folder / "capture" / "hdr.manifest.json").read_text())["files"]
    assert "train_000.json" in files
    assert "hdr/train_000.exr" not in files
    assert not (folder / "capture" / "hdr" / "train_000.exr").exists()

    options = ("--calibration", folder / "capture" / "calibration.json", "--out", folder / "capture" / "qa.json")
    assert call("qa", "--capture", folder / "raw", "--developed", folder / "capture", *options) == 0
    printed = capsys.readouterr().err
    assert "error: view train_000: " in printed
    assert "3 of 4 views are accepted" in printed

    source = ("--source", folder / "capture", "--format", "capture", "--poses", folder / "raw" / "transforms.json")
    options = ("--mesh", folder / "mesh.ply", "--dataset", folder / "dataset", "--settings", '{"overlay": false}')
    assert call("import", *source, *options) == 0
    data = Dataset(folder / "dataset")
    assert list(data.rejected) == ["train_000"]
    assert [camera.name for camera in data.cameras] == ["train_002", "train_003", "val_001"]

    # what is clipped in every exposure is a lower bound with weight, in the room's own unit of radiance
    clipped = data.clipped("train_002")
    radiance, weight = data.image("train_002")
    assert clipped.any()
    assert (weight[clipped] == 1).all()
    made = captures.cameras(4)[2]
    truth = captures.scene_image(made)
    inside = (data.flags("train_002") == 0) & (weight == 1)
    error = np.abs(radiance[inside] / truth[inside] - 1)
    assert np.median(error) < 0.05
    lamp = clipped & (truth.min(axis=-1) > 15) & (data.flags("train_002") == FLAG_SATURATED)
    # demosaicing mixes clipped and unclipped neighbours: a few per cent
    assert lamp.any()
    assert (radiance[lamp] <= truth[lamp] * 1.1).all()
