"""Light that no view shows was guessed: what photographs ask for, and what has the shape of an emitter."""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell how much of the light is guessed, and where to photograph."""
    emitters = room.fitted.emitters
    power = emitters.power
    share = float(power[emitters.guessed].sum() / max(power.sum(), 1e-12)) if len(power) else 0.0
    measure = Measure("share of the power of all emitters that is guessed", share, TOLERANCE, "")
    notes.measures["guessed-light"] = measure, 0.0
    if share <= TOLERANCE:
        return []
    own = emitters.guessed
    strongest = np.bincount(emitters.emitter[own], power[own]).argmax()
    rows = np.flatnonzero(own & (emitters.emitter == strongest))
    centers = room.mesh.corners[emitters.triangle[rows]].mean(axis=1)
    place = (centers * power[rows, None]).sum(axis=0) / power[rows].sum()
    near = ", ".join(f"{v:.1f}" for v in place)
    return [
        RoomFinding(
            "guessed-light",
            "serious",
            f"Light comes from where no view looks: {100 * share:.0f} % of the emitted power is "
            f"a guess, known within {100 * float(emitters.spread.max()):.0f} %. Base colours are as uncertain.",
            measure,
            f"Photograph what shines near ({near}), and run again.",
            {"position": [round(float(v), 2) for v in place]},
            image=plan(room.mesh, [each.camera for each in room.retakes], emitters, [("guessed", place)]),
        )
    ]
