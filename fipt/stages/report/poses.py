"""The section of the page on estimated poses: the overview, evidence of every view, links, alignment."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED
from fipt.stages.report import images

_WIDTH = 1500
"""Of the overview, pixels."""
_UNKNOWN = "–"  # noqa: RUF001 (a dash is meant)


@dataclass(frozen=True)
class PosesReport:
    """What the page says about estimated poses.

    Attributes
    ----------
    views
        Name, reason of a rejected one or None, figures in words.
    accepted
        Number of views with a pose.
    links, weakest
        Pairs of views that share points; the view with the fewest neighbours, and how many these are.
    weakly_linked
        Names of each smaller group of views, which too few points hold to the others.
    points, error
        Number of points; their mean reprojection error, pixels.
    runs
        What each threshold for matches gave.
    chosen
        The threshold used.
    align
        Key and value in words of how metres, up and axes were found.
    image
        Data URI, width, height; None where there is none.
    """

    views: Sequence[tuple[str, str | None, Sequence[str]]]
    accepted: int
    links: int
    weakest: tuple[str, int] | None
    weakly_linked: Sequence[str]
    points: int
    error: float
    runs: Sequence[Mapping[str, Any]]
    chosen: int
    align: Sequence[tuple[str, str]]
    image: tuple[str, int, int] | None


def read_poses(folder: Path) -> PosesReport | None:
    """Read what ``fipt pose`` wrote; None where there is nothing."""
    path = folder / "poses.json"
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        views = [(name, state["reason"], _figures(state)) for name, state in content["views"].items()]
        near = {name: len(state["neighbours"]) for name, state in content["views"].items() if state["accepted"]}
        return PosesReport(
            views=views,
            accepted=len(near),
            links=sum(pair["shared_points"] > 0 for pair in content["graph"]),
            weakest=min(near.items(), key=lambda item: item[1], default=None),
            weakly_linked=[", ".join(group) for group in content["groups"][1:]],
            points=content["points"],
            error=content["error"],
            runs=content["runs"],
            chosen=content["min_matches"],
            align=[(key.replace("_", " "), _words(value)) for key, value in content["align"].items()],
            image=_image(folder / "poses.png"),
        )
    except MALFORMED as error:
        raise FiptError(f"{path} is not what fipt pose writes ({error!r})", "run fipt pose again") from error


def _figures(state: Mapping[str, Any]) -> Sequence[str]:
    if state["reason"] is not None:
        return ()
    agreement, spread = state["agreement"], state["spread"]
    return (
        f"{state['features']}",
        f"{state['points']}",
        f"{state['track_length']:.1f}",
        f"{state['error']:.2f}",
        f"{len(state['neighbours'])}",
        f"{agreement['shift']:.2%}, {agreement['turn']:.2f}°",
        _UNKNOWN if spread is None else f"{spread:.2%}",
    )


def _words(value: Any) -> str:
    """A value of the alignment's report for people."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key.replace('_', ' ')} {_words(inner)}" for key, inner in value.items()) or _UNKNOWN
    if isinstance(value, list | tuple):
        return ", ".join(map(_words, value)) or _UNKNOWN
    if value is None:
        return _UNKNOWN
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _image(path: Path) -> tuple[str, int, int] | None:
    from PIL import Image

    if not path.is_file():
        return None
    with Image.open(path) as opened:
        return images.embedded(np.array(opened.convert("RGB")), _WIDTH)
