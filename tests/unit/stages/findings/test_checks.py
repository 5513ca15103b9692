"""Every check: silent where all is sound, and the right finding for a planted trouble."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from fipt.render.scene import RayScene
from fipt.scene.emitters import BOTH, FRONT, Emitters, Undecided, emitter_facts
from fipt.scene.environment import NOTHING, constant
from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.mesh import Mesh
from fipt.scene.samples import FootprintSamples
from fipt.scene.settled import RoundState
from fipt.stages.findings.checks import (
    added_emitters,
    brightness,
    cameras,
    dim_emitters,
    edges,
    emitters,
    exposures,
    guessed_light,
    hardly_seen,
    holes,
    light_balance,
    mesh,
    missing_emitter,
    mixed_ids,
    no_emitter,
    parts,
    rerendering,
    settled,
    thin,
    uncertain,
    viewpoints,
)
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.patches import SIDE as SIDE_OF_PATCH
from fipt.stages.findings.patches import EdgePatches
from tests import judged
from tests.judged import GRID, SIDE, VIEWS


def told(check, **changed):
    """Id -> finding of a check on the sound room with what is changed."""
    return {found.id: found for found in check(judged.room(**changed), Notes())}


def lit(found=None, environment=NOTHING):
    return SimpleNamespace(emitters=judged.emitters() if found is None else found, environment=environment)


@pytest.mark.parametrize(
    "check",
    [
        light_balance.check,
        brightness.check,
        missing_emitter.check,
        mesh.check,
        emitters.check,
        dim_emitters.check,
        exposures.check,
        mixed_ids.check,
        parts.check,
        rerendering.check,
        no_emitter.check,
        guessed_light.check,
        added_emitters.check,
        settled.check,
        hardly_seen.check,
        uncertain.check,
        viewpoints.check,
    ],
)
def test_a_sound_room_is_silent(check):
    assert told(check) == {}


def test_views_from_one_place():
    sound = judged.room().data
    turned = SimpleNamespace(views=sound.views, camera=lambda view: sound.camera("v0"))
    found = told(viewpoints.check, data=turned)["one-place"]
    assert found.severity == "serious"
    assert "from one place, within 0 cm" in found.cause


def test_what_the_check_of_cameras_found_is_repeated(tmp_path):
    moved = RoomFinding("mesh-misplaced", "warning", "C.", Measure("motion", 1.5, 1.0, ""), "R.")
    data = SimpleNamespace(root=tmp_path)
    assert told(cameras.check, data=data) == {}  # cameras that are exact are not checked
    (tmp_path / "check_poses.json").write_text(json.dumps({"views": {}, "findings": [moved.row]}))
    assert told(cameras.check, data=data) == {"mesh-misplaced": moved}


# --- light ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ratio", "word", "level"), [(0.75, "25 % less", "serious"), (1.18, "18 % more", "warning")])
def test_light_that_is_missing_or_too_much(ratio, word, level):
    found = told(light_balance.check, retakes=[judged.retake(k, ratio) for k in range(VIEWS)])["light-balance"]
    assert word in found.cause
    assert found.severity == level
    assert found.measure.value == pytest.approx(abs(ratio - 1), abs=0.01)
    assert found.image.shape[2] == 3


def test_the_view_that_is_named_is_one_that_was_judged():
    retakes = [judged.retake(k, ratio) for k, ratio in enumerate((0.7, 0.72, 0.7, 0.75, 0.78, 0.72))]
    retakes[0] = replace(retakes[0], weight=np.zeros_like(retakes[0].weight))  # clipped everywhere
    retakes[1:] = [judged.retake(k, 0.75 if k == 4 else 0.75 + 0.01 * (k - 4)) for k in range(1, VIEWS)]
    found = told(light_balance.check, retakes=retakes)["light-balance"]
    assert found.numbers["ratio"] == pytest.approx(0.74, abs=0.01)
    assert found.where["views"] == ["v3"]


def test_a_lamp_is_missing_only_where_colours_are_near_white():
    retakes = [judged.retake(k, 0.75) for k in range(VIEWS)]
    dark = told(light_balance.check, retakes=retakes)["light-balance"]
    assert "base colours are too dark" in dark.cause
    assert "more rounds" in dark.remedy
    pixels = judged.pixels()
    white = replace(pixels, base_color=np.full_like(pixels.base_color, 0.89))
    missing = told(light_balance.check, retakes=retakes, explained=white)["light-balance"]
    assert "ceiling" in missing.remedy
    over = replace(pixels, brightest=np.full(len(pixels), 0.4))
    assert "ceiling" in told(light_balance.check, retakes=retakes, explained=over)["light-balance"].remedy


def test_a_little_less_light_is_not_told():
    assert not told(light_balance.check, retakes=[judged.retake(k, 0.93) for k in range(VIEWS)])


def test_light_that_falls_off_to_one_side():
    across = np.exp(np.linspace(-0.3, 0.3, GRID))[None]
    found = told(light_balance.check, retakes=[judged.retake(k, across) for k in range(VIEWS)])["light-slope"]
    assert found.where["position"][0] < SIDE / 4
    assert found.measure.value > 0.4


def test_light_of_spheres_that_the_mesh_lacked_is_told():
    middle = judged.mesh().corners[[12, 13]].mean(axis=(0, 1)).tolist()
    added = [{"center": middle, "radius": 1.0, "views": 3}]
    found = told(added_emitters.check, prepared={"added_emitters": added})["added-emitters"]
    assert "100 % of the emitted power" in found.cause
    assert found.where["position"] == middle
    away = [{"center": [99.0, 0.0, 0.0], "radius": 0.1, "views": 3}]
    assert not told(added_emitters.check, prepared={"added_emitters": away})


def test_guessed_light_is_told():
    found = judged.emitters()
    guessed = replace(
        found, guessed=np.ones(len(found.triangle), bool), spread=np.full(len(found.triangle), 0.3, np.float32)
    )
    told_of = told(guessed_light.check, fitted=lit(guessed))["guessed-light"]
    assert "100 % of the emitted power is a guess, known within 30 %" in told_of.cause
    assert told_of.image.shape[2] == 3
    assert not told(no_emitter.check, fitted=lit(guessed))


def test_a_guess_shines_to_both_sides():
    """A lamp of one side, and as large and bright a guess of both: two thirds of the power."""
    sides = np.int8([BOTH, BOTH, FRONT, FRONT])
    guessed = np.array([True, True, False, False])
    both = judged.emitters((8, 9, 12, 13), emitter=np.int32([1, 1, 0, 0]), sides=sides, guessed=guessed)
    assert "67 % of the emitted power" in told(guessed_light.check, fitted=lit(both))["guessed-light"].cause
    shares = [row["share"] for row in emitter_facts(both, judged.mesh())]
    np.testing.assert_allclose(shares, [1 / 3, 2 / 3], rtol=1e-5)


def test_without_any_emitter():
    dark = [judged.retake(k, 0.2) for k in range(VIEWS)]
    changed = {"fitted": lit(Emitters.none()), "retakes": dark}
    assert told(light_balance.check, **changed) == {}


def test_no_emitter_and_where_it_may_be(backend):
    """The lamp's light on the floor tells that it hangs near the middle of the ceiling, which no view shows."""
    room = judged.room(fitted=lit(Emitters.none()))
    room.rays = RayScene(room.mesh)
    off = np.square(room.explained.position[: GRID * GRID] - [3, 0, 1]).sum(axis=1).reshape(GRID, GRID)
    light = 1 / (1 + off / SIDE**2) ** 2  # of a small lamp below the ceiling, above (3, 1)
    room.retakes = [judged.retake(k, np.maximum(1 - light, 0.01)) for k in range(VIEWS)]
    (found,) = no_emitter.check(room, Notes())
    assert found.severity == "serious"
    assert np.allclose(np.array(found.where["position"])[[0, 2]], [3, 1], atol=0.7)
    assert found.where["position"][1] > 0.5 * SIDE
    assert " near (" in found.remedy


def test_light_from_outside_is_light():
    assert told(no_emitter.check, fitted=lit(Emitters.none(), constant((1.0, 1.0, 1.0), "y"))) == {}


def test_brighter_than_anything_could_be():
    photo = judged.pixels().photo.copy()
    photo[judged.pixels().column > GRID / 2] = 3
    found = told(brightness.check, explained=judged.pixels(photo=photo))["too-bright"]
    assert found.severity == "serious"
    assert found.where["position"][0] > SIDE / 2
    clipped = photo[:, 0] == 3
    again = told(brightness.check, explained=judged.pixels(photo=photo, use=~clipped, clipped=clipped))["too-bright"]
    assert again.measure.value == found.measure.value
    dim = judged.pixels(use=~clipped, clipped=clipped)  # a lower bound below what surfaces show tells nothing
    assert told(brightness.check, explained=dim) == {}


def test_holes(backend):
    room = judged.room()
    room.rays = RayScene(room.mesh)
    assert holes.check(room, Notes()) == []
    room.mesh = Mesh(room.mesh.vertices, np.delete(room.mesh.triangles, [6, 7, 12, 13], axis=0))
    room.rays = RayScene(room.mesh)
    room.fitted = lit(Emitters.none())
    (found,) = holes.check(room, Notes())
    assert found.id == "holes"
    assert found.where["position"][1] == pytest.approx(SIDE, abs=0.01)
    room.fitted = lit(Emitters.none(), constant((1.0, 1.0, 1.0), "y"))
    assert holes.check(room, Notes()) == []


# --- emitters -------------------------------------------------------------------------------------


def _speckles():
    """A ceiling lamp cut into 200 triangles."""
    x, z = np.meshgrid(np.linspace(1.5, 2.5, 11), np.linspace(1.5, 2.5, 11), indexing="ij")
    vertices = np.stack([x, np.full_like(x, SIDE - 0.01), z], axis=-1).reshape(-1, 3)
    first = (np.arange(10)[:, None] * 11 + np.arange(10)).reshape(-1)
    quads = np.concatenate([first[:, None] + [0, 1, 12], first[:, None] + [0, 12, 11]])
    return Mesh(vertices.astype(np.float32), quads.astype(np.int32))


def test_an_emitter_in_speckles():
    lamp = _speckles()
    torn = judged.emitters(range(200), area=np.full(200, 0.005, np.float32), emitter=np.arange(200, dtype=np.int32))
    found = told(emitters.check, mesh=lamp, fitted=lit(torn))["torn-emitters"]
    assert found.numbers == {"emitters": 200, "groups": 1}
    whole = judged.emitters(range(200), area=np.full(200, 0.005, np.float32))
    assert told(emitters.check, mesh=lamp, fitted=lit(whole)) == {}


def test_a_clipped_emitter():
    found = told(emitters.check, fitted=lit(judged.emitters(lower_bound=np.ones(2, bool))))["clipped-emitters"]
    assert "clipped in every exposure" in found.cause


def test_a_screen_that_may_be_a_mirror():
    screen = (np.abs(judged.pixels().position - [1, 0, 1]).max(axis=1) < 0.9)[:, None]
    photo = np.where(screen, 1.3, judged.pixels().photo)
    explained = judged.pixels(photo=photo, footprint=np.full(len(photo), SIDE / GRID / 4))
    found = told(dim_emitters.check, explained=explained)["emitter-or-mirror"]
    assert np.allclose(found.where["position"], [1, 0, 1], atol=0.2)
    moving = np.where(screen, 1.2 + 0.5 * judged.pixels().view[:, None], judged.pixels().photo)
    assert told(dim_emitters.check, explained=judged.pixels(photo=moving, footprint=explained.footprint)) == {}


@pytest.mark.parametrize("finer", [1, 16])
def test_photographs_of_any_size_tell_a_screen_and_two_things_of_one_id(np_rng, finer):
    """As many pixels are compared, ``finer`` times as small, and each view shows other places."""
    sound = judged.pixels()
    place = sound.position + np_rng.uniform(-0.5, 0.5, sound.position.shape) * [SIDE / GRID, 0, SIDE / GRID]
    size = np.full(len(place), SIDE / GRID / 4 / finer)
    screen = (np.abs(place - [1, 0, 1]).max(axis=1) < 0.9)[:, None]
    shown = judged.pixels(position=place, footprint=size, photo=np.where(screen, 1.3, sound.photo))
    assert set(told(dim_emitters.check, explained=shown)) == {"emitter-or-mirror"}
    left, right = place[:, 0] < 1.2, place[:, 0] > 2.8
    photo = np.where(right[:, None], [0.1, 0.2, 0.5], sound.photo)
    two = judged.pixels(position=place, footprint=size, photo=photo, use=left | right)
    assert set(told(mixed_ids.check, explained=two)) == {"mixed-ids"}


@pytest.mark.parametrize("size", [0.4, 0.8])
def test_a_screen_that_is_small_and_near(np_rng, size):
    """Its pixels, 20 x 20 in each view, are smaller than those of most surface."""
    wall, count = judged.pixels(), 20 * 20
    number = VIEWS * count
    rows = np.arange(number) % len(wall.view)
    both = {name: np.concatenate([own, own[rows]]) for name, own in vars(wall).items() if name != "views"}
    screen = np.s_[len(wall.view) :]
    x, z = 1 + size * np_rng.random((2, number))
    both["position"][screen] = np.column_stack([x, np.ones(number), z])
    both["view"][screen] = np.repeat(np.arange(VIEWS), count)
    both["footprint"][screen], both["photo"][screen] = size / 20, 1.3
    found = told(dim_emitters.check, explained=judged.pixels(**both))
    assert np.allclose(found["emitter-or-mirror"].where["position"], [1 + size / 2, 1, 1 + size / 2], atol=0.1)


def test_emitters_that_are_undecided():
    one = np.ones(1, np.float32)
    asked = Undecided(np.array([4, 5], np.int32), np.zeros(2, np.int32), one, one, one)
    found = told(dim_emitters.check, fitted=lit(judged.emitters(undecided=asked)))["undecided-emitters"]
    assert found.measure.value == pytest.approx(SIDE**2 * 0.5 / (SIDE**2 * 0.5 + 16), rel=0.02)


# --- mesh and parts -------------------------------------------------------------------------------


def _floor(noise):
    """A floor of 800 triangles whose vertices err by ``noise`` metres; each pixel shows one of them."""
    x, z = np.meshgrid(np.linspace(0, SIDE, 21), np.linspace(0, SIDE, 21), indexing="ij")
    height = noise * np.random.default_rng(0).normal(size=x.shape)
    vertices = np.stack([x, height, z], axis=-1).reshape(-1, 3)
    first = (np.arange(20)[:, None] * 21 + np.arange(20)).reshape(-1)
    quads = np.concatenate([first[:, None] + [0, 1, 22], first[:, None] + [0, 22, 21]])
    return Mesh(vertices.astype(np.float32), quads.astype(np.int32))


def test_a_noisy_mesh():
    pixel = judged.pixels()
    shown = judged.pixels(triangle=np.arange(len(pixel)) % 800, footprint=np.full(len(pixel), 0.05))
    assert told(mesh.check, mesh=_floor(0.002), explained=shown) == {}
    noisy = told(mesh.check, mesh=_floor(0.05), explained=shown)
    assert set(noisy) == {"noisy-mesh"}


def test_triangles_that_no_pixel_resolves():
    pixel = judged.pixels()
    coarse = judged.pixels(triangle=np.arange(len(pixel)) % 800, footprint=np.full(len(pixel), 0.3))
    assert set(told(mesh.check, mesh=_floor(0.0), explained=coarse)) == {"fine-mesh"}


def _shard(triangle, weight):
    count = len(triangle)
    return SimpleNamespace(
        samples=SimpleNamespace(triangle=np.array(triangle, np.int32), weight=np.full(count, weight, np.float32))
    )


def test_parts_that_never_fill_a_pixel():
    """The lamp is a part of its own: in half of the pixels, with half of each."""
    alone, mixed = _shard([4] * 50, 1.0), _shard([4, 12] * 20, 0.5)
    found = told(thin.check, shards=[alone, mixed])["thin-parts"]
    assert found.measure.value == pytest.approx(10 / 70)
    assert told(thin.check, shards=[alone, mixed, _shard([12], 1.0)]) == {}


def test_ids_that_hold_two_things():
    pixel = judged.pixels()
    left, right = pixel.position[:, 0] < 1.2, pixel.position[:, 0] > 2.8
    photo = np.where(right[:, None], [0.1, 0.2, 0.5], pixel.photo)
    small = np.full(len(pixel), SIDE / GRID / 4)
    apart = judged.pixels(photo=photo, use=left | right, footprint=small)
    assert set(told(mixed_ids.check, explained=apart)) == {"mixed-ids"}
    texture = np.where((pixel.row // 2 + pixel.column // 2)[:, None] % 2, 0.1, 0.6)
    assert told(mixed_ids.check, explained=judged.pixels(photo=texture, use=left | right, footprint=small)) == {}


def test_a_part_that_no_material_explains():
    pixel = judged.pixels()
    odd = pixel.position[:, 0] < 1
    explained = judged.pixels(
        segment=np.where(odd, 2, 1), photo=np.where(odd[:, None], 0.5 + 0.5 * pixel.view[:, None], pixel.photo)
    )
    found = told(parts.check, explained=explained)["unexplained-parts"]
    assert found.where["segments"] == [2]


# --- views and rounds -----------------------------------------------------------------------------


def test_a_view_with_another_exposure():
    pixel = judged.pixels()
    photo = pixel.photo * np.where(pixel.view == 3, 1.2, 1.0)[:, None]
    found = told(exposures.check, explained=judged.pixels(photo=photo))["exposure"]
    assert found.where["views"] == ["v3"]
    assert found.numbers["v3"] == pytest.approx(1.2, abs=0.02)


def test_a_view_that_is_unlike_its_rendering():
    shaken = [judged.retake(k) for k in range(VIEWS - 1)]
    stripes = np.where(np.arange(GRID) % 4 < 2, 0.6, 1.5)[None]
    found = told(rerendering.check, retakes=[*shaken, judged.retake(5, stripes)])
    assert set(found) == {"view-unlike"}
    assert found["view-unlike"].where["views"] == ["v5"]
    all_off = told(rerendering.check, retakes=[judged.retake(k, stripes) for k in range(VIEWS)])
    assert set(all_off) == {"rerendering"}


def test_weights_that_are_alike_are_judged_as_full_ones():
    """A mask of 0.98 everywhere, as images that were averaged down may have."""
    soft = [replace(each, weight=0.98 * each.weight) for each in (judged.retake(k, 0.75) for k in range(VIEWS))]
    assert "light-balance" in told(light_balance.check, retakes=soft)
    assert rerendering.psnr(soft) == pytest.approx(rerendering.psnr([judged.retake(k, 0.75) for k in range(VIEWS)]))


def _patches(shift):
    """Edges that the fit has ``shift`` pixels beside where the photographs have them; another contrast, too."""
    columns = np.arange(SIDE_OF_PATCH) - SIDE_OF_PATCH / 2
    place = np.random.default_rng(0).uniform(-3, 3, 60)
    photo, fit = (1 + 2 / (1 + np.exp(-2 * (columns + at[:, None]))) for at in (place, place + shift))
    photo, predicted = (
        np.broadcast_to(edge[:, None, :, None], (60, SIDE_OF_PATCH, SIDE_OF_PATCH, 3)) for edge in (photo, 1.1 * fit)
    )
    return EdgePatches(("v0",) * 60, np.zeros((60, 2), int), photo, predicted)


@pytest.mark.parametrize("shift", [0.03, 0.2, -0.5])
def test_edges_that_are_off(shift):
    found = told(edges.check, patches=_patches(shift))
    assert set(found) == (set() if shift == 0.03 else {"edges-off"})
    assert abs(np.nanmedian(edges.displacements(_patches(shift)))) == pytest.approx(abs(shift), rel=0.2)


def _rounds(change):
    rng = np.random.default_rng(0)
    count = 60_000
    position = np.column_stack([rng.uniform(0, SIDE, (count, 2)), np.zeros(count)])[:, [0, 2, 1]]
    before = np.exp(0.1 * rng.normal(size=(count, 1, 3)))
    now = np.exp(0.1 * rng.normal(size=(count, 1, 3))) * (1 + change)
    samples = SimpleNamespace(position=position, normal=np.tile([0.0, 1.0, 0.0], (count, 1)))
    return {"shards": [SimpleNamespace(samples=samples, shading=now)], "earlier": [before]}


def test_rounds_that_had_not_settled():
    assert told(settled.check, **_rounds(0.03)) == {}
    found = told(settled.check, **_rounds(0.3))["not-settled"]
    assert found.measure.value == pytest.approx(0.3, abs=0.05)


def test_rounds_that_found_light_missing():
    """Later rounds are copies, which must not pass for a good end."""
    refused = RoundState(2, 2, 0.9, 0.1, 0.0, light_missing=1.0).after()
    found = told(settled.check, **_rounds(0.0), rounds=(refused,))["light-missing"]
    assert found.severity == "serious"
    assert "100 % of the shading" in found.cause
    assert told(settled.check, **_rounds(0.0), rounds=(RoundState(2, 2, 0.01, 0.1, 0.0),)) == {}
    guessed = RoundState(1, None, 0.9, 0.1, 0.0, light_missing=1.0, kept=1.0, moved=0.6)
    assert set(told(settled.check, **_rounds(0.0), rounds=(guessed,))) == {"light-missing", "emitters-change"}


@pytest.mark.parametrize(("moved", "expected"), [(0.05, False), (0.2, True)])
def test_emitters_that_change_in_the_last_round(moved, expected):
    last = RoundState(2, None, 0.02, 0.05, 0.0, moved=moved)
    assert ("emitters-change" in told(settled.check, **_rounds(0.0), rounds=(last,))) == expected
    over = replace(last, settled=2)
    assert told(settled.check, **_rounds(0.0), rounds=(over,)) == {}


def test_rounds_that_settled_or_go_on_slowly():
    settled_in_2 = RoundState(2, 2, 0.3, 0.1, 0.1)
    assert told(settled.check, **_rounds(0.3), rounds=(settled_in_2,)) == {}
    slow = RoundState(2, None, 0.06, 0.01, 0.1), RoundState(3, None, 0.05, 0.01, 0.1)
    found = told(settled.check, **_rounds(0.05), rounds=slow)["not-settled"]
    assert found.measure.value == pytest.approx(0.25, abs=0.08)


def _samples(place):
    """One view of a plane; what it shows is ``place`` (GRID, 3)."""
    count = len(place)
    zero = np.zeros(count, np.float32)
    return FootprintSamples(
        ("a",),
        ((1, count),),
        np.arange(count + 1),
        np.ones(count, np.uint8),
        place.astype(np.float32),
        np.tile(np.float32([0, 1, 0]), (count, 1)),
        zero.astype(np.int32),
        zero + 0.1,
        zero + 1,
        np.zeros((count, 4, 3), np.float16),
        np.zeros((count, 4), np.int32),
    )


def test_surface_that_no_training_view_shows():
    line = np.column_stack([np.linspace(0, SIDE, 100), np.zeros((100, 2))])
    data = SimpleNamespace(image=lambda view: (np.full((1, 100, 3), 0.5, np.float32), None))
    seen = {"shards": [SimpleNamespace(samples=_samples(line))], "data": data}
    assert told(hardly_seen.check, **seen, held_out=[_samples(line)]) == {}
    half = {"shards": [SimpleNamespace(samples=_samples(line[:50]))], "data": data}
    found = told(hardly_seen.check, **half, held_out=[_samples(line)])["unseen"]
    assert found.measure.value == pytest.approx(0.5, abs=0.06)


def test_base_colours_that_are_uncertain():
    found = told(uncertain.check, confidence=judged.confidence(0.03, 0.2))["uncertain-colors"]
    assert found.severity == "warning"
    assert found.measure.value == pytest.approx(np.sqrt((0.03**2 + 0.2**2) / 2), rel=0.1)
    assert found.where["position"][0] == pytest.approx(0.75 * SIDE, abs=0.2)
    assert "kd of 17 dB" in found.cause
    assert told(uncertain.check, confidence=judged.confidence(0.2, 0.2))["uncertain-colors"].severity == "serious"
    assert not told(uncertain.check, confidence=None)


# --- a lamp that the mesh lacks


def shining(place, views=VIEWS, times=10.0):
    """Pixels of some views, those brighter whose rays pass a place by less than 30 cm."""
    sound = judged.pixels()
    center = np.array([judged.camera(k).center for k in range(VIEWS)])[sound.view]
    ray = sound.position - center
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    away = np.linalg.norm(np.cross(np.asarray(place) - center, ray), axis=1)
    bright = (away < 0.3) & (sound.view < views)
    return replace(sound, photo=np.where(bright[:, None], times, sound.photo))


def test_a_lamp_that_the_mesh_lacks_has_a_place():
    """The cameras stand a metre apart and look from three above: the depth is told less well than the direction."""
    for height in (0.5, 1.0, 2.0):
        found = told(missing_emitter.check, explained=shining([2.0, height, 2.0]))["lamp-missing"]
        assert found.severity == "serious"
        assert (np.abs(found.where["position"] - np.array([2.0, height, 2.0])) < [0.1, 0.4, 0.1]).all()
        assert found.where["views"] == [f"v{k}" for k in range(VIEWS)]


def test_a_lamp_that_is_clipped_is_missing_all_the_same():
    """Its radiance is a lower bound, which is too bright already."""
    lamp = shining([2.0, 1.0, 2.0])
    clipped = lamp.photo[:, 0] == 10
    found = told(missing_emitter.check, explained=replace(lamp, use=~clipped, clipped=clipped))["lamp-missing"]
    assert found.where == told(missing_emitter.check, explained=lamp)["lamp-missing"].where


def test_few_views_and_what_a_surface_could_show_are_no_lamp():
    assert told(missing_emitter.check, explained=shining([2.0, 1.0, 2.0], views=2)) == {}
    assert told(missing_emitter.check, explained=shining([2.0, 1.0, 2.0], times=2.0)) == {}
