"""Materials of parts: which part a place belongs to, and the file where a field would stand."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.images import write_png
from fipt.model.parts import PartLabels, PartMaterials, part_labels, part_segments
from fipt.model.reflectance import Brdf
from fipt.model.store import load_field, load_model, save_parts
from fipt.scene.dataset import Dataset
from tests import scenes

LABELS = PartLabels(np.int32([2, 0, 1]), np.float32([[0, 0, 0], [1, 0, 0]]), np.int32([1, 2]))
BRDF = Brdf(
    np.float32([[0.5, 0.5, 0.5], [0.1, 0.2, 0.3], [0.7, 0.8, 0.9]]), np.float32([1, 0.3, 0.6]), np.float32([0, 1, 0])
)


def test_a_place_belongs_to_the_part_of_its_triangle_else_to_the_nearest():
    points = np.float32([[0, 0, 0], [0.9, 0, 0], [0.1, 0, 0], [0.9, 0, 0]])
    np.testing.assert_array_equal(LABELS.at(points, np.array([0, 1, 2, 7])), [2, 2, 1, 2])
    np.testing.assert_array_equal(LABELS.at(points), [1, 2, 1, 2])


def test_a_part_that_wins_no_triangle_counts():
    assert LABELS.count == 3
    assert PartLabels(np.int32([2, 0]), LABELS.place, np.int32([1, 9])).count == 10
    assert PartLabels(np.int32([0]), LABELS.place[:0], np.int32([])).count == 1


def test_materials_come_back_from_their_file(tmp_path):
    path = tmp_path / "model.safetensors"
    save_parts(path, PartMaterials(LABELS, BRDF))
    found = load_model(path).query(np.zeros((2, 3), np.float32), np.ones(2), np.array([0, 2]))
    np.testing.assert_array_equal(found.base_color, BRDF.base_color[[2, 1]])
    np.testing.assert_array_equal(found.roughness, np.float32([0.6, 0.3]))
    np.testing.assert_array_equal(found.metallic, [0, 1])
    with pytest.raises(FiptError, match="is a parts of the fit, not a field"):
        load_field(path)
    path.write_bytes(path.read_bytes()[:-7])
    with pytest.raises(FiptError, match="is damaged"):
        load_model(path)


def test_labels_are_what_most_pixels_of_a_triangle_have(tmp_path):
    scenes.write_dataset(tmp_path)
    data = Dataset(tmp_path)
    count = scenes.WIDTH * scenes.HEIGHT
    ids = np.full((scenes.HEIGHT, scenes.WIDTH), 3, np.uint16)
    ids.flat[:2], ids.flat[2] = 5, 0
    for path in (tmp_path / "segments").rglob("*.png"):
        path.unlink()
    (tmp_path / "segments" / "part").mkdir(parents=True, exist_ok=True)
    for manifest in tmp_path.rglob("*.manifest.json"):
        manifest.unlink()
    write_png(tmp_path / "segments" / "part" / "a.png", ids)
    triangle = np.full(count, 1)
    triangle[:3] = 0
    samples = scenes.samples_of(
        np.random.default_rng(0).random((count, 3)), triangle, shapes=[(scenes.HEIGHT, scenes.WIDTH)]
    )
    labels = part_labels(data, [samples], part_segments(data))
    assert labels.of_triangle[:3].tolist() == [5, 3, 0]
    assert len(labels.place) == count - 1  # of unknown ids nothing is said
    (tmp_path / "segments" / "part" / "a.png").unlink()
    (tmp_path / "segments" / "part").rmdir()
    with pytest.raises(FiptError, match="has no segment ids"):
        part_segments(Dataset(tmp_path))
