"""Light from directions that no pixel sees, told by what it does in the room."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from fipt.scene.environment import EnvironmentMap, solid_angles, texel_directions
from fipt.scene.surface_blocks import Blocks
from fipt.stages.environment import unseen
from fipt.stages.environment.directional import filled
from fipt.stages.environment.unseen import RoomLight, lit_from_outside, room_light
from tests import scenes

ROWS, COLUMNS = 12, 24
SHAPE = ROWS, COLUMNS
BLOCKS, GROUPS = 240, 8


def sky():
    """(h, w, 3) a blue sky that is brightest above, over a dim green ground."""
    up = texel_directions(*SHAPE)[:, 1:2]
    above = np.array([2.0, 3.0, 6.0]) * (1 + 2 * np.maximum(up, 0))
    return np.where(up > 0, above, [1.0, 1.2, 0.6]).reshape(*SHAPE, 3)


@pytest.fixture
def outdoors(np_rng):
    """Blocks of eight colours that face all ways under the open sky, and where their light comes from."""
    normal = np_rng.standard_normal((BLOCKS, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.broadcast_to(solid_angles(*SHAPE), SHAPE).reshape(-1)
    lobe = np.maximum(normal @ texel_directions(*SHAPE).T, 0) * angle / np.pi
    group = np_rng.integers(0, GROUPS, BLOCKS)
    rho = np_rng.uniform(0.2, 0.75, (GROUPS, 3))[group]
    light = RoomLight(np.full((BLOCKS, 3), 0.05), csr_matrix(lobe))
    radiance = rho * (light.inside + lobe @ sky().reshape(-1, 3)) * np.exp(0.03 * np_rng.standard_normal((BLOCKS, 1)))
    place = np_rng.uniform(0, 4, (BLOCKS, 1, 3)).astype(np.float32)
    nothing = np.zeros(BLOCKS)
    return Blocks(place, normal[:, None].astype(np.float32), radiance, nothing, group, nothing.astype(np.int64)), light


def band():
    """(h, w) bool: the texels near the horizon, which pixels look along."""
    return (np.abs(texel_directions(*SHAPE)[:, 1]) < 0.3).reshape(SHAPE)


def error(found, light):
    """Root mean square of the log of the irradiance that a map gives over that of the sky."""
    given, true = (light.inside + light.outside @ each.reshape(-1, 3) for each in (found, sky()))
    return np.sqrt(np.mean(np.log(given / true) ** 2))


def test_what_no_pixel_sees_is_told_by_the_light(outdoors):
    blocks, light = outdoors
    seen = band()
    mean = np.where(seen[..., None], sky(), 0)
    continued = filled(mean, seen)
    found, figures = lit_from_outside(mean, seen, continued, blocks, light)
    np.testing.assert_allclose(found[seen], mean[seen], rtol=1e-6)
    assert error(continued, light) > 0.25
    assert error(found, light) < 0.08
    zenith = found[0].mean(axis=0)
    np.testing.assert_allclose(zenith, sky()[0].mean(axis=0), rtol=0.3)
    assert zenith[2] > 1.5 * zenith[1]
    assert figures["residual"] < 0.06 < figures["residual_before"]
    assert 0.3 < figures["unseen_light"] < 0.9


@pytest.mark.parametrize("seen_radiance", [0.0, 1e-6])
def test_a_black_horizon_hides_no_light_from_above(outdoors, seen_radiance):
    """As before a black backdrop. How bright the sky is, is told by usual reflectances alone: to a factor of three."""
    blocks, light = outdoors
    seen = band()
    true = np.where(seen[..., None], seen_radiance, sky())
    rho = blocks.radiance / (light.inside + light.outside @ sky().reshape(-1, 3))
    dark = replace(blocks, radiance=rho * (light.inside + light.outside @ true.reshape(-1, 3)))
    mean = np.where(seen[..., None], seen_radiance, 0) * np.ones(3)
    found, figures = lit_from_outside(mean, seen, filled(mean, seen), dark, light)
    given, wanted = (light.inside + light.outside @ each.reshape(-1, 3) for each in (found, true))
    assert np.median(np.abs(np.log(given / wanted))) < np.log(3)
    assert figures["residual"] < 0.1 < figures["residual_before"]


def test_a_lamp_is_no_evidence_of_the_sky(outdoors):
    """What is much brighter than white surface emits; it does not make the sky brighter."""
    blocks, light = outdoors
    seen = band()
    mean = np.where(seen[..., None], sky(), 0)
    blocks.radiance[blocks.group == 0] = 500.0
    found, _ = lit_from_outside(mean, seen, filled(mean, seen), blocks, light)
    assert error(found, light) < 0.1


def test_rooms_that_the_unseen_sky_does_not_light_change_nothing(outdoors):
    blocks, light = outdoors
    seen = band()
    mean = np.where(seen[..., None], 2.0, 0) * np.ones(3)
    only = light.outside.multiply(seen.reshape(1, -1)).tocsr()
    found, figures = lit_from_outside(mean, seen, filled(mean, seen), blocks, RoomLight(light.inside, only))
    np.testing.assert_allclose(found, 2.0, rtol=0.02)
    assert figures["unseen_light"] == 0


def test_slopes_of_the_cost(outdoors, np_rng):
    blocks, light = outdoors
    seen = band()
    mean = np.where(seen[..., None], sky(), 0)
    problem, _, start = unseen._problem(mean, seen, filled(mean, seen), blocks, light)
    count = len(problem.free)
    at = np_rng.normal(0, 0.5, len(start)) + start

    def parts(x):
        u, rho, middle = problem.split(x)
        return unseen._misfit(problem, x), unseen._reflectance_prior(rho, middle), unseen._roughness(problem, u)

    def cost(x):
        return sum(part[0] for part in parts(x))

    def slope(x):
        (_, by_sky, by_rho), (_, rho, middle), (_, smooth) = parts(x)
        return np.concatenate([by_sky + smooth, by_rho + rho, middle[None]]).ravel()

    assert len(slope(at)) == 3 * (count + GROUPS + 1)
    some = np_rng.choice(len(at), 40, replace=False)

    step = 1e-5  # to both sides: rounding of the cost, which processors do differently, is 1e-8 of a slope then
    for index in some:
        unit = np.zeros(len(at))
        unit[index] = step
        measured = (cost(at + unit) - cost(at - unit)) / (2 * step)
        assert measured == pytest.approx(slope(at)[index], rel=1e-3, abs=1e-5)


def test_light_of_a_floor_comes_from_its_wall_and_the_sky(backend):
    """A floor beside a high wall that sends 3 everywhere: half of its lobe leaves, to directions above only."""
    from fipt.render.scene import RayScene

    mesh = scenes.joined(
        scenes.quad((-200, 0, -0.001), (400, 0, 0), (0, 400, 0)),  # the wall, in z = 0
        scenes.quad((-1, 0, 0), (2, 0, 0), (0, 0, 2)),
    )
    place = np.tile(np.float32([0, 0, 0.2]), (2, 4, 1))
    up = np.tile(np.float32([0, 1, 0]), (2, 4, 1))
    blocks = Blocks(place, up, np.ones((2, 3)), np.zeros(2), np.zeros(2, np.int64), np.zeros(2, np.int64))
    cache = {
        "center": np.zeros(3), "side": np.float64(900.0), "resolution": np.int64(1), "key": np.zeros(1, np.int64),
        "facing": np.int64([5]), "radiance": np.float32([[3, 3, 3]]), "source": np.zeros(1, np.int64),
    }  # fmt: skip
    empty = EnvironmentMap("map", np.zeros((*SHAPE, 3), np.float32))
    light = room_light(blocks, RayScene(mesh), cache, empty)
    np.testing.assert_allclose(light.inside, 1.5, atol=0.15)
    share = np.asarray(light.outside.sum(axis=1)).ravel()
    np.testing.assert_allclose(share, 0.5, atol=0.05)
    along = texel_directions(*SHAPE)[np.unique(light.outside.tocoo().col)]
    assert along[:, 1].min() > -0.1
    assert along[:, 2].min() > -0.3
