"""Settings of the import of what others estimated."""

from typing import Literal

from pydantic import Field

from fipt.settings import Settings


class ImportResultsSettings(Settings):
    """Outputs of another program on this room, for comparisons: where they are, and how they are meant."""

    path: str | None = Field(
        default=None,
        description="folder of the layout (docs/stages/compare.md); may hold {data_root}",
    )
    layout: Literal["results", "npz"] = Field(
        default="results",
        description="`results`: {brdf,viewsynthesis,relight}/METHOD/SCENE/%03d_QUANTITY.exr; `npz`: %06d.npz with "
        "albedo, diffuse, roughness, emission",
    )
    method: str = Field(default="", description="METHOD of the layout `results`")
    scene: str = Field(default="", description="SCENE of the layout `results`; empty: the name of the scene here")
    views: Literal["train", "val"] = Field(
        default="train", description="split whose views the materials are numbered by; other pictures: held-out views"
    )
    setup: str = Field(default="", description="relight setup of the scene that the pictures in relight show")
    only: tuple[str, ...] = Field(
        default=(), description="views that are given, and judged; numbers stay those of the whole split; none: all"
    )
    input: Literal["views", "reference"] = Field(
        default="views",
        description="what the program was shown; `reference`: photographs under the light of `setup`, as tables say",
    )
    scaled: bool = Field(
        default=False,
        description="true: every picture is scaled to its truth, by the energy of its darkest 95 %; the table says so",
    )
