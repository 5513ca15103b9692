"""Light setups: found emitters edited, new lights added."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import write_ply
from fipt.scene.setup import RelightSetup, parse_setup
from tests import scenes


@pytest.fixture
def apply(backend):
    from fipt.stages.render.lights import apply_setup

    def apply(empty=False, **setup):
        return apply_setup(ROOM, found(empty), RelightSetup.model_validate(setup))

    return apply


ROOM = scenes.box((0, 0, 0), (4, 3, 5))
BRIGHT = float(np.dot(LUMINANCE, [2, 4, 6]))
"""Luminance of the first emitter, which new colours keep."""
RADIANCE = np.float32([[2, 4, 6], [2, 4, 6], [8, 8, 8]])


def found(empty=False):
    keep = slice(0, 0) if empty else slice(None)
    ones = np.ones(3, np.float32)[keep]
    return Emitters(
        np.array([6, 7, 2], np.int32)[keep],
        RADIANCE[keep],
        ones,
        np.array([0, 0, 1], np.int32)[keep],
        ones,
        ones,
        0 * ones,
        ones > 1,
        np.int8([FRONT, FRONT, BACK])[keep],
    )


def test_nothing_asked_changes_nothing(apply):
    mesh, lit = apply()
    np.testing.assert_array_equal(mesh.vertices, ROOM.vertices)
    np.testing.assert_array_equal(mesh.triangles, ROOM.triangles)
    np.testing.assert_array_equal(lit.triangle, [6, 7, 2])
    np.testing.assert_array_equal(lit.radiance, RADIANCE)


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        ({"scale": 0}, [[0, 0, 0], [0, 0, 0], [0, 0, 0]]),
        ({"scale": 2}, 2 * RADIANCE),
        ({"index": 0, "scale": 0.5}, [[1, 2, 3], [1, 2, 3], [8, 8, 8]]),
        ({"index": 1, "radiance": (1, 2, 3)}, [[2, 4, 6], [2, 4, 6], [1, 2, 3]]),
        ({"radiance": (1, 2, 3), "scale": 10}, [[10, 20, 30]] * 3),
        ({"index": 0, "color": (3, 3, 3)}, [[BRIGHT] * 3, [BRIGHT] * 3, [8, 8, 8]]),
        ({"index": 1, "color": (0, 2, 0), "scale": 0.5}, [[2, 4, 6], [2, 4, 6], [0, 4 / LUMINANCE[1], 0]]),
    ],
)
def test_edits(apply, edit, expected):
    _, lit = apply(emitters=[edit])
    np.testing.assert_allclose(lit.radiance, expected, rtol=1e-6)
    assert lit.radiance.dtype == np.float32


def test_edits_follow_one_another(apply):
    _, lit = apply(emitters=[{"scale": 0}, {"index": 1, "radiance": (1, 1, 1)}, {"index": 1, "scale": 3}])
    np.testing.assert_allclose(lit.radiance, [[0, 0, 0], [0, 0, 0], [3, 3, 3]])


@pytest.mark.parametrize("normal", [(0, -1, 0), (0, 1, 0), (1, 0, 0), (1, -2, 0.5)])
def test_a_quad_is_appended(apply, normal):
    light = {"shape": "quad", "radiance": (5, 6, 7), "center": (2, 1.5, 2), "normal": normal, "size": (0.4, 0.6)}
    mesh, lit = apply(lights=[light])
    np.testing.assert_array_equal(mesh.triangles[:12], ROOM.triangles)
    np.testing.assert_array_equal(mesh.vertices[: len(ROOM.vertices)], ROOM.vertices)
    np.testing.assert_array_equal(lit.triangle, [6, 7, 2, 12, 13])
    np.testing.assert_array_equal(lit.radiance[3:], [[5, 6, 7]] * 2)
    np.testing.assert_array_equal(lit.sides, [FRONT, FRONT, BACK, BOTH, BOTH])
    unit = np.array(normal) / np.linalg.norm(normal)
    np.testing.assert_allclose(mesh.normals[12:], [unit] * 2, atol=1e-5)
    np.testing.assert_allclose(mesh.areas[12:].sum(), 0.24, rtol=1e-4)
    np.testing.assert_allclose(mesh.corners[12:].reshape(-1, 3)[[0, 2]].mean(axis=0), (2, 1.5, 2), atol=1e-5)
    sides = sorted(np.linalg.norm(np.diff(mesh.corners[12][:3], axis=0), axis=1))
    np.testing.assert_allclose(sides, [0.4, 0.6], rtol=1e-4)


def test_a_sphere_is_appended(apply):
    light = {"shape": "sphere", "radiance": (5, 5, 5), "center": (2, 1, 3), "radius": 0.25}
    mesh, lit = apply(lights=[light])
    own = mesh.corners[12:] - np.float32([2, 1, 3])
    np.testing.assert_allclose(np.linalg.norm(own, axis=-1), 0.25, rtol=1e-5)
    assert (np.einsum("tc,tc->t", mesh.normals[12:], own.mean(axis=1)) > 0).all()  # facing outwards
    assert mesh.areas[12:].sum() == pytest.approx(4 * np.pi * 0.25**2, rel=0.02)
    np.testing.assert_array_equal(lit.triangle[3:], np.arange(12, len(mesh.triangles)))


def test_several_lights_keep_their_own_triangles(apply):
    quad = {"shape": "quad", "radiance": (1, 0, 0), "center": (1, 2, 1)}
    sphere = {"shape": "sphere", "radiance": (0, 1, 0), "center": (3, 1, 3)}
    mesh, lit = apply(lights=[quad, sphere, quad | {"radiance": (0, 0, 1), "center": (2, 2, 2)}], empty=True)
    for color, center in (((1, 0, 0), (1, 2, 1)), ((0, 1, 0), (3, 1, 3)), ((0, 0, 1), (2, 2, 2))):
        own = lit.triangle[(lit.radiance == color).all(axis=1)]
        np.testing.assert_allclose(mesh.corners[own].reshape(-1, 3).mean(axis=0), center, atol=0.2)
    assert len(np.unique(lit.triangle)) == len(mesh.triangles) - 12


def test_an_emitter_that_was_not_found_is_named(apply):
    with pytest.raises(FiptError, match="names emitter 2, which is none of 2 emitters; indices are 0 to 1"):
        apply(emitters=[{"index": 2, "scale": 0}])
    with pytest.raises(FiptError, match="names emitter 0, which is none of 0 emitters; leave its emitters out"):
        apply(emitters=[{"index": 0, "scale": 0}], empty=True)


@pytest.mark.parametrize(
    ("edit", "dark"),
    [
        ({"name": "window"}, [0, 1]),
        ({"name": "emitter-0"}, [0, 1]),  # its number goes on being a name
        ({"name": "emitter-1"}, [2]),
        ({"names": ["emitter-1", "window"]}, [0, 1, 2]),
        ({"index": 1}, [2]),
        ({}, [0, 1, 2]),
    ],
)
def test_emitters_are_chosen_by_name(backend, edit, dark):
    from fipt.stages.render.lights import apply_setup

    setup = RelightSetup.model_validate({"emitters": [edit | {"off": True}]})
    _, lit = apply_setup(ROOM, found(), setup, ["window", "emitter-1"])
    expected = RADIANCE.copy()
    expected[dark] = 0
    np.testing.assert_array_equal(lit.radiance, expected)


def test_an_unknown_name_lists_the_emitters_closest_first(backend):
    from fipt.stages.render.lights import apply_setup

    setup = RelightSetup.model_validate({"emitters": [{"names": ["window", "my window"], "off": True}]})
    with pytest.raises(FiptError, match="which is none of 2 emitters; there are window, desk emitter"):
        apply_setup(ROOM, found(), setup, ["desk emitter", "window"])


def test_off_needs_no_quotes_in_yaml():
    for text in ("off: true", "'off': true"):
        edit = RelightSetup.model_validate({"emitters": [yaml.safe_load(text)]}).emitters[0]
        assert (edit.off, edit.scale) == (True, None)


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ({"index": 0, "name": "window"}, "by one of index, name and names, not by index and name"),
        ({"name": "a", "names": ["b"]}, "not by name and names"),
        ({"names": []}, "names: tuple should have at least 1 item"),
        ({"off": True, "scale": 0.5}, "off: true leaves no light for scale"),
        ({"off": True, "color": [1, 1, 1], "radiance": [1, 1, 1]}, "no light for color and radiance"),
    ],
)
def test_edits_that_contradict_themselves_are_refused(edit, said):
    with pytest.raises(FiptError, match=said):
        parse_setup(json.dumps({"emitters": [edit]}))


def test_all_of_no_emitters_may_be_edited(apply):
    _, lit = apply(emitters=[{"scale": 0}, {"color": (1, 0, 0)}], empty=True)
    assert lit.radiance.shape == (0, 3)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("{", "setup"),
        ('{"lamps": []}', "unknown key setup.lamps"),
        ('{"emitters": [{"scale": -1}]}', r"setup\.emitters\.0\.scale"),
        ('{"lights": [{"shape": "cone", "radiance": [1, 1, 1], "center": [0, 0, 0]}]}', r"setup\.lights\.0\.shape"),
        (
            '{"lights": [{"shape": "quad", "center": [0, 0, 0]}]}',
            r"setup\.lights\.0\.radiance is missing; shape: quad needs",
        ),
        (
            '{"lights": [{"shape": "quad", "radiance": [1, 1, 1], "center": [0, 0, 0], "normal": [0, 0, 0]}]}',
            "normal of a new quad light must not be zero",
        ),
    ],
)
def test_a_setup_that_is_wrong_is_explained(text, problem):
    with pytest.raises(FiptError, match=problem):
        parse_setup(text)


def entry(kind, **keys):
    return json.dumps({kind: [keys]})


SPOT = {"shape": "spot", "position": [0, 0, 0], "intensity": [1, 1, 1], "target": [1, 0, 0]}
THING = {"shape": "cube", "position": [0, 0, 0]}
BOX = {"center": [0, 0, 0], "size": [1, 1, 1]}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (entry("lights", **SPOT | {"intensity": [1, -1, 1]}), r"lights\.0\.intensity\.1.*greater than or equal to 0"),
        ('{"lights": [{"shape": "quad", "center": [0, 0, 0], "radiance": [NaN, 1, 1]}]}', r"lights\.0\.radiance\.0"),
        (entry("emitters", radiance=[1, 1, -2]), r"emitters\.0\.radiance\.2"),
        (entry("lights", **SPOT | {"direction": [1, 0, 0]}), "either direction or target"),
        (entry("lights", **SPOT | {"target": [0, 0, 0]}), "direction must not be zero, nor its target its position"),
        (entry("lights", **SPOT | {"cone_angle": 20, "soft_edge": 15}), "soft_edge must be at most half of cone_angle"),
        (
            entry("lights", **SPOT | {"radiance": [1, 1, 1]}),
            r"lights\.0\.radiance is only for shape quad or sphere or mesh; shape is spot",
        ),
        (
            entry("lights", shape="spot", intensity=[1, 1, 1], target=[1, 0, 0]),
            r"lights\.0\.position is missing; shape: spot needs",
        ),
        (entry("lights", shape="mesh", radiance=[1, 1, 1]), r"lights\.0\.file is missing; shape: mesh needs"),
        (entry("objects", position=[0, 0, 0]), "an object needs either file or shape"),
        (entry("objects", **THING, file="a.ply"), "an object needs either file or shape"),
        (entry("objects", **THING, scale=0), r"objects\.0\.scale"),
        (entry("objects", **THING, base_color=[1, 2, 1]), r"objects\.0\.base_color\.1"),
        (entry("materials", metallic=1), "give one of segment, at and box"),
        (entry("materials", metallic=1, segment=1, box=BOX), "give one of segment, at and box"),
        (entry("materials", box=BOX), "at least one of base_color, tint, roughness and metallic"),
        (entry("materials", box=BOX, tint=[1, 1, 1], base_color=[1, 1, 1]), "base_color or tint, not both"),
        (entry("materials", box=BOX, roughness=0), r"materials\.0\.roughness"),
        (entry("remove"), "give one of segment, at and box"),
        ("nowhere.yaml", "is missing: nowhere.yaml"),
    ],
)
def test_entries_that_are_wrong_are_explained(text, problem):
    with pytest.raises(FiptError, match=problem) as caught:
        parse_setup(text)
    assert "\n" not in str(caught.value)


def test_setups_of_files_and_what_the_config_passes_on(tmp_path):
    """YAML and JSON say the same; with all keys written out, as rules pass it, it stays the same."""
    path = tmp_path / "a.yaml"
    path.write_text("lights:\n  - {shape: spot, position: [0, 0, 0], intensity: [1, 1, 1], target: [1, 0, 0]}\n")
    setup = parse_setup(str(path))
    assert setup == parse_setup(entry("lights", **SPOT))
    full = RelightSetup.model_validate({"lights": [SPOT], "objects": [THING], "remove": [{"box": BOX}]})
    assert parse_setup(full.model_dump_json()) == full
    path.write_text("lights: [")
    with pytest.raises(FiptError, match=r"a\.yaml is not YAML"):
        parse_setup(str(path))


def test_mesh_lights_emit_and_spots_have_no_surface(apply, tmp_path):
    write_ply(tmp_path / "a.ply", scenes.turned(scenes.box((-1, -1, -1), (1, 1, 1))))
    light = {
        "shape": "mesh",
        "file": str(tmp_path / "a.ply"),
        "radiance": [1, 2, 3],
        "position": [2, 1, 2],
        "scale": 0.1,
    }
    mesh, lit = apply(lights=[SPOT, light])
    np.testing.assert_array_equal(lit.triangle[3:], np.arange(12, 24))
    np.testing.assert_array_equal(lit.radiance[3:], [[1, 2, 3]] * 12)
    np.testing.assert_allclose(mesh.corners[12:].min(axis=(0, 1)), [1.9, 0.9, 1.9], rtol=1e-6)


# --- each emitter alone ------------------------------------------------------------------------------


def alone(separate, outside=0.0, **changed):
    from fipt.stages.render.lights import one_at_a_time

    sky = EnvironmentMap("map", np.full((2, 4, 3), outside, np.float32))
    return one_at_a_time(replace(found(), **changed), sky, separate)


def test_parts_of_the_light_add_up_to_it(backend):
    """Emitter 0 has two triangles of mean radiance 4, emitter 1 one of 8 and half the area."""
    parts = alone(2, outside=3.0, area=np.float32([1, 1, 0.5]))
    assert list(parts) == ["emitter-0", "emitter-1", "outside"]
    np.testing.assert_array_equal(parts["emitter-0"].emitters.radiance, [[2, 4, 6], [2, 4, 6], [0, 0, 0]])
    np.testing.assert_array_equal(parts["emitter-1"].emitters.radiance, [[0, 0, 0], [0, 0, 0], [8, 8, 8]])
    np.testing.assert_array_equal(sum(part.emitters.radiance for part in parts.values()), RADIANCE)
    np.testing.assert_array_equal(sum(part.environment.radiance for part in parts.values()), np.full((2, 4, 3), 3))
    for part in parts.values():  # emitters that are off are black, not part of the wall
        np.testing.assert_array_equal(part.emitters.triangle, [6, 7, 2])


def test_the_weaker_emitters_are_one_part(backend):
    parts = alone(1, area=np.float32([1, 1, 2]))
    assert list(parts) == ["emitter-1", "rest"]
    np.testing.assert_array_equal(parts["rest"].emitters.radiance, [[2, 4, 6], [2, 4, 6], [0, 0, 0]])


def test_no_light_has_no_parts(backend):
    from fipt.stages.render.lights import one_at_a_time

    assert one_at_a_time(found(empty=True), NOTHING, 3) == {}
    assert list(alone(3, radiance=np.float32([[0] * 3, [0] * 3, [1] * 3]))) == ["emitter-1"]


def test_lights_that_light_nothing_are_told(apply):
    """Outside the walls, or within a closed box; not where light comes in by a gap or round a corner."""
    from fipt.stages.render.lights import idle_lights

    lamps = [
        {"shape": "sphere", "center": [2, 2, 2], "radiance": [1, 1, 1]},
        {"shape": "sphere", "center": [2, 2, -1], "radiance": [1, 1, 1]},
        {"shape": "quad", "center": [1, 0.5, 1], "size": [0.1, 0.1], "radiance": [1, 1, 1]},
        {"shape": "spot", "position": [6, 1, 1], "target": [2, 1, 1], "intensity": [1, 1, 1]},
        {"shape": "spot", "position": [2, 1, 1], "target": [2, 1, 9], "intensity": [1, 1, 1]},
        {"shape": "quad", "center": [9, 9, 9], "radiance": [0, 0, 0]},
    ]
    mesh, _ = apply(lights=lamps)
    setup = RelightSetup.model_validate({"lights": lamps})
    shut_in, open_below = scenes.box((0.8, 0.3, 0.8), (1.2, 0.7, 1.2)), scenes.box((1.8, 1.8, 1.8), (2.2, 2.2, 2.2))
    open_below = replace(open_below, triangles=open_below.triangles[2:])
    camera = scenes.look_at("a", (3.5, 1.5, 4.5), (2, 1, 2))
    told = idle_lights(scenes.joined(mesh, shut_in, open_below), setup, [camera])
    assert [warning.split()[0] for warning in told] == ["lights.1", "lights.2", "lights.3"]
    without_a_wall = replace(ROOM, triangles=ROOM.triangles[2:])
    mesh = scenes.joined(without_a_wall, replace(mesh, triangles=mesh.triangles[len(ROOM.triangles) :]))
    assert len(idle_lights(mesh, setup, [camera])) < len(told)


def test_objects_that_nobody_sees_are_told(backend):
    """Far outside, behind a wall or within another thing; not round a corner."""
    from fipt.stages.render.lights import idle_objects

    places = [(102, 1, 2), (2, 2, 2), (-0.5, 1, 2), (3, 0.5, 0.5)]
    things = [scenes.box(tuple(x - 0.1 for x in at), tuple(x + 0.1 for x in at)) for at in places]
    shell = scenes.box((1.8, 1.8, 1.8), (2.2, 2.2, 2.2))
    mesh, camera = scenes.joined(ROOM, shell, *things), scenes.look_at("a", (3.5, 1.5, 4.5), (2, 1, 2))
    told = idle_objects(mesh, [len(thing.triangles) for thing in things], [camera])
    assert [warning.split()[0] for warning in told] == ["objects.0", "objects.1", "objects.2"]
    assert "seen by no camera and no surface that they see" in told[0]
    assert idle_objects(mesh, [], [camera]) == []


def test_what_stands_in_one_place_is_told(backend):
    """A sphere in a cube and a light that is there twice; not a cube on another, nor a cross of two boards."""
    from fipt.stages.render.lights import crowded_things

    cubes = [((x - 0.1, y - 0.1, 1.9), (x + 0.1, y + 0.1, 2.1)) for x, y in [(1, 1), (1, 1.2), (3, 1)]]
    boards = [((1.5, 0, 2), (2.5, 0.1, 2.1)), ((1.95, 0, 1.5), (2.05, 0.1, 2.5))]
    things = [scenes.box(*corners) for corners in (*cubes, *boards)]
    lamps = [{"shape": "sphere", "center": [3, 1, 2], "radius": 0.1, "radiance": [1, 1, 1]}]
    lamps += [{"shape": "quad", "center": [2, 1, 1], "normal": [0, 1, 0], "size": [1, 1], "radiance": [1, 1, 1]}] * 2
    lamps += [{"shape": "spot", "position": [2, 1, 2], "target": [2, 1, 9], "intensity": [1, 1, 1]}] * 2
    setup = RelightSetup.model_validate({"lights": lamps})
    told = crowded_things(scenes.joined(ROOM, *things), setup, [len(thing.triangles) for thing in things])
    assert [" ".join(line.split()[:3]) for line in told] == [
        *("lights.0 and objects.2", "lights.1 and lights.2", "lights.3 and lights.4")
    ]
    assert crowded_things(ROOM, RelightSetup(), []) == []
