"""Planes of a mesh: found, and its vertices put onto them and onto the lines and points where they meet."""

from dataclasses import dataclass

import numpy as np

from fipt.groups import connected_groups
from fipt.meshing.topology import neighbours
from fipt.scene.mesh import Mesh

_ROUNDS = 5
"""Refits of a plane to the triangles that lie on it; it has settled long before."""
_MOST = 400
"""Planes looked for in one smooth region: a bound on time, far above what a room has."""
_ALIKE = 0.1
"""Smallest singular value of the normals of planes that meet, below which they are taken for nearly parallel: their
line lies too uncertain to put a vertex onto it."""

_LEANS = 0.5
"""Cosine to a plane above which rounded surface may belong to it: the tip of a corner of three planes has 0.58."""


@dataclass(frozen=True)
class Planes:
    """Planes of a mesh.

    Attributes
    ----------
    normal, offset
        (K, 3) float64 unit normals and (K,) float64 offsets in metres: n . x = offset.
    of
        (T,) int32 plane of each triangle, -1 for none.
    """

    normal: np.ndarray
    offset: np.ndarray
    of: np.ndarray


def find_planes(mesh: Mesh, angle: float, tolerance: float, smallest: float) -> Planes:
    """Find the planes of a mesh whose normals are smooth.

    Parameters
    ----------
    angle
        Radians up to which a triangle's normal may differ from its plane's, and neighbours from each other.
    tolerance
        Metres up to which a triangle's centre may lie beside its plane.
    smallest
        Square metres; smaller pieces are no plane.
    """
    pairs, area = neighbours(mesh.triangles), mesh.areas
    normals, centers = mesh.normals.astype(np.float64), mesh.corners.mean(axis=1, dtype=np.float64)
    of = np.full(len(area), -1, np.int32)
    normal: list[np.ndarray] = []
    offset: list[float] = []
    cosine = np.cos(angle)
    alike = (normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > cosine
    region = connected_groups(pairs[alike].T, len(area))
    sizes = np.bincount(region, area)
    order = np.argsort(region, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(region))])
    for number in np.flatnonzero(sizes >= smallest):
        rest = order[starts[number] : starts[number + 1]]
        for _ in range(_MOST):
            if area[rest].sum() < smallest:
                break
            n, d = _fitted(normals[rest], centers[rest], area[rest], cosine, tolerance)
            on = (normals[rest] @ n > cosine) & (np.abs(centers[rest] @ n - d) < tolerance)
            if area[rest[on]].sum() < smallest:
                break
            of[rest[on]] = len(normal)
            normal.append(n)
            offset.append(d)
            rest = rest[~on]
    planes = Planes(np.array(normal).reshape(-1, 3), np.array(offset), of)
    return _without_crumbs(planes, pairs, area, smallest)


def _fitted(
    normals: np.ndarray, centers: np.ndarray, area: np.ndarray, cosine: float, tolerance: float
) -> tuple[np.ndarray, float]:
    """Normal and offset of the largest plane among triangles of one smooth region."""
    n = _mode(normals, area, cosine)
    offsets = centers @ n
    near = normals @ n > cosine
    slot = np.floor((offsets - offsets.min()) / tolerance).astype(np.int64)
    filled = np.bincount(slot, area * near)
    # a plane may lie on the border of two slots
    best = int(np.argmax(filled + np.append(filled[1:], 0.0)))
    d = float(offsets.min() + (best + 1) * tolerance)
    for _ in range(_ROUNDS):
        on = near & (np.abs(centers @ n - d) < tolerance)
        if on.sum() < 3:
            break
        weight = area[on] / area[on].sum()
        middle = weight @ centers[on]
        away = centers[on] - middle
        fitted = np.linalg.eigh((away * weight[:, None]).T @ away)[1][:, 0]
        n = fitted if fitted @ n > 0 else -fitted
        d = float(middle @ n)
        near = normals @ n > cosine
    return n, d


def _mode(normals: np.ndarray, area: np.ndarray, cosine: float) -> np.ndarray:
    """Direction around which most area's normals lie: mean shift from the fullest cell of a coarse map."""
    cell = np.round(normals * 6).astype(np.int64) @ np.array([169, 13, 1])
    cells, index = np.unique(cell, return_inverse=True)
    fullest = np.bincount(index.reshape(-1), area, len(cells)).argmax()
    n = (normals * area[:, None])[index.reshape(-1) == fullest].sum(axis=0)
    for _ in range(_ROUNDS):
        n = n / max(float(np.linalg.norm(n)), 1e-30)
        near = normals @ n > cosine
        if not near.any():
            break
        n = (normals[near] * area[near, None]).sum(axis=0)
    return n / max(float(np.linalg.norm(n)), 1e-30)


def _without_crumbs(planes: Planes, pairs: np.ndarray, area: np.ndarray, smallest: float) -> Planes:
    """Planes whose pieces are large enough by themselves; the others belong to nothing."""
    same = (planes.of[pairs[:, 0]] == planes.of[pairs[:, 1]]) & (planes.of[pairs[:, 0]] >= 0)
    piece = connected_groups(pairs[same].T, len(area))
    large = np.bincount(piece, area)[piece] >= smallest
    return Planes(planes.normal, planes.offset, np.where(large, planes.of, -1).astype(np.int32))


def grown(mesh: Mesh, planes: Planes, reach: float | np.ndarray, steps: int | None = None) -> Planes:
    """Let planes take surface beside them: as far as ``steps`` triangles, if given, and ``reach`` metres off them.

    ``reach`` may be (T,), of each triangle.
    """
    reach = np.broadcast_to(reach, len(mesh.triangles))
    pairs = neighbours(mesh.triangles)
    of, normals = planes.of.copy(), mesh.normals
    corners = mesh.corners.astype(np.float64)
    last = of >= 0  # what was refused beside others stays so
    for _ in range(len(of) if steps is None else steps):
        best, chosen = np.full(len(of), 0.0), np.full(len(of), -1, np.int32)
        for one, other in (pairs.T, pairs.T[::-1]):
            asks = (of[one] < 0) & last[other]
            face, plane = one[asks], of[other[asks]]
            n = planes.normal[plane]
            away = np.abs(np.einsum("fck,fk->fc", corners[face], n) - planes.offset[plane][:, None]).max(axis=1)
            turned = (normals[face] * n).sum(axis=1)
            fits = (away < reach[face]) & (turned > _LEANS) & (turned > best[face])
            best[face[fits]], chosen[face[fits]] = turned[fits], plane[fits]
        last = chosen >= 0
        if not last.any():
            break
        of = np.where(last, chosen, of)
    return Planes(planes.normal, planes.offset, of)


def flattened(mesh: Mesh, planes: Planes, most: float) -> Mesh:
    """Put the vertices onto the planes of their triangles; where planes meet, onto their line or point.

    A vertex that would move by more than ``most`` metres stays.
    """
    flat = planes.of >= 0
    corner = mesh.triangles[flat].ravel().astype(np.int64)
    key = np.unique(corner * len(planes.normal) + np.repeat(planes.of[flat], 3)) if flat.any() else corner
    vertex, plane = np.divmod(key, max(len(planes.normal), 1))
    count = np.bincount(vertex, minlength=len(mesh.vertices))
    first = np.concatenate([[0], np.cumsum(count)])
    touched = np.flatnonzero(count)
    normals, away = np.zeros((len(touched), 3, 3)), np.zeros((len(touched), 3))
    place = mesh.vertices[touched].astype(np.float64)
    for slot in range(3):
        has = count[touched] > slot
        chosen = plane[first[touched[has]] + slot]
        normals[has, slot] = planes.normal[chosen]
        away[has, slot] = planes.offset[chosen] - (planes.normal[chosen] * place[has]).sum(axis=1)
    move = np.einsum("vij,vj->vi", np.linalg.pinv(normals, rcond=_ALIKE), away)
    near = np.linalg.norm(move, axis=1) <= most
    vertices = mesh.vertices.astype(np.float64)
    vertices[touched[near]] += move[near]
    return Mesh(vertices.astype(np.float32), mesh.triangles)
