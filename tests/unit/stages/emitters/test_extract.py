"""Extraction of emitters: which triangles, which radiance, which lamps."""

import numpy as np
import pytest
import trimesh

from fipt.conventions import SHADING_OUTPUTS
from fipt.scene.emitters import BACK, BOTH, FRONT, read_emitters, write_emitters
from fipt.scene.mesh import Mesh
from fipt.scene.review import ReviewDecisions
from fipt.stages.emitters.extract import extract
from fipt.stages.emitters.settings import EmittersSettings
from tests import scenes

BLUE, RED = np.array([2.0, 4.0, 9.0]), np.array([12.0, 6.0, 3.0])
VIEWS = ("a", "b", "c")


@pytest.fixture(scope="module")
def room():
    """A floor under two lamps of four triangles each (2 to 5, 6 to 9) and a fifth that no view sees (10, 11)."""

    def lamp(x):
        return scenes.joined(
            scenes.emitter_quad((x, x + 1), 2.0, (0, 1)), scenes.emitter_quad((x + 1, x + 2), 2.0, (0, 1))
        )

    hidden = scenes.emitter_quad((9, 10), 2.0, (0, 1))
    return scenes.lit(scenes.floor(), (lamp(-3), BLUE), (lamp(1), RED), (hidden, RED)).mesh


def is_emitter(points):
    """The mask that a fit should have learnt: open on everything above the floor."""
    return np.where(points[:, 1] > 1, 0.4, 0.001).astype(np.float32)


def seen(room, rng, per_triangle=6):
    """Hits of three views on triangles 0 to 9, with what they show and the light there."""
    triangle = np.concatenate([np.repeat(np.arange(10), per_triangle) for _ in VIEWS])
    count = len(triangle)
    u = rng.dirichlet(np.ones(3), count)
    position = np.einsum("nk,nkc->nc", u, room.corners[triangle])
    samples = scenes.samples_of(position, triangle, views=VIEWS, shapes=[(1, count // 3)] * 3)
    shading = np.full((count, SHADING_OUTPUTS, 3), 0.3, np.float16)
    image = np.full((count, 3), 0.2, np.float32)
    image[triangle >= 2] = BLUE
    image[triangle >= 6] = RED
    return samples, shading, image, np.ones(count, np.float32)


def found(room, data, mask=is_emitter, **settings):
    samples, shading, image, valid = data
    return extract(
        room,
        scenes.observed([samples], [shading], [(image, valid)]),
        mask,
        EmittersSettings(**{"decide": "mask"} | settings),
    ).emitters


def test_emitters_are_found_with_their_radiance(room, np_rng):
    emitters = found(room, seen(room, np_rng))
    np.testing.assert_array_equal(emitters.triangle, np.arange(2, 10))
    np.testing.assert_array_equal(emitters.emitter, [0] * 4 + [1] * 4)
    np.testing.assert_allclose(emitters.radiance, [BLUE] * 4 + [RED] * 4)
    np.testing.assert_allclose(emitters.area, 0.5)
    np.testing.assert_array_equal(emitters.views, 3)
    assert emitters.confidence.min() > 0.7
    np.testing.assert_array_equal(emitters.sides, BACK)  # pixels see them from above
    assert emitters.triangle.dtype == np.int32
    assert emitters.radiance.dtype == np.float32


def test_triangles_that_nobody_sees_are_dropped(room, np_rng):
    """The mask is open on the hidden lamp too, and on triangle 5, whose pixels are taken away here."""
    samples, shading, image, valid = seen(room, np_rng)
    valid[samples.triangle == 5] = 0
    dropped = found(room, (samples, shading, image, valid), complete=False)
    np.testing.assert_array_equal(dropped.triangle, [2, 3, 4, 6, 7, 8, 9])


def without(data, *triangles):
    """The same views without any hit on some triangles."""
    samples, shading, image, valid = data
    keep = ~np.isin(samples.triangle, triangles)
    count = keep.sum() // 3
    fewer = scenes.samples_of(samples.position[keep], samples.triangle[keep], views=VIEWS, shapes=[(1, count)] * 3)
    return fewer, shading[keep], image[keep], valid[keep]


def test_the_far_side_of_an_emitter_emits_like_its_near_side(room, np_rng):
    data = without(seen(room, np_rng), 5)
    whole = found(room, data, complete=True)
    np.testing.assert_array_equal(whole.triangle, np.arange(2, 10))
    np.testing.assert_allclose(whole.radiance, [BLUE] * 4 + [RED] * 4)
    np.testing.assert_array_equal(whole.emitter, [0] * 4 + [1] * 4)
    np.testing.assert_allclose(whole.area, 0.5)
    np.testing.assert_array_equal(found(room, data, complete=False).triangle, [2, 3, 4, 6, 7, 8, 9])


def looking(mesh, looks):
    """Views of triangles: which, from the front (1) or the back (-1), and the light that they show."""
    triangle = np.tile(np.concatenate([own for own, _, _ in looks]), 6)
    turned = np.tile(np.concatenate([np.full(len(own), side) for own, side, _ in looks]), 6)
    image = np.tile(np.concatenate([np.tile(np.float32(light), (len(own), 1)) for own, _, light in looks]), (6, 1))
    arrays = {
        "normal": mesh.normals[triangle] * turned[:, None],
        "footprint": np.full(len(triangle), np.float32(0.02)),
    }
    samples = scenes.samples_of(mesh.corners[triangle].mean(axis=1), triangle, **arrays)
    shading = np.full((len(triangle), SHADING_OUTPUTS, 3), 1.0, np.float16)
    return samples, shading, image, np.ones(len(triangle), np.float32)


@pytest.mark.parametrize("wall_side", [None, "dark"])
def test_a_shade_lights_the_wall_behind_it_though_views_see_its_dark_inside_there(backend, wall_side):
    """Through its opening. Where the outside is seen there, and is dark, it is dark."""
    whole = trimesh.creation.cylinder(0.2, 0.3, sections=24).subdivide()
    shade = Mesh(np.float32(whole.vertices), np.int32(whole.faces[np.abs(whole.face_normals[:, 2]) < 0.5]))
    near, far = np.flatnonzero(shade.normals[:, 0] > -0.2), np.flatnonzero(shade.normals[:, 0] < -0.8)
    looks = [(near, 1, RED), (far, -1, 0.2 * BLUE)] + ([(far, 1, 0.2 * BLUE)] if wall_side else [])
    data = looking(shade, looks)
    emitters = found(shade, data, lambda points: np.full(len(points), 0.4, np.float32))
    expected = np.arange(len(shade.triangles))
    np.testing.assert_array_equal(emitters.triangle, np.setdiff1d(expected, far) if wall_side else expected)
    np.testing.assert_array_equal(emitters.sides, FRONT)


def test_the_dark_rim_of_a_panel_is_no_emitter_though_its_dark_back_is_seen():
    """Views see the back of some glowing triangles, and it is dark: that is no face that glows."""
    panel = scenes.joined(*(scenes.emitter_quad((x, x + 1), 2.0, (z, z + 1)) for x in range(5) for z in range(4)))
    x = panel.corners[:, :, 0].mean(axis=1)
    glows, behind = np.flatnonzero(x < 3), np.flatnonzero(x < 1)
    looks = [(glows, 1, RED), (np.flatnonzero(x > 3), 1, 0.02 * RED), (behind, -1, 0.02 * RED)]
    emitters = found(panel, looking(panel, looks), lambda points: np.full(len(points), 0.4, np.float32))
    np.testing.assert_array_equal(emitters.triangle, glows)
    np.testing.assert_array_equal(emitters.sides, FRONT)


def test_a_part_that_glows_in_one_place_is_no_emitter_all_over(room, np_rng):
    """Of the first lamp, triangle 5 is unseen and 3 and 4 are dark."""
    samples, shading, image, valid = without(seen(room, np_rng), 5)
    image[np.isin(samples.triangle, (3, 4))] = 0.1
    np.testing.assert_array_equal(
        found(room, (samples, shading, image, valid), complete=True).triangle, [2, 6, 7, 8, 9]
    )


def test_one_emitter_has_the_median_of_all_its_pixels(room, np_rng):
    samples, shading, image, valid = seen(room, np_rng)
    lamp = np.flatnonzero((samples.triangle >= 2) & (samples.triangle < 6))
    image[lamp] *= np_rng.uniform(0.9, 1.1, (len(lamp), 1)).astype(np.float32)
    image[lamp[:10]] = 500.0  # a few wild pixels
    patches = found(room, (samples, shading, image, valid))
    np.testing.assert_allclose(patches.radiance[:4], np.tile(np.median(image[lamp], axis=0), (4, 1)), rtol=1e-6)
    each = found(room, (samples, shading, image, valid), patches=False)
    for k in range(2, 6):
        np.testing.assert_allclose(each.radiance[k - 2], np.median(image[samples.triangle == k], axis=0), rtol=1e-6)
    np.testing.assert_array_equal(each.emitter, patches.emitter)
    assert patches.confidence[0] < patches.confidence[4]  # its pixels agree less


def test_pixels_on_edges_tell_nothing(room, np_rng):
    samples, shading, image, valid = seen(room, np_rng)
    weight = samples.weight.copy()
    mixed = np.arange(len(weight)) % 3 > 0
    weight[mixed] = 0.5
    image[mixed & (samples.triangle >= 2)] *= 0.1
    samples = scenes.samples_of(samples.position, samples.triangle, weight, views=VIEWS, shapes=samples.shapes)
    np.testing.assert_allclose(found(room, (samples, shading, image, valid)).radiance, [BLUE] * 4 + [RED] * 4)


def test_several_samples_of_a_pixel_and_several_shards(room, np_rng):
    """Views are counted over all shards; a pixel's value belongs to the hit that fills it."""
    samples, shading, image, valid = seen(room, np_rng)
    first, more = 60, 40
    counts = np.r_[np.full(more, 2), np.ones(60 - more, int)]
    position = np.repeat(samples.position[:first], counts, axis=0)
    weight = np.repeat(np.ones(first), counts)
    weight[1 : 2 * more : 2] = 0.05
    triangle = np.repeat(samples.triangle[:first], counts)
    triangle[1 : 2 * more : 2] = 0  # a sliver of floor beside each
    shards = [
        scenes.samples_of(position, triangle, weight, counts, views=("a",)),
        scenes.samples_of(samples.position[first:], samples.triangle[first:], views=("b", "c"), shapes=[(1, 60)] * 2),
    ]
    baked = [np.full((len(position), SHADING_OUTPUTS, 3), 0.3, np.float16), shading[first:]]
    images = [(image[:first], valid[:first]), (image[first:], valid[first:])]
    emitters = extract(
        room, scenes.observed(shards, baked, images), is_emitter, EmittersSettings(decide="mask")
    ).emitters
    np.testing.assert_array_equal(emitters.triangle, np.arange(2, 10))
    np.testing.assert_allclose(emitters.radiance, [BLUE] * 4 + [RED] * 4)
    np.testing.assert_array_equal(emitters.views, 3)


def test_what_could_be_reflected_is_no_emitter(room, np_rng):
    """With evidence, an open mask alone is not enough; without, it is."""
    samples, shading, image, valid = seen(room, np_rng)
    lit = samples.triangle >= 6
    shading[lit, 3], shading[lit, 9] = RED, RED / 2  # a mirror would look 1.5 times as bright there
    np.testing.assert_array_equal(found(room, (samples, shading, image, valid)).triangle, np.arange(2, 6))
    np.testing.assert_array_equal(
        found(room, (samples, shading, image, valid), evidence=False).triangle, np.arange(2, 10)
    )


def test_brightness_alone_is_no_emitter(room, np_rng):
    """A closed mask keeps a bright triangle from shining."""
    data = seen(room, np_rng)
    closed = found(room, data, lambda points: np.where(points[:, 0] < 0, is_emitter(points), 0.001))
    np.testing.assert_array_equal(closed.triangle, np.arange(2, 6))
    # the mean over a triangle decides: a fifth of it is open, 0.08 in the mean
    partly = found(room, data, lambda points: np.where(points[:, 0] < -2.5, is_emitter(points), 0.0), threshold=0.02)
    assert set(partly.triangle) == {2, 3}
    assert len(found(room, data, threshold=0.5).triangle) == 0


def test_touching_emitters_of_other_brightness_are_two(room, np_rng):
    samples, shading, image, valid = seen(room, np_rng)
    image[np.isin(samples.triangle, (4, 5))] *= 3
    emitters = found(room, (samples, shading, image, valid))
    np.testing.assert_array_equal(emitters.emitter, [0, 0, 1, 1, 2, 2, 2, 2])
    np.testing.assert_allclose(emitters.radiance[2], 3 * BLUE)


def test_settings_reach_the_result(room, np_rng):
    np.testing.assert_array_equal(found(room, seen(room, np_rng), sides="both").sides, BOTH)


@pytest.mark.parametrize("evidence", [True, False])
def test_without_emitters_the_result_is_empty_and_can_be_stored(room, np_rng, tmp_path, evidence):
    emitters = found(room, seen(room, np_rng), lambda points: np.zeros(len(points)), evidence=evidence)
    assert len(emitters.triangle) == 0
    assert emitters.radiance.shape == (0, 3)
    write_emitters(tmp_path / "emitters.npz", emitters, room)
    again = read_emitters(tmp_path / "emitters.npz")
    assert again.radiance.shape == (0, 3)
    assert len(again.sides) == 0


def test_views_that_show_nothing_at_all(room):
    nothing = scenes.samples_of(np.zeros((0, 3)), counts=[0, 0])
    data = nothing, np.zeros((0, SHADING_OUTPUTS, 3), np.float16), np.ones((2, 3), np.float32), np.ones(2, np.float32)
    assert len(found(room, data).triangle) == 0


# --- clipped pixels -------------------------------------------------------------------------------


def bounded(room, data, clipped, **settings):
    samples, shading, image, valid = data
    shards = scenes.observed([samples], [shading], [(image, valid)], [clipped])
    return extract(room, shards, is_emitter, EmittersSettings(**{"decide": "mask"} | settings)).emitters


@pytest.mark.parametrize("patches", [True, False])
def test_an_emitter_clipped_in_every_pixel_is_a_lower_bound(room, np_rng, patches):
    """Its bounds differ, as vignetting makes them: the brightest come nearest to the truth."""
    samples, shading, image, valid = seen(room, np_rng)
    blue = (samples.triangle >= 2) & (samples.triangle < 6)
    image[blue] = BLUE * np_rng.uniform(0.5, 1.0, (blue.sum(), 1))
    found = bounded(room, (samples, shading, image, valid), blue, patches=patches)
    np.testing.assert_array_equal(found.triangle, np.arange(2, 10))
    np.testing.assert_array_equal(found.lower_bound, [True] * 4 + [False] * 4)
    np.testing.assert_allclose(found.clipped, [1] * 4 + [0] * 4)
    assert (found.radiance[:4] <= BLUE).all()
    assert (found.radiance[:4] > 0.85 * BLUE).all()
    np.testing.assert_allclose(found.radiance[4:], [RED] * 4)


def test_pixels_that_are_not_clipped_tell_what_the_others_are(room, np_rng):
    """Two of three pixels clip at half of the lamp's radiance; those at the picture's corners do not clip."""
    samples, shading, image, valid = seen(room, np_rng)
    clipped = (samples.triangle >= 2) & (np.arange(len(image)) % 3 > 0)
    image[clipped] *= 0.5
    found = bounded(room, (samples, shading, image, valid), clipped)
    np.testing.assert_allclose(found.radiance, [BLUE] * 4 + [RED] * 4)
    assert not found.lower_bound.any()
    np.testing.assert_allclose(found.clipped, 2 / 3, atol=1e-6)


def test_a_clipped_core_in_a_dim_rim_is_a_lower_bound(room, np_rng):
    samples, shading, image, valid = seen(room, np_rng)
    clipped = (samples.triangle >= 6) & (np.arange(len(image)) % 3 > 0)
    image[(samples.triangle >= 6) & ~clipped] *= 0.6
    found = bounded(room, (samples, shading, image, valid), clipped)
    np.testing.assert_array_equal(found.lower_bound, [False] * 4 + [True] * 4)
    np.testing.assert_allclose(found.radiance[4:], [RED] * 4)


# --- what a person decided ------------------------------------------------------------------------


def reviewed(room, data, mask=is_emitter, settings=None, **decisions):
    samples, shading, image, valid = data
    decided = ReviewDecisions(mesh_triangles=len(room.triangles), **decisions)
    shards = scenes.observed([samples], [shading], [(image, valid)])
    return extract(room, shards, mask, EmittersSettings(**{"decide": "mask"} | (settings or {})), decided).emitters


def test_a_rejected_emitter_never_emits(room, np_rng):
    data = seen(room, np_rng)
    np.testing.assert_array_equal(reviewed(room, data, reject=["2-5"]).triangle, np.arange(6, 10))
    # nor does a triangle that no view shows, of a lamp that is otherwise as it was
    unseen = reviewed(room, without(data, 5), reject=["5"])
    np.testing.assert_array_equal(unseen.triangle, [2, 3, 4, 6, 7, 8, 9])


@pytest.mark.parametrize("settings", [{}, {"complete": False}, {"evidence": False}])
def test_an_accepted_emitter_emits_whatever_the_mask_says(room, np_rng, settings):
    """Nothing is found; triangles 3 and 4 are accepted, of which no pixel shows 4."""
    data = without(seen(room, np_rng), 4)
    found = reviewed(room, data, lambda points: np.zeros(len(points)), settings, accept=["3-4"])
    np.testing.assert_array_equal(found.triangle, [3, 4])
    np.testing.assert_allclose(found.radiance, [BLUE] * 2)  # as the pictures show it
    np.testing.assert_allclose(found.area, 0.5)


def test_an_accepted_wall_has_the_radiance_of_its_pixels(room, np_rng):
    found = reviewed(room, seen(room, np_rng), accept=["0-1"])
    np.testing.assert_array_equal(found.triangle, np.arange(10))
    np.testing.assert_array_equal(found.emitter, [0] * 2 + [1] * 4 + [2] * 4)
    np.testing.assert_allclose(found.radiance[:2], 0.2)


def test_an_accepted_emitter_is_exactly_its_triangles(room, np_rng):
    """Its neighbours are another lamp, and its own parts are one however they differ."""
    samples, shading, image, valid = seen(room, np_rng)
    image[samples.triangle == 2] *= 5
    found = reviewed(room, (samples, shading, image, valid), accept=["2-3"])
    np.testing.assert_array_equal(found.emitter, [0, 0, 1, 1, 2, 2, 2, 2])
    alone = reviewed(room, (samples, shading, image, valid))
    np.testing.assert_array_equal(alone.emitter, [0, 1, 1, 1, 2, 2, 2, 2])


def test_accepted_triangles_that_no_pixel_shows_are_left_out(room, np_rng):
    found = reviewed(room, seen(room, np_rng), accept=["10-11"])
    np.testing.assert_array_equal(found.triangle, np.arange(2, 10))


def test_merged_emitters_are_one_of_one_radiance(room, np_rng):
    data = seen(room, np_rng)
    one = reviewed(room, data, merge=[["2-5", "6-9"]])
    np.testing.assert_array_equal(one.emitter, 0)
    assert len(np.unique(one.radiance, axis=0)) == 1
    np.testing.assert_allclose(one.radiance[0], np.median(data[2][data[0].triangle >= 2], axis=0), rtol=1e-6)
    # part of a lamp stands for all of it, and one that does not emit for nothing
    np.testing.assert_array_equal(reviewed(room, data, merge=[["3", "6", "10"]]).emitter, 0)
    np.testing.assert_array_equal(reviewed(room, data, merge=[["0", "6"]]).emitter, [0] * 4 + [1] * 4)
    both = reviewed(room, data, accept=["2", "6-9"], merge=[["2", "6-9"]])
    np.testing.assert_array_equal(both.emitter, [0, 1, 1, 1, 0, 0, 0, 0])


def test_nothing_decided_changes_nothing(room, np_rng):
    data = without(seen(room, np_rng), 5)
    plain, decided = found(room, data), reviewed(room, data)
    for name in ("triangle", "radiance", "emitter", "views", "confidence"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(decided, name))


def parted(mesh, *pieces):
    """The mesh in ``pieces`` of its triangles, a few hundredths of a millimetre apart, as preparation leaves them."""
    return scenes.joined(
        *(Mesh(mesh.vertices + np.float32(2e-5 * k), mesh.triangles[own]) for k, own in enumerate(pieces))
    )


def hung_globe():
    """A globe with its cord, which is of the same surface, and which of its triangles views see, as a scan has it.

    Its far side is a part by itself; its top, which hangs on the cord, is in no view.
    """
    ball = trimesh.creation.icosphere(3, 0.12)
    ball.update_faces(ball.triangles_center[:, 2] < 0.117)
    ring = np.float32(ball.outline().discrete[0][:-1])
    up, count = ring + np.float32([0, 0, 0.3]), len(ring)
    k, after = np.arange(count), np.roll(np.arange(count), -1)
    faces = np.concatenate([np.stack([k, after, after + count], 1), np.stack([k, after + count, k + count], 1)])
    cord = Mesh(np.concatenate([ring, up]), np.int32(faces))
    outwards = (cord.normals * (cord.corners.mean(axis=1) * [1, 1, 0])).sum()
    cord = cord if outwards > 0 else Mesh(cord.vertices, cord.triangles[:, ::-1].copy())
    globe = Mesh(np.float32(ball.vertices), np.int32(ball.faces))
    far = globe.normals[:, 0] <= -0.5
    top = ~far & (globe.normals[:, 2] >= 0.8)
    pieces = [np.flatnonzero(own) for own in (~far & ~top, far, top)]
    # the top and the cord share their vertices, as they do on a scan
    hung = scenes.joined(parted(globe, *pieces), Mesh(cord.vertices + np.float32(4e-5), cord.triangles))
    return hung, np.arange(len(pieces[0])), np.arange(len(globe.triangles), len(hung.triangles))


def below_the_cord(points):
    return np.where(points[:, 2] < 0.12, 0.4, 0.001).astype(np.float32)


def test_what_a_scan_tears_from_a_globe_emits_though_no_view_sees_it(backend):
    hung, seen_part, cord = hung_globe()
    data = looking(hung, [(seen_part, 1, RED), (cord, 1, 0.01 * RED)])
    emitters = found(hung, data, below_the_cord)
    np.testing.assert_array_equal(emitters.triangle, np.arange(cord[0]))
    np.testing.assert_array_equal(emitters.emitter, 0)
    np.testing.assert_allclose(emitters.radiance, np.tile(RED, (cord[0], 1)), rtol=1e-6)
    np.testing.assert_array_equal(found(hung, data, below_the_cord, complete=False).triangle, seen_part)


def test_what_a_person_accepted_or_rejected_does_not_grow(backend):
    hung, seen_part, cord = hung_globe()
    data = looking(hung, [(seen_part, 1, RED), (cord, 1, 0.01 * RED)])
    accepted = reviewed(hung, data, below_the_cord, accept=[f"0-{seen_part[-1]}"])
    np.testing.assert_array_equal(accepted.triangle, seen_part)
    rejected = reviewed(hung, data, below_the_cord, reject=[f"{len(seen_part)}-{len(seen_part) + 39}"])
    assert len(rejected.triangle) == cord[0] - 40


@pytest.mark.parametrize("flipped", [False, True])
def test_bars_between_panes_that_no_view_sees_close_nothing(backend, flipped):
    whole = scenes.sheet((0, 0, 0), (1.2, 0, 0), (0, 1.2, 0), 12)
    column, row = (whole.corners.mean(axis=1)[:, :2] / 0.1).astype(int).T
    bars = (column % 4 == 1) & (row > 0) & (row < 11)
    panes = np.flatnonzero(~bars)
    turned = np.where((bars & flipped)[:, None], whole.triangles[:, ::-1], whole.triangles)
    window = parted(Mesh(whole.vertices, turned), panes, np.flatnonzero(bars))
    glowing = lambda points: np.full(len(points), 0.4, np.float32)  # noqa: E731
    emitters = found(window, looking(window, [(np.arange(len(panes)), 1, RED)]), glowing)
    np.testing.assert_array_equal(emitters.triangle, np.arange(len(panes)))
