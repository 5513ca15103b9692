"""Images that are no radiance: what the import saw of them (prepare.json), for the reader of the result."""

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

_VALUES = 1024.0
"""Values that tell light apart by a thousandth, near white."""
_CUT = 1e-4
"""Share of the pixels at one largest value from which the import tells it."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell images of 8 bits, and light that is cut off without a flag."""
    strange, found = room.prepared.get("images", {}), []
    levels, cut = strange.get("levels"), strange.get("cut")
    if levels:
        measure = Measure("steps in which the images tell light apart, of white", 1 / levels["count"], 1 / _VALUES)
        level = notes.judge("eight-bits", measure)
        how = " They are likely still encoded for a display." if levels["even"] else ""
        found.append(
            RoomFinding(
                "eight-bits",
                level or "warning",
                f"The images have {levels['count']} values only.{how}",
                measure,
                "Give linear images of high dynamic range (16-bit or float EXR of brackets).",
            )
        )
    if cut:
        measure = Measure("pixels at one largest value, in different colours", cut["share"], _CUT)
        notes.judge("light-cut-off", measure)
        found.append(
            RoomFinding(
                "light-cut-off",
                "warning",
                f"Light is cut off at {cut['radiance']:.4g} without a flag: lamps are brighter than they seem.",
                measure,
                "Set flags.Y to 1 in clipped pixels, which makes them lower bounds, or export without clipping.",
                {"views": cut["views"]},
            )
        )
    return found
