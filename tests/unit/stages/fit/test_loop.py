"""The optimisation: known materials come back, a stopped fit goes on as if it had not stopped."""

import drjit
import numpy as np
import pytest
import torch

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.model import store
from fipt.model.networks import Brdf, Field, SceneBox
from fipt.model.reflectance import reflected
from fipt.stages.fit import loop
from fipt.stages.fit.objective import Objective
from fipt.stages.fit.part_search import estimate_parts
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.targets import part_targets
from tests import scenes

LEVELS = len(ROUGHNESS_LEVELS)
BOX = SceneBox((0.0, 0.0, 0.0), 2.2)
SETTINGS = FitSettings(
    steps=500,
    batch=256,
    queries=1,
    learning_rate=1e-2,
    final_learning_rate=1e-3,
    levels=4,
    table_log2=10,
    table_rate=1.0,
    start_rough=True,
    emission_threshold=1.5,
    diffuse_weight=0,
    part_weight=0.1,
    checkpoint_every=1000,
    footprint=0.0,
    threads=1,
)
MATERIALS = (((0.7, 0.3, 0.2), 0.3, 0.0), ((0.9, 0.7, 0.3), 0.5, 1.0), ((0.2, 0.4, 0.8), 0.9, 0.0))


@pytest.fixture
def one_thread(backend):
    """One thread in torch and Dr.Jit: sums repeat to the bit."""
    before = torch.get_num_threads(), drjit.thread_count()
    torch.set_num_threads(1)
    drjit.set_thread_count(1)
    yield backend
    torch.set_num_threads(before[0])
    drjit.set_thread_count(before[1])


def scene(emitter=False, size=28):
    """A plate of three stripes with known materials under perfect shading of varied lobes; and their truth."""
    rng = np.random.default_rng(3)
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, size), np.linspace(-1, 1, size)))
    stripe = np.minimum(((x + 1) * 1.5).astype(int), 2)
    position = np.stack([x, np.zeros_like(x), z], axis=1)
    shading = np.empty((len(x), SHADING_OUTPUTS, 3))
    shading[:, 0] = rng.uniform(0.3, 1.0, (len(x), 1))
    # a reflection: bright here and dark there where smooth, ever more like the mean where rough
    sharp, mean = rng.choice([0.0, 10.0], (len(x), 3), p=[0.85, 0.15]), 1.5
    for level, s in enumerate(ROUGHNESS_LEVELS):
        shading[:, 1 + level] = (mean + (sharp - mean) * (1 - s)) * (1 - 0.5 * s)
    shading[:, 1 + LEVELS :] = 0.04 * shading[:, 1 : 1 + LEVELS]
    shading = shading.astype(np.float16)
    base, roughness, metallic = (np.float32([m[k] for m in MATERIALS])[stripe] for k in range(3))
    brdf = Brdf(*map(torch.from_numpy, (base, roughness, metallic)))
    image = reflected(brdf, torch.from_numpy(shading.astype(np.float32)), 1)[0].numpy()
    lit = (np.abs(x) < 0.2) & (np.abs(z) < 0.2) & emitter
    image[lit] = 25.0
    sub = rng.uniform(-0.01, 0.01, (len(x), 4, 3)).astype(np.float16)
    samples = scenes.samples_of(position, stripe, sub=sub)
    segment = np.where(lit, 4, stripe + 1).astype(np.uint16)
    return (
        scenes.training_pixels([samples], [shading], [(image, np.ones(len(x)))], [segment]),
        position,
        (base, roughness, metallic),
        lit,
    )


def test_known_materials_come_back(one_thread, tmp_path):
    pixels, position, (base, roughness, metallic), _ = scene()
    settings = SETTINGS.model_copy(update={"steps": 350})
    field = Field(settings, BOX, mask=True)
    before = field.query(position)
    stats = loop.fit(field, pixels, Objective(settings, "part"), tmp_path / "c.safetensors")
    found = field.query(position)
    truth = (base, roughness, metallic)
    first, last = (
        [
            np.abs(getattr(brdf, name) - v)
            for name, v in zip(("base_color", "roughness", "metallic"), truth, strict=True)
        ]
        for brdf in (before, found)
    )
    assert min(error.mean() for error in first) > 0.15  # it did not start there
    assert max(error.mean() for error in last) < 0.06
    assert last[0].mean() < 0.03
    assert field.query_mask(position).max() < 0.05  # nothing shines
    curve = np.array(stats["loss_curve"])
    assert curve[-1, 1] < 0.05 * curve[0, 1]
    assert stats["steps"] == settings.steps
    assert set(stats["loss"]) == {"color", "emission", "diffuse", "part"}
    assert list(tmp_path.iterdir()) == []


def test_an_emitter_opens_the_mask_and_nothing_else(one_thread, tmp_path):
    pixels, position, (base, *_), lit = scene(emitter=True)
    settings = SETTINGS.model_copy(update={"steps": 300, "emission_weight": 0.05, "whitest": 1})  # as preset `paper`
    field = Field(settings, BOX, mask=True)
    loop.fit(field, pixels, Objective(settings, "part"), tmp_path / "c.safetensors")
    mask = field.query_mask(position)
    assert mask[lit].mean() > 0.3
    assert mask[~lit].mean() < 0.05
    assert np.abs(field.query(position).base_color - base)[~lit].mean() < 0.06


def wrongly_lit(error=0.15, views=4, size=20):
    """The plate, matte, seen by several views whose shading is wrong by a factor of its own at every place."""
    rng = np.random.default_rng(3)
    x, z = (a.ravel() for a in np.meshgrid(np.linspace(-1, 1, size), np.linspace(-1, 1, size)))
    position = np.stack([x, np.zeros_like(x), z], axis=1)
    stripe = np.tile(np.minimum(((x + 1) * 1.5).astype(int), 2), views)
    base = np.float32([m[0] for m in MATERIALS])[stripe]
    shading = np.zeros((len(stripe), SHADING_OUTPUTS, 3), np.float32)
    shading[:, 0] = rng.uniform(0.3, 1.0, (len(stripe), 1))
    image = base * shading[:, 0]
    shading[:, 0] *= np.exp(error * rng.standard_normal((len(stripe), 1)))
    names = [f"v{view}" for view in range(views)]
    samples = scenes.samples_of(np.tile(position, (views, 1)), stripe, views=names, shapes=[(size, size)] * views)
    segment = (stripe + 1).astype(np.uint16)
    return (
        scenes.training_pixels([samples], [shading], [(image, np.ones(len(image)))], [segment]),
        position,
        base[: size**2],
    )


def test_parts_of_one_colour_are_spared_the_errors_of_their_shading(one_thread, tmp_path):
    pixels, position, base = wrongly_lit()
    settings = SETTINGS.model_copy(update={"steps": 220, "emission_threshold": 0.0, "base_weight": 0.1})
    found = estimate_parts(pixels, np.zeros(3), BOX.side, emitter_gain=1e9)
    assert (found.uniform[1:] > 0.5).all()
    errors = []
    for weight in (0.0, 0.1):
        own = settings.model_copy(update={"base_weight": weight})
        field = Field(own, BOX)
        objective = Objective(own, "part", part_targets(found, own).to(field.device))
        stats = loop.fit(field, pixels, objective, tmp_path / "c.safetensors")
        errors.append(np.abs(field.query(position).base_color - base).mean())
    assert set(stats["loss"]) == {"color", "target", "base", "smoothness", "part"}
    assert errors[1] < 0.75 * errors[0]
    assert errors[1] < 0.02


class Killed(Exception):
    """Stands for kill -9 after some step."""


def test_a_killed_fit_goes_on_as_if_it_had_not_stopped(one_thread, tmp_path, monkeypatch, caplog):
    settings = SETTINGS.model_copy(update={"steps": 25, "batch": 128, "checkpoint_every": 5, "queries": 2})
    pixels = scene()[0]
    whole = Field(settings, BOX, mask=True)
    loop.fit(whole, pixels, Objective(settings, "part"), tmp_path / "a.safetensors")

    original, calls = Objective.terms, []

    def killed_later(*arguments):
        calls.append(1)
        if len(calls) == 18:
            raise Killed
        return original(*arguments)

    path = tmp_path / "b.safetensors"
    monkeypatch.setattr(Objective, "terms", killed_later)
    with pytest.raises(Killed):
        loop.fit(Field(settings, BOX, mask=True), pixels, Objective(settings, "part"), path)
    monkeypatch.setattr(Objective, "terms", original)
    resumed = Field(settings.model_copy(update={"seed": 9}), BOX, mask=True)  # whatever it starts from
    with caplog.at_level("INFO"):
        loop.fit(resumed, pixels, Objective(settings, "part"), path)
    assert "going on from step 15" in caplog.text
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_a_checkpoint_of_other_settings_is_refused(one_thread, tmp_path):
    pixels, path = scene()[0], tmp_path / "c.safetensors"
    settings = SETTINGS.model_copy(update={"steps": 3})
    field = Field(settings, BOX, mask=True)
    store.save_checkpoint(path, field, torch.optim.Adam(loop._parameter_groups(field, settings)), settings, 1)
    other = settings.model_copy(update={"part_weight": 0.5})
    with pytest.raises(FiptError, match="was made with other settings; delete it"):
        loop.fit(Field(other, BOX, mask=True), pixels, Objective(other, "part"), path)


def test_a_checkpoint_of_another_version_is_refused(one_thread, tmp_path, monkeypatch):
    pixels, path = scene()[0], tmp_path / "c.safetensors"
    settings = SETTINGS.model_copy(update={"steps": 3})
    field = Field(settings, BOX, mask=True)
    store.save_checkpoint(path, field, torch.optim.Adam(loop._parameter_groups(field, settings)), settings, 1)
    monkeypatch.setitem(store.VERSIONS, "fit", 99)
    with pytest.raises(FiptError, match=r"was written by version .* of the fit, this is version 99"):
        loop.fit(Field(settings, BOX, mask=True), pixels, Objective(settings, "part"), path)


def test_a_loss_that_is_not_finite_names_its_term(one_thread, tmp_path):
    pixels = scene()[0]
    pixels.radiance[0][:] = np.inf
    settings = SETTINGS.model_copy(update={"steps": 3})
    with pytest.raises(FiptError, match=r"the loss is not finite at step 0 \(color\)"):
        loop.fit(Field(settings, BOX), pixels, Objective(settings, "part"), tmp_path / "c.safetensors")


def test_epochs_set_the_fewest_steps(one_thread, tmp_path):
    pixels = scene(size=10)[0]
    settings = SETTINGS.model_copy(update={"steps": 2, "batch": 30, "min_epochs": 1.0})
    stats = loop.fit(Field(settings, BOX), pixels, Objective(settings, "part"), tmp_path / "c.safetensors")
    assert stats["steps"] == 4  # 100 pixels in batches of 30


def test_fewer_pixels_than_a_batch(one_thread, tmp_path):
    pixels = scene(size=4)[0]
    settings = SETTINGS.model_copy(update={"steps": 3})
    stats = loop.fit(Field(settings, BOX), pixels, Objective(settings, "part"), tmp_path / "c.safetensors")
    assert np.isfinite(list(stats["loss"].values())).all()
