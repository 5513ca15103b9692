"""Networks: shapes, ranges, the scene box, and queries in world coordinates."""

import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_MIN
from fipt.errors import FiptError
from fipt.model import networks
from fipt.model.networks import Brdf, BrdfNetwork, EmissionNetwork, Field, SceneBox
from fipt.model.settings import NetworkSettings

SETTINGS = NetworkSettings(levels=4, table_log2=10, seed=3)
BOX = SceneBox((1.0, -2.0, 0.5), 4.0)
OTHER_SEED = SETTINGS.model_copy(update={"seed": 4})


def unit_points(count: int) -> torch.Tensor:
    return torch.rand(count, 3, generator=torch.Generator().manual_seed(0))


def excited(network: torch.nn.Module, factor: float) -> torch.nn.Module:
    """Weights far from their start."""
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.mul_(factor)
    return network


def test_brdf_shapes_and_ranges():
    brdf = excited(BrdfNetwork(SETTINGS), 30)(unit_points(300))
    assert brdf.base_color.shape == brdf.kd.shape == brdf.ks.shape == (300, 3)
    assert brdf.roughness.shape == brdf.metallic.shape == (300,)
    for values, low in ((brdf.base_color, 0), (brdf.metallic, 0), (brdf.roughness, ROUGHNESS_MIN)):
        assert values.min() >= low - 1e-7
        assert values.max() <= 1


@pytest.mark.parametrize("whitest", [0.9, 1.0])
def test_no_paint_is_whiter_than_white_but_metal_is(whitest):
    network = BrdfNetwork(SETTINGS.model_copy(update={"whitest": whitest}))
    last = [layer for layer in network.mlp if hasattr(layer, "bias")][-1]
    with torch.no_grad():
        last.bias[:3] = 50.0
        for metallic in (-50.0, 50.0):
            last.bias[4] = metallic
            brdf = network(unit_points(10))
            torch.testing.assert_close(brdf.base_color, torch.full((10, 3), whitest if metallic < 0 else 1.0))
        last.bias[:] = 0
    gradient = torch.autograd.grad(network(unit_points(10)).base_color.sum(), last.bias)[0]
    assert gradient[4] == 0, "no surface becomes metal to be whiter"
    assert (gradient[:3] > 0).all()


def test_a_field_is_where_rays_are_traced(monkeypatch):
    monkeypatch.setattr(networks, "active_device", lambda: "meta")
    field = Field(SETTINGS, BOX)
    assert field.device.type == "meta"
    assert {values.device.type for values in (*field.parameters(), *field.buffers())} == {"meta"}


def test_positional_encoding_in_place_of_the_hash_grid():
    field = Field(NetworkSettings(encoding="positional"), BOX)
    assert not [name for name in field.state_dict() if "table" in name]
    shapes = [tuple(layer.weight.shape) for layer in field.brdf_network.mlp[0].hidden]
    assert shapes == [(128, 63), (128, 128), (128, 128), (128, 191), (128, 128), (128, 128)]
    p_world = np.float32([[0.1, 0.2, 0.3], [1.0, -1.0, 0.5]])
    found = field.query(p_world)
    np.testing.assert_array_equal(field.query(p_world, np.ones(2)).base_color, found.base_color)
    assert np.abs(found.roughness - 0.82).max() < 0.1  # it starts matte, as the hash grid does
    field.brdf(torch.tensor(p_world, device=field.device)).base_color.sum().backward()
    assert all(p.grad.abs().max() > 0 for p in field.brdf_network.parameters())


@pytest.mark.parametrize("kind", [np.asarray, torch.tensor])
def test_reflectances_by_hand(kind):
    brdf = Brdf(kind([[0.5, 0.2, 0.0]] * 3), kind([0.3] * 3), kind([0.0, 1.0, 0.5]))
    np.testing.assert_allclose(brdf.kd, [[0.5, 0.2, 0], [0, 0, 0], [0.25, 0.1, 0]])
    np.testing.assert_allclose(brdf.ks, [[0.04] * 3, [0.5, 0.2, 0], [0.27, 0.12, 0.02]])


def test_emission_starts_small_and_can_grow():
    network = EmissionNetwork()
    x = unit_points(2000) * 2 - 1
    e = network(x)
    assert e.shape == (2000,)
    assert (e > 0).all()  # every point has a gradient at the start
    assert network.mask(e).max() < 0.1
    network.mask(e).sum().backward()
    assert all(p.grad.abs().max() > 0 for p in network.parameters())


def test_emission_sizes_of_the_paper():
    network = EmissionNetwork()
    shapes = [tuple(layer.weight.shape) for layer in network.hidden]
    assert shapes == [(128, 63), (128, 128), (128, 128), (128, 191), (128, 128), (128, 128)]


def test_mask_by_hand():
    mask = EmissionNetwork.mask(torch.tensor([-1.0, 0.0, np.log(2), 50.0]))
    np.testing.assert_allclose(mask, [0, 0, 0.5, 1], atol=1e-6)


@pytest.mark.parametrize("kind", [np.asarray, torch.tensor])
def test_scene_box_maps_its_faces(kind):
    faces = kind([[-1.0, -4.0, -1.5], [1.0, -2.0, 0.5], [3.0, 0.0, 2.5]])
    np.testing.assert_allclose(BOX.to_unit(faces), [[0] * 3, [0.5] * 3, [1] * 3], atol=1e-6)
    np.testing.assert_allclose(BOX.to_signed(faces), [[-1] * 3, [0] * 3, [1] * 3], atol=1e-6)


def test_scene_box_around_points(np_rng):
    points = np_rng.uniform([-1, 2, 0], [1, 8, 3], (500, 3)).astype(np.float32)
    box = SceneBox.around(points)
    unit = box.to_unit(points)
    assert unit.dtype == np.float32
    assert unit.min() == pytest.approx(0.5 - 0.5 / 1.05, abs=1e-6)
    assert unit.max() == pytest.approx(0.5 + 0.5 / 1.05, abs=1e-6)
    assert all(isinstance(value, float) for value in (*box.center, box.side))


def test_seed_decides_the_weights():
    first, again = Field(SETTINGS, BOX, mask=True), Field(SETTINGS, BOX, mask=True)
    other = Field(OTHER_SEED, BOX, mask=True)
    for name, value in first.state_dict().items():
        assert torch.equal(value, again.state_dict()[name])
        unlike = not torch.equal(value, other.state_dict()[name])
        assert unlike or name.endswith("output.bias") or name == "finest"


def test_the_finest_queries_are_known_by_place(np_rng):
    field = Field(SETTINGS, BOX, mask=True)
    points = np_rng.uniform([0, -3, -0.5], [0.9, -2.1, 0.4], (200, 3)).astype(np.float32)
    field.learn_finest(points, np.full(200, 0.3, np.float32))
    field.learn_finest(points[:100], np.full(100, 0.2, np.float32))
    np.testing.assert_array_equal(field.finest_at(points[:100]), np.float32(0.2))
    assert (field.finest_at(points[100:]) >= np.float32(0.2)).all()
    assert field.finest_at(points[100:]).max() == np.float32(0.3)
    np.testing.assert_array_equal(field.finest_at(points + np.float32([1.1, 0, 0])), 0)  # no view there


def test_building_a_field_leaves_the_global_generator_alone():
    before = torch.get_rng_state()
    Field(SETTINGS, BOX, mask=True)
    assert torch.equal(before, torch.get_rng_state())


def test_queries_equal_single_calls_whatever_the_chunk(backend):
    field = Field(SETTINGS, BOX, mask=True)
    excited(field.brdf_network.encoding, 1e4)
    field = field.to(backend.torch_device)
    p_world = unit_points(1001).numpy() * 4 + [-1, -4, -1.5]
    p_world = p_world.astype(np.float32)
    p_world.setflags(write=False)  # like a memory map
    footprint = np.full(len(p_world), 0.2, np.float32)
    whole = field.brdf(
        torch.tensor(p_world, device=backend.torch_device),
        torch.tensor(footprint, device=backend.torch_device),
    )
    for chunk in (1001, 100):
        found = field.query(p_world, footprint, chunk=chunk)
        for name in ("base_color", "roughness", "metallic"):
            expected = getattr(whole, name).detach().cpu().numpy()
            assert getattr(found, name).dtype == np.float32
            np.testing.assert_allclose(getattr(found, name), expected, atol=2e-5)
    assert not np.allclose(field.query(p_world).roughness, found.roughness)
    mask = field.query_mask(p_world, 100)
    e = field.emission(torch.tensor(p_world, device=backend.torch_device))
    np.testing.assert_allclose(mask, field.emission_network.mask(e).detach().cpu(), atol=1e-6)


def test_a_field_whose_emitters_are_known_has_no_mask(backend):
    field, masked = Field(SETTINGS, BOX), Field(SETTINGS, BOX, mask=True)
    assert {name for name, _ in field.named_parameters()} == {
        name for name, _ in masked.named_parameters() if not name.startswith("emission_network")
    }
    p_world = unit_points(10).numpy().astype(np.float32)
    assert field.emission(torch.tensor(p_world, device=backend.torch_device)) is None
    np.testing.assert_array_equal(field.query(p_world).base_color, masked.query(p_world).base_color)
    with pytest.raises(FiptError, match=r"must have an emission mask.*emitters\.decide: regions"):
        field.query_mask(p_world)


@pytest.mark.parametrize(("own", "given"), [(True, True), (True, False), (False, True), (False, False)])
def test_a_field_starts_from_the_one_before_whichever_has_a_mask(backend, own, given):
    field, before = (Field(settings, BOX, mask=mask) for settings, mask in ((SETTINGS, own), (OTHER_SEED, given)))
    mine, theirs = ({n: v.clone() for n, v in each.state_dict().items()} for each in (field, before))
    field.start_from(before)
    for name, value in field.state_dict().items():
        assert torch.equal(value, theirs.get(name, mine[name])), name


def test_a_field_does_not_start_from_one_of_other_sizes(backend):
    for other in ({"encoding": "positional"}, {"table_log2": SETTINGS.table_log2 + 1}):
        with pytest.raises(FiptError, match="must have networks of the same sizes"):
            Field(SETTINGS, BOX).start_from(Field(SETTINGS.model_copy(update=other), BOX))


def test_footprint_is_measured_in_metres(backend):
    field = Field(SETTINGS, BOX).to(backend.torch_device)
    excited(field.brdf_network.encoding, 1e4)
    p = torch.tensor([[0.3, -1.7, 0.2]], device=backend.torch_device)
    metres = torch.tensor([0.4], device=backend.torch_device)
    inside = field.brdf_network(BOX.to_unit(p), metres / BOX.side)
    torch.testing.assert_close(field.brdf(p, metres).roughness, inside.roughness)


@pytest.mark.parametrize("count", [3, 100, 500, 9001])
def test_threads_do_not_change_the_gradients(backend, threads, count):
    """Sums over many points are what libraries divide among threads."""
    if backend.torch_device != "cpu":
        pytest.skip("no number of threads divides the sums of CUDA")
    field = Field(NetworkSettings(levels=4, table_log2=10), SceneBox((0.0, 0.0, 0.0), 2.0), mask=True)
    points = torch.rand(count, 3, generator=torch.Generator().manual_seed(1)) * 2 - 1
    seen = []
    for number in (1, 2, 4):
        threads(number)
        field.zero_grad()
        brdf = field.brdf(points)
        (brdf.kd.square().sum(1).mean() + brdf.roughness.mean() + field.emission(points[::2]).mean()).backward()
        seen.append([value.grad.clone() for value in field.parameters() if value.grad is not None])
    for other in seen[1:]:
        assert all(torch.equal(one, two) for one, two in zip(seen[0], other, strict=True))


def test_every_layer_sums_its_gradients_in_parts():
    """On some processors a matrix library divides only narrow products among threads, on others wide ones, too."""
    field = Field(NetworkSettings(levels=4, table_log2=10), SceneBox((0.0, 0.0, 0.0), 2.0), mask=True)
    layers = [layer for layer in field.modules() if isinstance(layer, torch.nn.Linear)]
    assert len(layers) > 3
    for layer in layers:
        assert type(layer(torch.ones(2, layer.in_features)).grad_fn).__name__ == "_ProductBackward", layer
