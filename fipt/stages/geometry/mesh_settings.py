"""Settings of the mesh that is made of depth maps."""

from typing import Literal

from pydantic import Field

from fipt.settings import Length, Settings


class GeometrySettings(Settings):
    """A mesh from depth maps: completed by planes, fused, smoothed, flattened, cut along edges; or a scan, placed."""

    planes: bool = Field(default=True, description="complete bare surface by the planes of what lies beside it")
    voxel: Length = Field(default=0.01, description="finest voxel, metres; the median pixel's footprint where larger")
    scan: str | None = Field(
        default=None,
        description="a mesh of the room in coordinates of its own, such as a laser scanner's: it is brought to the "
        "cameras by the depth of the views, and nothing is fused; {data_root} is replaced",
    )
    scan_unit: Length = Field(default=1.0, description="metres in a unit of `scan`")
    memory_gb: Length = Field(default=12.0, description="memory above which a fusion is refused before it starts")
    triangle_size: Length = Field(
        default=1.0, description="side of triangles on curved surface, in pixels of the nearest view"
    )
    cut_edges: bool = Field(
        default=True, description="cut along sharp edges of radiance, and part what they enclose: emitters are parts"
    )

    @property
    def prepare(self) -> Literal["auto", "always"]:
        """What `fipt.meshing.prepare` is asked for: fused depth always needs it, a scan that exists perhaps."""
        return "always" if self.scan is None else "auto"
