"""What is measured on: the room in code, made in seconds, or the results of a scene."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fipt.errors import FiptError
from fipt.model.networks import Brdf
from fipt.render.points import Points
from fipt.render.surface import EmitterSet
from fipt.scene.mesh import Mesh

_VIEWS, _WIDTH, _HEIGHT, _SPP = 16, 160, 120, 32
"""Of the room: enough views for the cache to know most surfaces."""


@dataclass(frozen=True)
class Scene:
    """Inputs of the kernels.

    Attributes
    ----------
    name
        For people.
    mesh
        The room.
    voxels
        Radiance cache with one record a voxel, so that both implementations integrate the same light.
    materials
        Of the K records.
    emitters
        Emitting triangles; both of their sides shine.
    view
        All samples of one view.
    pixels
        Pixels of that view.
    """

    name: str
    mesh: Mesh
    voxels: dict[str, np.ndarray]
    materials: Brdf
    emitters: EmitterSet
    view: Points
    pixels: int

    def some(self, count: int) -> Points:
        """About ``count`` of the view's samples, evenly spread."""
        step = max(len(self.view.position) // count, 1)
        view = self.view
        return Points(view.position[::step], view.normal[::step], view.wo[::step], view.key[::step])


def merged(cache: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Cache with one record a voxel instead of one a voxel and facing, unseen ones filled as in the bake."""
    key, first, index = np.unique(cache["key"], return_index=True, return_inverse=True)
    radiance = cache["radiance"][cache["source"]].astype(np.float64)
    weight = np.maximum(cache["count"], 1e-3)
    total = np.stack([np.bincount(index, weight * radiance[:, c], len(key)) for c in range(3)], axis=1)
    return {name: cache[name] for name in ("center", "side", "resolution")} | {
        "key": key,
        "facing": np.zeros(len(key), np.uint8),
        "point": cache["point"][first],
        "radiance": (total / np.bincount(index, weight, len(key))[:, None]).astype(np.float32),
        "count": np.bincount(index, cache["count"], len(key)).astype(np.float32),
        "source": np.arange(len(key), dtype=np.int32),
    }


def demo_room() -> Scene:
    """The room in code under its own lamps, its cache filled from quickly rendered views."""
    from fipt.render.footprint import joined, trace_view
    from fipt.render.points import view_points
    from fipt.render.scene import RayScene
    from fipt.scene.mesh import connected_parts
    from fipt.stages.cache.build import build as build_cache
    from fipt.stages.cache.settings import CacheSettings
    from fipt.stages.samples.settings import SamplesSettings
    from fipt.synthetic.poses import OpenSpace, sample_cameras
    from fipt.synthetic.room import build
    from fipt.synthetic.settings import SynthesizeSettings
    from fipt.synthetic.views import Truth, render_views

    settings = SynthesizeSettings(train_views=_VIEWS, width=_WIDTH, height=_HEIGHT, spp=_SPP, denoise=False)
    room = build(settings.seed)
    truth = Truth(room)
    cameras = sample_cameras(OpenSpace(room, truth.intersect, settings.seed), settings)[:_VIEWS]
    traced, parts = RayScene(room.mesh), connected_parts(room.mesh)
    samples = joined(cameras, [trace_view(traced, parts, camera, SamplesSettings()) for camera in cameras])
    images = (image.reshape(-1, 3) for _, image, _ in render_views(room, cameras, settings))
    pictures = ((image, np.ones(len(image), np.float32), np.zeros(len(image), bool)) for image in images)
    cache = build_cache(room.mesh, [samples], pictures, CacheSettings())
    voxels = merged(cache)
    lamps = np.flatnonzero(room.emits).astype(np.int32)
    return Scene(
        "the room in code",
        room.mesh,
        voxels,
        _true_materials(truth, room.mesh, np.asarray(samples.position), np.asarray(samples.triangle), voxels["point"]),
        EmitterSet(lamps, room.radiance[lamps]),
        view_points(samples, 0, cameras[0], seed=0),
        _WIDTH * _HEIGHT,
    )


def _true_materials(truth: object, mesh: Mesh, place: np.ndarray, triangle: np.ndarray, points: np.ndarray) -> Brdf:
    """Materials of the room at points on its surface; ``place`` (N, 3) are such points of known triangles."""
    from fipt.scene.mesh import surface_points

    low, high = mesh.vertices.min(axis=0) - 1, mesh.vertices.max(axis=0) + 1
    more, owner = surface_points(mesh, 0.02, low, high, seed=0)
    _, nearest = cKDTree(np.concatenate([place, more])).query(points, workers=-1)
    normal = mesh.normals[np.concatenate([triangle, owner])[nearest]]
    seen = truth.trace(points + np.float32(1e-3) * normal, -normal)
    return Brdf(seen["base_color"], np.maximum(seen["roughness"], np.float32(0.02)), seen["metallic"])


def of_results(folder: Path) -> Scene:
    """A scene that the pipeline has worked on: ``folder`` is results/NAME."""
    from fipt.formats.arrays import load_npz
    from fipt.model.fitted import voxel_materials
    from fipt.model.store import load_field
    from fipt.render.points import view_points
    from fipt.render.surface import emitter_set
    from fipt.scene.dataset import Dataset
    from fipt.scene.emitters import read_emitters
    from fipt.scene.samples import read_samples

    rounds = [path.parent for path in folder.glob("round-*/emitters.npz")]
    if not rounds:
        raise FiptError(f"{folder} holds no fitted model", "give the results of a finished scene, such as results/demo")
    last = max(rounds, key=lambda path: int(re.sub(r"\D", "", path.name)))
    dataset = Dataset(folder / "dataset")
    samples = read_samples(min(folder.glob("samples/train-*[0-9]")))
    voxels = merged(load_npz(folder / "cache.npz"))
    field = load_field(last / "model.safetensors")
    camera = dataset.camera(samples.views[0])
    return Scene(
        folder.name,
        dataset.mesh(),
        voxels,
        voxel_materials(field, voxels),
        emitter_set(read_emitters(last / "emitters.npz")).lit(),
        view_points(samples, 0, camera, seed=0),
        camera.width * camera.height,
    )
