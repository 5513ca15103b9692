"""The stages materials, render and relight: files in, pictures out."""

from pathlib import Path

import numpy as np

from fipt.io.background import Background, covered_share, edited, pixel_directions, read_background
from fipt.io.cameras import Camera
from fipt.io.confidence import read_confidence
from fipt.io.dataset import Dataset
from fipt.io.emitters import read_emitters
from fipt.io.exr import write_exr
from fipt.io.hits import Hits, read_hits
from fipt.io.manifests import Stats, read_manifest, write_manifest
from fipt.io.meshes import Mesh, connected_parts
from fipt.io.voxels import read_cache
from fipt.model.store import load_field
from fipt.model.voxels import voxel_materials
from fipt.progress import progress
from fipt.relight.lights import apply_setup
from fipt.relight.maps import emission_of, hit_materials, material_maps
from fipt.render.background import sky_of
from fipt.render.denoise import denoise
from fipt.render.first_hits import joined, trace_view
from fipt.render.picture import pixels_of_hits, radiance_of_hits
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
from fipt.render.tracer import PathSettings, Shader
from fipt.settings import Hits as HitsSettings
from fipt.settings import Materials, RelightSetup, Render, dumped


def write_materials(
    dataset: Path,
    hits: Path,
    model: Path,
    emitters: Path,
    confidence: Path,
    out: Path,
    manifest: Path,
    settings: Materials,
    stats: Stats,
) -> None:
    """Write the material maps of a shard's views, materials/{view}.exr, then their manifest."""
    data, shard = Dataset(dataset), read_hits(hits)
    found, sure = read_emitters(emitters), read_confidence(confidence)
    field, metadata = load_field(model)
    scale = metadata["settings"].footprint
    files = []
    with progress("materials", shard.first_pixels[-1], " pixels") as bar:
        for index, view in enumerate(shard.views):
            camera = data.camera(view)
            maps = material_maps(field, found, sure, shard, index, camera, settings.average, scale)
            files.append(out / f"{view}.exr")
            write_exr(files[-1], maps)
            bar.advance(camera.width * camera.height)
        stats["pixels_per_s"] = bar.rate
    write_manifest(manifest, "materials", files, dumped(settings))


def write_pictures(
    stage: str,
    dataset: Path,
    hits: Path,
    cache: Path,
    model: Path,
    emitters: Path,
    background: Path | None,
    setup: RelightSetup | None,
    out: Path,
    manifest: Path,
    settings: Render,
    stats: Stats,
) -> None:
    """Path trace a shard's views with the model, under its own emitters or a light setup.

    Paths follow the model alone: the photographs' radiance is not read, so that the same holds under other light.
    """
    data, shard = Dataset(dataset), read_hits(hits)
    mesh, found, outside = data.mesh(), read_emitters(emitters), read_background(background)
    lit = EmitterSet(found.triangle, found.radiance, found.two_sided)
    if setup is not None:
        room = mesh
        mesh, lit = apply_setup(room, found, setup)
        outside = edited(outside, setup.background)
        if len(mesh.triangles) > len(room.triangles):  # new lights may hide what the views saw
            shard = _traced(data, mesh, shard.views, hits)
    field, metadata = load_field(model)
    scale = metadata["settings"].footprint
    voxels = read_cache(cache)
    nothing = np.zeros((len(voxels["key"]), 3), np.float32)
    shader = Shader(
        RayScene(mesh),
        Triangles(mesh, lit),
        SurfaceCache(voxels, nothing, np.zeros(len(nothing), bool), voxel_materials(field, voxels)),
        PathSettings(settings.max_depth, cache_roughness=1.0, light_at_first=True),
        sky_of(outside),
    )
    files = []
    with progress(stage, len(shard.position) * settings.spp, " paths") as bar:
        for index, view in enumerate(shard.views):
            own = shard.of_view(index)
            brdf = hit_materials(field, shard, np.arange(own.start, own.stop), True, scale)
            values = radiance_of_hits(
                shader,
                shard,
                index,
                data.camera(view),
                brdf.base_color,
                brdf.roughness,
                brdf.metallic,
                settings.spp,
                settings.denoise,
                settings.seed,
                bar.advance,
            )
            triangle = np.asarray(shard.triangle[own])
            shining = np.isin(triangle, lit.triangle)
            values[shining] = 0
            emitted = np.zeros_like(values)
            emitted[shining] = emission_of(lit, triangle[shining])
            if not lit.two_sided:
                away = (np.asarray(shard.normal[own]) * mesh.normals[triangle]).sum(axis=1) < 0
                emitted[shining & away] = 0
            behind = _behind(outside, shard, index, data.camera(view))
            picture = pixels_of_hits(values, shard, index, np.zeros(3))
            if settings.denoise:  # pieces of mixed pixels are too few to be denoised alone; lamps stay exact
                bright = picture.any(axis=-1, keepdims=True) & picture.any(axis=(0, 1))
                picture = np.where(bright, denoise(picture), 0)
            files.append(out / f"{view}.exr")
            write_exr(files[-1], {"": picture + pixels_of_hits(emitted, shard, index, behind)})
        stats["paths_per_s"] = bar.rate
    write_manifest(manifest, stage, files, dumped(settings))


def _behind(outside: Background, hits: Hits, index: int, camera: Camera) -> np.ndarray:
    """(pixels, 3) radiance from outside in the direction of every pixel of a view that hits do not cover."""
    pixel = np.flatnonzero(covered_share(hits, index) < 1)
    radiance = np.zeros((camera.width * camera.height, 3), np.float32)
    radiance[pixel] = outside.lookup(pixel_directions(camera, pixel))
    return radiance


def _traced(data: Dataset, mesh: Mesh, views: tuple[str, ...], hits: Path) -> Hits:
    """First hits of views on a mesh that has changed, with the settings of the hits there were."""
    settings = HitsSettings(**read_manifest(Path(f"{hits}.manifest.json"), "hits")["settings"])
    scene, parts = RayScene(mesh), connected_parts(mesh)
    cameras = [data.camera(view) for view in views]
    return joined(cameras, [trace_view(scene, parts, camera, settings) for camera in cameras])
