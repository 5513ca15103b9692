"""The search for roughness and metallic of parts: planted ones are found, nothing is claimed without evidence."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.model.reflectance import specular_shading
from fipt.scene.metals import JudgedMetals
from fipt.stages.fit import inner_pixels
from fipt.stages.fit.inner_pixels import InnerPixels
from fipt.stages.fit.part_colors import uniformity
from fipt.stages.fit.part_search import ROUGHNESS, _chosen, _of_classes, estimate_parts, part_classes
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.targets import part_targets
from tests import scenes

LEVELS = len(ROUGHNESS_LEVELS)
PER_PART = 600
PIECES = 30


def light(rng, count, varied):
    """Shading whose specular outputs differ from pixel to pixel (highlights) or, not ``varied``, are all alike."""
    shading = np.full((count, 1 + 2 * LEVELS, 3), 0.5, np.float32)
    if varied:
        for level in range(LEVELS):
            shading[:, 1 + level] = rng.gamma(0.3, 2.0, (count, 1)) * (1 - 0.1 * level)
            shading[:, 1 + LEVELS + level] = 0.1 * shading[:, 1 + level]
    return shading


def pixels(rng, materials, varied=True, noise=0.01, missing=0.0):
    """One shard whose segment k + 1 has materials[k] = (base colour, roughness, metallic), seen over and over.

    Light is ``missing`` from the shading, in logarithms: all of it at the far end, none at the near one.
    """
    shading = light(rng, PER_PART * len(materials), varied)
    radiance = np.empty((len(shading), 3), np.float32)
    for k, (base, s, m) in enumerate(materials):
        own = slice(k * PER_PART, (k + 1) * PER_PART)
        ls0, ls1 = specular_shading(torch.from_numpy(shading[own]), torch.full((PER_PART, 1), s))
        kd, ks = np.array(base) * (1 - m), 0.04 * (1 - m) + np.array(base) * m
        radiance[own] = kd * shading[own, 0] + ks * ls0[:, 0].numpy() + ls1[:, 0].numpy()
    radiance *= 1 + noise * rng.standard_normal(radiance.shape)
    radiance *= np.exp(missing * (np.arange(len(shading)) % PIECES) / (PIECES - 1))[:, None]
    segment = np.repeat(np.arange(1, len(materials) + 1), PER_PART).astype(np.uint16)
    place = np.stack([np.arange(len(shading)) % PIECES, 3 * segment, np.zeros(len(shading))], axis=1) * 0.1
    samples = scenes.samples_of(place, segment)
    return scenes.training_pixels(
        [samples], [shading.astype(np.float16)], [(np.maximum(radiance, 0), np.ones(len(shading)))], [segment]
    )


def found(data):
    return estimate_parts(data, np.array([1.5, 1.5, 1.5]), 3.3, emitter_gain=1e9)


def test_planted_materials_are_found(np_rng):
    """A matte wall, a lacquered table and a copper vase."""
    planted = [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.5, 0.1, 0.1), 0.2, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)]
    parts = found(pixels(np_rng, planted))
    np.testing.assert_allclose(parts.roughness[1:], [1.0, 0.2, 0.3], atol=0.06)
    np.testing.assert_array_equal(parts.metallic[1:], [0, 0, 1])
    assert parts.gain[3] > 0.5 > 0.05 > parts.gain[1]


def test_the_pixels_that_are_used_are_of_all_columns(monkeypatch):
    """The step is half the width of the views."""
    width = 30
    place = np.stack([np.arange(20 * width) % width, np.zeros(20 * width), np.zeros(20 * width)], axis=1)
    samples = scenes.samples_of(place, shapes=[(20, width)])
    shading = np.full((len(place), SHADING_OUTPUTS, 3), 0.5, np.float32)
    images = [(np.full((len(place), 3), 0.3, np.float32), np.ones(len(place)))]
    data = scenes.training_pixels([samples], [shading], images, [np.ones(len(place), np.uint16)])
    monkeypatch.setattr(inner_pixels, "_MOST_PIXELS", len(place) // (width // 2))
    used = inner_pixels.inner_pixels(data, 1e9)
    assert len(used.place) == 40
    assert len(np.unique(used.place[:, 0])) > width / 2


def test_threads_do_not_change_what_is_found(np_rng, threads):
    data = pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)])
    seen = []
    for count in (1, 3):
        threads(count)
        parts = found(data)
        seen.append({name: values for name, values in vars(parts).items() if name != "light"})
    for name, values in seen[0].items():
        np.testing.assert_array_equal(values, seen[1][name], err_msg=name)


def test_light_that_is_missing_from_place_to_place_is_no_base_color(np_rng, monkeypatch):
    # the pieces are a line
    monkeypatch.setattr("fipt.stages.fit.light_errors._AROUND", 0.0)
    monkeypatch.setattr("fipt.stages.fit.light_errors._FEWEST", PIECES)
    planted = [((0.5, 0.4, 0.3), 1.0, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)]
    data = pixels(np_rng, planted, missing=0.5)
    box = np.array([1.5, 1.5, 1.5]), 3.3
    kept, parts = (estimate_parts(data, *box, emitter_gain=1e9, light_errors=told) for told in (False, True))
    assert kept.light is None
    assert parts.light is not None
    place = np.stack([np.arange(PIECES), np.full(PIECES, 3), np.zeros(PIECES)], axis=1) * 0.1
    logs = np.log(parts.light.factor(place, np.ones(PIECES, int)))
    assert 0.8 < np.polyfit(np.arange(PIECES) / (PIECES - 1), logs, 1)[0] / 0.5 < 1.1, (
        "what it mirrors is brighter, too"
    )
    metal = parts.light.factor(place + np.array([0, 0.3, 0]), np.full(PIECES, 2))
    assert metal.tolist() == [1.0] * PIECES, "a metal shows the room, whatever lights it"


def test_without_evidence_nothing_is_claimed(np_rng):
    """Even light shows no difference between materials: any roughness is as likely, and metal is not believed."""
    parts = found(pixels(np_rng, [((0.5, 0.1, 0.1), 0.2, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)], varied=False))
    np.testing.assert_allclose(parts.roughness[1:], 0.5, atol=0.05)
    np.testing.assert_array_equal(parts.metallic[1:], [0, 0])
    np.testing.assert_array_equal(parts.gain[1:], 0)


def test_a_part_without_evidence_is_taken_for_what_others_of_the_room_are(np_rng):
    """Three matte walls, and a part in even light."""
    data = pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0)] * 4)
    own = slice(3 * PER_PART, None)
    data.shading[0][own] = light(np_rng, PER_PART, False)
    data.radiance[0][own] = 0.3
    parts = found(data)
    assert parts.roughness[4] > 0.7 > found(pixels(np_rng, [((0.6, 0.5, 0.4), 0.2, 0.0)], varied=False)).roughness[1]


def test_the_weight_of_a_part_grows_with_evidence(np_rng):
    settings = FitSettings()
    parts = found(pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.9, 0.6, 0.4), 0.3, 1.0)]))
    targets = part_targets(parts, settings)
    unknown = targets.of(torch.tensor([0]))
    assert (unknown.roughness.item(), unknown.metallic.item(), unknown.uniform.item()) == (1, 0, 0)
    assert unknown.weight.item() == pytest.approx(settings.diffuse_weight)
    assert targets.weight[2] > 3 * targets.weight[1] >= 3 * settings.target_weight
    np.testing.assert_array_equal(targets.base_color, parts.base_color)


def test_no_goal_is_whiter_than_the_network_can_be(np_rng):
    """The second, with missing light, is too bright; metal may be that."""
    settings = FitSettings()
    parts = found(
        pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0), ((0.97, 0.97, 0.4), 1.0, 0.0), ((0.97, 0.6, 0.4), 0.3, 1.0)])
    )
    assert parts.base_color[2].max() > 0.94
    goals = part_targets(parts, settings).base_color
    np.testing.assert_allclose(goals[2, :2], 0.9, atol=1e-6)
    np.testing.assert_array_equal(goals[[1, 3]], parts.base_color[[1, 3]])


def test_emitters_do_not_count(np_rng):
    """Pixels brighter than any reflection say nothing about a part's reflectance."""
    data = pixels(np_rng, [((0.6, 0.5, 0.4), 1.0, 0.0)])
    data.radiance[0][::2] *= 1000
    parts = estimate_parts(data, np.array([1.5, 1.5, 1.5]), 3.3, emitter_gain=1.5)
    assert 0 < parts.pixels[1] <= PER_PART / 2
    assert parts.roughness[1] == 1


def test_pixels_of_high_confidence_decide(np_rng):
    """Two thirds of a lacquered table lie in wrong shading, and are known to be unsure."""
    data = pixels(np_rng, [((0.5, 0.1, 0.1), 0.2, 0.0)])
    wrong = np.arange(PER_PART) % PIECES % 3 > 0
    data.radiance[0][wrong] *= np_rng.uniform(0.5, 1.5, (wrong.sum(), 1)).astype(np.float32)
    plain = found(data)
    place = np.asarray(data.shards[0].position)[:, 0]
    unsure = np.unique(place[wrong])

    def at(points, normals, values):
        return np.where(np.isin(points[:, 0], unsure), 0, 1).astype(np.float32)

    data.confidence = SimpleNamespace(at=at, combined=None)
    confident = found(data)
    assert confident.roughness[1] == pytest.approx(0.2, abs=0.06)
    assert confident.gain[1] > plain.gain[1] + 0.2
    assert confident.pixels[1] == plain.pixels[1]


# --- is a part one colour? ------------------------------------------------------------------------

GRID = 24
"""Places of a part along each side; further apart than the pieces that share a base colour."""


def matte_parts(rng, parts):
    """Matte squares under even light: (base colour, texture, error, views) each; see `test_parts_of_one_colour`."""
    most = max(views for *_, views in parts)
    truth = [np.clip(np.array(base) + texture * rng.standard_normal((GRID**2, 1)), 0, 1) for base, texture, *_ in parts]
    x, z = (a.ravel() * 0.05 for a in np.meshgrid(np.arange(GRID), np.arange(GRID)))
    place, segment, image = [], [], []
    for view in range(most):
        for k, (_, _, error, views) in enumerate(parts):
            wrong = 1 + error * rng.standard_normal((GRID**2, 1))  # of the shading, at this place in this view
            place.append(np.stack([x + 0.1, np.full_like(x, 0.6 * k + 0.1), z + 0.1], axis=1))
            segment.append(np.full(GRID**2, k + 1 if view < views else 0))
            image.append(truth[k] * 0.5 * wrong)
    position, segment, image = (np.concatenate(rows) for rows in (place, segment, image))
    shading = np.zeros((len(position), SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = 0.5
    samples = scenes.samples_of(
        position, segment, views=[f"v{view}" for view in range(most)], shapes=[(1, len(position) // most)] * most
    )
    image = np.maximum(image, 0).astype(np.float32)
    return scenes.training_pixels([samples], [shading], [(image, np.ones(len(image)))], [segment.astype(np.uint16)])


def test_parts_of_one_colour(np_rng):
    """What views do not agree on is error; what they do agree on is texture; one view tells neither."""
    wall, carpet, shelf, door = (0.5, 0.4, 0.3), (0.5, 0.5, 0.5), (0.4, 0.4, 0.6), (0.6, 0.6, 0.6)
    planted = [(wall, 0, 0.15, 6), (carpet, 0.12, 0.05, 6), (shelf, 0, 0.15, 1), (door, 0.02, 0.12, 4)]
    parts = found(matte_parts(np_rng, planted))
    assert parts.uniform[0] == 0
    assert parts.uniform[1] > 1.5
    np.testing.assert_allclose(parts.base_color[1], wall, atol=0.02)
    assert parts.uniform[2] == 0
    assert parts.uniform[3] == 0
    assert parts.uniform[4] > 0.5  # its texture drowns in the error


def test_error_and_texture_by_pairs_of_views(np_rng):
    """Against a loop over all pairs of views of all pieces; some pieces are seen by one view, some twice by one."""
    count, fines = 600, 60
    fine = np_rng.integers(0, fines, count)
    segment = fine % 4  # of which the last has pieces that one view sees
    view = np.where(segment == 3, 0, np_rng.integers(0, 5, count))
    alpha, beta = 0.1 * np_rng.random((count, 3)), 0.3 + np_rng.random((count, 3))
    color = np_rng.uniform(0.3, 0.6, (4, 3))
    texture = 0.05 * np_rng.standard_normal((fines, 3)) * np.array([0, 0.5, 1, 1])[np.arange(fines) % 4, None]
    error = np.array([0.05, 0.2, 0.1, 0.2])[segment, None] * np_rng.standard_normal((count, 3))
    radiance = np.maximum(alpha + beta * (color[segment] + texture[fine] + error), 0)
    nothing = np.zeros((count, 3))
    sample = InnerPixels(radiance, np.zeros((count, 1, 3)), nothing, nothing, segment, view)
    got = uniformity(sample, alpha, beta, fine, fines, color)

    off = {}
    for piece, looker in {*zip(fine.tolist(), view.tolist(), strict=True)}:
        own = (fine == piece) & (view == looker)
        a = np.empty(3)
        for c in range(3):
            root = (radiance[own, c] + 0.05) ** -0.6
            a[c] = np.linalg.lstsq((root * beta[own, c])[:, None], root * (radiance - alpha)[own, c], rcond=None)[0][0]
        off[piece, looker] = np.clip(a - color[piece % 4], -0.4, 0.4)
    expected = np.zeros(4)
    for k in range(3):
        suggestions = [key for key in off if key[0] % 4 == k]
        mean = np.mean([off[key] for key in suggestions], axis=0)
        off |= {key: off[key] - mean for key in suggestions}
        pairs = [np.mean(off[p, u] * off[q, v]) for p, u in suggestions for q, v in suggestions if p == q and u != v]
        total, shared = np.mean([np.mean(off[key] ** 2) for key in suggestions]), max(np.mean(pairs), 0)
        views = len(suggestions) / len({p for p, _ in suggestions})
        expected[k] = np.clip((total - shared) / (shared + 0.01**2) / views - 1, 0, 8)
    assert ((expected > 0.2) & (expected < 7)).any()  # the case is not trivial
    np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-9)


def test_parts_without_a_claim_follow_a_class_that_agrees():
    """Parts 1 to 4 are of class 1, which agrees; 5 to 8 of class 2, which does not; 9 has no class."""
    roughness = np.array([1, 0.4, 0.5, 0.4, 1, 0.1, 0.9, 0.4, 1, 1])
    used = np.array([0, 10, 20, 10, 5, 10, 10, 10, 5, 5])
    own = (roughness, np.zeros(10), np.where(roughness < 1, 0.3, 0.0))
    classes = np.array([0, 1, 1, 1, 1, 2, 2, 2, 2, 0])
    found, metallic, gain = _of_classes(own, used, classes)
    assert found[4] == pytest.approx((0.4 * 10 + 0.5 * 20 + 0.4 * 10) / 40)
    assert gain[4] == pytest.approx(0.3)
    others = np.arange(10) != 4
    np.testing.assert_array_equal(found[others], roughness[others])
    assert not metallic.any()
    few = np.where(np.isin(np.arange(10), [1, 2, 3]), 1, used)  # the silent part has most of the pixels
    np.testing.assert_array_equal(_of_classes(own, few, classes)[0], roughness)


def test_a_part_has_the_class_of_most_of_its_pixels():
    part = np.array([[1, 1, 1, 2], [2, 2, 5, 0]], np.uint16)
    semantic = np.array([[7, 7, 9, 3], [3, 4, 6, 9]], np.uint16)
    assert part_classes([(part, semantic), (part[:, :1], semantic[:, :1])], 4).tolist() == [0, 7, 3, 0]


def test_pixels_that_pieces_of_one_part_fill(np_rng):
    """A chair's leg is nowhere flat over a whole pixel: its pieces count together, with the mean of their shading."""
    whole = pixels(np_rng, [((0.9, 0.6, 0.4), 0.3, 1.0)])
    shading, samples = whole.shading[0][:], whole.shards[0]
    cut = scenes.samples_of(
        np.repeat(samples.position, 2, axis=0), 1, np.tile([0.25, 0.75], PER_PART), counts=[2] * PER_PART
    )
    away = np_rng.uniform(-0.2, 0.2, shading.shape).astype(np.float32) * shading
    rows = np.stack([shading + 3 * away, shading - away], axis=1).reshape(-1, *shading.shape[1:])
    ids = np.ones(PER_PART, np.uint16)
    parts = found(scenes.training_pixels([cut], [rows], [(whole.radiance[0], whole.valid[0])], [ids]))
    assert parts.pixels[1] == PER_PART
    assert (parts.metallic[1], parts.roughness[1]) == (1.0, pytest.approx(0.3, abs=0.06))


def test_one_colour_tells_metal_where_pieces_have_few_pixels(np_rng):
    """Four pixels a piece: colours of their own would explain most of what a dielectric cannot."""
    count = 400
    shading = light(np_rng, count, True)
    spread = np_rng.gamma(2.0, 0.5, (count // 4, 1, 1)).astype(np.float32)
    shading[:, 1:] = np.repeat(spread, 4, axis=0) * (1 + 0.05 * np_rng.standard_normal((count, 2 * LEVELS, 1)))
    ls0, ls1 = specular_shading(torch.from_numpy(shading), torch.full((count, 1), 0.4))
    radiance = 0.6 * ls0[:, 0].numpy() + ls1[:, 0].numpy()
    radiance *= 1 + 0.03 * np_rng.standard_normal(radiance.shape)
    place = np.stack([np.repeat(np.arange(count // 4), 4), np.zeros(count), np.zeros(count)], axis=1) * 0.1
    data = scenes.training_pixels(
        [scenes.samples_of(place, 1)],
        [shading],
        [(np.maximum(radiance, 0).astype(np.float32), np.ones(count))],
        [np.ones(count, np.uint16)],
    )
    parts = estimate_parts(data, np.array([5.0, 0, 0]), 10.1, emitter_gain=1e9)
    assert parts.metallic[1] == 1.0
    np.testing.assert_allclose(parts.base_color[1], 0.6, atol=0.05)


@pytest.mark.parametrize(("residuals", "metallic"), [((1, 0.5, 0.5, 0.52), 1.0), ((1, 0.5, 0.5, 0.7), 0.5)])
def test_a_surface_is_metal_or_not(residuals, metallic):
    """What is neither is believed only where metal explains clearly less."""
    residual = np.tile(np.array(residuals)[:, None, None], (1, 16, 1))
    assert _chosen(residual, np.array([1000]), JudgedMetals())[1] == metallic


@pytest.mark.parametrize(("scale", "metallic"), [(0.05, 1.0), (0.005, 0.0)])
def test_where_a_dielectric_explains_all_that_shows_there_is_no_metal(scale, metallic):
    """Metal leaves an eighth less: of 13 steps of an 8-bit picture, or of one."""
    residual = scale * np.tile(np.array([1, 0.9, 0.9, 0.87])[:, None, None], (1, 16, 1))
    assert _chosen(residual, np.array([10_000]), JudgedMetals())[1] == metallic


@pytest.mark.parametrize(
    ("metal", "free", "expected"),
    [
        (1.05, 1000, (1.0, 0.2)),  # a little worse as metal: it is
        (1.12, 1000, (0.0, 1.0)),  # its own pixels clearly say no
        (1.12, 20, (1.0, 0.2)),  # so few of them say nothing clearly
        (1.00, 0, (1.0, 0.35)),  # none: the roughness that is said
    ],
)
def test_a_part_that_others_prove_to_be_metal_is_one_unless_its_pixels_say_no(metal, free, expected):
    rough = np.array(ROUGHNESS)
    residual = np.full((4, len(ROUGHNESS), 3), 2.0)
    residual[0, -1], residual[3, rough == 0.2] = 1.0, metal
    roughness, metallic, _ = _chosen(residual, np.full(3, free), JudgedMetals({1: 0.35}))
    assert (metallic[1], roughness[1]) == expected
    assert metallic[[0, 2]].tolist() == [0, 0]


def test_a_part_that_is_known_to_be_no_metal_is_none_whatever_its_pixels_say():
    residual = np.full((4, len(ROUGHNESS), 2), 1.0)
    residual[3] = 0.5
    assert _chosen(residual, np.full(2, 1000), JudgedMetals())[1].tolist() == [1, 1]
    assert _chosen(residual, np.full(2, 1000), JudgedMetals({}, frozenset({1})))[1].tolist() == [1, 0]
