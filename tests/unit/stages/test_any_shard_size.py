"""Results do not depend on how views are cut into shards."""

import shutil

import numpy as np
import pytest

from fipt.scene.samples import read_samples, strided, summed_by
from fipt.scene.shading import read_shading
from tests.fitted import call, content

ONE_A_VIEW = ("a", "b")
"""Shards of a single view each; `tests.fitted` has both views in one."""


def in_shards(folder):
    """The same folder of every shard, comma-separated."""
    return ",".join(str(folder / view) for view in ONE_A_VIEW)


def run_in_shards(root):
    """Take the box room through the loop with a shard for each view, as `tests.fitted.run_all` does with one."""
    samples, first, traced, last = (root / name for name in ("samples", "shading", "traced", "damped"))
    for view in ONE_A_VIEW:
        assert call("samples", root, "--views", view, "--out", samples / view) == 0
    every = ("--samples", in_shards(samples))
    for verb in ("environment", "cache"):
        assert call(verb, root, *every) == 0
    for view in ONE_A_VIEW:
        assert call("bake", root, "--samples", samples / view, "--out", first / view) == 0
    every += ("--shading", in_shards(first))
    for verb in ("fit", "emitters"):
        assert call(verb, root, *every) == 0
    for verb, given, out in (("refine", (), traced), ("damp", ("--every", in_shards(traced)), last)):
        for view in ONE_A_VIEW:
            own = ("--traced", traced / view) if verb == "damp" else ()
            own += ("--samples", samples / view, "--previous", first / view, "--out", out / view)
            assert call(verb, root, *own, *given) == 0
    assert call("review", root, "--samples", in_shards(samples)) == 0
    assert call("findings", root, *every) == 0


def test_shards_of_single_views_give_the_same_bytes(scene, tmp_path):
    shutil.copytree(scene / "dataset", tmp_path / "dataset")
    run_in_shards(tmp_path)
    whole = read_samples(scene / "samples" / "train-000")
    for index, view in enumerate(ONE_A_VIEW):
        for mine, theirs in (("shading", "round-0"), ("damped", "round-1")):
            own = read_shading(tmp_path / mine / view).words
            shared = read_shading(scene / theirs / "shading" / "train-000").words
            np.testing.assert_array_equal(own, shared[whole.of_view(index)])
    own, shared = content(tmp_path), content(scene)
    names = [name for name in shared if name.startswith(("round-0/model", "round-0/conf", "round-0/emitters.npz"))]
    names += ["cache.npz", "environment.npz", "findings.json", "emitters/emitters.json", "round-0/settled.json"]
    assert len(names) == 8
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
