"""Settings that say how the networks are built and asked; the fit adds those of its training."""

from typing import Literal

from pydantic import Field

from fipt.settings import Count, Positive, Settings, Weight


class NetworkSettings(Settings):
    """Sizes of the networks, and the size of what they are asked about."""

    encoding: Literal["hash", "positional"] = Field(
        default="hash",
        description="of places: a hash grid; `positional`: 10 frequencies and an MLP of 6 layers, for comparisons",
    )
    levels: Positive = Field(default=16, le=32, description="levels of the hash encoding")
    table_log2: int = Field(default=18, ge=8, le=24, description="log2 of the entries of a level")
    growth: float = Field(default=1.45, gt=1, le=2, description="resolution ratio of neighbouring levels")
    footprint: Weight = Field(
        default=0.5, description="size of a query in pixel footprints; finer levels fade; 0 = points"
    )
    start_rough: bool = Field(default=True, description="start rough and not metallic instead of in the middle")
    whitest: float = Field(
        default=0.9, ge=0.5, le=1, description="highest base colour of what is no metal: no paint reflects more"
    )
    seed: Count = Field(default=0, description="seed of the random numbers")
