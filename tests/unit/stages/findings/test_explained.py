"""Pixels of the training views and what the model says of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import Emitters
from fipt.stages.findings.explained import explained_pixels
from tests import scenes

WIDTH, HEIGHT = 30, 20


def reflectance(place, normal, footprint):
    """Grey and matte everywhere; the normal is the place's own."""
    count = len(place)
    np.testing.assert_array_equal(normal, place[:, ::-1])
    return SimpleNamespace(
        base_color=np.full((count, 3), 0.5, np.float32),
        roughness=np.ones(count, np.float32),
        metallic=np.zeros(count, np.float32),
    )


@pytest.mark.parametrize("kind", [None, "part"])
def test_a_room_with_and_without_segment_ids(np_rng, kind):
    count = WIDTH * HEIGHT
    place = np_rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    samples = scenes.samples_of(place, 0, views=("a",), shapes=[(HEIGHT, WIDTH)], normal=place[:, ::-1].copy())
    image = np.ones((count, 3), np.float32), np.ones(count, np.float32)
    shards = scenes.observed([samples], [np.ones((count, SHADING_OUTPUTS, 3), np.float32)], [image])
    fitted = SimpleNamespace(reflectance=reflectance, emitters=Emitters.none(), mesh=scenes.floor())
    ids = np.full((HEIGHT, WIDTH), 7, np.uint16)
    data = SimpleNamespace(segment_kind=lambda _: kind, segments=lambda view, kind: ids)
    found = explained_pixels(data, shards, fitted, count)
    assert len(found) == count
    assert (found.segment == (7 if kind else 0)).all()
