"""One material for each part of a room: what methods estimate that fit no field."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from fipt.errors import FiptError
from fipt.groups import most_frequent
from fipt.model.reflectance import Brdf
from fipt.model.settings import NetworkSettings
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples, segments_of

_PLACES = 200_000
"""Labelled places that are kept, spread over all that were seen."""


class MaterialModel(Protocol):
    """What tells the reflectance of any place of the surface."""

    @property
    def settings(self) -> NetworkSettings:
        """How large a part of a pixel it is asked about."""
        ...

    def place(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N, 3) where it is asked about surface at points (N, 3), metres, with normals (N, 3) to its viewer."""
        ...

    def query(
        self, points: np.ndarray, footprint: np.ndarray | None = None, triangle: np.ndarray | None = None
    ) -> Brdf:
        """Reflectance at places (N, 3), metres, of triangles (N,), seen through ``footprint`` (N,) metres; numpy."""
        ...

    def finest_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) width of the smallest query that taught anything around points (N, 3), metres; 0: any will do."""
        ...


def seen_materials(
    model: MaterialModel,
    points: np.ndarray,
    normals: np.ndarray,
    footprint: np.ndarray,
    triangle: np.ndarray | None = None,
) -> Brdf:
    """Reflectance at points (N, 3) of triangles (N,), seen through pixels that are ``footprint`` (N,) metres wide.

    ``normals`` (N, 3) are turned to the viewer.

    The model is asked about as large a part of the pixel as in the fit (settings of the fit, ``footprint``), and about
    nothing finer than what taught it: of a view from close by, that would be noise (docs/adr/0078).
    """
    width = np.maximum(footprint * model.settings.footprint, model.finest_at(points)).astype(np.float32)
    return model.query(model.place(points, normals), width, triangle)


@dataclass(frozen=True)
class PartLabels:
    """Which part each place of the surface belongs to.

    Attributes
    ----------
    of_triangle
        (T,) int32 segment id that most pixels of the triangle have; 0 where none is known.
    place
        (K, 3) float32 points of the surface, metres.
    of_place
        (K,) int32 their segment ids.
    """

    of_triangle: np.ndarray
    place: np.ndarray
    of_place: np.ndarray

    @property
    def count(self) -> int:
        """Rows of a table by segment id, that of places without one included."""
        return 1 + max(int(self.of_triangle.max(initial=0)), int(self.of_place.max(initial=0)))

    @cached_property
    def _nearest(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.place)

    def at(self, points: np.ndarray, triangle: np.ndarray | None = None) -> np.ndarray:
        """(N,) int32 segment ids of points (N, 3): of their triangles (N,) where known, else of the nearest place."""
        part = np.zeros(len(points), np.int32)
        if triangle is not None:
            own = triangle < len(self.of_triangle)
            part[own] = self.of_triangle[triangle[own]]
        unknown = part == 0
        if unknown.any() and len(self.place):
            part[unknown] = self.of_place[self._nearest.query(points[unknown], workers=-1)[1]]
        return part


@dataclass(frozen=True)
class PartMaterials:
    """A material for each part; a `MaterialModel`.

    Attributes
    ----------
    labels
        Of the surface.
    brdf
        (P,) rows by segment id; row 0 is for places without one.
    """

    labels: PartLabels
    brdf: Brdf
    settings: NetworkSettings = field(default_factory=lambda: NetworkSettings(footprint=0.0))

    def place(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """The points: a part is told by its surface."""
        return points

    def query(
        self, points: np.ndarray, footprint: np.ndarray | None = None, triangle: np.ndarray | None = None
    ) -> Brdf:
        """Reflectance of the parts that points (N, 3) belong to; ``footprint`` changes nothing."""
        part = self.labels.at(points, triangle)
        return Brdf(self.brdf.base_color[part], self.brdf.roughness[part], self.brdf.metallic[part])

    def finest_at(self, points: np.ndarray) -> np.ndarray:
        """(N,) zeros: a part is the same however near."""
        return np.zeros(len(points), np.float32)


def centre_samples(samples: FootprintSamples) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N,) of a shard whose centre hits the mesh, and the sample (N,) that each shows there."""
    pixel = np.flatnonzero(np.asarray(samples.center))
    return pixel, np.asarray(samples.offsets)[pixel]


def part_segments(data: Dataset) -> str:
    """Kind of segments that tell parts: ``part``, else ``semantic``.

    Raises
    ------
    FiptError
        If there are none.
    """
    kind = data.segment_kind()
    if kind is None:
        raise FiptError(f"{data.segments_root} has no segment ids, and one material a part needs some", "segment first")
    return kind


def part_labels(data: Dataset, shards: Sequence[FootprintSamples], kind: str) -> PartLabels:
    """Segment ids of the surface, by what pixel centres of the views show.

    Parameters
    ----------
    data
        Whose segments and mesh count.
    shards
        Of views that have segments.
    kind
        Of segments: ``part`` or ``semantic``.
    """
    places, parts, triangles = [], [], []
    for shard in shards:
        pixel, first = centre_samples(shard)
        part = segments_of(data, shard, kind)[pixel].astype(np.int32)
        known = part > 0
        places.append(np.asarray(shard.position)[first[known]])
        triangles.append(np.asarray(shard.triangle)[first[known]])
        parts.append(part[known])
    place, part, triangle = (np.concatenate(each) for each in (places, parts, triangles))
    chosen = np.linspace(0, len(place) - 1, min(len(place), _PLACES)).astype(np.int64)
    votes = most_frequent(triangle, part, np.zeros(len(data.mesh().triangles), np.int32))
    return PartLabels(votes, place[chosen].astype(np.float32), part[chosen])
