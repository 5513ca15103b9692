"""The loss of a batch: what the networks say of it, and all terms with their weights."""

from dataclasses import dataclass

import torch

from fipt.model.networks import EmissionNetwork, Field
from fipt.model.reflectance import Brdf, reflected
from fipt.stages.fit.batches import Batch
from fipt.stages.fit.settings import FitSettings
from fipt.stages.fit.targets import PartTargets
from fipt.stages.fit.terms.base_color_prior import base_color_prior, with_scaled_gradient
from fipt.stages.fit.terms.base_color_smoothness import base_color_smoothness
from fipt.stages.fit.terms.data import data_term
from fipt.stages.fit.terms.diffuse_prior import diffuse_prior
from fipt.stages.fit.terms.emission import emission_term
from fipt.stages.fit.terms.hidden_surface import hidden_surface_term
from fipt.stages.fit.terms.part_prior import part_prior
from fipt.stages.fit.terms.part_propagation import part_propagation
from fipt.stages.fit.terms.semantic_propagation import semantic_propagation

HiddenPoints = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
"""Points (N, 3), segments (N,) and sizes (N,) of surface that no view sees."""


@dataclass(frozen=True)
class Objective:
    """What is minimised.

    Attributes
    ----------
    settings
        Weights of the terms.
    kind
        What the segment ids mean: ``part``, ``semantic`` or None.
    targets
        What each segment is drawn to; None: all to matte, as the paper.
    """

    settings: FitSettings
    kind: str | None
    targets: PartTargets | None = None

    def terms(self, field: Field, batch: Batch, hidden: HiddenPoints | None = None) -> dict[str, torch.Tensor]:
        """All terms of a batch, weighted; ``color`` is the data term.

        ``hidden`` are points that no view sees, drawn to what their segments are drawn to.
        """
        settings, queries = self.settings, batch.points.shape[1]
        brdf, hidden_brdf = self._reflectance(field, batch, hidden if self.targets is not None else None)
        part = None if self.targets is None else self.targets.of(batch.segment)
        taught = brdf
        if part is not None and settings.base_weight > 0:
            taught = with_scaled_gradient(brdf, part, queries)
        radiance, specular = reflected(taught, batch.shading, queries)
        e = field.emission(batch.points[:, 0])
        mask = None if e is None else EmissionNetwork.mask(e)
        color = data_term(batch, radiance, mask, settings.emission_threshold)
        mean = Brdf(*(values.view(-1, queries, *values.shape[1:]).mean(1) for values in vars(brdf).values()))
        return {
            "color": settings.color_weight * color,
            **({} if e is None else {"emission": settings.emission_weight * emission_term(e)}),
            **self._priors(batch, brdf, mean, part),
            **self._hidden(hidden_brdf, hidden, len(batch.points)),
            **self._propagation(field, batch, mean, specular),
        }

    def _priors(self, batch: Batch, brdf: Brdf, mean: Brdf, part: PartTargets | None) -> dict[str, torch.Tensor]:
        """Terms that know no photograph, of samples with these parts; ``mean`` is the mean over each one's queries."""
        settings = self.settings
        if part is None:
            return {"diffuse": settings.diffuse_weight * diffuse_prior(mean.roughness, mean.metallic)}
        # what photographs do not tell, the part does
        doubt = 1.5 - batch.confidence if settings.confidence_weights else 1.0
        queries = batch.points.shape[1]
        base = base_color_prior(brdf.base_color, part, queries)
        return {
            "target": (doubt * part_prior(mean.roughness, mean.metallic, part)).mean(),
            "base": settings.base_weight * (part.uniform * base).mean(),
            "smoothness": settings.base_smoothness_weight * base_color_smoothness(brdf.base_color, queries),
        }

    def _reflectance(self, field: Field, batch: Batch, hidden: HiddenPoints | None) -> tuple[Brdf, Brdf | None]:
        """Reflectance at all queries of the batch, and at the hidden points.

        They are asked about together, since each question makes a gradient of all of the hash table.
        """
        points = batch.points.view(-1, 3)
        footprint = (batch.footprint * self.settings.footprint)[:, None].expand(-1, batch.points.shape[1]).reshape(-1)
        if hidden is None:
            return field.brdf(points, footprint), None
        both = field.brdf(torch.cat([points, hidden[0]]), torch.cat([footprint, hidden[2]]))
        parts = slice(len(points)), slice(len(points), None)
        seen, unseen = (Brdf(*(values[part] for values in vars(both).values())) for part in parts)
        return seen, unseen

    def _hidden(self, brdf: Brdf | None, hidden: HiddenPoints | None, samples: int) -> dict[str, torch.Tensor]:
        """Term of the hidden surface, whose reflectance is ``brdf``; none where that is not asked for."""
        if brdf is None or hidden is None or self.targets is None:
            return {}
        part = self.targets.of(hidden[1])
        return {"hidden": hidden_surface_term(brdf, part, self.settings.base_weight, samples)}

    def _propagation(self, field: Field, batch: Batch, mean: Brdf, specular: torch.Tensor) -> dict[str, torch.Tensor]:
        """Term of the propagation that the segments call for."""
        if self.kind == "part":
            evidence = specular * batch.confidence
            loss = part_propagation(mean.roughness, mean.metallic, evidence, batch.segment)
            return {"part": self.settings.part_weight * loss}
        if self.kind == "semantic":
            place = field.box.to_signed(batch.points[:, 0])
            loss = semantic_propagation(mean.roughness, mean.metallic, mean.base_color, place, batch.segment)
            return {"semantic": self.settings.semantic_weight * loss}
        return {}
