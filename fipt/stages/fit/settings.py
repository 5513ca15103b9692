"""Settings of the fit."""

from typing import Literal

from pydantic import Field

from fipt.conventions import EMITTER_GAIN
from fipt.model.settings import NetworkSettings
from fipt.settings import Count, Fraction, Positive, Weight


class FitSettings(NetworkSettings):
    """The material network, the emission network if there is one, and how they are fitted."""

    steps: Positive = Field(default=500, description="optimiser steps of a round")
    min_epochs: Weight = Field(default=0, description="at least this many passes over all training pixels")
    batch: Positive = Field(default=2048, description="pixels a step")
    queries: Positive = Field(
        default=2, le=4, description="material queries per sample and step, spread over its footprint"
    )
    learning_rate: float = Field(default=5e-3, gt=0, le=1, description="of Adam")
    final_learning_rate: float = Field(
        default=2e-4, gt=0, le=1, description="reached by exponential decay at the last step"
    )
    table_rate: float = Field(
        default=8.0, gt=0, le=100, description="learning rate of the hash table over the networks'"
    )
    emission_threshold: Weight = Field(
        default=EMITTER_GAIN,
        description="pixels so many times brighter than any reflection teach no material; 0 = off, as the paper",
    )
    color_weight: Weight = Field(default=1.0, description="of the difference to the photographs")
    emission_weight: Weight = Field(default=1.0, description="price of the emission mask, where there is one")
    diffuse_weight: Weight = Field(default=1e-3, description="prior towards rough and not metallic")
    part_search: bool = Field(
        default=True, description="search roughness and metallic of whole segments before the fit"
    )
    light_errors: bool = Field(
        default=True, description="after the search, take what varies slowly within parts off the traced light"
    )
    target_weight: Weight = Field(default=3e-3, description="prior towards what the search found")
    base_weight: Weight = Field(default=0.03, description="prior of parts that seem to have one colour towards it")
    base_smoothness_weight: Weight = Field(
        default=0.3, description="prior against small changes of base colour within a pixel, where there are parts"
    )
    hidden: Count = Field(
        default=512, description="points of unseen surface a step that are drawn to their part; 0 = off"
    )
    part_weight: Weight = Field(default=2e-2, description="propagation within parts")
    semantic_weight: Weight = Field(default=1e-3, description="propagation within semantic segments")
    segments: Literal["auto", "part", "semantic", "none"] = Field(
        default="auto", description="which segment ids to use"
    )
    warm_start: bool = Field(default=True, description="start a later round from the model before it")
    checkpoint_every: Positive = Field(default=250, description="steps between checkpoints")
    confidence_weights: bool = Field(
        default=False, description="weight part search, propagation, priors by confidence in the surface"
    )
    min_confidence: Fraction = Field(
        default=0.0, description="pixels of surface less sure than this teach nothing; 0 = all do"
    )
    settled: Weight = Field(
        default=1.0,
        description="from round 2: change of shading, and of the emitters' power, over the noise of shading, below "
        "which later rounds are copies; 0 = never",
    )
    threads: Count = Field(default=0, description="CPU threads, 0 = all")

    @property
    def emitter_gain(self) -> float:
        """Pixels this much brighter than any reflection show an emitter, also where ``emission_threshold`` is 0."""
        return self.emission_threshold or EMITTER_GAIN
