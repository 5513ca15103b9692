"""What emits beside what views show to emit."""

import numpy as np
import pytest
import trimesh

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import BACK, FRONT, Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.review import ReviewDecisions
from fipt.stages.emitters.completion import Seen, completed
from fipt.stages.emitters.decided import Decided
from fipt.stages.emitters.settings import EmittersSettings
from tests import scenes

RADIANCE = np.float32([12, 6, 3])


@pytest.mark.parametrize(("dark_side", "whole"), [(BACK, True), (FRONT, False)])
def test_a_tube_whose_dark_inside_is_seen_through_its_end_shines_all_around(dark_side, whole):
    """Views show its side towards them, and, in pixels shared with others, a bit of the side towards the wall."""
    closed = trimesh.creation.cylinder(0.02, 2.0, sections=24)
    tube = Mesh(np.float32(closed.vertices), np.int32(closed.faces[np.abs(closed.face_normals[:, 2]) < 0.5]))
    near, far = np.flatnonzero(tube.normals[:, 0] > 0.7), tube.normals[:, 0] < -0.7
    samples = scenes.samples_of(tube.corners[near].mean(axis=1), near, normal=tube.normals[near])
    shading = np.zeros((len(near), SHADING_OUTPUTS, 3), np.float16)
    image = np.tile(RADIANCE, (len(near), 1))
    shards = scenes.observed([samples], [shading], [(image, np.ones(len(near), np.float32))])
    found = Emitters.plain(tube, near, image, 0 * near)
    seen = Seen(
        np.isin(np.arange(len(far)), near),
        far[:, None] & (np.array([FRONT, BACK]) == dark_side),
        np.full((len(far), 3), np.nan),
    )
    decided = Decided.of(ReviewDecisions(), len(far))
    emitters = completed(tube, shards, found, seen, EmittersSettings(), decided)
    np.testing.assert_array_equal(emitters.triangle, np.arange(len(far)) if whole else near)


@pytest.mark.parametrize(("light", "whole"), [(8.0, True), (2.0, False)])
def test_a_strip_is_not_dark_where_its_shared_pixels_have_its_light(light, whole):
    """One triangle of a strip fills pixels; the other has half of pixels that could be reflections in a mirror."""
    strip = scenes.quad((0, 0, 0), (0, 0.8, 0), (0, 0, 0.02))
    samples = scenes.samples_of(np.zeros((4, 3)), np.array([0, 0, 1, 1]), np.array([1, 1, 0.5, 0.5]))
    image = np.repeat([RADIANCE, RADIANCE / RADIANCE.mean() * light / 2], 2, axis=0).astype(np.float32)
    shading = np.zeros((4, SHADING_OUTPUTS, 3), np.float16)
    shards = scenes.observed([samples], [shading], [(image, np.ones(4, np.float32))])
    found = Emitters.plain(strip, np.array([0]), RADIANCE[None], np.zeros(1))
    seen = Seen(np.array([True, False]), np.array([[False, False], [True, False]]), np.full((2, 3), np.nan))
    settings, decided = EmittersSettings(sides="both"), Decided.of(ReviewDecisions(), 2)
    assert completed(strip, shards, found, seen, settings, decided).triangle.tolist() == ([0, 1] if whole else [0])


@pytest.mark.parametrize(("shown", "whole"), [(2, True), (1, False)])
def test_of_what_views_show_little_of_the_rest_is_not_known(shown, whole):
    """A box of twelve like triangles."""
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    lamp, own = Mesh(np.float32(cube.vertices), np.int32(cube.faces)), np.arange(12) < shown
    found = Emitters.plain(lamp, np.flatnonzero(own), np.tile(RADIANCE, (shown, 1)), np.zeros(shown))
    seen = Seen(own, np.zeros((12, 2), bool), np.full((12, 3), np.nan))
    settings, decided = EmittersSettings(sides="both"), Decided.of(ReviewDecisions(), 12)
    emitters = completed(lamp, scenes.observed([], [], []), found, seen, settings, decided)
    assert len(emitters.triangle) == (12 if whole else shown)
