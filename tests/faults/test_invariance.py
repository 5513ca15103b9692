"""What means nothing changes nothing: the place, direction and unit of the world, the order of views, idle triangles.

Import, samples and radiance cache of the box room, written in another way. `python -m benchmarks.invariance` follows
the same changes through fit and metrics.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.invariance import cluttered, placed, reordered
from fipt.cli.main import main
from fipt.render.variant import Backend
from fipt.scene.samples import FootprintSamples, read_samples
from fipt.scene.voxels import read_cache
from tests import scenes

VIEWS = ("a", "b")
Seen = tuple[FootprintSamples, dict[str, np.ndarray]]


def made(
    folder: Path, change: Callable[[Path], None], **settings: object
) -> tuple[FootprintSamples, dict[str, np.ndarray]]:
    """Samples of the training views and the cache of the room after a change."""
    source, data = folder / "source", folder / "dataset"
    scenes.write_dataset(source)
    change(source)
    settings = {"overlay": False, "prepare": "never"} | settings
    into = (
        "--dataset",
        str(data),
        "--manifest",
        str(data / "images.manifest.json"),
        "--settings",
        json.dumps(settings),
    )
    assert main(["import", "--source", str(source), "--format", "fipt", *into]) == 0
    shard, cache = folder / "samples" / "train-000", folder / "cache.npz"
    assert main(["samples", "--dataset", str(data), "--views", ",".join(VIEWS), "--out", str(shard)]) == 0
    options = ("--out", str(cache), "--settings", '{"resolution": 16}')
    assert main(["cache", "--dataset", str(data), "--samples", str(shard), *options]) == 0
    return read_samples(shard), read_cache(cache)


def turned() -> np.ndarray:
    """A rotation by which no axis stays an axis, as a (4, 4) matrix."""
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("yxz", (37, 11, -23), degrees=True).as_matrix()
    return matrix


@pytest.mark.parametrize("name", ["twice the length", "millimetres", "another order", "triangles twice"])
def test_the_same_bits(name: str, backend: Backend, tmp_path: Path) -> None:
    """Powers of two, order and idle triangles are exact; a declared unit is so but for the rounding of positions."""
    change, settings, scale = {
        "twice the length": (placed(np.diag([2.0, 2, 2, 1])), {}, 2.0),
        "millimetres": (placed(np.diag([1000.0, 1000, 1000, 1])), {"unit": 0.001}, 1.0),
        "another order": (reordered, {}, 1.0),
        "triangles twice": (cluttered, {}, 1.0),
    }[name]
    samples, cache = made(tmp_path / "plain", lambda _: None)
    other, found = made(tmp_path / "other", change, **settings)
    np.testing.assert_array_equal(other.triangle, samples.triangle)
    np.testing.assert_array_equal(other.offsets, samples.offsets)
    np.testing.assert_allclose(other.position, samples.position * scale, atol=0 if name != "millimetres" else 1e-6)
    for array in ("key", "facing", "radiance", "count", "source"):
        np.testing.assert_array_equal(found[array], cache[array])


def mean_light(cache: dict[str, np.ndarray]) -> float:
    """Radiance of the seen surface, by the pixels that see it."""
    return float(np.average(cache["radiance"].mean(axis=1), weights=cache["count"]))


def test_a_turned_and_a_moved_room_are_seen_alike(backend: Backend, tmp_path: Path) -> None:
    """Rounding moves points by micrometres, and a ray along an edge to the other side of it."""
    samples, cache = made(tmp_path / "plain", lambda _: None)
    moved = np.eye(4)
    moved[:3, 3] = (512345, 5412345, 321)
    for name, matrix in {"turned": turned(), "moved": moved}.items():
        other, found = made(tmp_path / name, placed(matrix))
        assert len(other.triangle) == pytest.approx(len(samples.triangle), rel=0.02)
        place = other.position - np.median(other.position, axis=0)
        back = samples.position @ matrix[:3, :3].T
        distance, _ = cKDTree(place).query(back - np.median(back, axis=0))
        assert np.median(distance) < 1e-3
        assert mean_light(found) == pytest.approx(mean_light(cache), rel=0.02)
