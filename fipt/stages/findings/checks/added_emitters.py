"""Lamps that the mesh lacked, or had in scraps: the import put spheres there (prepare.json)."""

import numpy as np

from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.drawing import plan
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import TOLERANCE

_AROUND = 1.05
"""Radii of a sphere within which triangles are its own."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell how much of the light comes from spheres that stand for lamps which the mesh lacked."""
    added, emitters = room.prepared.get("added_emitters", []), room.fitted.emitters
    if not added:
        return []
    middles = room.mesh.corners[emitters.triangle].mean(axis=1)
    centers, radii = np.array([row["center"] for row in added]), np.array([row["radius"] for row in added])
    own = (np.linalg.norm(middles[:, None] - centers, axis=2) < _AROUND * radii).any(axis=1)
    share = float(emitters.power[own].sum() / max(emitters.power.sum(), 1e-12))
    measure = Measure("emitted power of spheres that stand for lamps which the mesh lacked", share, TOLERANCE)
    if notes.judge("added-emitters", measure) is None:
        return []
    near = "; ".join(f"({', '.join(f'{v:.2f}' for v in row['center'])})" for row in added[:3])
    more = f" and {len(added) - 3} more" if len(added) > 3 else ""
    return [
        RoomFinding(
            "added-emitters",
            "warning",
            f"The views show round lamps that the mesh lacked, or had in scraps ({len(added)}), near {near}{more}. "
            f"Spheres stand for them, and have {100 * share:.0f} % of the emitted power; stands and shades are missing "
            "all the same.",
            measure,
            "Add the lamps to the mesh (photograph them from near, all around). If one is no lamp, set "
            "import.add_emitters: false.",
            {"position": added[0]["center"]},
            {"added": len(added)},
            image=plan(
                room.mesh, [each.camera for each in room.retakes], emitters, [("added", place) for place in centers]
            ),
        )
    ]
