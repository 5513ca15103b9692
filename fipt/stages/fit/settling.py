"""Whether the loop of fit and refinement has settled; and a round that is a copy of the one before it."""

import logging
from typing import TYPE_CHECKING

import numpy as np

from fipt.errors import FiptError
from fipt.formats.files import copy_file
from fipt.formats.manifests import Stats
from fipt.scene.change import read_change
from fipt.scene.emitters import moved_power, read_emitters
from fipt.scene.settled import SETTLED, RoundState, read_state, write_state
from fipt.scene.voxels import facing_normals, read_cache
from fipt.stages.fit.inputs import FitInputs

if TYPE_CHECKING:
    from fipt.model.networks import Field

log = logging.getLogger(__name__)

_COPIED = ("model.safetensors", "confidence.npz")
_POINTS = 4096
"""Points of seen surface at which kd of two rounds is compared: the figure is known to a few hundredths of itself."""
_FIRST = 2
"""Round that may settle the loop: what round 1 changes is the difference to the cache's light, another estimate."""


def copy_round(inputs: FitInputs, state: RoundState) -> Stats:
    """Write the model of the round before as that of this round, since the loop has settled."""
    if inputs.previous is None:
        raise FiptError("a settled round must have a model to copy; --previous is missing", "give the model before it")
    for name in _COPIED:
        copy_file(inputs.previous.with_name(name), inputs.out.with_name(name))
    write_state(inputs.out.with_name(SETTLED), state.after())
    log.info("settled in round %d: the model of the round before stays", state.settled)
    return {"copied": True, "settled_in_round": state.settled}


def judge_round(inputs: FitInputs, field: "Field", before: "Field | None", settled: float) -> Stats:
    """Write settled.json of a fitted round, say it in a line, and return its figures.

    Parameters
    ----------
    field, before
        The model, and the one before it.
    settled
        Change of shading, and share of the emitters' power that moved, over the noise of shading, below which the loop
        has settled; 0: never.
    """
    last = read_state(inputs.settled)
    number = 0 if inputs.previous is None else 1 if last is None else last.round + 1
    found = read_change(inputs.shading)
    if found is None:
        write_state(inputs.out.with_name(SETTLED), RoundState(number))
        return {}
    moved = _moved(inputs)
    # where nothing of a refinement was kept, the next one would be given the same, unless the emitters change
    change = 0.0 if found.kept == 1 else found.change
    over = max(change, moved) < settled * found.noise and number >= _FIRST
    kd = None if before is None else _kd_change(inputs, field, before)
    end = number if over else None
    missing = float(found.light_missing)
    change, noise, moved = (round(figure, 5) for figure in (found.change, found.noise, moved))
    state = RoundState(number, end, change, noise, kd, missing, found.kept, moved)
    write_state(inputs.out.with_name(SETTLED), state)
    log.info(
        "round %d: shading changed by %.1f %% (noise %.1f %%), %.1f %% of the light moved%s: %s",
        number,
        100 * found.change,
        100 * found.noise,
        100 * moved,
        "" if kd is None else f", kd by {kd:.3f}",
        _in_words(found.light_missing, over),
    )
    figures = {"change": state.change, "noise": state.noise, "kept": state.kept, "moved": moved, "settled": over}
    return figures | ({} if kd is None else {"kd_change": kd})


def _in_words(light_missing: bool, over: bool) -> str:
    """How a round ended."""
    if light_missing:
        stays = "the shading of the round before stays, since the emitters that were found give too little light"
        return f"{stays}; later rounds are copies" if over else stays
    return "settled" if over else "not settled yet"


def _moved(inputs: FitInputs) -> float:
    """Share of the emitters' power that is not where it was in the round before, with which the shading was made."""
    if inputs.emitters is None or inputs.emitters_before is None:
        return 0.0
    return moved_power(read_emitters(inputs.emitters), read_emitters(inputs.emitters_before))


def _kd_change(inputs: FitInputs, field: "Field", before: "Field") -> float | None:
    """Root mean square of the change of kd over surface that views see; None without a cache."""
    if inputs.cache is None:
        return None
    cache = read_cache(inputs.cache)
    seen = np.flatnonzero(cache["count"] > 0)
    if len(seen) == 0:
        return None
    chosen = seen[:: max(1, len(seen) // _POINTS)]
    surface = cache["point"][chosen], facing_normals(cache["facing"][chosen])
    size = np.full(len(chosen), float(cache["side"]) / int(cache["resolution"]), np.float32)
    kd, kd_before = (each.query(each.place(*surface), size).kd for each in (field, before))
    difference = kd - kd_before
    return round(float(np.sqrt(np.mean(np.square(difference)))), 5)
