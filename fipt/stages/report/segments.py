"""The segments' section of the page: views before and after the fusion, agreement of votes, list of segments."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.images import read_ids
from fipt.formats.text import MALFORMED
from fipt.scene.dataset import Dataset
from fipt.scene.segment_colors import heat, in_colors, matching_colors, over_photo
from fipt.scene.segments import read_view_ids

_VIEWS = 4
"""Views shown, spread over the training views."""
_LISTED = 40
"""Segments on the page; fusion.json has all."""


@dataclass(frozen=True)
class SegmentsReport:
    """What the page says about the segments.

    Attributes
    ----------
    source
        Where they come from, in words.
    agreement
        Share of all votes that the fused ids got; None where nothing voted.
    views
        View -> its embedded images.
    segments
        id, name, area (square metres), views and agreement of each, largest first; ``more`` is how many are not shown.
    """

    source: str
    agreement: float | None
    views: Mapping[str, Sequence[Any]]
    segments: Sequence[Mapping[str, Any]]
    more: int


def read_segments(
    folder: Path,
    data: Dataset | None,
    mode: Mapping[str, Any],
    exposure: float,
    embed: Callable[[str, np.ndarray], Any],
) -> SegmentsReport | None:
    """Read segments/ of a results folder; None where nothing was fused.

    Parameters
    ----------
    folder
        ``segments`` of the scene.
    data
        The dataset, for the photographs.
    mode
        Settings of stage segment as they were used, perhaps empty.
    exposure
        Factor on radiance, the page's.
    embed
        Embeds an image (H, W, 3) uint8 under a heading.
    """
    path = folder / "fusion.json"
    if not path.is_file() or data is None:
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        listed = sorted(content["segments"], key=lambda entry: -entry["area"])
        kind = content["kinds"][-1]
        grown = content["source"] != "views"
        agreement = None if grown else float(content["agreement"])
    except MALFORMED as error:
        raise FiptError(f"{path} is not a list of fused segments ({error!r})", "run fipt fuse again") from error
    train = data.views("train")
    chosen = [train[k] for k in np.unique(np.linspace(0, len(train) - 1, _VIEWS).round().astype(int))]
    return SegmentsReport(
        source=_source(grown, mode),
        agreement=agreement,
        views={
            view: [embed(*shown) for shown in _images(folder, data, view, kind, grown, exposure).items()]
            for view in chosen
        },
        segments=listed[:_LISTED],
        more=max(len(listed) - _LISTED, 0),
    )


def _source(grown: bool, mode: Mapping[str, Any]) -> str:
    if grown:
        return "Parts are grown on the mesh, by its shape and the colour of the photographs"
    if mode.get("mode") == "mask2former":
        return f"Mask2Former ({mode['task']}, {mode['model']}) segments each view by itself"
    return "Ids of each view are given" + (f" ({mode['path']})" if mode.get("path") else "")


def _images(folder: Path, data: Dataset, view: str, kind: str, grown: bool, exposure: float) -> dict[str, np.ndarray]:
    """Images of a view by heading; what was not fused from views has neither a before nor votes."""
    fused = read_ids(folder / "fused" / kind / f"{view}.png")
    shown = {"On the photograph": over_photo(data.image(view)[0], fused, exposure)}
    before = folder / "views" / f"{view}.npz"
    if not grown and before.is_file():
        ids, _ = read_view_ids(before)
        if ids.shape == fused.shape:
            shown["Before fusion"] = in_colors(ids, matching_colors([(ids, fused)]))
    shown["Fused"] = in_colors(fused)
    agreement = folder / "fused" / "agreement" / f"{view}.png"
    if not grown and agreement.is_file():
        shown["Agreement of votes"] = heat(read_ids(agreement) / 255)
    return shown
