"""Gradients of path tracing against finite differences; a small room found again from its images."""

import copy

import numpy as np
import pytest

from fipt.model.parts import PartLabels
from fipt.render.replay import PathBatch, ReplayScene
from fipt.scene.cameras import Camera
from fipt.stages.inverse_trace.optimise import optimise
from fipt.stages.inverse_trace.parts import PartGroups, facing_viewers, seen_radiance
from fipt.stages.inverse_trace.rays import TrainingPixels
from fipt.stages.inverse_trace.settings import InverseTraceSettings
from tests.scenes import cornell, samples_of, turned

GROUPS = 5
"""Left and right half of the room, its block, two emitters."""
TRUE = {
    "base_color": np.array([[0.7, 0.6, 0.5], [0.3, 0.5, 0.6], [0.2, 0.7, 0.3], [0.5] * 3, [0.5] * 3]),
    "roughness": np.array([0.9, 0.5, 0.4, 0.5, 0.5]),
    "metallic": np.array([0.0, 0.3, 0.0, 0.0, 0.0]),
    "emission": np.array([[0.0] * 3, [0.0] * 3, [0.0] * 3, [6.0, 5.0, 4.0], [30.0, 60.0, 90.0]]),
}


@pytest.fixture(scope="module")
def groups():
    room = cornell()
    found = np.where(room.mesh.corners.mean(axis=1)[:, 0] > 0, 1, 0)
    emitting = len(room.triangle)
    found[-emitting - 12 : -emitting] = 2
    found[room.triangle] = np.repeat([3, 4], 2)
    return found


@pytest.fixture(scope="module")
def scene(groups, backend):
    return ReplayScene(cornell().mesh, groups, max_depth=4)


@pytest.mark.parametrize(
    ("name", "index", "step"),
    [
        ("base_color", (1, 1), 0.02),
        ("roughness", (1,), 0.03),
        ("metallic", (1,), 0.03),
        ("emission", (3, 0), 0.3),
        ("emission", (0, 1), 0.05),  # of what does not emit yet
    ],
)
def test_gradients_are_those_of_finite_differences(scene, name, index, step):
    direction = np.random.default_rng(0).normal(size=(1 << 15, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rays = PathBatch(np.tile(np.float32([0.1, 0, 0.3]), (len(direction), 1)), direction.astype(np.float32))
    values = copy.deepcopy(TRUE)
    sums = []
    for change in (0, step, -step) if name != "emission" else (0, 2 * step, 0):
        values[name][index] = TRUE[name][index] + change
        scene.assign(values)
        sums.append(np.mean([scene.radiance(rays, seed).sum(axis=1).mean() for seed in range(2)]))
    values[name][index] = TRUE[name][index]
    scene.assign(values)
    adjoint = np.full((len(direction), 3), 1 / len(direction), np.float32)
    found = scene.gradient(rays, 7, adjoint)[name][index]
    assert found == pytest.approx((sums[1] - sums[2]) / (2 * step), rel=0.1, abs=0.002)


class Cameras:
    """Six views from the middle of the room, all around."""

    def camera(self, view):
        c, s = np.cos(1.05 * int(view)), np.sin(1.05 * int(view))
        pose = np.eye(4)
        pose[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        pose[:3, 3] = pose[:3, :3] @ [0, 0, 0.8]
        return Camera(view, "train", 16, 12, 8.0, 8.0, 8.0, 6.0, pose)


def training(radiance):
    """All pixels of the views, with this radiance."""
    row, column = (np.tile(each, 6) for each in np.divmod(np.arange(16 * 12), 16))
    view = np.repeat(np.arange(6), 16 * 12)
    return TrainingPixels(Cameras(), "012345", view, row, column, radiance, np.zeros(len(view), bool))


def test_a_room_is_found_again(scene):
    blank = training(np.zeros((6 * 16 * 12, 3)))
    scene.assign(TRUE)
    rays = blank.rays(np.arange(len(blank.view)), 64, np.random.default_rng(1))
    pixels = training(scene.radiance(rays, 3).reshape(-1, 64, 3).mean(axis=1))
    settings = InverseTraceSettings(steps=100, pixels=256, spp=2, max_depth=4, emission_rate=0.4, learning_rate=0.1)
    found = optimise(scene, pixels, np.array([0.3, 0.2, 0.2, 5.0, 60.0]), settings)
    assert found.emits[:4].tolist() == [False, False, False, True]  # the other emitter has hardly a pixel
    values = found.values()
    assert np.abs(values["base_color"] - TRUE["base_color"])[:2].mean() < 0.12
    assert np.abs(np.log(values["emission"][3] / TRUE["emission"][3])).max() < 0.4


def test_groups_that_no_pixel_shows_are_dark(scene):
    pixels = training(np.ones((6 * 16 * 12, 3), np.float32))
    settings = InverseTraceSettings(steps=2, pixels=16, spp=1, max_depth=2)
    assert optimise(scene, pixels, np.array([0.01, 0, 0.01, 0, 0]), settings).emits.tolist() == [1, 0, 1, 0, 0]


def test_pixels_without_weight_say_nothing_of_a_group():
    samples = samples_of(np.zeros((10, 3)), triangle=np.repeat([0, 1], 5))
    radiance, weight = np.ones((10, 3), np.float32), np.ones(10, np.float32)
    radiance[7:] = weight[7:] = 0
    groups = PartGroups(np.array([1, 2]), np.array([0, 1]))
    assert seen_radiance(groups, [samples], [(radiance, weight)]).tolist() == [1, 1]
    weight[5:] = 0
    assert seen_radiance(groups, [samples], [(radiance, weight)]).tolist() == [1, 0]


def test_triangles_are_turned_to_their_viewers():
    room = cornell().mesh
    backwards = turned(room)
    samples = samples_of(room.corners.mean(axis=1), triangle=np.arange(len(room.triangles)), normal=room.normals)
    assert np.allclose(facing_viewers(backwards, [samples]).normals, room.normals)
    assert np.allclose(facing_viewers(room, [samples]).normals, room.normals)


def test_segments_without_triangles_have_the_mean():
    labels = PartLabels(np.int32([0, 2, 2]), np.zeros((1, 3), np.float32), np.int32([3]))
    groups = PartGroups.of(labels)
    values = {"base_color": np.array([[0.2] * 3, [0.4] * 3]), "roughness": np.ones(2), "metallic": np.zeros(2)}
    found = groups.materials(labels, values).brdf
    assert found.base_color[:, 0] == pytest.approx([0.2, 0.3, 0.4, 0.3])
