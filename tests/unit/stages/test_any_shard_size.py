"""Results do not depend on how views are cut into shards."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from fipt.cli.main import main
from fipt.scene.samples import read_samples, scattered, strided, summed_by
from fipt.scene.settled import read_state
from fipt.scene.shading import BEFORE, SHADING, read_shading
from tests.fitted import FIT, call, content

ONE_A_VIEW = ("a", "b")
"""Shards of a single view each; `tests.fitted` has both views in one."""


def in_shards(folder, shards):
    """The same folder of every shard, comma-separated."""
    return ",".join(str(folder / shard) for shard in shards)


def shade(root, verb, number, shards, *given):
    """Write the shading of a round, shard by shard."""
    for shard in shards:
        own = ("--samples", root / "samples" / shard, "--out", root / f"round-{number}/shading" / shard)
        before = ("--previous", root / f"round-{number - 1}/shading" / shard) if number else ()
        assert call(verb, root, *own, *before, *given) == 0


def second_round(root, shards):
    """Go on from the refinement of round 1: fit, emitters, parts, findings, refinement of round 2."""
    every = ("--samples", in_shards(root / "samples", shards), "--shading", in_shards(root / "round-1/shading", shards))
    before, after = root / "round-0", root / "round-1"
    given = ("--previous", before / "model.safetensors", "--settled", before / "settled.json")
    assert call("fit", root, *every, *given, "--out", after / "model.safetensors", settings=FIT | {"steps": 5}) == 0
    assert call("emitters", root, *every, "--out", after / "emitters.npz") == 0
    parts = ("--emitters", after / "emitters.npz", "--out", after / "segments")
    parts += ("--manifest", after / "segments.manifest.json")
    assert main(["regroup", *map(str, ("--dataset", root / "dataset", *every, *parts, "--settings", "{}"))]) == 0
    earlier = ("--earlier", in_shards(root / "round-0/shading", shards))
    assert call("findings", root, *every, *earlier, "--out", root / "findings.json") == 0
    shade(root, "refine", 2, shards, "--settled", after / "settled.json")


def run_in_shards(root):
    """Take the box room through the loop with a shard for each view, as `tests.fitted.run_all` does with one."""
    for view in ONE_A_VIEW:
        assert call("samples", root, "--views", view, "--out", root / "samples" / view) == 0
    assert call("samples", root, "--views", "c", "--out", root / "samples" / "val-000") == 0
    every = ("--samples", in_shards(root / "samples", ONE_A_VIEW))
    for verb in ("environment", "cache"):
        assert call(verb, root, *every) == 0
    shade(root, "bake", 0, ONE_A_VIEW)
    every += ("--shading", in_shards(root / "round-0/shading", ONE_A_VIEW))
    for verb in ("fit", "emitters"):
        assert call(verb, root, *every) == 0
    shade(root, "refine", 1, ONE_A_VIEW)
    second_round(root, ONE_A_VIEW)


def test_shards_of_single_views_give_the_same_bytes(work, tmp_path_factory):
    """Every file but those of the shards themselves."""
    root = tmp_path_factory.mktemp("shards")
    shutil.copytree(work / "dataset", root / "dataset")
    run_in_shards(root)
    second_round(work, ["train-000"])
    assert 0 < read_state(work / "round-1" / "settled.json").kept < 1
    whole = read_samples(work / "samples" / "train-000")
    for number, name in ((0, SHADING), (1, SHADING), (1, BEFORE), (2, SHADING), (2, BEFORE)):
        folder = Path(f"round-{number}", "shading")
        shared = read_shading(work / folder / "train-000", name=name).words
        for index, view in enumerate(ONE_A_VIEW):
            own = read_shading(root / folder / view, name=name).words
            np.testing.assert_array_equal(own, shared[whole.of_view(index)])
    own, shared = content(root), content(work)
    names = [name for name in own if name in shared and not name.startswith(("dataset", "samples"))]
    assert len(names) > 12
    assert [name for name in names if own[name] != shared[name]] == []


@pytest.mark.parametrize("lengths", [(10,), (3, 0, 7), (1, 1, 8), (5, 5)])
def test_strides_and_sums_go_on_from_shard_to_shard(lengths, np_rng):
    values, groups = np_rng.random(10).astype(np.float32), np_rng.integers(0, 3, 10)
    ends = np.cumsum(lengths)[:-1]
    parts = np.split(values, ends)
    rows = strided(lengths, 4)
    np.testing.assert_array_equal(
        np.concatenate([part[own] for part, own in zip(parts, rows, strict=True)]), values[::4]
    )
    found = summed_by(zip(np.split(groups, ends), parts, strict=True), 3)
    np.testing.assert_array_equal(found, np.bincount(groups, values, 3))


@pytest.mark.parametrize("step", [1, 2, 7, 50, 160])
def test_scattered_pixels_are_the_same_ones_in_any_shards(step):
    whole, passed, parts = scattered(0, 8000, step), 0, []
    for length in (5, 0, 1, 993, 4000, 3001):
        parts.append(passed + scattered(passed, length, step))
        passed += length
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal((whole // step)[: 8000 // step], np.arange(8000 // step))  # one of each run
    assert len(np.unique(whole % 800)) > min(len(whole), 800) / 2
