"""Settings of the emitters and of their list."""

from typing import ClassVar, Literal

from pydantic import Field

from fipt.settings import Fraction, Positive, Settings


class EmittersSettings(Settings):
    """Emitting triangles."""

    of_plans: ClassVar = frozenset({"every_round"})

    decide: Literal["regions", "mask"] = Field(
        default="regions",
        description="`regions`: what explains all views of a region best, reflection or emission, before the fit; "
        "`mask`: the emission mask of each triangle, after the fit",
    )
    threshold: Fraction = Field(default=0.01, description="`mask`: a triangle emits where its mean mask exceeds this")
    points: Positive = Field(default=100, description="`mask`: points of a triangle at which the mask is queried")
    every_round: bool = Field(default=True, description="decide in every round, not only the first")
    evidence: bool = Field(default=True, description="`mask`: require more radiance than any reflectance could give")
    complete: bool = Field(
        default=True,
        description="unseen triangles of a part that glows wherever it is seen emit too, those that are seen dark from "
        "behind, those that an emitter surrounds and is closed by, and pieces of an emitter's shape that look alike",
    )
    patches: bool = Field(default=True, description="one radiance for each connected emitter instead of each triangle")
    sides: Literal["seen", "both"] = Field(
        default="seen", description="`seen`: an emitter shines from the sides that views see shine; `both`: from both"
    )
    guess: bool = Field(
        default=True,
        description="unseen surface emits what explains the photographs, where seen emitters do not and it is told; "
        "with `complete` unseen pieces of an emitter's shape emit as it does, too; small lamps are as bright as what "
        "they light",
    )


class ReviewSettings(Settings):
    """The list of the emitters for people: names, images, and the file in which they decide."""

    width: int = Field(
        default=192, ge=32, le=1024, description="of an emitter's image, pixels; its height is three quarters"
    )
