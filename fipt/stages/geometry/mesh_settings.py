"""Settings of the mesh that is made of views and their depth maps."""

from typing import Annotated, Literal

from pydantic import Field

from fipt.settings import Count, Fraction, Length, Positive, Settings, Weight, by_mode


class _Geometry(Settings):
    """A room's mesh from its views: how its surface is found, and made ready for the rest."""

    planes: bool = Field(default=True, description="complete bare surface by the planes of what lies beside it")
    voxel: Length = Field(default=0.01, description="finest voxel, metres; the median pixel's footprint where larger")
    memory_gb: Length = Field(default=12.0, description="memory above which a mesh is refused before it is begun")
    triangle_size: Length = Field(
        default=1.0, description="side of triangles on curved surface, in pixels of the nearest view"
    )
    cut_edges: bool = Field(
        default=True, description="cut along sharp edges of radiance, and part what they enclose: emitters are parts"
    )
    openings: bool = Field(
        default=True,
        description="leave surface out where the views see far outside; else panes close such openings; of no effect "
        "with `planes: false` or a scan",
    )

    @property
    def prepare(self) -> Literal["auto", "always"]:
        """What `fipt.meshing.prepare` is asked for: a surface of voxels always needs it."""
        return "always"


class ScanSettings(_Geometry):
    """Depth maps or a scan."""

    scan: str | None = Field(
        default=None,
        description="of methods `auto` and `depth`: a mesh of the room in coordinates of its own, such as a laser "
        "scanner's: it is brought to the cameras by the depth of the views, and nothing is fused; {data_root} is "
        "replaced",
    )
    scan_unit: Length = Field(default=1.0, description="metres in a unit of `scan`")

    @property
    def prepare(self) -> Literal["auto", "always"]:
        """What `fipt.meshing.prepare` is asked for: a scan that exists perhaps needs it."""
        return "always" if self.scan is None else "auto"


class AutoGeometry(ScanSettings):
    """The scan where one is named, else `mvs` or `depth`."""

    method: Literal["auto"] = "auto"


class FusedGeometry(_Geometry):
    """Fused depth maps."""

    method: Literal["mvs"] = "mvs"


class VolumeGeometry(_Geometry):
    """Signed distance and radiance, fitted to the photographs by volume rendering."""

    iterations: Positive = Field(default=1_500, description="optimiser steps; of `monosdf` 200000 by default")
    rays: Positive = Field(default=512, description="rays a step; of `monosdf` 1024 by default")
    samples: Positive = Field(default=12, le=1024, description="places on a ray, near the surface; of `monosdf` 64")
    levels: Positive = Field(default=8, le=32, description="grids of features; of `monosdf` 16")
    finest: Positive = Field(
        default=512, ge=32, le=1 << 16, description="cells along a side, of the finest grid; of `monosdf` 2048"
    )
    table_log2: Positive = Field(default=19, le=24, description="log2 of the entries of a grid")
    width: Positive = Field(default=32, le=1024, description="of the hidden layers; of `monosdf` 256")
    learning_rate: float = Field(default=2e-3, gt=0, le=1, description="of Adam; of `monosdf` 0.0005")
    table_rate: float = Field(
        default=2.0, gt=0, le=1000, description="learning rate of the grids over the networks'; of `monosdf` 20"
    )
    eikonal_weight: Weight = Field(default=0.05, description="of gradients that have not length 1")
    smooth_weight: Weight = Field(default=0.005, description="of normals that differ from those close by")
    depth_weight: Weight = Field(default=0.1, description="of the difference to depth maps, by their confidence")
    normal_weight: Weight = Field(default=0.05, description="of the difference to their normals, and of the angle")
    seed: Count = Field(default=0, description="seed of the networks and of the rays")


class RefinedGeometry(VolumeGeometry):
    """Fused depth maps, whose surface is then fitted to the photographs."""

    method: Literal["sdf"] = "sdf"


class MonosdfGeometry(VolumeGeometry):
    """From a sphere, after MonoSDF (Yu et al. 2022), and its schedule; meant for a GPU."""

    method: Literal["monosdf"] = "monosdf"
    iterations: Positive = Field(default=200_000, description="optimiser steps")
    rays: Positive = Field(default=1024, description="rays a step")
    samples: Positive = Field(default=64, le=1024, description="places on a ray, near the surface")
    even_samples: Positive = Field(default=32, le=1024, description="of `monosdf`: places all along a ray")
    first_samples: Positive = Field(
        default=128, ge=8, le=1024, description="of `monosdf`: places that the error of opacity is bounded by at first"
    )
    sampling_rounds: Count = Field(default=5, le=20, description="of `monosdf`: so often as many are added")
    error: Fraction = Field(default=0.1, gt=0, description="of `monosdf`: error of opacity that is allowed")
    levels: Positive = Field(default=16, le=32, description="grids of features")
    finest: Positive = Field(default=2048, ge=32, le=1 << 16, description="cells along a side, of the finest grid")
    width: Positive = Field(default=256, le=1024, description="of the hidden layers")
    learning_rate: float = Field(default=5e-4, gt=0, le=1, description="of Adam")
    table_rate: float = Field(default=20.0, gt=0, le=1000, description="learning rate of the grids over the networks'")
    prior: str | None = Field(
        default=None,
        description="of `monosdf`: folder of predicted depth, VIEW.exr or VIEW.png, of any scale and shift, and of "
        "normals in the same EXR; absent: the depth maps of the views; {data_root} is replaced",
    )


class GivenGeometry(ScanSettings):
    """Depth maps of a depth camera (`depth.given`, or the source's), or a scan: stereo is refused."""

    method: Literal["depth"] = "depth"


AnyGeometry = AutoGeometry | FusedGeometry | RefinedGeometry | MonosdfGeometry | GivenGeometry
GeometrySettings = Annotated[AnyGeometry, Field(discriminator="method"), by_mode(AnyGeometry)]
