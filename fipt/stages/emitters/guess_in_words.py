"""What people are told about guessed light: where to photograph, and how sure it is."""

import numpy as np

from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.stages.emitters.unseen_fit import Guess

_LEVEL = 0.7
"""Cosine with the vertical above which a surface is floor or ceiling."""
_OPEN = 0.15
"""Share of the light's directions that may leave the mesh unknown; more is an error like those of shading."""


def advice_in_words(mesh: Mesh, emitters: Emitters, own: np.ndarray, guess: Guess, up: str) -> tuple[str, ...]:
    """What a person should know of the guess that some triangles (E,) emit: where to photograph, and how sure it is."""
    if not own.any():  # all of it lies on doubtful emitters, which it does not light
        return ()
    power = emitters.power
    share, power = float(power[own].sum() / power.sum()), power[own]
    triangle = emitters.triangle[own]
    strongest = emitters.emitter[own] == np.bincount(emitters.emitter[own], power).argmax()
    weight = power[strongest]
    centers = mesh.corners[triangle[strongest]].mean(axis=1)
    place = (centers * weight[:, None]).sum(axis=0) / weight.sum()
    text = ", ".join(f"{v:.2f}" for v in place)
    kind = _kind(mesh, triangle[strongest], place, up)
    return (
        f"the emitters that views show cannot explain the photographs: {100 * share:.0f} % of the power of all "
        f"emitters is guessed, and known within {100 * guess.spread:.0f} %; photograph the {kind} near ({text})",
    )


def missing_in_words(mesh: Mesh, darkened: Emitters) -> tuple[str, ...]:
    """What to say of surface that reflects more than the light of the emitters, and that no guess lights."""
    if not len(darkened.triangle):
        return ()
    area, centers = mesh.areas[darkened.triangle], mesh.corners[darkened.triangle].mean(axis=1)
    largest = darkened.emitter == np.bincount(darkened.emitter, area).argmax()
    place = ", ".join(f"{v:.2f}" for v in np.average(centers[largest], axis=0, weights=area[largest]))
    return (
        f"light is missing: {area.sum():.2f} m2 of surface, the largest of it near ({place}), are brighter than white "
        "under the emitters found, and not under the light that views show; photograph what lights that place",
    )


def _kind(mesh: Mesh, triangles: np.ndarray, place: np.ndarray, up: str) -> str:
    """Ceiling, floor or wall."""
    axis = 1 if up == "y" else 2
    normal = np.abs(mesh.area_normals[triangles]).sum(axis=0)
    if normal[axis] < _LEVEL * np.linalg.norm(normal):
        return "wall"
    return "ceiling" if place[axis] > mesh.vertices[:, axis].mean() else "floor"


def undetermined_in_words(guess: Guess, leaves: float) -> tuple[str, ...]:
    """What to say where seen light does not explain the photographs, and no guess does."""
    if leaves > _OPEN:
        return (
            f"the light that is seen cannot explain the photographs, and {100 * leaves:.0f} % of the directions leave "
            "the mesh to where no view looks: photograph the openings, or give environment.file",
        )
    if guess.before <= 2 * _OPEN:
        return ()
    return (
        "the light that is seen cannot explain the photographs, and where the rest comes from is not determined: "
        "photograph the ceiling, the windows and whatever else shines",
    )
