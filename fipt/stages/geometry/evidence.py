"""What speaks for the surface of a mesh, region by region: depth of its own, planes that go on, walls, or nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.meshing.denoise import weighted_median
from fipt.render.scene import RayScene
from fipt.scene.mesh import Mesh, connected_parts
from fipt.stages.geometry.completion import Completed

SOURCES = ("measured", "completed", "closed", "unseen")
"""What a triangle is known by: depth of a view's own, planes that go on from others, walls of the room's box for want
of anything else; nothing where no view sees it."""
_SMALLEST = 0.01
"""Square metres of the smallest piece of surface that is told of by itself: a hand's."""


@dataclass(frozen=True)
class SurfaceEvidence:
    """What views say of each triangle of a mesh.

    Attributes
    ----------
    views
        (T,) int64 views in whose pixels it is seen.
    source
        (T,) int64 index in `SOURCES`: what most of its pixels are known by, where any is; a pixel without depth counts
        as closed.
    """

    views: np.ndarray
    source: np.ndarray

    def share(self, areas: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> dict[str, float]:
        """Share of the area of chosen triangles (all) that is known by each of `SOURCES`; areas (T,) of all."""
        area = areas[chosen]
        known = np.bincount(self.source[chosen], area, len(SOURCES)) / max(float(area.sum()), 1e-30)
        return {name: round(float(value), 4) for name, value in zip(SOURCES, known, strict=True)}


def evidence(mesh: Mesh, views: Sequence[Completed]) -> SurfaceEvidence:
    """Ask each pixel of the views which triangle it shows, and where its depth comes from."""
    scene, count = RayScene(mesh), len(mesh.triangles)
    seen, votes = np.zeros(count, np.int64), np.zeros((len(SOURCES) - 1, count), np.int64)
    for each in views:
        rays = each.view.rays.reshape(-1, 3)
        way = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
        _, triangle = scene.intersect(each.view.camera.center, way)
        met = triangle >= 0
        known = each.view.map.known & ~each.closed
        source = np.where(each.measured, 0, np.where(known, 1, 2)).ravel()
        seen[np.unique(triangle[met])] += 1
        for number, row in enumerate(votes):
            row += np.bincount(triangle[met & (source == number)], minlength=count)
    return SurfaceEvidence(seen, np.where(seen > 0, votes.argmax(axis=0), len(SOURCES) - 1))


def regions(mesh: Mesh, plane: np.ndarray, known: SurfaceEvidence) -> list[dict[str, Any]]:
    """What speaks for each region, the largest first: surface on a plane, and connected surface on none.

    Parameters
    ----------
    plane
        (T,) int64 number of each triangle's plane, -1 for none.
    """
    off = plane < 0
    label = plane.copy()
    if off.any():  # what stands on a plane is connected through it
        label[off] = plane.max(initial=-1) + 1 + connected_parts(Mesh(mesh.vertices, mesh.triangles[off]))
    corners, areas = mesh.corners, mesh.areas
    area = np.bincount(label, areas)
    # thousands of regions of a million triangles: each takes its own, and none looks through all
    order, ends = np.argsort(label, kind="stable"), np.cumsum(np.bincount(label))
    found = []
    for number in np.argsort(-area, kind="stable"):
        if area[number] < _SMALLEST:
            break
        on = order[ends[number - 1] if number else 0 : ends[number]]
        low, high = corners[on].min(axis=(0, 1)), corners[on].max(axis=(0, 1))
        found.append({
            "plane": int(number) if number <= plane.max(initial=-1) else None,
            "area": round(float(area[number]), 4),
            "views": int(weighted_median(known.views[on], areas[on])),
            **known.share(areas, on),
            "low": np.round(low.astype(float), 3).tolist(),
            "high": np.round(high.astype(float), 3).tolist(),
        })  # fmt: skip
    return found
