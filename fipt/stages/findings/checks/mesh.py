"""A mesh that is noisy, or finer than the pictures: shading and emitters are then decided by noise.

Angles are those between triangles that share an edge, without creases, for the triangles that training pixels show; the
size of a triangle is compared with the pixel that shows it.
"""

import numpy as np

from fipt.conventions import ROUGHNESS_LEVELS
from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.mesh import Mesh
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom

_CREASE = np.deg2rad(40)
"""An edge sharper than this is meant."""
_NOISY = ROUGHNESS_LEVELS[2] ** 2 / np.sqrt(2)
"""Error of normals, radians, at which noise alone makes a mirror look as rough as the second level after it.

GGX of roughness s tilts microfacets by s squared over the square root of two.
"""
_SMALL = 0.5
"""Share of the pixels that may show a triangle smaller than themselves: half of them."""
_REMEDY = "Prepare the mesh: smooth it within planes and parts, and decimate it to triangles that pixels resolve."


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell normals that are noise, and triangles that no pixel resolves."""
    pixels, mesh = room.explained, room.mesh
    if not len(pixels):
        return []
    bend = roughness(mesh)[pixels.triangle]
    known = np.isfinite(bend)
    noise = float(np.median(bend[known])) if known.any() else 0.0
    small = float((mesh.areas[pixels.triangle] < pixels.footprint**2).mean())
    found = []
    measure = Measure(
        "noise of the normals that a typical pixel shows",
        float(np.rad2deg(noise)),
        float(np.rad2deg(_NOISY)),
        "degrees",
    )
    level = notes.judge("noisy-mesh", measure)
    if level:
        cause = (
            f"The mesh is noisy: normals of neighbouring triangles err by {measure.value:.0f} degrees, so that "
            "shading, mirrors and emitters follow the noise."
        )
        found.append(
            RoomFinding("noisy-mesh", level, cause, measure, _REMEDY, numbers={"triangles": len(mesh.triangles)})
        )
    measure = Measure("pixels that show a triangle smaller than themselves", small, _SMALL)
    if notes.judge("fine-mesh", measure):
        cause = (
            f"{100 * small:.0f} % of the pixels show triangles smaller than themselves: single triangles are judged by "
            "a few pixels, and time is lost."
        )
        found.append(
            RoomFinding("fine-mesh", "warning", cause, measure, _REMEDY, numbers={"triangles": len(mesh.triangles)})
        )
    return found


def roughness(mesh: Mesh) -> np.ndarray:
    """(T,) typical error of a triangle's normal, radians: from the angles to its neighbours, creases left out.

    The angle between two normals that err independently is sqrt(2) times the error of one. NaN where a triangle has no
    neighbour.
    """
    _, vertex = np.unique(mesh.vertices, axis=0, return_inverse=True)
    corner = vertex.reshape(-1)[mesh.triangles]
    edges = np.sort(corner[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1).astype(np.int64)
    owner = np.repeat(np.arange(len(mesh.triangles)), 3)
    key = edges[:, 0] * (int(corner.max()) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    a, b = owner[order[:-1][same]], owner[order[1:][same]]
    # noisy triangles may be turned about: what counts is the angle between planes
    cosine = np.abs((mesh.normals[a] * mesh.normals[b]).sum(axis=1))
    angle = np.arccos(np.clip(cosine, 0, 1))
    meant = angle > _CREASE
    square = np.where(meant, 0, angle**2)
    both, weight = np.concatenate([a, b]), np.concatenate([~meant, ~meant])
    count = np.bincount(both, weight, len(mesh.triangles))
    total = np.bincount(both, np.concatenate([square, square]), len(mesh.triangles))
    with np.errstate(invalid="ignore"):
        return np.sqrt(total / np.where(count > 0, count, np.nan) / 2)
