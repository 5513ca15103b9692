"""What the import adds to a mesh: round lamps that it lacks, or has in scraps."""

from collections.abc import Sequence
from typing import Any

from fipt.meshing.missing_emitters import missing_emitters, with_spheres
from fipt.meshing.radiance_edges import Radiance
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

_NAMED = 3
"""Places that a warning names."""
_BLUR = 2.0
"""By how much fusion displaces the surface of thin things, sides of a scan's triangles: front and back meet in one
distance field, and each moves the other by a voxel or two."""


def with_missing_emitters(
    mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance, side: float = 0.0
) -> tuple[Mesh, dict[str, Any], list[str]]:
    """The mesh with spheres where the training views show round lamps that it lacks, figures and warnings.

    ``side`` is the median side of the triangles of the noisy scan that the mesh was made of, metres; 0 if it was none.
    """
    set_variant()
    found = missing_emitters(mesh, cameras, radiance, _BLUR * side)
    if not found:
        return mesh, {}, []
    mesh = with_spheres(mesh, found)
    rows = [
        {"center": [round(float(v), 3) for v in own.center], "radius": round(own.radius, 4), "views": own.views}
        for own in found
    ]
    places = [f"({', '.join(f'{v:.2f}' for v in row['center'])}), {row['radius']:.3f} m" for row in rows]
    more = f"; and {len(rows) - _NAMED} more" if len(rows) > _NAMED else ""
    warning = (
        f"the views show round lamps that the mesh lacks, or has in scraps ({len(rows)}); spheres stand there (centre, "
        f"radius): {'; '.join(places[:_NAMED])}{more}. If one is no lamp, set import.add_emitters: false"
    )
    return mesh, {"added_emitters": rows, "triangles": len(mesh.triangles)}, [warning]
