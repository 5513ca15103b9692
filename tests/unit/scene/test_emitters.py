"""Emitters on disk: the file for programs, the file for people."""

import json
from dataclasses import replace

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters, Undecided, read_emitters, write_emitters
from tests import scenes

ARRAYS = ("triangle", "radiance", "area", "emitter", "views", "confidence", "clipped", "lower_bound", "sides")


@pytest.fixture
def mesh():
    return scenes.box((0, 0, 0), (4, 3, 5))


@pytest.fixture
def emitters(mesh):
    triangle = np.array([6, 7, 0], np.int32)
    return Emitters(
        triangle,
        np.float32([[1, 2, 3], [3, 2, 1], [5, 5, 5]]),
        mesh.areas[triangle].astype(np.float32),
        np.array([0, 0, 1], np.int32),
        np.array([4, 4, 2], np.int32),
        np.float32([0.5, 0.7, 0.25]),
        np.float32([0.9, 0.9, 0]),
        np.array([True, True, False]),
        np.int8([FRONT, FRONT, BACK]),
    )


def test_round_trip(tmp_path, mesh, emitters):
    path = tmp_path / "round-0" / "emitters.npz"
    write_emitters(path, emitters, mesh)
    read = read_emitters(path)
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(read, name), getattr(emitters, name))
        assert getattr(read, name).dtype == getattr(emitters, name).dtype
    assert sorted(p.name for p in path.parent.iterdir()) == ["emitters.json", "emitters.npz"]


@pytest.mark.parametrize(("sides", "count"), [(FRONT, 1), (BACK, 1), (BOTH, 2)])
def test_for_people(tmp_path, mesh, emitters, sides, count):
    write_emitters(tmp_path / "emitters.npz", replace(emitters, sides=np.full(3, sides, np.int8)), mesh)
    content = json.loads((tmp_path / "emitters.json").read_text())
    ceiling, wall = content["emitters"]
    assert (ceiling["index"], ceiling["triangles"], ceiling["views"]) == (0, 2, 4)
    assert ceiling["area"] == pytest.approx(20)
    assert ceiling["radiance"] == pytest.approx([2, 2, 2])
    assert ceiling["center"] == pytest.approx([2, 3, 2.5])
    assert ceiling["confidence"] == pytest.approx(0.6)
    assert (ceiling["lower_bound"], wall["lower_bound"]) == (True, False)
    assert ceiling["clipped"] == pytest.approx(0.9)
    # flux of a Lambertian emitter: pi times area times radiance, of each side
    assert ceiling["power"] == pytest.approx([count * np.pi * 20 * 2] * 3)
    assert ceiling["sides"] == count
    assert wall["area"] == pytest.approx(7.5)
    assert wall["radiance"] == pytest.approx([5, 5, 5])


@pytest.mark.parametrize("name", ["sides", "error", "guessed", "spread", "raised"])
def test_what_may_be_left_out_is_of_all_triangles_or_none(emitters, name):
    whole = getattr(emitters, name)
    with pytest.raises(ValueError, match=f"{name} is of 2 triangles, not of 3"):
        replace(emitters, **{name: whole[:2]})
    assert len(getattr(replace(emitters, **{name: whole[:0]}), name)) == 3


def test_no_emitters(tmp_path, mesh, emitters):
    empty = emitters.chosen(np.zeros(3, bool))
    write_emitters(tmp_path / "emitters.npz", empty, mesh)
    assert read_emitters(tmp_path / "emitters.npz").radiance.shape == (0, 3)
    assert json.loads((tmp_path / "emitters.json").read_text()) == {
        "emitters": [],
        "undecided": [],
    }


@pytest.mark.parametrize("name", ARRAYS)
def test_a_file_that_lacks_an_array(tmp_path, mesh, emitters, name):
    path = tmp_path / "emitters.npz"
    write_emitters(path, emitters, mesh)
    arrays = load_npz(path)
    del arrays[name]
    save_npz(path, **arrays)
    with pytest.raises(FiptError, match=rf"emitters\.npz lacks the arrays {name}; give the file of the stage"):
        read_emitters(path)


def test_a_damaged_or_missing_file(tmp_path, mesh, emitters):
    path = tmp_path / "emitters.npz"
    with pytest.raises(FiptError, match="is missing"):
        read_emitters(path)
    write_emitters(path, emitters, mesh)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(FiptError, match=r"emitters\.npz is not a complete npz file"):
        read_emitters(path)


def test_the_largest_undecided_regions_are_asked_about():
    """Three regions of triangles of 1, 2, 4, 8 and 16 m2."""
    costs = np.float32([1, 2, 3])
    undecided = Undecided(np.int32([0, 1, 2, 3, 4]), np.int32([2, 0, 1, 0, 1]), costs, costs, costs)
    two = undecided.largest(np.array([1.0, 2, 4, 8, 16]), 2)
    assert two.triangle.tolist() == [1, 2, 3, 4]
    assert two.region.tolist() == [0, 1, 0, 1]
    assert two.price.tolist() == [1, 2]
    assert undecided.largest(np.ones(5), 9).region.tolist() == undecided.region.tolist()
    assert len(Undecided.none().largest(np.ones(5), 2).price) == 0
