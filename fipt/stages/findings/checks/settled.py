"""How the rounds ended: whether a refinement found light missing, and whether they had come to rest.

Coming to rest is told by how much the diffuse shading changed between the last two rounds.

Changes are taken as medians of cells of the surface, so that the noise of single pixels does not count. What is still
to come is the rest of a geometric series: its quotient is that of the last two rounds' changes, where settled.json
tells them.
"""

from collections.abc import Sequence

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.samples import strided
from fipt.scene.settled import RoundState
from fipt.scene.voxels import FACINGS, facings, voxel_keys
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE

_CELLS = 24
"""Cells along the longest side of the room."""
_FEWEST = 20
"""Samples that a cell must have."""
_DARK = 0.01
"""Share of the median shading that is added before ratios are taken: noise decides there."""
_DAMPED = 0.5
"""Quotient of the changes of two rounds where nothing is known: the default damping lets half of a change for later."""
_QUOTIENT = (0.1, 0.9)
"""Between these the quotient is believed: noise decides below, and above there may be no end."""
_STRIDE = 3
"""Every third sample is enough."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell rounds that found light missing, or had not settled."""
    missing = _light_missing(room, notes)
    if missing:
        return [*missing, *_emitters_change(room, notes)]
    if room.earlier is None or any(state.settled is not None for state in room.rounds[-1:]):
        return []
    return [*_emitters_change(room, notes), *_not_settled(room, notes)]


def _not_settled(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell that light still changed from round to round."""
    place, change = changes(room)
    if not len(change):
        return []
    typical = float(np.expm1(np.median(np.abs(change))))
    ahead = typical * remaining(room.rounds)
    measure = Measure("light on a typical surface, change that is still to come", ahead, TOLERANCE)
    level = notes.judge("not-settled", measure)
    if level is None:
        return []
    worst = place[np.abs(change).argmax()]
    cameras = [each.camera for each in room.retakes]
    return [
        RoomFinding(
            "not-settled",
            level,
            f"The rounds had not settled: in the last one the light on a typical surface still changed by "
            f"{100 * typical:.0f} %, and {100 * ahead:.0f} % are still to come.",
            measure,
            "Run more rounds (raise rounds in the configuration); the rounds that are done are kept.",
            {"position": [round(float(v), 2) for v in worst]},
            {"change": typical, "ninety_percent_below": float(np.expm1(np.percentile(np.abs(change), 90)))},
            image=plan(room.mesh, cameras, room.fitted.emitters, [], (place, change, "log change")),
        )
    ]


def _emitters_change(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell emitters of the last round that light no surface in its fit."""
    moved = max((state.moved for state in room.rounds[-1:]), default=0.0)
    measure = Measure("power of the emitters that is not where it was in the round before", moved, TOLERANCE)
    level = notes.judge("emitters-change", measure)
    if level is None:
        return []
    finding = RoomFinding(
        "emitters-change",
        level,
        f"The emitters had not settled: {100 * moved:.0f} % of their power is not where it was in the round before, "
        "and base colours were fitted with the light of that.",
        measure,
        "Accept or reject emitters that come and go (emitters_review.yaml), photograph them, or run more rounds.",
        image=plan(room.mesh, [each.camera for each in room.retakes], room.fitted.emitters, []),
    )
    return [finding]


def _light_missing(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell rounds whose shading was not taken, since it explains the photographs worse than that before."""
    share = max((state.light_missing for state in room.rounds[-1:]), default=0.0)
    measure = Measure("shading that a refinement kept whole, since less light arrived than photographs show", share, 0)
    level = notes.judge("light-missing", measure)
    if level is None:
        return []
    finding = RoomFinding(
        "light-missing",
        level,
        f"The emitters that were found give too little light: {100 * measure.value:.0f} % of the shading is that of a "
        "round before, without their reflections.",
        measure,
        "Look for lamps and windows that are missing in emitters.json, accept them in the review "
        "(emitters_review.yaml), or photograph them.",
        image=plan(room.mesh, [each.camera for each in room.retakes], room.fitted.emitters, []),
    )
    return [finding]


def remaining(rounds: Sequence[RoundState]) -> float:
    """Change that is still to come, relative to that of the last round.

    Changes of rounds are taken for a geometric series, whose quotient the last two tell.
    """
    known = [state.change for state in rounds if state.change]
    quotient = float(np.clip(known[-1] / known[-2], *_QUOTIENT)) if len(known) > 1 else _DAMPED
    return quotient / (1 - quotient)


def changes(room: JudgedRoom) -> tuple[np.ndarray, np.ndarray]:
    """Place (C, 3) and median logarithm (C,) of the ratio of the last two rounds' Ld, for cells of the surface."""
    rows = strided((len(shard.samples.position) for shard in room.shards), _STRIDE)
    position, normal = (
        np.concatenate([getattr(shard.samples, name)[own] for shard, own in zip(room.shards, rows, strict=True)])
        for name in ("position", "normal")
    )
    now, before = (
        np.concatenate([shading[own][:, 0].mean(axis=1) for shading, own in zip(rounds, rows, strict=True)])
        for rounds in ([shard.shading for shard in room.shards], room.earlier or [])
    )
    if not len(position):
        return position, np.zeros(0)
    little = _DARK * float(np.median(now)) + 1e-9
    value = np.log((now + little) / (before + little))
    low, high = np.percentile(position, (1, 99), axis=0)  # what a window shows outside may be far away
    key = voxel_keys(position, (low + high) / 2, float((high - low).max()) * 1.01, _CELLS) * FACINGS + facings(normal)
    order = np.argsort(key, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
    groups = [group for group in groups if len(group) >= _FEWEST]
    place = np.array([position[group].mean(axis=0) for group in groups]).reshape(-1, 3)
    return place, np.array([np.median(value[group]) for group in groups])
