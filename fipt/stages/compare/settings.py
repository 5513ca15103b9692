"""Settings of comparisons."""

from typing import ClassVar

from pydantic import Field

from fipt.settings import Positive, Settings


class CompareSettings(Settings):
    """Methods that are compared on a scene."""

    of_plans: ClassVar = frozenset({"methods", "sensitivity", "seeds", "quick"})

    methods: tuple[str, ...] = Field(default=(), description="names of the methods; none: all that are known")
    sensitivity: tuple[str, ...] = Field(
        default=(),
        description="series of planted errors and other ids, or methods of them; `all`: every one",
    )
    seeds: Positive = Field(default=3, le=20, description="runs of a method that has random numbers, for the spread")
    quick: bool = Field(
        default=False, description="one seed; of all methods those that are quick, unless some are named"
    )
