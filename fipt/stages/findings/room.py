"""A run as the checks see it: its files, and what is computed of them once, when the first check asks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fipt.model.fitted import FittedScene
from fipt.render.scene import RayScene
from fipt.scene.confidence import Confidence
from fipt.scene.dataset import Dataset
from fipt.scene.display import common_exposure
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import FootprintSamples
from fipt.scene.settled import RoundState
from fipt.scene.shading import Shading
from fipt.stages.findings.explained import ExplainedPixels, explained_pixels
from fipt.stages.findings.patches import EdgePatches, edge_patches
from fipt.stages.findings.retakes import Retake, retakes
from fipt.stages.findings.settings import FindingsSettings


@dataclass(frozen=True)
class JudgedRoom:
    """A run that is judged.

    Attributes
    ----------
    data, fitted
        The dataset, and what was found, of the last round.
    shards
        The training views, with the shading of the last round.
    held_out
        Samples of the held-out views.
    earlier
        Shading of the training views in the round before; None where there was one round only.
    settings
        How much is looked at.
    prepared
        Figures of the mesh's preparation (prepare.json); empty where there are none.
    rounds
        Whether the loop had settled in the last rounds; empty where that is not known.
    confidence
        Predicted errors of the materials; None where the method tells none.
    """

    data: Dataset
    fitted: FittedScene
    shards: Sequence[ObservedShard]
    held_out: Sequence[FootprintSamples]
    earlier: Sequence[Shading] | None
    settings: FindingsSettings
    prepared: Mapping[str, Any] = field(default_factory=dict)
    rounds: Sequence[RoundState] = ()
    confidence: Confidence | None = None

    @property
    def mesh(self) -> Mesh:
        """The room's surface."""
        return self.fitted.mesh

    @cached_property
    def rays(self) -> RayScene:
        """The mesh to trace rays against."""
        return RayScene(self.mesh)

    @cached_property
    def explained(self) -> ExplainedPixels:
        """Training pixels, and what the fit says of them."""
        return explained_pixels(self.data, self.shards, self.fitted, self.settings.pixels)

    @cached_property
    def retakes(self) -> list[Retake]:
        """Some training views, rendered with the model."""
        views = self.data.views("train")
        picks = np.unique(np.linspace(0, len(views) - 1, min(self.settings.views, len(views))).round().astype(int))
        return retakes(self.data, self.fitted, [views[pick] for pick in picks], self.settings)

    @cached_property
    def patches(self) -> EdgePatches:
        """Patches of the training views around edges."""
        return edge_patches(self.shards, self.fitted, self.settings.patches)

    @cached_property
    def exposure(self) -> float:
        """Factor on radiance with which pictures are shown."""
        return common_exposure(retake.photo for retake in self.retakes)
