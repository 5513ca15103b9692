"""The call of the library that collapses edges, for a process of its own: this module imports little."""

import numpy as np


def collapsed(
    vertices: np.ndarray, triangles: np.ndarray, share: float, aggressiveness: float
) -> dict[str, np.ndarray]:
    """Call the library, which may crash; ``share`` of the triangles go."""
    from fast_simplification import simplify

    kept, faces = simplify(vertices, triangles, target_reduction=float(share), agg=float(aggressiveness))
    return {"vertices": np.asarray(kept, np.float32), "triangles": np.asarray(faces, np.int32)}
