"""What the check of the cameras found that all views have in common, and of views that are off by little."""

from fipt.scene.dataset import CHECKED
from fipt.scene.findings import RoomFinding, read_findings
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Repeat the findings of check_poses.json; a room whose cameras are exact has none."""
    path = room.data.root / CHECKED
    found = read_findings(path) if path.is_file() else []
    for finding in found:
        notes.judge(finding.id, finding.measure)
    return found
