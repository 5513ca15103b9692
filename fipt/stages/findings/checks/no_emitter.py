"""No emitter was found and nothing comes from outside: the room has no light of its own."""

import numpy as np

from fipt.scene.cameras import up_axis
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.missing_light import likely_place
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

_CEILING = 0.1
"""Share of the room's height that counts as the ceiling."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell that there is no light, and where it may be."""
    found = len(np.unique(room.fitted.emitters.emitter))
    measure = Measure("emitters found", found, 1, "")
    dark = found == 0 and room.fitted.environment.mode == "none"
    notes.measures["no-emitter"] = measure, 0.0
    if not dark:
        return []
    place = likely_place(room)
    cameras = [each.camera for each in room.retakes]
    marks = [] if place is None else [("lamp?", place)]
    return [
        RoomFinding(
            "no-emitter",
            "serious",
            "No emitter was found, and no light comes from outside: the light of this room stands in no training view.",
            measure,
            f"Photograph {_where(room, place)}, every lamp and every window, and make sure that they are part of the "
            "mesh.",
            {} if place is None else {"position": [round(float(v), 2) for v in place]},
            image=plan(room.mesh, cameras, room.fitted.emitters, marks),
        )
    ]


def _where(room: JudgedRoom, place: np.ndarray | None) -> str:
    if place is None:
        return "the ceiling"
    height = room.mesh.vertices @ up_axis([each.camera for each in room.retakes])
    high = place @ up_axis([each.camera for each in room.retakes]) > height.max() - _CEILING * np.ptp(height)
    return f"{'the ceiling' if high else 'what is'} near ({', '.join(f'{v:.1f}' for v in place)})"
