"""The room in 3D on the page: the exported scene where there is one, else the mesh in the colours of its materials."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats import glb
from fipt.formats.text import MALFORMED
from fipt.scene.cameras import Camera, up_axis
from fipt.scene.dataset import Dataset, read_layers
from fipt.scene.emitters import default_name
from fipt.scene.mesh import Mesh
from fipt.scene.samples import read_samples
from fipt.stages.report import images
from fipt.stages.report.files import of_form

_LARGEST = 12_000_000
"""Bytes of an exported scene that the page takes in; of a larger one it shows the coloured mesh instead."""
_TRIANGLES = 150_000
"""Larger triangles are quartered until at most so many more are needed, so that vertices can hold the colours."""
_MOST = 300_000
"""Triangles; a mesh with more is thinned to about the size of those."""
_SAMPLES = 400_000
"""Pixels whose material colours the vertices."""
_VIEWPOINTS = 12


@dataclass(frozen=True)
class Viewpoint:
    """Where a view was taken: (3,) ``eye``, unit ``forward``, and the vertical field of view, degrees."""

    name: str
    eye: Sequence[float]
    forward: Sequence[float]
    fov: float


@dataclass(frozen=True)
class Marker:
    """An emitter: its default name, its name in emitters.json, colour as ``#rrggbb`` and (3,) centre."""

    key: str
    name: str
    color: str
    center: Sequence[float]


@dataclass(frozen=True)
class RoomModel:
    """What the 3D view shows; all places are in the model's own axes.

    Attributes
    ----------
    model
        A binary glTF file, packed (`fipt.stages.report.images.packed`).
    exported
        Whether it is the exported scene.
    up
        (3,) the axis that points up.
    """

    model: str
    exported: bool
    up: Sequence[float]
    viewpoints: Sequence[Viewpoint]
    emitters: Sequence[Marker]


def read_room(
    results: Path, data: Dataset | None, emitters: Sequence[Mapping[str, Any]] | None, export: bool = True
) -> RoomModel | None:
    """Read the room of a results folder; None where neither an exported scene nor material maps exist.

    Parameters
    ----------
    emitters
        Entries of emitters.json.
    export
        Whether the exported scene is shown, where there is one.
    """
    if data is None:
        return None
    scene, turn = results / "export" / "scene.glb", np.eye(3)
    exported = export and scene.is_file() and scene.stat().st_size <= _LARGEST
    if exported:
        content, turn = scene.read_bytes(), _turn(results / "export" / "export.json")
    elif (results / "dataset" / "mesh.ply").is_file() and (found := _seen(results, data)):
        content = colored(data.mesh(), *found)
    else:
        return None
    cameras = [camera for camera in data.cameras if camera.split == "val"] or data.cameras
    up = np.round(turn @ up_axis(data.cameras))  # another world axis, where the export has turned the room
    return RoomModel(
        model=images.packed(content),
        exported=exported,
        up=up.tolist(),
        viewpoints=[_viewpoint(camera, turn) for camera in cameras[:_VIEWPOINTS]],
        emitters=[
            Marker(default_name(int(entry["index"])), entry["name"], entry["color"], (turn @ entry["center"]).tolist())
            for entry in emitters or ()
        ],
    )


def _turn(path: Path) -> np.ndarray:
    """(3, 3) rotation from the dataset's axes to those of the exported scene, which has y up."""
    try:
        turn = np.array(json.loads(path.read_text(encoding="utf-8"))["room_from_source"], np.float64)
        return turn.reshape(3, 3)
    except (OSError, *MALFORMED) as error:
        raise FiptError(f"{path} does not say how the export was turned ({error!r})", "export again") from error


def _viewpoint(camera: Camera, turn: np.ndarray) -> Viewpoint:
    return Viewpoint(
        camera.name,
        (turn @ camera.center).tolist(),
        (turn @ -camera.world_from_camera[:3, 2]).tolist(),
        float(np.degrees(2 * np.arctan(camera.height / (2 * camera.fy)))),
    )


def _seen(results: Path, data: Dataset) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions (N, 3) and linear colours (N, 3) in [0, 1] of pixels spread over all views; None where there are none.

    Emitters have the colour of their light.
    """
    shards = [read_samples(path.parent) for path in sorted((results / "samples").glob("*/views.json"))]
    views = [(shard, index, view) for shard in shards for index, view in enumerate(shard.views)]
    total = sum(camera.width * camera.height for camera in data.cameras)
    step = max(1, total // _SAMPLES)
    positions, colors = [], []
    for shard, index, view in views:
        path = results / "materials" / f"{view}.exr"
        if not path.is_file():
            continue
        layers, pixels = read_layers(path), shard.pixels(index)
        known = np.flatnonzero(np.asarray(shard.center[pixels]))[::step]
        positions.append(np.asarray(shard.position)[np.asarray(shard.offsets[pixels])[known]])
        with of_form(path):
            emission, base = (layers[name].reshape(-1, 3)[known] for name in ("emission", "base_color"))
        peak = emission.max(axis=1, keepdims=True)
        colors.append(np.where(peak > 0, emission / np.maximum(peak, 1e-9), np.clip(base, 0, 1)))
    if not sum(map(len, positions)):
        return None
    return np.concatenate(positions), np.concatenate(colors)


def colored(mesh: Mesh, positions: np.ndarray, colors: np.ndarray) -> bytes:
    """Return a room as binary glTF whose vertices have the colours of what pixels saw nearby.

    Parameters
    ----------
    mesh
        The room. Large triangles are cut, so that vertices are dense enough; a mesh of very many is thinned.
    positions, colors
        (N, 3) places that were seen, metres, and their linear colours in [0, 1].
    """
    from scipy.spatial import cKDTree

    vertices, triangles = _cut(mesh)
    distance, nearest = cKDTree(positions).query(vertices, k=range(1, min(3, len(positions)) + 1))
    weight = 1 / (distance + 1e-3)
    mixed = (colors[nearest] * weight[..., None]).sum(axis=1) / weight.sum(axis=1, keepdims=True)
    return _glb(vertices, triangles, mixed)


def _cut(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float32 and triangles (T, 3) without very large ones; vertices at one place become one."""
    from trimesh.remesh import subdivide

    vertices, triangles = mesh.vertices, mesh.triangles
    largest = 4 * mesh.areas.sum() / _TRIANGLES
    cell = 1e-4 if len(triangles) <= _MOST else float(np.sqrt(2 * largest))
    while (large := np.flatnonzero(Mesh(vertices, triangles).areas > largest)).size:
        vertices, triangles = subdivide(vertices, triangles, large)[:2]
    cells = np.round(vertices / cell)
    _, first, vertex = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    triangles = vertex.reshape(-1)[triangles]
    a, b, c = triangles.T
    return vertices[first].astype(np.float32), triangles[(a != b) & (b != c) & (c != a)]


def _glb(vertices: np.ndarray, triangles: np.ndarray, colors: np.ndarray) -> bytes:
    """One mesh with linear vertex colours (V, 3) as binary glTF 2.0."""
    shades = np.full((len(vertices), 4), 65535, "<u2")
    shades[:, :3] = np.clip(colors, 0, 1) * 65535 + 0.5
    arrays = [np.asarray(vertices, "<f4"), shades, np.asarray(triangles, "<u4").reshape(-1, 1)]
    kinds = [(5126, "VEC3"), (5123, "VEC4"), (5125, "SCALAR")]
    starts = np.cumsum([0, *(array.nbytes for array in arrays)]).tolist()
    accessors: list[dict[str, Any]] = [
        {"bufferView": number, "componentType": kind, "type": shape, "count": len(array)}
        for number, (array, (kind, shape)) in enumerate(zip(arrays, kinds, strict=True))
    ]
    accessors[0] |= {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    accessors[1] |= {"normalized": True}
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes}
            for start, array in zip(starts[:-1], arrays, strict=True)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    return glb.packed(document, b"".join(array.tobytes() for array in arrays))
