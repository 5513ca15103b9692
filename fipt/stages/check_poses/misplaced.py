"""Views and meshes that are off by little: what is said of the motions that would bring them into place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fipt.render.scene import RayScene
from fipt.scene.findings import Measure, RoomFinding
from fipt.stages.check_poses.alignment import MeshMotion, align
from fipt.stages.check_poses.surface import ReducedView
from fipt.stages.check_poses.verdict import Verdict, accepted_partners

_FEWEST, _FEWEST_OF_MESH, _LEAST_SIZE = 4, 8, 80
"""Views with partners that must tell, of each other and of the mesh, and pixels along the larger side of most.

Of fewer or of smaller ones, sound meshes seem to be off by up to five times what is tolerated."""

_DISPLACED, _TYPICAL = 1.5, 5.0
"""Displacement of a view from which it is named: in pixels, and over that of the median view.

Sound views have up to 1.6 pixels, and up to 3.3 times the median, in thirteen rooms."""

_MESH_MOVED, _MESH_TURNED, _MESH_SCALED = 0.015, 2.5, 0.02
"""Share of the distance, degrees, and growth from which on the mesh is named.

Sound rooms have up to 0.009, 1.2 and 0.009."""


def judged_by_alignment(
    scene: RayScene, views: Sequence[ReducedView], verdicts: Sequence[Verdict]
) -> tuple[list[Verdict], list[RoomFinding]]:
    """Verdicts that name views which are off by little, and what is to be said of them and of the mesh."""
    partners = accepted_partners(verdicts)
    if sum(map(bool, partners)) < _FEWEST:
        return list(verdicts), []
    mesh, cameras = align(scene, views, partners)
    found = [own.displacement for own, others in zip(cameras, partners, strict=True) if others]
    limit = max(_DISPLACED, _TYPICAL * float(np.median(found)))
    result, off = [], []
    for view, verdict, own, others in zip(views, verdicts, cameras, partners, strict=True):
        verdict = replace(verdict, displacement=own.displacement) if others else verdict
        if others and own.displacement > limit:
            said = (
                f"is off by {own.displacement:.1f} of {view.camera.width} pixels from what others show: turning it by "
                f"{own.turned:.1f} degrees and moving it by {100 * own.moved:.2g} cm would mend that"
            )
            verdict = replace(verdict, reason="; ".join(filter(None, [verdict.reason, said])))
            off.append((own.displacement, verdict.view))
        result.append(verdict)
    size = float(np.median([max(view.camera.width, view.camera.height) for view in views]))
    certain = len(found) >= _FEWEST_OF_MESH and size >= _LEAST_SIZE
    return result, [*_displaced_views(off, limit), *(_misplaced_mesh(mesh) if certain else [])]


def _displaced_views(off: list[tuple[float, str]], limit: float) -> list[RoomFinding]:
    """Say which views are off, by (displacement, view) of each."""
    if not off:
        return []
    names = [view for _, view in sorted(off, reverse=True)]
    return [
        RoomFinding(
            "views-displaced",
            "warning",
            f"{', '.join(names)} are off from where others show them: edges are seen twice, colours beside them mix.",
            Measure("largest displacement of a view, reduced", max(off)[0], limit, "pixels"),
            "Correct the poses of these views, or leave them out.",
            {"views": names},
        )
    ]


def _misplaced_mesh(mesh: MeshMotion) -> list[RoomFinding]:
    """Say that the mesh is not where the views show it; nothing where it is."""
    share = float(np.linalg.norm(mesh.moved)) / max(mesh.distance, 1e-9)
    excess = max(share / _MESH_MOVED, mesh.turned / _MESH_TURNED, abs(mesh.scale - 1) / _MESH_SCALED)
    if excess <= 1:
        return []
    moved = ", ".join(f"{100 * part:.2g}" for part in mesh.moved)
    return [
        RoomFinding(
            "mesh-misplaced",
            "warning",
            f"The mesh is not where the views show it: they would agree better if it were moved by {moved} cm along "
            f"x, y, z, turned by {mesh.turned:.1f} degrees and {mesh.scale:.3f} times as large.",
            Measure("motion of the mesh, over what is tolerated", excess, 1.0, ""),
            "Bring mesh and cameras into one frame and unit.",
            numbers={"moved_share": share, "turned_degrees": mesh.turned, "scale": mesh.scale},
        )
    ]
