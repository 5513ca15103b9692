"""The room itself: closed, clean, fully described."""

import json

import numpy as np
import pytest

from fipt.synthetic import shapes
from fipt.synthetic.parts import SEMANTICS
from fipt.synthetic.room import build
from fipt.synthetic.rooms.living_room import SIZE


@pytest.fixture(scope="module")
def room():
    return build(3)


def test_triangles_are_clean_and_inside_the_walls(room):
    assert 5_000 < len(room.mesh.triangles) < 40_000
    assert room.mesh.areas.min() > 1e-7
    assert room.mesh.triangles.max() < len(room.mesh.vertices)
    low, high = room.mesh.vertices.min(axis=0), room.mesh.vertices.max(axis=0)
    assert (low >= [-1e-6, -1e-3, -0.2]).all()  # the window's recess reaches beyond z = 0
    assert (high <= np.array(SIZE) + 1e-6).all()


def test_same_seed_same_room_and_other_seed_another(room):
    build.cache_clear()
    again, other = build(3), build(4)
    for name in ("uv", "part", "semantic", "material", "radiance"):
        np.testing.assert_array_equal(getattr(room, name), getattr(again, name))
    np.testing.assert_array_equal(room.mesh.vertices, again.mesh.vertices)
    np.testing.assert_array_equal(room.mesh.triangles, again.mesh.triangles)
    assert other.description() != room.description()


def test_every_triangle_has_ids_and_a_physical_material(room):
    count = len(room.mesh.triangles)
    assert len(room.part) == len(room.semantic) == len(room.material) == count
    assert set(room.part) == set(range(1, len(room.parts) + 1))
    assert room.semantic.min() >= 1
    assert room.semantic.max() <= len(SEMANTICS)
    assert len(set(room.parts)) == len(room.parts)
    for material in room.materials:
        assert 0.02 <= material.roughness.item() <= 1
        assert material.metallic.item() in (0, 1)
        assert material.base_color.min() >= 0
        assert material.base_color.max() < 0.9  # the reflectance gains energy for whiter dielectrics


def test_it_has_the_surfaces_a_test_room_needs(room):
    metallic, roughness = (
        np.array([getattr(room.materials[k], name).item() for k in room.material]) for name in ("metallic", "roughness")
    )
    assert metallic.any()
    assert (roughness[(metallic == 0) & ~room.emits] <= 0.2).any(), "a glossy dielectric"
    assert {SEMANTICS[i - 1] for i in room.semantic} == set(SEMANTICS)
    walls = [tuple(m.base_color.ravel()) for m in room.materials if m.name.endswith(" wall")]
    assert len(set(walls)) == 4


def test_emitters_are_listed_with_their_radiance(room):
    described = json.loads(json.dumps(room.description()))
    assert [emitter["part"] for emitter in described["emitters"]] == [
        "window pane",
        "ceiling lamp",
        "table lamp globe",
    ]
    listed = np.concatenate([emitter["triangles"] for emitter in described["emitters"]])
    np.testing.assert_array_equal(listed, np.flatnonzero(room.emits))
    for emitter in described["emitters"]:
        np.testing.assert_allclose(
            room.radiance[emitter["triangles"]], [emitter["radiance"]] * len(emitter["triangles"]), rtol=1e-5
        )
        assert emitter["area"] == pytest.approx(room.mesh.areas[emitter["triangles"]].sum(), abs=1e-5)


def test_room_is_closed_and_shows_lamps_from_their_front_only(room, backend, np_rng):
    from fipt.synthetic.views import Truth

    points = np.array([[2.5, 1.6, 1.2], [4.3, 1.2, 1.9], [0.9, 2.3, 3.5], [1.9, 1.5, -0.05], [3.4, 0.1, 2.2]])
    direction = np_rng.standard_normal((20_000, 3))
    direction = (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)
    normals = room.mesh.normals
    shell = [i + 1 for i, name in enumerate(room.parts) if name.endswith("wall") or name in ("floor", "ceiling")]
    for point in points:
        origin = np.broadcast_to(point.astype(np.float32), direction.shape)
        distance, triangle = Truth(room).intersect(origin, direction)
        assert (triangle >= 0).all()
        assert (distance < np.linalg.norm(SIZE) + 1).all()
        facing = -(normals[triangle] * direction).sum(axis=1)
        assert (facing[room.emits[triangle]] > 0).all()
        assert (facing[np.isin(room.part[triangle], shell)] > 0).all()


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (shapes.box((1.0, 2.0, 0.5)), 1.0),
        (shapes.ball(0.5, 64), 4 / 3 * np.pi * 0.125),
        (shapes.rod((0, 0, 0), (0.3, 0.4, 1.2), 0.1, 64), np.pi * 0.01 * 1.3),
        (shapes.ring(1.0, 0.1, 96, 48), 2 * np.pi**2 * 0.01),
        (shapes.box((1.0, 1.0, 1.0), 0.5, 8), np.pi / 6),
    ],
)
def test_solids_are_closed_and_wound_outward(shape, volume):
    corners = shape.vertices[shape.triangles]
    signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert signed == pytest.approx(volume, rel=0.02)


def test_turning_is_right_handed():
    quad = shapes.panel((1, 0, 0), (0.1, 0, 0), (0, 0.1, 0)).turned(90, "z")
    np.testing.assert_allclose(quad.vertices[0], (0, 1, 0), atol=1e-12)
