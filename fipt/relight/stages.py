"""The stages materials, render, relight and lamps: files in, pictures out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.io.background import Background, covered_share, edited, pixel_directions, read_background
from fipt.io.cameras import Camera
from fipt.io.confidence import read_confidence
from fipt.io.dataset import Dataset
from fipt.io.emitters import read_emitters, read_names
from fipt.io.exr import write_exr
from fipt.io.hits import Hits, read_hits
from fipt.io.manifests import Stats, read_manifest, write_manifest
from fipt.io.meshes import Mesh, connected_parts
from fipt.io.voxels import read_cache
from fipt.model.networks import Brdf, Field
from fipt.model.store import load_field
from fipt.model.voxels import voxel_materials
from fipt.progress import progress
from fipt.relight.cameras import chosen_cameras
from fipt.relight.changes import UNCHANGED, Changes, change
from fipt.relight.lights import apply_setup, lights_alone
from fipt.relight.maps import emission_of, hit_materials, material_maps
from fipt.relight.standing import standing
from fipt.render.background import sky_of
from fipt.render.denoise import denoise
from fipt.render.first_hits import joined, trace_view
from fipt.render.picture import pixels_of_hits, radiance_of_hits
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, SurfaceCache, Triangles, emitter_set
from fipt.render.tracer import PathSettings, Shader
from fipt.settings import Hits as HitsSettings
from fipt.settings import Lamps, Materials, Relight, RelightSetup, Render, dumped


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
    settings: Render | Relight,
    stats: Stats,
    *,
    lamps: Path | None = None,
    cameras: Sequence[str] = (),
    segments: Path | None = None,
) -> None:
    """Path trace a shard's views with the model, under its own emitters or a light setup.

    Paths follow the model alone: the photographs' radiance is not read, so that the same holds under other light.

    Parameters
    ----------
    lamps
        List that has the names by which the setup chooses lamps.
    cameras
        Of a setup with its own cameras, those to render; of ``hits`` only the settings are used then.
    segments
        fusion.npz, whose ids the setup may name; None: it names connected parts of the mesh.
    """
    data, shard = Dataset(dataset), read_hits(hits)
    own = None if setup is None else setup.cameras
    seen_by = [data.camera(view) for view in shard.views] if own is None else chosen_cameras(own, data, cameras)
    mesh, found, outside = data.mesh(), read_emitters(emitters), read_background(background)
    lit, changes = emitter_set(found), UNCHANGED
    if setup is not None:
        room = mesh
        mesh, lit = apply_setup(room, found, setup, read_names(lamps, found))
        outside = edited(outside, setup.background)
        mesh, lit, changes = change(room, mesh, lit, setup, segments, outside)
        if own or not np.array_equal(mesh.triangles, room.triangles):  # views see what is new, and behind what is gone
            shard = changes.smooth(_traced(seen_by, mesh, hits), seen_by)
    if own:
        stats["warnings"] = standing(RayScene(mesh), seen_by, data.cameras)
        for warning in stats.figures["warnings"]:
            print(f"warning: {warning}")
    field, metadata = load_field(model)
    light = lights_of(mesh, read_cache(cache), field, [(lit, outside)], settings, changes)[0]
    files = []
    with progress(stage, len(shard.position) * settings.spp, " paths") as bar:
        for index, view in enumerate(shard.views):
            brdf = view_materials(field, shard, index, metadata["settings"].footprint)
            brdf = changes.materials(brdf, shard, index)
            files.append(out / f"{view}.exr")
            write_exr(files[-1], {"": light.picture(shard, index, seen_by[index], brdf, settings, bar.advance)})
        stats["paths_per_s"] = bar.rate
    said = {} if setup is None else {"setup": setup.model_dump(mode="json", exclude_defaults=True)}
    write_manifest(manifest, stage, files, dumped(settings) | said)


def write_lamps(
    dataset: Path,
    hits: Path,
    cache: Path,
    model: Path,
    emitters: Path,
    background: Path | None,
    views: Sequence[str],
    out: Path,
    manifest: Path,
    settings: Lamps,
    stats: Stats,
) -> None:
    """Path trace views of a shard with each lamp, and the light from outside, alone: lamps/{view}.exr, a layer each.

    Light transport is linear in what the lamps emit, so that sums of these pictures are the room under other light.
    """
    data, shard = Dataset(dataset), read_hits(hits)
    wanted = data.accepted(views)
    strange = [view for view in wanted if view not in shard.views]
    if strange:
        raise FiptError(f"{hits} has no hits of the views {', '.join(strange)}", "give views of that shard")
    alone = lights_alone(read_emitters(emitters), read_background(background), settings.separate)
    field, metadata = load_field(model)
    lights = lights_of(data.mesh(), read_cache(cache), field, list(alone.values()), settings)
    chosen = [index for index, view in enumerate(shard.views) if view in wanted and alone]
    total = sum(len(shard.position[shard.of_view(index)]) for index in chosen) * len(lights) * settings.spp
    files = []
    with progress("lamps", total, " paths") as bar:
        for index in chosen:
            view = shard.views[index]
            brdf = view_materials(field, shard, index, metadata["settings"].footprint)
            seen = (shard, index, data.camera(view), brdf, settings, bar.advance)
            files.append(out / f"{view}.exr")
            write_exr(files[-1], {name: light.picture(*seen) for name, light in zip(alone, lights, strict=True)})
        stats["paths_per_s"] = bar.rate
    write_manifest(manifest, "lamps", files, dumped(settings))


def view_materials(field: Field, shard: Hits, index: int, scale: float) -> Brdf:
    """Reflectance of the hits of view number ``index``; ``scale`` as in `hit_materials`."""
    own = shard.of_view(index)
    return hit_materials(field, shard, np.arange(own.start, own.stop), True, scale)


def lights_of(
    mesh: Mesh,
    voxels: dict[str, np.ndarray],
    field: Field,
    shining: Sequence[tuple[EmitterSet, Background]],
    settings: Render | Relight | Lamps,
    changes: Changes = UNCHANGED,
) -> list["Light"]:
    """Return the room ready to be seen under each of several lights: emitting triangles, and light from outside."""
    scene, nothing = RayScene(mesh), np.zeros((len(voxels["key"]), 3), np.float32)
    records = changes.records(voxel_materials(field, voxels), voxels["point"], voxels["facing"], scene)
    unknown = np.zeros(len(nothing), bool)
    surface = SurfaceCache(voxels, nothing, unknown, records, changes.of_triangles(), changes.first_object)
    path = PathSettings(settings.max_depth, cache_roughness=1.0, light_at_first=True)
    return [
        Light(mesh, lit, outside, Shader(scene, Triangles(mesh, lit), surface, path, sky_of(outside), changes.spots))
        for lit, outside in shining
    ]


@dataclass(frozen=True)
class Light:
    """The room under some light: what shines in it, what comes from outside, and the tracer that knows both."""

    mesh: Mesh
    lit: EmitterSet
    outside: Background
    shader: Shader

    def picture(
        self,
        shard: Hits,
        index: int,
        camera: Camera,
        brdf: Brdf,
        settings: Render | Relight | Lamps,
        advance: Callable[[int], None],
    ) -> np.ndarray:
        """(H, W, 3) float32 radiance of view number ``index``, whose hits have the materials ``brdf``."""
        own = shard.of_view(index)
        values = radiance_of_hits(
            self.shader,
            shard,
            index,
            camera,
            brdf.base_color,
            brdf.roughness,
            brdf.metallic,
            settings.spp,
            settings.denoise,
            settings.seed,
            advance,
        )
        triangle = np.asarray(shard.triangle[own])
        shining = np.isin(triangle, self.lit.triangle)
        values[shining] = 0
        emitted = np.zeros_like(values)
        emitted[shining] = emission_of(self.lit, triangle[shining])
        if not self.lit.two_sided:
            away = (np.asarray(shard.normal[own]) * self.mesh.normals[triangle]).sum(axis=1) < 0
            emitted[shining & away] = 0
        behind = _behind(self.outside, shard, index, camera)
        picture = pixels_of_hits(values, shard, index, np.zeros(3))
        if settings.denoise:  # pieces of mixed pixels are too few to be denoised alone; lamps stay exact
            bright = picture.any(axis=-1, keepdims=True) & picture.any(axis=(0, 1))
            picture = np.where(bright, denoise(picture), 0)
        return picture + pixels_of_hits(emitted, shard, index, behind)


def _behind(outside: Background, hits: Hits, index: int, camera: Camera) -> np.ndarray:
    """(pixels, 3) radiance from outside in the direction of every pixel of a view that hits do not cover."""
    pixel = np.flatnonzero(covered_share(hits, index) < 1)
    radiance = np.zeros((camera.width * camera.height, 3), np.float32)
    radiance[pixel] = outside.lookup(pixel_directions(camera, pixel))
    return radiance


def _traced(cameras: list[Camera], mesh: Mesh, hits: Path) -> Hits:
    """First hits of cameras on a mesh, with the settings of the hits there are."""
    settings = HitsSettings(**read_manifest(Path(f"{hits}.manifest.json"), "hits")["settings"])
    scene, parts = RayScene(mesh), connected_parts(mesh)
    return joined(cameras, [trace_view(scene, parts, camera, settings) for camera in cameras])
