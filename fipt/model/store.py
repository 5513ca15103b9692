"""Fields, checkpoints of their training and materials of parts on disk: safetensors with JSON metadata, no pickles."""

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from fipt.errors import FiptError
from fipt.formats.files import atomic, existing_file
from fipt.formats.origins import check_origin, origin
from fipt.formats.text import MALFORMED
from fipt.model.networks import Field, SceneBox
from fipt.model.parts import MaterialModel, PartLabels, PartMaterials
from fipt.model.reflectance import Brdf
from fipt.model.settings import NetworkSettings
from fipt.registry import VERSIONS
from fipt.settings import dumped, validate

_KEY = "fipt"  # of the JSON text in the file's metadata, whose values may only be strings
_Kind = Literal["field", "checkpoint", "parts"]
_REQUIRED = {
    "field": {"settings", "box", "mask", "inset"},
    "checkpoint": {"settings", "box", "mask", "inset", "step", "optimizer"},
    "parts": set(),
}
_PART_ARRAYS = ("of_triangle", "place", "of_place", "base_color", "roughness", "metallic")


def save_field(path: str | Path, field: Field, settings: NetworkSettings) -> None:
    """Write a fitted field.

    Parameters
    ----------
    path : path
        File, ``*.safetensors``.
    field : Field
        What was fitted.
    settings : NetworkSettings
        With which it was made, those of the fit included; the loader builds the networks by them.
    """
    _write(path, "field", _weights(field), _description(field, settings))


def load_field(path: str | Path) -> Field:
    """Read a fitted field, to the device that traces rays.

    Parameters
    ----------
    path : path
        File written by `save_field`.

    Raises
    ------
    FiptError
        If the file is missing, damaged or of another version of the stage.
    """
    tensors, metadata = _read(path, "field")
    mask, inset = bool(metadata["mask"]), float(metadata["inset"])
    field = Field(_network_settings(path, metadata), _box(path, metadata), mask=mask, inset=inset)
    _restore(path, field, tensors)
    return field


def save_parts(path: str | Path, parts: PartMaterials) -> None:
    """Write materials of parts, where a fitted field would stand."""
    arrays = vars(parts.labels) | vars(parts.brdf)
    _write(path, "parts", {name: torch.from_numpy(np.ascontiguousarray(arrays[name])) for name in _PART_ARRAYS}, {})


def load_model(path: str | Path) -> MaterialModel:
    """Read a fitted field, or materials of parts.

    Raises
    ------
    FiptError
        If the file is missing, damaged or of another version of the stage.
    """
    if _kind(path) != "parts":
        return load_field(path)
    tensors, _ = _read(path, "parts")
    missing = [name for name in _PART_ARRAYS if name not in tensors]
    if missing:
        raise _damaged(path, f"no {', '.join(missing)}")
    arrays = [tensors[name].numpy() for name in _PART_ARRAYS]
    return PartMaterials(PartLabels(*arrays[:3]), Brdf(*arrays[3:]))


def save_checkpoint(
    path: str | Path, field: Field, optimizer: torch.optim.Optimizer, settings: NetworkSettings, step: int
) -> None:
    """Write all that a fit needs to go on as if it had never stopped; its random numbers are keyed by the step.

    Parameters
    ----------
    path : path
        File, ``*.safetensors``; replaced whole or not at all.
    field, optimizer
        What is being fitted, and its optimiser.
    settings : NetworkSettings
        Of the fit; a checkpoint resumes only under equal ones.
    step : int
        Steps done.
    """
    tensors = _weights(field)
    state = optimizer.state_dict()
    numbers: dict[str, dict[str, Any]] = {}
    for index, values in state["state"].items():
        for name, value in values.items():
            if isinstance(value, torch.Tensor):
                tensors[f"optimizer.{index}.{name}"] = value
            else:
                numbers.setdefault(str(index), {})[name] = value
    optimizer_state = {"numbers": numbers, "groups": state["param_groups"]}
    _write(path, "checkpoint", tensors, _description(field, settings) | {"step": step, "optimizer": optimizer_state})


def load_checkpoint(path: str | Path, field: Field, optimizer: torch.optim.Optimizer, settings: NetworkSettings) -> int:
    """Bring field and optimiser, in place, to where a checkpoint left them; return the steps done.

    Parameters
    ----------
    path, field, optimizer, settings
        As they were given to `save_checkpoint`.

    Raises
    ------
    FiptError
        If the file is missing, damaged, of another version of the stage, or was made with other
        settings or another scene box. Nothing has been changed then.
    """
    tensors, metadata = _read(path, "checkpoint")
    if metadata["settings"] != dumped(settings) or metadata["mask"] != (field.emission_network is not None):
        raise FiptError(f"{path} was made with other settings", "delete it to fit from the start")
    if (_box(path, metadata), metadata["inset"]) != (field.box, field.inset):
        raise FiptError(f"{path} was made for another scene", "delete it to fit from the start")
    state: dict[int, dict[str, Any]] = {}
    for name in [name for name in tensors if name.startswith("optimizer.")]:
        _, index, key = name.split(".", 2)
        state.setdefault(int(index), {})[key] = tensors.pop(name)
    for index, values in metadata["optimizer"]["numbers"].items():
        state.setdefault(int(index), {}).update(values)
    _restore(path, field, tensors)
    optimizer.load_state_dict({"state": state, "param_groups": metadata["optimizer"]["groups"]})
    return metadata["step"]


def _weights(field: Field) -> dict[str, torch.Tensor]:
    return {f"field.{name}": tensor for name, tensor in field.state_dict().items()}


def _network_settings(path: str | Path, metadata: Mapping[str, Any]) -> NetworkSettings:
    """Of all settings of the fit those that the networks need."""
    try:
        known = {name: metadata["settings"][name] for name in NetworkSettings.model_fields}
        return validate(NetworkSettings, "fit", known)
    except (FiptError, KeyError, TypeError) as error:
        raise _damaged(path, str(error)) from error


def _box(path: str | Path, metadata: Mapping[str, Any]) -> SceneBox:
    try:
        return SceneBox(metadata["box"]["center"], metadata["box"]["side"])
    except MALFORMED as error:
        raise _damaged(path, str(error)) from error


def _description(field: Field, settings: NetworkSettings) -> dict[str, Any]:
    mask = field.emission_network is not None
    return {"settings": dumped(settings), "box": asdict(field.box), "mask": mask, "inset": field.inset}


def _restore(path: str | Path, field: Field, tensors: dict[str, torch.Tensor]) -> None:
    """Copy stored weights into the field, after checking that all are there and fit."""
    weights = {name.removeprefix("field."): tensor for name, tensor in tensors.items()}
    expected = {name: tensor.shape for name, tensor in field.state_dict().items()}
    if expected != {name: tensor.shape for name, tensor in weights.items()}:
        raise _damaged(path, "its tensors do not match its settings")
    field.load_state_dict(weights)


def _write(
    path: str | Path,
    kind: _Kind,
    tensors: dict[str, torch.Tensor],
    description: dict[str, Any],
) -> None:
    stored = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    metadata = {"kind": kind, "stage": "fit", "version": VERSIONS["fit"], "origin": origin(), **description}
    metadata["checksum"] = _checksum(stored)
    with atomic(path) as temporary:
        # Not the library's own file writer, which hides the system's errors that `atomic` explains.
        temporary.write_bytes(save(stored, {_KEY: json.dumps(metadata, sort_keys=True)}))


def _read(path: str | Path, kind: _Kind) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Return the tensors and metadata of a file of this kind and version."""
    existing_file(path, f"a {kind} of the fit")
    tensors = {}
    try:
        with safe_open(path, framework="pt") as file:
            metadata = json.loads((file.metadata() or {})[_KEY])
            found = metadata["kind"], metadata["version"]
            if found == (kind, VERSIONS["fit"]):
                # Copies: the library's tensors map the file, which may be replaced meanwhile.
                names = file.keys()
                tensors = {name: file.get_tensor(name).clone() for name in names}
                missing = _REQUIRED[kind] - set(metadata)
                if missing:
                    raise KeyError(f"no {', '.join(sorted(missing))}")
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise _damaged(path, str(error)) from error
    if found[0] != kind:
        raise FiptError(f"{path} is a {found[0]} of the fit, not a {kind}", "give the right file")
    if found[1] != VERSIONS["fit"]:
        raise FiptError(
            f"{path} was written by version {found[1]} of the fit, this is version {VERSIONS['fit']}",
            "delete it and run the fit again",
        )
    if metadata.get("checksum", _checksum(tensors)) != _checksum(tensors):
        raise _damaged(path, "its weights are not those that were written")
    if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
        raise _damaged(path, "not all of its weights are finite")
    check_origin(path, metadata.get("origin"))
    return tensors, metadata


def _checksum(tensors: Mapping[str, torch.Tensor]) -> int:
    """CRC-32 of all tensors: the format has none of its own."""
    found = 0
    for name in sorted(tensors):
        found = zlib.crc32(tensors[name].reshape(-1).numpy().data, found)
    return found


def _kind(path: str | Path) -> str | None:
    """What a file of ours holds; None where it cannot be told."""
    existing_file(path, "a model")
    try:
        with safe_open(path, framework="pt") as file:
            return str(json.loads((file.metadata() or {})[_KEY])["kind"])
    except (SafetensorError, KeyError, TypeError, ValueError):
        return None


def _damaged(path: str | Path, why: str) -> FiptError:
    return FiptError(f"{path} is damaged ({why})", "delete it and run the fit again")
