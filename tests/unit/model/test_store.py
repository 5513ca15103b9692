"""Fields and checkpoints on disk: round trips, resuming, and the errors of bad files."""

import json

import drjit
import numpy as np
import pytest
import torch
from safetensors import safe_open

from fipt.errors import FiptError
from fipt.model.networks import Field, SceneBox
from fipt.model.store import load_checkpoint, load_field, save_checkpoint, save_field
from fipt.registry import VERSIONS
from fipt.stages.fit.settings import FitSettings

SETTINGS = FitSettings(levels=4, table_log2=10, growth=1.7, seed=3)
BOX = SceneBox((1.0, -2.0, 0.1), 4.3)


@pytest.fixture
def one_thread(backend):
    """One thread in torch and Dr.Jit: sums repeat to the bit."""
    before = torch.get_num_threads(), drjit.thread_count()
    torch.set_num_threads(1)
    drjit.set_thread_count(1)
    yield backend
    torch.set_num_threads(before[0])
    drjit.set_thread_count(before[1])


class Toy:
    """A regression of a field to a few waves, with random numbers keyed by the step."""

    def __init__(self, device: str, settings: FitSettings = SETTINGS) -> None:
        self.device, self.settings, self.done = device, settings, 0
        self.field = Field(settings, BOX, mask=True).to(device)
        self.optimizer = torch.optim.Adam(self.field.parameters(), lr=1e-2, fused=True)

    def run(self, steps: int) -> float:
        for _ in range(steps):
            rng = np.random.default_rng([2, self.done])
            x = torch.from_numpy(rng.random((256, 3), np.float32)) * 4 + torch.tensor([-1.0, -4.0, -2.0])
            noise = rng.normal(0, 0.01, 3).astype(np.float32)
            target = x.sin().abs() + torch.tensor(noise)
            brdf = self.field.brdf(x.to(self.device))
            loss = (brdf.kd - target.to(self.device)).square().mean()
            loss = loss + self.field.emission(x.to(self.device)).abs().mean()
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
            self.done += 1
        return loss.item()

    def save(self, path) -> None:
        save_checkpoint(path, self.field, self.optimizer, self.settings, self.done)

    def load(self, path) -> None:
        self.done = load_checkpoint(path, self.field, self.optimizer, self.settings)

    def weights(self) -> dict[str, torch.Tensor]:
        return {name: value.clone() for name, value in self.field.state_dict().items()}


def damage(path, change) -> None:
    """Rewrite the file's metadata: safetensors is a length, a JSON header, then the data."""
    content = path.read_bytes()
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    metadata = json.loads(header["__metadata__"]["fipt"])
    change(metadata, header)
    if "__metadata__" in header:
        header["__metadata__"]["fipt"] = json.dumps(metadata)
    text = json.dumps(header).encode()
    path.write_bytes(len(text).to_bytes(8, "little") + text + content[8 + length :])


@pytest.mark.parametrize("mask", [True, False])
def test_field_round_trip(tmp_path, backend, mask):
    field = Field(SETTINGS, BOX, mask=mask, inset=0.015)
    path = tmp_path / "round-0" / "model.safetensors"
    save_field(path, field, SETTINGS)
    loaded = load_field(path)
    assert (loaded.box, loaded.inset) == (BOX, 0.015)
    assert loaded.settings.model_dump().items() <= SETTINGS.model_dump().items()
    assert (loaded.settings.levels, loaded.settings.seed) == (4, 3)
    assert set(loaded.state_dict()) == set(field.state_dict())
    for name, value in field.state_dict().items():
        assert torch.equal(value, loaded.state_dict()[name])
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3)).astype(np.float32)
    np.testing.assert_array_equal(field.query(points).base_color, loaded.query(points).base_color)
    assert [p.name for p in path.parent.iterdir()] == ["model.safetensors"]


def test_same_field_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_field(tmp_path / name, Field(SETTINGS, BOX), SETTINGS)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_resume_equals_uninterrupted(tmp_path, one_thread):
    path = tmp_path / "model.checkpoint.safetensors"
    whole = Toy(one_thread.torch_device)
    first_loss = whole.run(1)
    whole.run(6)
    whole.save(path)
    last_loss = whole.run(8)
    assert last_loss < first_loss

    resumed = Toy(one_thread.torch_device)
    resumed.run(3)  # whatever it did before must not matter
    resumed.load(path)
    assert resumed.done == 7
    resumed.run(8)
    assert resumed.done == whole.done
    exact = one_thread.name == "llvm"
    for name, value in whole.weights().items():
        other = resumed.weights()[name]
        assert torch.equal(value, other) if exact else torch.allclose(value, other, atol=1e-3)


def test_checkpoint_before_the_first_step(tmp_path, backend):
    path = tmp_path / "c.safetensors"
    toy = Toy(backend.torch_device)
    toy.save(path)
    other = Toy(backend.torch_device)
    other.load(path)
    assert other.done == 0
    assert not other.optimizer.state


def test_checkpoint_of_other_settings_or_scene_changes_nothing(tmp_path, backend):
    path = tmp_path / "c.safetensors"
    toy = Toy(backend.torch_device)
    toy.run(1)
    toy.save(path)
    other = Toy(backend.torch_device, SETTINGS.model_copy(update={"learning_rate": 0.5}))
    before = other.weights()
    with pytest.raises(FiptError, match="other settings; delete it"):
        other.load(path)
    elsewhere = Toy(backend.torch_device)
    elsewhere.field.box = SceneBox((0.0, 0.0, 0.0), 1.0)
    with pytest.raises(FiptError, match="another scene"):
        elsewhere.load(path)
    elsewhere.field.box, elsewhere.field.inset = BOX, 0.01
    with pytest.raises(FiptError, match="another scene"):
        elsewhere.load(path)
    assert all(torch.equal(value, other.weights()[name]) for name, value in before.items())


def test_another_version_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "m.safetensors"
    save_field(path, Field(SETTINGS, BOX), SETTINGS)
    monkeypatch.setitem(VERSIONS, "fit", VERSIONS["fit"] + 1)
    with pytest.raises(FiptError, match="written by version") as caught:
        load_field(path)
    assert "run the fit again" in caught.value.remedy
    assert "\n" not in str(caught.value)


def test_a_checkpoint_is_not_a_field(tmp_path, backend):
    path = tmp_path / "c.safetensors"
    Toy(backend.torch_device).save(path)
    with pytest.raises(FiptError, match="is a checkpoint of the fit, not a field"):
        load_field(path)


@pytest.mark.parametrize(
    "change",
    [
        lambda metadata, header: header.pop("__metadata__"),
        lambda metadata, header: metadata.pop("version"),
        lambda metadata, header: metadata.pop("box"),
        lambda metadata, header: metadata["box"].pop("side"),
        lambda metadata, header: metadata.pop("settings"),
        lambda metadata, header: metadata["settings"].update(levels=5),
        lambda metadata, header: metadata["settings"].update(levels=-5),
        lambda metadata, header: header.pop("field.emission_network.output.bias"),
        lambda metadata, header: metadata.pop("mask"),
        lambda metadata, header: metadata.update(mask=False),
    ],
    ids=[
        "no metadata",
        "no version",
        "no box",
        "half a box",
        "no settings",
        "other sizes",
        "impossible sizes",
        "no tensor",
        "no word of a mask",
        "a mask that is denied",
    ],
)
def test_damaged_metadata(tmp_path, change):
    path = tmp_path / "m.safetensors"
    save_field(path, Field(SETTINGS, BOX, mask=True), SETTINGS)
    damage(path, change)
    with pytest.raises(FiptError, match="damaged"):
        load_field(path)


def test_damaged_or_missing_file(tmp_path):
    path = tmp_path / "m.safetensors"
    with pytest.raises(FiptError, match=r"m\.safetensors"):
        load_field(path)
    save_field(path, Field(SETTINGS, BOX), SETTINGS)
    content = path.read_bytes()
    for broken in (b"", content[:5], content[: len(content) // 2], b"x" * 100):
        path.write_bytes(broken)
        with pytest.raises(FiptError, match="damaged"):
            load_field(path)


def test_file_is_plain_safetensors(tmp_path):
    path = tmp_path / "m.safetensors"
    save_field(path, Field(SETTINGS, BOX), SETTINGS)
    with safe_open(path, framework="np") as file:
        names = set(file.keys())
        metadata = json.loads(file.metadata()["fipt"])
    assert "field.brdf_network.encoding.table" in names
    assert metadata["settings"]["levels"] == 4
    assert metadata["box"] == {"center": [1.0, -2.0, 0.1], "side": 4.3}
