"""A foreign mesh made fit for the pipeline, where it asks for that."""

import logging
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Protocol

import numpy as np

from fipt.groups import grouped_median
from fipt.meshing.clean import clean
from fipt.meshing.cut import cut_at
from fipt.meshing.decimate import decimated
from fipt.meshing.denoise import filtered_normals, fitted_to_normals, normal_deviation, taubin, weighted_median
from fipt.meshing.footprints import SeenSurface, seen_surface
from fipt.meshing.holes import without_small_holes
from fipt.meshing.planes import Planes, find_planes, flattened, grown
from fipt.meshing.radiance_edges import Radiance, find_edges
from fipt.meshing.separate import separated
from fipt.meshing.topology import distinct_rows, triangle_sides
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

log = logging.getLogger(__name__)

NOISY = 1.0
"""Degrees that normals deviate by, above which a mesh is noisy: at 60 degrees of incidence it changes what a surface
receives by 3 %. A modeller's mesh has rounding of coordinates, a hundredth of this."""
_SMALL = 16.0
"""Area in footprints below which a triangle can carry noise. Corners of larger ones are a modeller's."""
FINE = 1.0
"""Triangles that the median pixel's footprint holds, above which a mesh is too fine: no pixel is then filled by one
triangle, and nothing is known of a single triangle."""
_EQUILATERAL = 0.433
"""Area of a triangle with equal sides of length 1."""
_PASSES = 20
"""Of the filters of normals and vertices: they reach four triangles far."""
_CREASE = 4.0
"""Width of the filter of normals, in deviations of normals: differences that noise makes are averaged, others kept."""
_PLANE_ANGLE = 2.5
"""Angle within which a triangle may lie on a plane, in deviations of normals before they were filtered."""
_PLANE_DISTANCE = 3.0
"""Distance within which it may, in deviations of vertices."""
_UNSEEN = 0.005
"""Displacement in footprints that no pixel shows: the least noise that is assumed."""
_EVEN = 1e-4
"""Deviation of normals, radians, that rounding of positions alone makes: the least that is assumed."""
_ROUNDED, _ROUNDED_RINGS = 1.0, 3
"""How far a crease is rounded by fusion and filters: sides of the scan off its planes, and triangles to either side."""
_ERROR = 0.1
"""Distance in footprints by which decimation may leave the surface: a pixel's shading hardly changes."""
_PLANE_SIDE = 6.0
"""Side of the smallest plane in footprints: below it a plane is not told from a curve."""
_HOLE = 4.0
"""Width of a hole in footprints up to which it is closed: what lies behind it fills no pixel by itself."""
_COARSE = 4.0
"""Side of triangles on planes, in footprints, that the number of triangles counts with."""


class PrepareSettings(Protocol):
    """What a person chooses."""

    @property
    def prepare(self) -> str:
        """``auto`` or ``always``."""
        ...

    @property
    def triangle_size(self) -> float:
        """Side of triangles on curved surface, in pixel footprints."""
        ...

    @property
    def cut_edges(self) -> bool:
        """Whether triangles are cut along sharp edges of radiance."""
        ...


def prepared(
    mesh: Mesh, cameras: Sequence[Camera], radiance: Radiance, settings: PrepareSettings
) -> tuple[Mesh, dict[str, Any]]:
    """Return the mesh to go on with, and figures about it; Mitsuba's variant must be set.

    A mesh that does not ask for it is returned as it is: smooth normals and triangles that pixels resolve.

    Parameters
    ----------
    cameras, radiance
        The training views, and what they show.
    """
    start = time.perf_counter()
    figures: dict[str, Any] = {"prepared": False, "triangles_before": len(mesh.triangles)}
    seen = seen_surface(mesh, cameras)
    asks = _asks(mesh, seen)
    figures |= asks
    if len(seen.position) == 0:
        log.warning("no training view sees the mesh: it is taken as it is")
        return mesh, {**figures, "triangles": len(mesh.triangles)}
    noisy = asks["small_share"] >= 0.5 and asks["normal_deviation_degrees"] > NOISY
    if settings.prepare == "always" or noisy or asks["triangles_per_pixel"] > FINE:
        mesh, made = _made(mesh, seen, np.radians(asks["normal_deviation_degrees"]), settings)
        figures |= {"prepared": True, **made}
        if not noisy:  # a modeller's fine mesh is right where it is thin
            del figures["side_mm"]
        if settings.cut_edges:
            edges = find_edges(mesh, cameras, radiance)
            mesh, regions = separated(cut_at(mesh, edges), cameras, radiance)
            figures |= {"edge_points": len(edges), "regions": regions}
    figures |= {"triangles": len(mesh.triangles), "seconds": round(time.perf_counter() - start, 2)}
    if figures["prepared"]:
        log.info(
            "mesh prepared: normals deviate by %.1f degrees, %.1f triangles a pixel; %d of %d triangles kept, "
            "%d planes, %d floaters dropped, %d holes closed, %d left (%.2g m2), %.0f s",
            asks["normal_deviation_degrees"], asks["triangles_per_pixel"], figures["triangles"],
            figures["triangles_before"], figures["planes"], figures["floaters"], figures["holes_closed"],
            figures["holes_open"], figures["hole_area"], figures["seconds"],
        )  # fmt: skip
    else:
        log.info(
            "mesh taken as it is: normals deviate by %.2f degrees, %.2f triangles a pixel",
            asks["normal_deviation_degrees"], asks["triangles_per_pixel"],
        )  # fmt: skip
    return mesh, figures


def _asks(mesh: Mesh, seen: SeenSurface) -> dict[str, float]:
    """What tells whether a mesh needs preparation: measured over the surface that pixels see, pixel by pixel."""
    pixels = seen.footprint.astype(np.float64) ** 2 / np.maximum(mesh.areas[seen.triangle], 1e-30)
    small = pixels * _SMALL > 1.0
    deviation = normal_deviation(mesh)[seen.triangle[small]]
    return {
        "normal_deviation_degrees": round(float(np.degrees(np.median(deviation))), 4) if small.any() else 0.0,
        "small_share": round(float(small.mean()), 4) if len(small) else 0.0,
        "triangles_per_pixel": round(float(np.median(pixels)), 4) if len(pixels) else 0.0,
    }


def _made(mesh: Mesh, seen: SeenSurface, deviation: float, settings: PrepareSettings) -> tuple[Mesh, dict[str, Any]]:
    """Clean, close small holes, smooth, flatten and decimate; ``deviation`` of normals in radians."""
    footprint = float(np.median(seen.footprint))
    needed = np.zeros(len(mesh.triangles), bool)
    needed[seen.triangle] = True
    mesh, cleaned = clean(mesh, (_PLANE_SIDE * footprint) ** 2, needed)
    mesh, holes = without_small_holes(mesh, _HOLE * footprint)
    edge = _edge(mesh)
    # of vertices along the normal, metres; never less than what no pixel can tell
    noise = max(edge * deviation, _UNSEEN * footprint)
    log.info("noise of the mesh: %.2g mm; %d triangles", 1e3 * noise, len(mesh.triangles))
    smooth = taubin(mesh, 10)
    smooth = decimated(smooth, _count(smooth, seen, settings.triangle_size, None), max(noise, _ERROR * footprint))
    deviation = max(weighted_median(normal_deviation(smooth), smooth.areas), _EVEN)
    smooth = fitted_to_normals(smooth, filtered_normals(smooth, _CREASE * deviation, _PASSES), _PASSES)
    planes = find_planes(smooth, _PLANE_ANGLE * deviation, _PLANE_DISTANCE * noise, (_PLANE_SIDE * footprint) ** 2)
    rounded = _ROUNDED * edge
    planes = grown(smooth, planes, rounded, _ROUNDED_RINGS)
    around = _noise_around(mesh, smooth.corners.mean(axis=1), edge, _PLANE_SIDE * footprint)
    planes = grown(smooth, planes, np.minimum(_PLANE_DISTANCE * np.maximum(around, noise), rounded))
    flat = flattened(smooth, planes, 2 * edge)
    flat_area = float(flat.areas[planes.of >= 0].sum())
    done = decimated(flat, _count(flat, seen, settings.triangle_size, planes), _ERROR * footprint)
    done, _ = clean(done, 0.0)
    return done, {
        "noise_mm": round(float(1e3 * noise), 3),
        "side_mm": round(1e3 * edge, 3),
        **asdict(cleaned),
        **asdict(holes),
        "planes": len(planes.offset),
        "plane_share": round(flat_area / max(float(flat.areas.sum()), 1e-30), 4),
        "footprint_mm": round(1e3 * footprint, 2),
    }


def _noise_around(mesh: Mesh, places: np.ndarray, edge: float, side: float) -> np.ndarray:
    """(K,) deviation of vertices along their normals, metres, in the cell that holds each of (K, 3) places.

    Few depths were averaged where few saw the surface: there noise is several times what it is in the room. Cells are
    cubes of some ``side``, metres; ``edge`` is the median side of triangles, metres. 0 where the mesh has nothing.
    """
    centers = mesh.corners.mean(axis=1)
    cell = distinct_rows(np.floor(np.concatenate([centers, places]) / side).astype(np.int64))[1]
    own, asked = np.split(cell, [len(centers)])
    known, index = np.unique(own, return_inverse=True)
    noise = np.zeros(cell.max(initial=-1) + 1)
    noise[known] = edge * grouped_median(normal_deviation(mesh), index.reshape(-1), len(known))
    return noise[asked]


def _edge(mesh: Mesh) -> float:
    """Median length of a side, metres."""
    corners = mesh.vertices[np.stack(np.divmod(np.unique(triangle_sides(mesh.triangles)), 1 << 32), axis=1)]
    return float(np.median(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)))


def _count(mesh: Mesh, seen: SeenSurface, size: float, planes: Planes | None) -> int:
    """Triangles that the surface needs, if their sides are ``size`` footprints; on planes, more."""
    side = size * seen.footprint_at(mesh.corners.mean(axis=1))
    if planes is not None:
        side = side * np.where(planes.of >= 0, _COARSE, 1.0)
    return int((mesh.areas / (_EQUILATERAL * side**2)).sum()) + 1
