"""Emitters that hardly fill a pixel: spots whose pixels all show the ceiling, too."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.scene.mesh import Mesh
from fipt.stages.emitters import small
from fipt.stages.emitters.extract import _all_pixels, extract
from fipt.stages.emitters.regions import find_regions
from fipt.stages.emitters.settings import EmittersSettings
from fipt.stages.emitters.small import small_emitters
from tests import scenes

SIDE, VIEWS = 16, 4
CEILING, SPOT = 0.5, 200.0
SPOTS = 3


@pytest.fixture
def mesh():
    """A ceiling (triangles 0, 1), a spot below it (2, 3), and the ring around that (4, 5)."""
    ceiling = scenes.quad((0, 3, 0), (4, 0, 0), (0, 0, 4))
    spot, ring = (scenes.quad((2, y, 2), (0.05, 0, 0), (0, 0, 0.05)) for y in (2.99, 2.98))
    return scenes.joined(ceiling, spot, ring)


def shards(
    rng,
    spot=SPOT,
    ring=0.5,
    views=VIEWS,
    moving=False,
    side=SIDE,
    spots=SPOTS,
    parted=False,
    place=None,
    share_range=(2, 6),
):
    """Every view shows the ceiling everywhere, and in a few pixels, or at a ``place``, shares of spot and ring.

    With ``moving`` the spot is a knob that shines in one view; with ``parted`` one half of the views shows the spot,
    the other the ring. Shares are 1 / 16 times numbers of a ``share_range``.
    """
    pixels = side * side
    triangle, share, count, image = [], [], [], []
    for view in range(views):
        chosen = (
            rng.choice(pixels, spots, replace=False) if place is None else np.arange(pixels).reshape(side, side)[place]
        )
        shown = set(chosen.reshape(-1).tolist())
        for pixel in range(pixels):
            w = rng.integers(*share_range, 2) / 16 if pixel in shown else np.zeros(2)
            w = w * ([view % 2, 1 - view % 2] if parted else 1)
            rows = [(rng.integers(0, 2), 1 - w.sum())]
            rows += [(2 * k + 2 + rng.integers(0, 2), w[k]) for k in range(2) if w[k] > 0]
            triangle += [row[0] for row in rows]
            share += [row[1] for row in rows]
            count.append(len(rows))
            level = (spot if view == 0 else 1.5) if moving else spot
            image.append((1 - w.sum()) * CEILING + w @ [level, ring])
    samples = scenes.samples_of(
        np.zeros((len(triangle), 3)),
        np.array(triangle),
        np.array(share),
        np.array(count),
        views=[f"v{k}" for k in range(views)],
        shapes=[(side, side)] * views,
        normal=np.tile(np.float32([0, -1, 0]), (len(triangle), 1)),
    )
    color = np.array(image)[:, None] * np.float32([1.2, 1.0, 0.8])
    shading = np.zeros((len(triangle), SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = 1
    return scenes.observed([samples], [shading], [(color.astype(np.float32), np.ones(len(color), np.float32))])


def found(mesh, seen):
    surface = find_regions(mesh, seen, _all_pixels(mesh, seen))
    nothing = np.zeros(len(mesh.triangles), bool)
    return small_emitters(mesh, seen, surface, nothing, nothing)


def test_a_spot_is_told_from_its_ring_and_the_ceiling(mesh, np_rng):
    result = found(mesh, shards(np_rng))
    np.testing.assert_array_equal(result.number, [-1, -1, 0, 0, -1, -1])
    np.testing.assert_allclose(
        result.pixels.radiance, np.tile(SPOT * np.float32([1.2, 1, 0.8]), (VIEWS * SPOTS, 1)), rtol=0.15
    )
    assert (np.diff(result.pixels.view) >= 0).all()


def test_a_lamp_may_mirror_another_one_in_a_pixel(mesh, np_rng):
    """Bulbs of a chandelier: somewhere a mirror would show the next one."""
    (seen,) = shards(np_rng)
    shading = np.array(seen.shading)
    shading[np.flatnonzero(seen.samples.triangle == 2)[0], 1 : 1 + len(ROUGHNESS_LEVELS)] = 2 * SPOT
    np.testing.assert_array_equal(found(mesh, [replace(seen, shading=shading)]).number, [-1, -1, 0, 0, -1, -1])


@pytest.fixture
def box():
    """A ceiling (triangles 0, 1) and a light box: its bottom (2, 3) and one of its sides (4, 5)."""
    ceiling = scenes.quad((0, 3, 0), (4, 0, 0), (0, 0, 4))
    bottom = scenes.quad((2, 2.9, 2), (0.05, 0, 0), (0, 0, 0.05))
    side = scenes.quad((2.05, 2.9, 2), (0, 0.05, 0), (0, 0, 0.05))
    return scenes.joined(ceiling, bottom, side)


def test_candidates_that_are_joined_are_numbered_without_gaps(box):
    """Bottom (2, 3) and side (4, 5) touch; 6 and 7 stand alone, and so does what is found (8, 9)."""
    apart = [scenes.quad((x, 0, 0), (0.05, 0, 0), (0, 0, 0.05)) for x in (5, 6)]
    mesh = scenes.joined(box, *apart)
    number = np.array([-1, -1, 0, 0, 1, 1, 2, 2, 3, 3])
    none = np.zeros(0, np.int64)
    shared = small._Shared(*[none] * 5, *[np.zeros(0)] * 2, np.zeros((0, 3)), np.zeros(0, bool))
    wholes = small._with_wholes(mesh, shared, number, np.arange(10) >= 8)
    np.testing.assert_array_equal(wholes, [-1, -1, 2, 2, 2, 2, 0, 0, 1, 1])
    kept = small._with_wholes(mesh, shared, number, np.arange(10) >= 5)
    np.testing.assert_array_equal(kept, number)
    nothing = np.full(10, -1)
    np.testing.assert_array_equal(small._with_wholes(mesh, shared, nothing, nothing >= 0), nothing)


def bulb_shards(rng, pixels):
    """Views of a ceiling (triangles 0, 1) and of a bulb of twelve triangles, of which each of ``pixels`` shows a few.

    The mesh is off, so that pixels show other shares of it than the photographs do.
    """
    triangle, share, count, image = [], [], [], []
    for _ in range(VIEWS):
        shown = set(rng.choice(SIDE * SIDE, pixels, replace=False).tolist())
        for pixel in range(SIDE * SIDE):
            faces = rng.choice(np.arange(2, 14), 4, replace=False) if pixel in shown else np.zeros(0, int)
            w = rng.integers(1, 4, len(faces)) / 16
            triangle += [rng.integers(0, 2), *faces]
            share += [1 - w.sum(), *w]
            count.append(1 + len(w))
            image.append((1 - w.sum()) * CEILING + SPOT * w.sum() * np.exp(rng.normal(0, 0.4)))
    samples = scenes.samples_of(
        np.zeros((len(triangle), 3)), np.array(triangle), np.array(share), np.array(count),
        views=[f"v{k}" for k in range(VIEWS)], shapes=[(SIDE, SIDE)] * VIEWS,
    )  # fmt: skip
    shading = np.zeros((len(triangle), SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = 1
    color = np.tile(np.float32(image)[:, None], (1, 3))
    return scenes.observed([samples], [shading], [(color, np.ones(len(color), np.float32))])


def test_a_bulb_that_faces_to_all_sides_is_one_emitter(np_rng, monkeypatch):
    """Its faces share their pixels, so that none is certain."""
    cube = trimesh.creation.box((0.05, 0.05, 0.05))
    cube.apply_translation((2, 2.9, 2))
    ceiling = scenes.quad((0, 3, 0), (4, 0, 0), (0, 0, 4))
    bulb = scenes.joined(ceiling, Mesh(np.float32(cube.vertices), np.int32(cube.faces)))
    seen = bulb_shards(np_rng, 2)
    result = found(bulb, seen)
    np.testing.assert_array_equal(result.number, [-1, -1, *([0] * 12)])
    assert result.pixels.radiance.mean() == pytest.approx(SPOT, rel=0.5)
    monkeypatch.setattr(small, "_FEW", 0.5)
    assert (found(bulb, seen).number < 0).all(), "it fills too many pixels for that"


@pytest.mark.parametrize("paint", [CEILING, 2.5])
def test_a_dark_side_that_touches_a_lamp_takes_none_of_its_light(box, np_rng, paint):
    seen = shards(np_rng, ring=paint, views=8, spots=9, share_range=(4, 8))
    result = found(box, seen)
    np.testing.assert_array_equal(result.number, [-1, -1, 0, 0, -1, -1])
    assert result.pixels.radiance.mean() == pytest.approx(SPOT, rel=0.15)


def test_faces_of_two_radiances_that_touch_are_two_emitters(box, np_rng):
    seen = shards(np_rng, ring=20, views=8, spots=9, parted=True, share_range=(4, 8))
    np.testing.assert_array_equal(found(box, seen).number, [-1, -1, 0, 0, 1, 1])


def test_a_side_that_is_seen_dark_in_shared_pixels_is_no_far_side(box, np_rng):
    """Its bottom shines, its side does not, and no pixel shows either alone."""
    seen = shards(np_rng, views=8, spots=9, parted=True, share_range=(4, 8))
    np.testing.assert_array_equal(found(box, seen).seen_dark.any(axis=1), [True, True, False, False, True, True])
    emitters = extract(box, seen, None, EmittersSettings(guess=False)).emitters
    np.testing.assert_array_equal(emitters.triangle, [2, 3])


@pytest.mark.parametrize("case", ["shines in small shares", "clipped"])
def test_what_does_not_tell_is_not_seen_dark(box, np_rng, case):
    """A side that shines makes no pixel bright of which it has a sixteenth; a clipped pixel may be brighter."""
    if case == "clipped":
        seen = shards(np_rng, views=8, spots=9, parted=True, share_range=(4, 8))
        seen = [replace(shard, clipped=np.ones(len(shard.clipped), bool)) for shard in seen]
    else:
        seen = shards(np_rng, spot=10, ring=10, views=8, spots=20, parted=True, share_range=(1, 3))
    assert not found(box, seen).seen_dark[4:].any()


def test_the_spot_is_an_emitter(mesh, np_rng):
    emitters = extract(mesh, shards(np_rng), None, EmittersSettings(guess=False)).emitters
    np.testing.assert_array_equal(emitters.triangle, [2, 3])
    assert emitters.radiance.mean() == pytest.approx(SPOT, rel=0.15)


@pytest.mark.parametrize("case", [{"spot": 0.9}, {"spot": 40, "moving": True}, {"views": 1}])
def test_no_emitter(mesh, np_rng, case):
    """Paint; a highlight on a knob; what one view alone shows."""
    assert (found(mesh, shards(np_rng, **case)).number < 0).all()


@pytest.mark.parametrize(
    ("place", "emits"),
    [
        (np.s_[20:22, 8:56], True),
        (np.s_[3:61, 30:31], True),
        (np.s_[20:23, 20:23], False),
        (np.s_[15:18, 15:18], False),
        (np.s_[30:31, 10:23], False),
        (np.s_[28:36, 28:36], False),
    ],
)
def test_one_view_shows_a_strip_in_several_sections_and_a_highlight_in_one(mesh, np_rng, place, emits):
    """A strip below a shelf that one view sees from below crosses it; wherever a highlight lies, it is a place."""
    number = found(mesh, shards(np_rng, views=1, side=4 * SIDE, place=place)).number
    np.testing.assert_array_equal(number, [-1, -1, 0, 0, -1, -1] if emits else [-1] * 6)


def test_a_spot_that_is_clipped_is_at_least_so_bright(mesh, np_rng):
    seen = [replace(shard, clipped=np.asarray(shard.radiance)[:, 0] > 5) for shard in shards(np_rng)]
    emitters = extract(mesh, seen, None, EmittersSettings(guess=False)).emitters
    np.testing.assert_array_equal(emitters.triangle, [2, 3])
    assert emitters.lower_bound.all()


def test_least_squares_that_do_not_converge_tell_nothing(mesh, np_rng, monkeypatch):
    def fails(*_):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(small, "nnls", fails)
    assert (found(mesh, shards(np_rng)).number < 0).all()


def test_noise_that_shares_pixels_goes_in_a_few_steps(np_rng, monkeypatch):
    """On a noisy mesh hundreds of bright slivers share pixels; taken one by one, each step solves for all others."""
    slivers, pixels, bright = 120, 400, [7, 70]
    shown = np_rng.random((slivers, pixels)) < 0.03
    shown[np.arange(slivers), np.arange(slivers)] = True
    emitter, pixel = (index.astype(np.int64) for index in np.nonzero(shown))
    share = np_rng.uniform(0.1, 0.3, len(emitter))
    sent = np.where(np.isin(emitter, bright), SPOT, CEILING * np_rng.uniform(0.5, 2, len(emitter)))
    left = np.bincount(pixel, share * sent, pixels)[pixel, None] * np.ones(3)
    seen = small._Shared(
        emitter, pixel % VIEWS, pixel % VIEWS, np.arange(len(emitter)), pixel, share,
        np.full(len(emitter), CEILING), left, np.zeros(len(emitter), bool),
    )  # fmt: skip
    solved, steps = small._solved, []
    monkeypatch.setattr(small, "_solved", lambda *given: steps.append(1) or solved(*given))
    np.testing.assert_array_equal(np.flatnonzero(small._needed(seen, emitter, slivers)), bright)
    assert len(steps) < 30


def test_what_a_person_rejected_stays_out(mesh, np_rng):
    seen = shards(np_rng)
    surface = find_regions(mesh, seen, _all_pixels(mesh, seen))
    never = np.isin(np.arange(6), [2, 3])
    assert (small_emitters(mesh, seen, surface, np.zeros(6, bool), never).number[2:4] < 0).all()


def test_beside_a_known_emitter_nothing_is_small(mesh, np_rng):
    """Where the spot is known, its light in the pixels of the ring is no emitter of its own."""
    seen = shards(np_rng)
    surface = find_regions(mesh, seen, _all_pixels(mesh, seen))
    surface.radiance[2:4] = SPOT
    known = np.isin(np.arange(6), [2, 3])
    assert (small_emitters(mesh, seen, surface, known, np.zeros(6, bool)).number < 0).all()
