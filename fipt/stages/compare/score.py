"""What a run of a method reached, took and used: the content of method.json."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED

_FIGURES = {
    "kd": ("kd_psnr",),
    "reflectance": ("reflectance_psnr",),
    "base_color": ("base_color_psnr",),
    "roughness": ("roughness_l1", "roughness_psnr"),
    "metallic": ("metallic_l1",),
    "emission": ("emission_iou", "log_radiance_error", "log_l2"),
}
"""What a method estimates -> the figures that judge it."""

_CARD = {"id", "seed", "label", "kind", "random", "not_estimated", "oracle"}
_EMITTERS = ("true_triangles", "false_triangles", "missed_triangles")


def parse_card(text: str) -> dict[str, Any]:
    """Read a card; FiptError where it is not one."""
    try:
        card = json.loads(text)
        missing = _CARD - set(card)
        if missing:
            raise KeyError(", ".join(sorted(missing)))
    except MALFORMED as error:
        raise FiptError(f"--card must be the card of a method ({error!r})", "call it as the workflow does") from error
    return card


def scored(card: Mapping[str, Any], metrics: Mapping[str, Any], jobs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Content of method.json.

    Parameters
    ----------
    card
        Of the method, with ``id`` and ``seed``.
    metrics
        Of its run, as ``fipt metrics`` writes them.
    jobs
        Stats of the jobs that made its materials and emitters, those that it shares with others among them.
    """
    unknown = {figure for name in card["not_estimated"] for figure in _FIGURES[name]}
    names = [figure for figures in _FIGURES.values() for figure in figures]

    def figures_of(split: str) -> dict[str, Any]:
        found = metrics.get(split) or {}
        published = found.get("published") or {}
        return {
            **{name: None if name in unknown else found[name] for name in names if name in found},
            "render_psnr": found.get("render_psnr"),
            "published": {name: None if name in unknown else value for name, value in published.items()},
        }

    emitters = metrics.get("emitters") or {}
    relit = metrics.get("relight") or {}
    return {
        **card,
        "figures": {
            "val": figures_of("val"),
            "train": figures_of("train"),
            "emitters": {
                name: None if "emission" in card["not_estimated"] else emitters.get(name) for name in _EMITTERS
            },
            "relight": {setup: found.get("relight_psnr") for setup, found in relit.items()},
        },
        "definitions": metrics.get("definitions") or {},
        "time_s": round(sum(float(job["wall_s"]) for job in jobs), 1) if jobs else None,
        "peak_memory_bytes": max((int(job["peak_memory_bytes"]) for job in jobs), default=None),
    }
