"""Views from one place, as of a panorama: nothing of them tells where surface is, or how it shines."""

from fipt.scene.cameras import LEAST_BASELINE, parallax
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell training views that are all from one place."""
    views = room.data.views("train")
    baseline, near = parallax([room.data.camera(view) for view in views], room.mesh.vertices)
    measure = Measure(
        "distance of what is near over that of the cameras", near / max(baseline, 1e-6 * near), 1 / LEAST_BASELINE, ""
    )
    level = notes.judge("one-place", measure)
    if level is None:
        return []
    return [
        RoomFinding(
            "one-place",
            level,
            f"All training views are from one place, within {100 * baseline:.2g} cm: nothing tells whether the mesh is "
            "where the images show it, and roughness and metallic are guessed.",
            measure,
            "Photograph from places all over the room.",
            {"views": list(views[:8])},
        )
    ]
