"""Fewer triangles where fewer say the same."""

import numpy as np

from fipt.child import run_in_child
from fipt.meshing.collapse import collapsed
from fipt.meshing.topology import compact
from fipt.scene.mesh import Mesh

_SECONDS_A_TRIANGLE = 1e-4
"""Of the time limit: some fifty times what a slow computer needs."""

_FIRST, _LAST = 1e-9, 103.0
"""Of the library: its squared error at aggressiveness 0, square metres, and the base of the last pass."""


def decimated(mesh: Mesh, count: int, error: float) -> Mesh:
    """Collapse edges until about ``count`` triangles are left, those first that change the surface least.

    Parameters
    ----------
    error
        Metres; edges whose collapse leads further off the planes around them stay, though more triangles are left then.

    Notes
    -----
    Garland and Heckbert's quadrics (SIGGRAPH 1997), from the package fast-simplification. In its pass k, of 100, it
    collapses what has a squared error below 1e-9 (k + 3)^aggressiveness.
    """
    if len(mesh.triangles) <= count:
        return mesh
    arguments = {
        "vertices": mesh.vertices,
        "triangles": mesh.triangles,
        "share": 1.0 - count / len(mesh.triangles),
        "aggressiveness": float(np.clip(np.log(error**2 / _FIRST) / np.log(_LAST), 0.5, 7.0)),
    }
    found = run_in_child(collapsed, arguments, 60 + _SECONDS_A_TRIANGLE * len(mesh.triangles))
    return compact(found["vertices"], found["triangles"])
