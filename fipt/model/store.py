"""Fields and checkpoints of their training on disk: safetensors with JSON metadata, no pickles."""

import json
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
from fipt.model.hash_encoding import Backend
from fipt.model.networks import Field, SceneBox
from fipt.model.settings import FitSettings
from fipt.registry import VERSIONS
from fipt.settings import dumped, validate

Generators = Mapping[str, torch.Generator | np.random.Generator]

_KEY = "fipt"  # of the JSON text in the file's metadata, whose values may only be strings
_Kind = Literal["field", "checkpoint"]
_REQUIRED = {"field": {"extra"}, "checkpoint": {"extra", "step", "optimizer", "generators"}}


def save_field(path: str | Path, field: Field, settings: FitSettings, extra: Mapping[str, Any] | None = None) -> None:
    """Write a fitted field.

    Parameters
    ----------
    path : path
        File, ``*.safetensors``.
    field : Field
        What was fitted.
    settings : Fit
        With which it was made; the loader builds the networks by them.
    extra : mapping, optional
        Anything that JSON can hold, returned by `load_field`.
    """
    _write(path, "field", _weights(field), _description(field, settings), extra)


def load_field(path: str | Path, backend: Backend = "auto") -> tuple[Field, dict[str, Any]]:
    """Read a fitted field.

    Parameters
    ----------
    path : path
        File written by `save_field`.
    backend : {"auto", "drjit", "torch"}
        Of the hash encoding.

    Returns
    -------
    field : Field
        On the CPU.
    metadata : dict
        ``settings`` (Fit), ``box`` (SceneBox), ``version`` (int), ``extra`` (dict).

    Raises
    ------
    FiptError
        If the file is missing, damaged or of another version of the stage.
    """
    tensors, metadata = _read(path, "field")
    field = Field(metadata["settings"], metadata["box"], backend)
    _restore(path, field, tensors)
    return field, metadata


def save_checkpoint(
    path: str | Path,
    field: Field,
    optimizer: torch.optim.Optimizer,
    settings: FitSettings,
    step: int,
    generators: Generators | None = None,
    extra: Mapping[str, Any] | None = None,
) -> None:
    """Write all that a fit needs to go on as if it had never stopped.

    Parameters
    ----------
    path : path
        File, ``*.safetensors``; replaced whole or not at all.
    field, optimizer
        What is being fitted, and its optimiser.
    settings : Fit
        Of the fit; a checkpoint resumes only under equal ones.
    step : int
        Steps done.
    generators : mapping of str to torch.Generator or numpy.random.Generator, optional
        Everything random the fit draws from.
    extra : mapping, optional
        Anything that JSON can hold, such as the hashes of the inputs or a scheduler's state.
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
    states: dict[str, Any] = {}
    for name, generator in (generators or {}).items():
        if isinstance(generator, torch.Generator):
            tensors[f"generator.{name}"] = generator.get_state()
        else:
            states[name] = generator.bit_generator.state
    description = _description(field, settings) | {
        "step": step,
        "optimizer": {"numbers": numbers, "groups": state["param_groups"]},
        "generators": states,
    }
    _write(path, "checkpoint", tensors, description, extra)


def load_checkpoint(
    path: str | Path,
    field: Field,
    optimizer: torch.optim.Optimizer,
    settings: FitSettings,
    generators: Generators | None = None,
) -> tuple[int, dict[str, Any]]:
    """Bring field, optimiser and generators, in place, to where a checkpoint left them.

    Parameters
    ----------
    path, field, optimizer, settings, generators
        As they were given to `save_checkpoint`.

    Returns
    -------
    step : int
        Steps done.
    extra : dict
        As given to `save_checkpoint`.

    Raises
    ------
    FiptError
        If the file is missing, damaged, of another version of the stage, or was made with other
        settings or another scene box. Nothing has been changed then.
    """
    tensors, metadata = _read(path, "checkpoint")
    if metadata["settings"] != settings:
        raise FiptError(f"{path} was made with other settings", "delete it to fit from the start")
    if metadata["box"] != field.box:
        raise FiptError(f"{path} was made for another scene", "delete it to fit from the start")
    generators = generators or {}
    state: dict[int, dict[str, Any]] = {}
    stored_generators: dict[str, Any] = dict(metadata["generators"])
    for name in [name for name in tensors if name.startswith(("optimizer.", "generator."))]:
        kind, _, rest = name.partition(".")
        if kind == "generator":
            stored_generators[rest] = tensors.pop(name)
        else:
            index, _, key = rest.partition(".")
            state.setdefault(int(index), {})[key] = tensors.pop(name)
    if set(stored_generators) != set(generators):
        raise _damaged(path, f"generators {sorted(stored_generators)} for {sorted(generators)}")
    for index, values in metadata["optimizer"]["numbers"].items():
        state.setdefault(int(index), {}).update(values)
    _restore(path, field, tensors)
    groups = metadata["optimizer"]["groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
    for name, generator in generators.items():
        if isinstance(generator, torch.Generator):
            generator.set_state(stored_generators[name])
        else:
            generator.bit_generator.state = stored_generators[name]
    return metadata["step"], metadata["extra"]


def _weights(field: Field) -> dict[str, torch.Tensor]:
    return {f"field.{name}": tensor for name, tensor in field.state_dict().items()}


def _description(field: Field, settings: FitSettings) -> dict[str, Any]:
    return {"settings": dumped(settings), "box": asdict(field.box)}


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
    extra: Mapping[str, Any] | None,
) -> None:
    metadata = {"kind": kind, "stage": "fit", "version": VERSIONS["fit"], **description}
    metadata["extra"] = dict(extra or {})
    stored = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
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
                metadata["settings"] = validate(FitSettings, "fit", metadata["settings"])
                box = metadata["box"]
                metadata["box"] = SceneBox(box["center"], box["side"])
                missing = _REQUIRED[kind] - set(metadata)
                if missing:
                    raise KeyError(f"no {', '.join(sorted(missing))}")
    except (SafetensorError, FiptError, KeyError, TypeError, ValueError) as error:
        raise _damaged(path, str(error)) from error
    if found[0] != kind:
        raise FiptError(f"{path} is a {found[0]} of the fit, not a {kind}", "give the right file")
    if found[1] != VERSIONS["fit"]:
        raise FiptError(
            f"{path} was written by version {found[1]} of the fit, this is version {VERSIONS['fit']}",
            "delete it and run the fit again",
        )
    return tensors, metadata


def _damaged(path: str | Path, why: str) -> FiptError:
    return FiptError(f"{path} is damaged ({why})", "delete it and run the fit again")
