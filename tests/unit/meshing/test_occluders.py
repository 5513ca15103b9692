"""A dark rod that hangs in a room of six walls, whose mesh has it, or has it not."""

import numpy as np
import pytest

from fipt.meshing import occluders
from fipt.meshing.occluders import occluded
from fipt.scene.voxels import FACINGS, voxel_keys
from tests.lit_ball import PLACES, WALLS, box, cameras, shown, with_shining

pytestmark = pytest.mark.usefixtures("backend")

ROD = box((0.05, 1.0, 0.05), (2.1, 1.5, 1.4))
DARK, WALL = 0.03, 0.3


def masks_of(mesh, places=PLACES, level=DARK, valid=None, exposure=1.0):
    """Masks of the views, and what they show: luminance (H, W) each; the second one has an exposure of its own."""
    views = cameras(places=places)
    radiance = shown(*with_shining(WALLS, ROD), views, level=level, wall=WALL)
    images = {view.name: radiance(view.name) for view in views}
    second = views[1].name
    images[second] = images[second][0] * exposure, images[second][1]
    if valid is not None:
        images = {name: (image, 0 * weight + valid) for name, (image, weight) in images.items()}
    masks, odd = occluded(mesh, views, images.__getitem__)
    assert odd == []
    return masks, [images[view.name][0][..., 0] for view in views]


def test_what_the_mesh_lacks_is_left_out():
    masks, images = masks_of(WALLS)
    rod = [image < 0.5 * WALL for image in images]
    assert sum(mask.sum() for mask in masks) > 0.5 * sum(own.sum() for own in rod)
    seen = np.concatenate([image[mask] for mask, image in zip(masks, images, strict=True)])
    assert (seen < 0.9 * WALL).mean() > 0.6, "and little beside it"


def test_what_the_mesh_has_stays():
    """Of the wall beside it some is left out, where a pixel's centre shows the wall, and some of the pixel the rod."""
    masks, images = masks_of(with_shining(WALLS, ROD)[0])
    assert not any((image[mask] < 1.5 * DARK).any() for mask, image in zip(masks, images, strict=True))
    assert sum(mask.sum() for mask in masks) < 0.2 * sum((image < 0.9 * WALL).sum() for image in images)


@pytest.mark.parametrize("exposure", [0.3, 0.8, 3.0])
def test_a_view_of_another_exposure_loses_nothing_else(exposure):
    plain, _ = masks_of(WALLS)
    masks, _ = masks_of(WALLS, exposure=exposure)
    for mask, own in zip(masks, plain, strict=True):
        assert (mask != own).mean() < 0.002


def test_a_view_that_is_dark_in_many_places_is_named_and_stays():
    """Its walls have dark stripes that no other view shows: it is of somewhere else."""
    views = cameras()
    radiance = shown(*with_shining(WALLS, ROD), views, level=DARK, wall=WALL)
    images = {view.name: radiance(view.name) for view in views}
    stripes = np.where(np.arange(80) % 20 < 6, 0.1, 1.0)[None, :, None]
    images[views[1].name] = images[views[1].name][0] * stripes, images[views[1].name][1]
    masks, odd = occluded(WALLS, views, images.__getitem__)
    assert odd == [views[1].name]
    assert not masks[1].any()
    assert any(mask.any() for mask in masks)


def test_what_is_brighter_may_be_a_highlight():
    masks, _ = masks_of(WALLS, level=10 * WALL)
    assert not np.any(masks)


def test_two_views_do_not_tell_which_is_wrong():
    masks, images = masks_of(WALLS, places=PLACES[:2])
    assert all((image < 0.5 * WALL).any() for image in images)
    assert not np.any(masks)


@pytest.mark.parametrize("valid", [0.0, 1.0])
def test_views_that_see_nothing(valid):
    away = [(20.0, 1.5, 20.0), (21.0, 1.5, 20.0), (22.0, 1.5, 20.0)]
    masks, _ = masks_of(box((0.1, 0.1, 0.1), (0, 0, 0)), places=away, valid=valid)
    assert [mask.shape for mask in masks] == [(60, 80)] * 3
    assert not np.any(masks)


def test_no_view_is_no_error():
    assert occluded(WALLS, [], {}.__getitem__) == ([], [])


def test_pixels_without_weight_say_nothing():
    masks, _ = masks_of(WALLS, valid=0.0)
    assert not np.any(masks)


def test_a_quiet_cell_in_a_mirror_has_the_noise_of_the_mirror():
    """Two blocks of cells side by side, one of a mirror and one of a wall; half a metre behind each another surface."""
    side = float(occluders._CELLS)  # cells of 1 m
    x, y, depth = (axis.ravel() for axis in np.meshgrid(np.arange(16), np.arange(8), [0, 8], indexing="ij"))
    place = np.column_stack([x, y, depth]) + 0.5
    mirror = (x < 8) & (depth == 0)
    noise = np.where(mirror & (y != 3), 0.5, 0.02)
    for facing in (0, 5):
        keys = voxel_keys(place, np.zeros(3), side, occluders._CELLS) * FACINGS + facing
        np.testing.assert_array_equal(occluders._around(keys, noise), np.where(mirror, 0.5, 0.02))
    both = np.concatenate([keys, keys - 1])  # the same places, seen from another side
    around = occluders._around(both, np.concatenate([noise, 0 * noise + 0.1]))
    np.testing.assert_array_equal(around[len(keys) :], 0.1)
