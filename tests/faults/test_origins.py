"""Files say of which mesh and by which version of a stage they were made; models also what their weights sum to."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from fipt.errors import FiptError
from fipt.formats import origins
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.origins import running
from fipt.model.networks import Field, SceneBox
from fipt.model.settings import NetworkSettings
from fipt.model.store import load_field, save_field
from fipt.scene.mesh import write_ply
from fipt.scene.samples import read_samples, write_samples
from tests.fake_results import write_results
from tests.layouts import room

SMALL = NetworkSettings(levels=1, table_log2=8)


def write_model(path: Path, change: Callable[[torch.Tensor], torch.Tensor] = lambda weight: weight) -> None:
    field = Field(SMALL, SceneBox((0.0, 0.0, 0.0), 2.0))
    field.load_state_dict({name: change(weight) for name, weight in field.state_dict().items()})
    save_field(path, field, SMALL)


def write_shard(folder: Path) -> None:
    shard = write_results(folder.parent / "made") / "samples" / "train-000"
    folder.mkdir()
    write_samples(folder, replace(read_samples(shard)))


FILES: dict[str, tuple[str, Callable[[Path], object], Callable[[Path], object]]] = {
    "npz": ("a.npz", lambda path: save_npz(path, a=np.arange(3)), load_npz),
    "model": ("a.safetensors", write_model, load_field),
    "samples": ("shard", write_shard, read_samples),
}


@pytest.mark.parametrize("kind", FILES)
def test_files_of_another_mesh_or_version_are_refused(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, write, read = FILES[kind]
    mesh = tmp_path / "dataset" / "mesh.ply"
    write_ply(mesh, room())
    with running("cache", mesh.parent):
        write(tmp_path / name)
        read(tmp_path / name)
    read(tmp_path / name)  # outside a stage nobody asks
    with monkeypatch.context() as patched, running("bake", mesh.parent):
        patched.setitem(origins.VERSIONS, "cache", -1)
        with pytest.raises(FiptError, match=r"by version \d+ of the stage cache; this is version -1; delete"):
            read(tmp_path / name)
    write_ply(mesh, replace(room(), vertices=room().vertices * 2))
    with running("bake", mesh.parent), pytest.raises(FiptError, match=rf"{name}.* belongs to another mesh than {mesh}"):
        read(tmp_path / name)
    mesh.unlink()
    with running("bake", mesh.parent):
        read(tmp_path / name)


def test_what_says_nothing_of_itself_is_read(tmp_path: Path) -> None:
    write_ply(tmp_path / "mesh.ply", room())
    save_npz(tmp_path / "a.npz", a=np.arange(3))
    with running("bake", tmp_path):
        assert set(load_npz(tmp_path / "a.npz")) == {"a"}
    with running("bake", None):
        save_npz(tmp_path / "b.npz", a=np.arange(3))
        assert set(load_npz(tmp_path / "b.npz")) == {"a"}


def test_a_flipped_bit_of_a_model_is_found(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    write_model(path)
    whole = path.read_bytes()
    for place in (-1, -100, -1000):
        data = bytearray(whole)
        data[place] ^= 1
        path.write_bytes(bytes(data))
        with pytest.raises(FiptError, match=r"is damaged \(its weights are not those that were written\); delete"):
            load_field(path)


def test_weights_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    write_model(tmp_path / "m.safetensors", lambda weight: weight * (np.nan if weight.is_floating_point() else 1))
    with pytest.raises(FiptError, match="not all of its weights are finite"):
        load_field(tmp_path / "m.safetensors")


def test_verbs_run_with_the_mesh_of_their_dataset(tmp_path: Path) -> None:
    """What a stage writes carries the mesh's hash."""
    write_ply(tmp_path / "mesh.ply", room())
    with running("cache", tmp_path):
        said = origins.origin()
    assert said["stage"] == "cache"
    assert said["mesh"] == origins.file_hash(tmp_path / "mesh.ply")
    assert origins.origin() == {}
    json.dumps(said)
