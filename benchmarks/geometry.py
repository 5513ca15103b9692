"""How far a mesh is from the true one of a dataset, in what the pipeline needs of it.

    python -m benchmarks.geometry results/NAME/geometry/mesh.ply results/NAME_true/dataset [--out figures.json]

Points are drawn on both meshes by area and kept where a training view sees them (rays against their own mesh). From
each, the distance to the other mesh is exact (to its triangles, not to points on it).

    accuracy, completeness     distance from ours to the true mesh, and from the true one to ours, mm
    precision, recall, F       share of the points nearer than a threshold, and their harmonic mean
    normals                    angle between the normals of a point of ours and of the nearest true triangle, degrees
    planes                     RMS distance of ours from true planes above `PLANE` square metres: from a plane fitted to
                               ours (flatness), and from the true one, mm
    leaving                    share of rays from seen points, cosine distributed, that leave our mesh; the true one's
    emitters                   of each true emitter: pixels whose depth is right within 2 cm, and how well one connected
                               part of our mesh covers it (intersection over union in pixels)
"""

import argparse
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np

from fipt.render.scene import RayScene
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh, connected_parts, points_of, read_mesh

log = logging.getLogger(__name__)

POINTS = 200_000
"""Points on either mesh."""
THRESHOLDS = (0.05, 0.02, 0.01)
"""Metres, of precision and recall."""
PLANE = 0.25
"""Square metres of the smallest true plane that counts."""
NEAR = 0.05
"""Metres within which normals and planes are compared: farther points belong to nothing."""
EMITTER_DEPTH = 0.02
"""Metres within which the depth of an emitter's pixel is right."""
EMITTER_PIXELS = 20
"""Least pixels, of all training views, of an emitter that counts."""
_DRAWS = 12
"""Draws of points until enough are seen."""


def geometry(mesh: Mesh, dataset: Dataset, points: int = POINTS, seed: int = 0) -> dict[str, Any]:
    """Compare a mesh with the dataset's own; Mitsuba's variant must be set."""
    true, cameras = dataset.mesh(), [camera for camera in dataset.cameras if camera.split == "train"]
    rng = np.random.default_rng(seed)
    ours, ours_from, ours_by = seen_points(mesh, cameras, points, rng)
    theirs, theirs_from, theirs_by = seen_points(true, cameras, points, rng)
    away, nearest = distances(true, ours)
    missing, _ = distances(mesh, theirs)
    figures: dict[str, Any] = {
        "triangles": len(mesh.triangles),
        "accuracy_mm": _middle(away),
        "completeness_mm": _middle(missing),
    }
    for limit in THRESHOLDS:
        precision, recall = float((away < limit).mean()), float((missing < limit).mean())
        figures[f"{limit * 100:g}cm"] = {
            "precision": round(precision, 4),
            "recall": round(recall, 4),
            "f": round(2 * precision * recall / max(precision + recall, 1e-12), 4),
        }
    near = away < NEAR
    cosine = np.abs((mesh.normals[ours_from[near]] * true.normals[nearest[near]]).sum(axis=1))
    angle = np.degrees(np.arccos(np.minimum(cosine, 1.0)))
    figures["normals_degrees"] = {
        "median": round(float(np.median(angle)), 3),
        "p90": round(float(np.percentile(angle, 90)), 3),
    }
    figures["planes_mm"] = plane_rms(true, ours[near], nearest[near], cosine)
    figures["leaving"] = {
        "ours": leaving(mesh, ours, ours_from, ours_by, rng),
        "true": leaving(true, theirs, theirs_from, theirs_by, rng),
    }
    figures["emitters"] = emitters(mesh, true, dataset, cameras)
    return figures


def _middle(values: np.ndarray) -> dict[str, float]:
    """Mean and median of metres, in mm."""
    return {"mean": round(float(1e3 * values.mean()), 2), "median": round(float(1e3 * np.median(values)), 2)}


def seen_points(
    mesh: Mesh, cameras: list[Camera], count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, 3) float64 points on a mesh by area, at most ``count``, that a camera sees.

    Also the (N,) triangle of each, and the (N, 3) place of a camera that sees it.
    """
    scene, chance = RayScene(mesh), mesh.areas / mesh.areas.sum()
    centers = np.array([camera.center for camera in cameras])
    found: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for _ in range(_DRAWS):
        of = rng.choice(len(chance), count, p=chance)
        places = points_of(mesh.corners[of].astype(np.float64), *rng.random((2, count)))
        by = seen_by(scene, places, cameras)
        seen = by >= 0
        found.append((places[seen], of[seen], centers[by[seen]]))
        if sum(len(places) for places, _, _ in found) >= count:
            break
    places, triangles, viewers = (np.concatenate(parts)[:count] for parts in zip(*found, strict=True))
    return places, triangles, viewers


def seen_by(scene: RayScene, places: np.ndarray, cameras: list[Camera]) -> np.ndarray:
    """(N,) int64 the first camera that sees each point; -1 for none."""
    seen = np.full(len(places), -1)
    for number, camera in enumerate(cameras):
        image, depth = camera.project(places)
        inside = (
            (seen < 0) & (depth > 0) & (image >= 0).all(axis=1) & (image < [camera.width, camera.height]).all(axis=1)
        )
        chosen = np.flatnonzero(inside)
        if len(chosen) == 0:
            continue
        to = places[chosen] - camera.center
        far = np.linalg.norm(to, axis=1)
        met, _ = scene.intersect(camera.center, (to / far[:, None]).astype(np.float32))
        seen[chosen[met > far - 1e-3]] = number
    return seen


def distances(mesh: Mesh, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) distances, metres, of points to a mesh, and (N,) the nearest triangles."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)), o3d.core.Tensor(mesh.triangles.astype(np.uint32))
    )
    found = scene.compute_closest_points(o3d.core.Tensor(places.astype(np.float32)))
    return np.linalg.norm(found["points"].numpy() - places, axis=1), found["primitive_ids"].numpy().astype(np.int64)


def plane_rms(true: Mesh, places: np.ndarray, nearest: np.ndarray, cosine: np.ndarray) -> dict[str, float]:
    """RMS distance of our points from large true planes: as flat, and from where the plane is; mm."""
    normal, plane = true.normals.astype(np.float64), true_planes(true)
    of = np.where(cosine > np.cos(np.radians(30)), plane[nearest], -1)
    flat, off, count = 0.0, 0.0, 0
    for number in np.unique(of[of >= 0]):
        on, triangle = places[of == number], nearest[of == number]
        away = ((on - true.corners[triangle, 0]) * normal[triangle]).sum(axis=1)
        flat += float(np.linalg.svd(on - on.mean(axis=0), full_matrices=False)[1][-1] ** 2)
        off += float((away**2).sum())
        count += len(on)
    if count == 0:
        return {"flatness": 0.0, "from_true": 0.0, "share": 0.0}
    return {
        "flatness": round(1e3 * float(np.sqrt(flat / count)), 2),
        "from_true": round(1e3 * float(np.sqrt(off / count)), 2),
        "share": round(count / len(places), 4),
    }


def true_planes(mesh: Mesh) -> np.ndarray:
    """(T,) plane of each triangle, -1 where it is smaller than `PLANE`: coplanar triangles are of one, anywhere."""
    normal = mesh.normals.astype(np.float64)
    offset = (mesh.corners[:, 0] * normal).sum(axis=1)
    rounded = np.column_stack([np.round(normal * 200), np.round(offset * 500)])
    plane = np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)
    return np.where(np.bincount(plane, mesh.areas)[plane] >= PLANE, plane, -1)


def leaving(mesh: Mesh, places: np.ndarray, of: np.ndarray, viewers: np.ndarray, rng: np.random.Generator) -> float:
    """Share of cosine-distributed rays from points that meet nothing; they start on the side of who sees the point."""
    scene, normal = RayScene(mesh), mesh.normals[of].astype(np.float64)
    side = ((viewers - places) * normal).sum(axis=1)
    normal *= np.where(side < 0, -1.0, 1.0)[:, None]
    ball = rng.standard_normal((len(places), 3))
    way = normal + ball / np.linalg.norm(ball, axis=1, keepdims=True)
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
    distance, _ = scene.intersect((places + 2e-3 * normal).astype(np.float32), way.astype(np.float32))
    return round(float((~np.isfinite(distance)).mean()), 5)


def emitters(mesh: Mesh, true: Mesh, dataset: Dataset, cameras: list[Camera]) -> list[dict[str, Any]]:
    """Figures of each connected part of the true mesh that the truth says to emit."""
    ours, theirs = RayScene(mesh), RayScene(true)
    part, true_part = connected_parts(mesh), connected_parts(true)
    parts, right = [], []
    for camera in cameras:
        truth = dataset.truth(camera.name)
        if truth is None:
            return []
        emits = truth["emission_mask"] > 0.5 if "emission_mask" in truth else truth["emission"].max(axis=-1) > 0
        rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
        directions = camera.directions(columns, rows).reshape(-1, 3)
        far, triangle = theirs.intersect(camera.center, directions)
        met, found = ours.intersect(camera.center, directions)
        both = np.stack([
            np.where(emits.ravel() & (triangle >= 0), true_part[triangle], -1), np.where(found >= 0, part[found], -1)
        ])  # fmt: skip
        parts.append(both)
        with np.errstate(invalid="ignore"):  # where both rays leave
            right.append(np.abs(met - far) < EMITTER_DEPTH)
    pixels, near = np.concatenate(parts, axis=1), np.concatenate(right)
    figures = []
    for number in np.unique(pixels[0][pixels[0] >= 0]):
        on = pixels[0] == number
        if on.sum() < EMITTER_PIXELS:
            continue
        best = np.bincount(pixels[1][on] + 1).argmax() - 1
        joined = on | (pixels[1] == best)
        figures.append({
            "part": int(number),
            "pixels": int(on.sum()),
            "within_2cm": round(float(near[on].mean()), 4),
            "own_part_iou": round(float((on & (pixels[1] == best)).sum() / joined.sum()), 4) if best >= 0 else 0.0,
        })  # fmt: skip
    return figures


def main() -> int:
    """Print the figures of a mesh."""
    parser = argparse.ArgumentParser("python -m benchmarks.geometry", description=__doc__.splitlines()[0])
    parser.add_argument("mesh", type=Path, help="PLY or OBJ file to judge")
    parser.add_argument("dataset", type=Path, help="dataset folder with the true mesh, of the same views")
    parser.add_argument("--points", type=int, default=POINTS, help="points on either mesh")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    set_variant()
    figures = geometry(read_mesh(args.mesh), Dataset(args.dataset), args.points)
    text = json.dumps(figures, indent=1)
    if args.out:
        args.out.write_text(text + "\n", encoding="utf-8")
    log.info("%s", text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
