"""All checks of a run, and their findings, worst first.

A new check is a module in ``checks`` and a line in `CHECKS`.
"""

from collections.abc import Callable

from fipt.progress import progress
from fipt.scene.findings import SEVERITIES, RoomFinding
from fipt.stages.findings.checks import (
    added_emitters,
    brightness,
    cameras,
    dim_emitters,
    edges,
    emitters,
    encoding,
    exposures,
    guessed_light,
    hardly_seen,
    holes,
    light_balance,
    mesh,
    missing_emitter,
    mixed_ids,
    no_emitter,
    parts,
    rerendering,
    settled,
    thin,
    uncertain,
    viewpoints,
)
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

Check = Callable[[JudgedRoom, Notes], list[RoomFinding]]

CHECKS: tuple[Check, ...] = (
    encoding.check,
    viewpoints.check,
    cameras.check,
    no_emitter.check,
    guessed_light.check,
    added_emitters.check,
    light_balance.check,
    brightness.check,
    missing_emitter.check,
    holes.check,
    mesh.check,
    emitters.check,
    dim_emitters.check,
    thin.check,
    hardly_seen.check,
    settled.check,
    exposures.check,
    mixed_ids.check,
    parts.check,
    edges.check,
    uncertain.check,
    rerendering.check,
)
"""What says why stands before what only says that something is wrong: findings keep this order."""

_FIT = frozenset(
    {
        "emitter-or-mirror",
        "undecided-emitters",
        "edges-off",
        "unexplained-parts",
        "mixed-ids",
        "exposure",
        "lamp-missing",
    }
)
"""What the fit's own residual tells: no evidence where the light is missing under which it was made."""

EXPLAINS: dict[str, frozenset[str]] = {
    "no-emitter": _FIT | {"too-bright", "rerendering", "view-unlike"},
    "light-missing": _FIT | {"rerendering", "view-unlike"},
    "too-bright": _FIT | {"rerendering", "view-unlike"},
    # views see different parts of a light that still changes, and edges lie where it changes most
    "not-settled": frozenset({"edges-off", "exposure", "rerendering", "view-unlike"}),
    "noisy-mesh": frozenset({"fine-mesh"}),
    "mesh-misplaced": frozenset({"edges-off"}),
    "views-displaced": frozenset({"edges-off"}),
}
"""Finding -> findings that it explains: these are left out, so that the cause stands alone."""


def judged(room: JudgedRoom) -> tuple[list[RoomFinding], Notes]:
    """Make every check; return the findings, worst first, and what was measured."""
    notes, found = Notes(), []
    with progress("findings", len(CHECKS), " checks") as bar:
        for check in CHECKS:
            found += check(room, notes)
            bar.advance()
    explained = {other for finding in found for other in EXPLAINS.get(finding.id, ())}
    causes = [finding for finding in found if finding.id not in explained]
    return sorted(causes, key=lambda finding: SEVERITIES.index(finding.severity)), notes
