"""The folder of a network's weights: one that is named, or the local cache's."""

import re
from pathlib import Path

from fipt.errors import FiptError

_FILES = ("config.json", "preprocessor_config.json", "model.safetensors")
_SHARDED = "model.safetensors.index.json"
"""In the place of model.safetensors where the weights are several files."""
_HUB_NAME = re.compile(r"\w[\w.-]*/[\w.-]+")


def is_place(model: str) -> bool:
    """Whether the name of a checkpoint is the path of a folder, not one that a hub has."""
    return _HUB_NAME.fullmatch(model) is None


def model_folder(model: str) -> Path:
    """Folder with the files of a checkpoint: ``model`` itself, or where the local cache keeps it.

    Raises
    ------
    FiptError
        If one of the files is not there: which, where, and how to get it.
    """
    fetch = f"hf download {model} {' '.join(_FILES)}"
    folder = Path(model).expanduser()
    if folder.is_dir():
        remedy = "put them there (of a checkpoint as `hf download NAME --local-dir FOLDER` fetches it)"
    elif _HUB_NAME.fullmatch(model):
        folder = _cached(model)
        remedy = f"fetch them once with: {fetch}"
    else:
        raise FiptError(
            f"segment.model {model} does not exist", "name a folder that holds a Mask2Former, or a checkpoint"
        )
    missing = [name for name in _FILES if not (folder / name).is_file()]
    if "model.safetensors" in missing and (folder / _SHARDED).is_file():
        missing.remove("model.safetensors")
    if missing:
        raise FiptError(
            f"segment.mode mask2former needs the files {', '.join(_FILES)} of {model} in {folder}; "
            f"{', '.join(missing)} missing (nothing is downloaded here, and pickled weights are not read)",
            f"{remedy}; segment.mode: geometry needs none",
        )
    return folder


def _cached(model: str) -> Path:
    """Snapshot of a checkpoint in the cache of huggingface_hub, whether it is there or not."""
    from huggingface_hub import constants, snapshot_download
    from huggingface_hub.errors import LocalEntryNotFoundError

    try:
        return Path(snapshot_download(model, local_files_only=True))
    except LocalEntryNotFoundError:
        return Path(constants.HF_HUB_CACHE, f"models--{model.replace('/', '--')}")
