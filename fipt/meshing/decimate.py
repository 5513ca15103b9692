"""Fewer triangles where fewer say the same."""

from fipt.child import run_in_child
from fipt.meshing.collapse import collapsed
from fipt.meshing.topology import compact
from fipt.scene.mesh import Mesh

_SECONDS_A_TRIANGLE = 1e-4
"""Of the time limit: some fifty times what a slow computer needs."""


def decimated(mesh: Mesh, count: int, aggressiveness: float = 3.0) -> Mesh:
    """Collapse edges until about ``count`` triangles are left, those first that change the surface least.

    Parameters
    ----------
    aggressiveness
        How fast the error that is allowed grows from pass to pass: lower is slower, and closer to the surface.

    Notes
    -----
    Garland and Heckbert's quadrics (SIGGRAPH 1997), from the package fast-simplification.
    """
    if len(mesh.triangles) <= count:
        return mesh
    arguments = {
        "vertices": mesh.vertices,
        "triangles": mesh.triangles,
        "share": 1.0 - count / len(mesh.triangles),
        "aggressiveness": float(aggressiveness),
    }
    found = run_in_child(collapsed, arguments, 60 + _SECONDS_A_TRIANGLE * len(mesh.triangles))
    return compact(found["vertices"], found["triangles"])
