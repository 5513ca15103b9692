"""Settings of the import."""

from typing import Literal

from pydantic import Field

from fipt.settings import Length, Positive, Settings


class ImportSettings(Settings):
    """Other people's layouts into a dataset."""

    val_every: Positive = Field(default=8, description="every n-th view is held out where the source has no split")
    overlay: bool = Field(default=True, description="write an image of mesh edges over one photo")
    exposure: Length | None = Field(
        default=None, description="factor on a capture's radiance; absent: what brings its median luminance to 0.2"
    )
    downscale: Positive = Field(
        default=1,
        le=16,
        description="average blocks of this many pixels a side, once poses and a mesh of the full images are made",
    )
    unit: Length | None = Field(
        default=None,
        description="metres in a unit of the source's mesh and cameras, such as 0.001; absent: metres, "
        "refused where another unit fits much better",
    )
    undo_transform: bool = Field(
        default=False,
        description="take cameras to where they were before nerfstudio's applied_transform, if the mesh is there",
    )
    prepare: Literal["auto", "always", "never"] = Field(
        default="auto",
        description="smooth, flatten and decimate the mesh; auto: where it is noisy or finer than pixels, "
        "unless fipt mesh made it",
    )
    triangle_size: Length = Field(
        default=1.0, description="side of a prepared mesh's triangles on curved surface, in pixels of the nearest view"
    )
    cut_edges: bool = Field(
        default=True,
        description="cut a prepared mesh along sharp edges of radiance, and part what they enclose",
    )

    mask_occluders: bool = Field(
        default=True,
        description="leave out pixels of training views that show something dark before the surface of a prepared "
        "mesh, or of one of photographs, which lacks it",
    )
    add_emitters: bool = Field(
        default=True,
        description="put spheres into the mesh where the views show round lamps that it lacks, or a scan has in scraps",
    )

    @property
    def of_views(self) -> "ImportSettings":
        """What holds of the full images without a mesh; what concerns the mesh and smaller images as by default."""
        kept = {"val_every", "exposure", "unit", "undo_transform"}
        return ImportSettings(**self.model_dump(include=kept))
