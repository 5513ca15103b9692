"""Pictures of lamps: from which view, which part of it, and that lamp and surroundings are recognised."""

import numpy as np
import pytest

from fipt.formats.exr import write_exr
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.stages.emitters.review import _LINE, _crop, _drawn, thumbnail, visibilities
from fipt.stages.importing.overlay import visible_triangles
from tests import scenes


@pytest.fixture(scope="module")
def room(backend, tmp_path_factory):
    """The box room, its dataset, and the samples of its training views: one for each pixel."""
    data = Dataset(scenes.write_dataset(tmp_path_factory.mktemp("room")))
    cameras = [camera for camera in data.cameras if camera.split == "train"]
    mesh = data.mesh()
    rays = RayScene(mesh)
    triangle = np.concatenate([visible_triangles(rays, camera)[0].ravel() for camera in cameras])
    position = np.zeros((len(triangle), 3), np.float32)
    shapes = [(camera.height, camera.width) for camera in cameras]
    samples = scenes.samples_of(position, triangle, views=tuple(camera.name for camera in cameras), shapes=shapes)
    return data, samples, scenes.room().triangle


def test_the_view_that_shows_most_is_chosen(room):
    data, samples, emitter = room
    shown = {view: np.isin(samples.triangle[samples.of_view(k)], emitter).sum() for k, view in enumerate(samples.views)}
    assert len(set(shown.values())) == 2
    count = len(data.mesh().triangles)
    seen, nothing = visibilities(data, [samples], [emitter, np.array([], int)], count)
    assert seen.best == (0, list(samples.views).index(max(shown, key=shown.get)))
    assert seen.views == list(samples.views)
    assert (nothing.best, nothing.views) == (None, [])
    assert thumbnail(data, [samples], nothing, np.array([], int), 64) is None


def test_views_and_shards_are_counted_alike(room):
    """A view whose pixels have no weight shows the lamp, but not alone in a pixel."""
    data, samples, emitter = room
    light = scenes.samples_of(
        samples.position,
        samples.triangle,
        np.full(len(samples.triangle), 0.5),
        views=samples.views,
        shapes=samples.shapes,
    )
    (seen,) = visibilities(data, [light, samples], [emitter], len(data.mesh().triangles))
    assert seen.views == list(samples.views)
    assert seen.best[0] == 1


def test_masked_pixels_show_nothing(backend, tmp_path):
    """View a shows more of the emitter, but is masked there."""
    data = Dataset(scenes.write_dataset(tmp_path))
    shape, shards = (scenes.HEIGHT, scenes.WIDTH), []
    for view, shown in (("a", 60), ("b", 40)):
        emitter = np.arange(scenes.HEIGHT * scenes.WIDTH) < shown
        position = np.zeros((len(emitter), 3), np.float32)
        shards.append(scenes.samples_of(position, np.where(emitter, 12, 0), views=(view,), shapes=[shape]))
        valid = np.float32(~emitter if view == "a" else np.ones_like(emitter)).reshape(shape)
        write_exr(tmp_path / "images" / f"{view}.exr", {"": np.ones((*shape, 3), np.float32), "valid.Y": valid})
    (seen,) = visibilities(data, shards, [np.array([12])], 20)
    assert (seen.views, seen.best) == (["b"], (1, 0))


def test_the_image_shows_the_emitter_outlined(room):
    data, samples, emitter = room
    (seen,) = visibilities(data, [samples], [emitter], len(data.mesh().triangles))
    image = thumbnail(data, [samples], seen, emitter, 96)
    assert image.shape[1] <= 96
    assert image.shape[0] <= 72
    assert (96 in image.shape) or (72 in image.shape)
    line = (image == _LINE).all(axis=-1)
    assert line.any()
    # inside the outline it is white, outside there is the colour of walls, neither black nor white
    inside = image.min(axis=-1) > 240
    assert inside.any()
    walls = image[~inside & (image.max(axis=-1) > 0) & ~line]
    assert 40 < np.median(walls) < 220


@pytest.mark.parametrize(
    ("rows", "columns", "expected"),
    [
        ((40, 50), (60, 70), ((33, 57), (46, 86))),  # three times the lamp is less than a quarter of the width
        ((0, 10), (0, 10), ((0, 30), (0, 40))),  # at the corner: moved into the view
        ((0, 120), (0, 160), ((0, 120), (0, 160))),
    ],
)
def test_the_part_of_the_view_around_an_emitter(rows, columns, expected):
    mask = np.zeros((120, 160), bool)
    mask[slice(*rows), slice(*columns)] = True
    y, x = _crop(mask)
    assert (y.start, y.stop, x.start, x.stop) == pytest.approx((*expected[0], *expected[1]), abs=10)
    assert (y.stop - y.start) * 4 == pytest.approx((x.stop - x.start) * 3, abs=4)
    assert (y.start <= rows[0], y.stop >= rows[1], x.start <= columns[0], x.stop >= columns[1]) == (True,) * 4


@pytest.mark.parametrize("emitter", [10.0, 1e6])
def test_emitter_and_surroundings_are_both_recognised(emitter):
    """However bright the lamp is, the wall has the same grey, and a mark on it is seen."""
    radiance = np.full((48, 64, 3), 0.02, np.float32)
    radiance[:8] = 0.005
    mask = np.zeros((48, 64), bool)
    mask[20:30, 30:40] = True
    radiance[mask] = emitter
    image = _drawn(radiance, mask, (64, 48))
    assert image.shape == (48, 64, 3)
    assert image[25, 35].min() > 250
    assert 110 < image[15, 5].mean() < 135
    assert 40 < image[2, 5].mean() < 90


def test_black_images_and_emitters_that_fill_all(room):
    assert _drawn(np.zeros((12, 16, 3), np.float32), np.zeros((12, 16), bool), (64, 48)).shape == (48, 64, 3)
    assert _drawn(np.ones((12, 16, 3), np.float32), np.ones((12, 16), bool), (64, 48)).min() >= 0
