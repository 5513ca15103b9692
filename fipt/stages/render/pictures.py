"""The stages materials, render, relight and lamps: files in, pictures out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.manifests import Stats, read_manifest, write_manifest
from fipt.model.fitted import voxel_materials
from fipt.model.networks import Brdf, Field
from fipt.model.store import load_field
from fipt.progress import progress
from fipt.render.environment import sky_of
from fipt.render.picture import Light, Sight, paths_of_ray, pictures
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, SurfaceCache, Triangles, emitter_set
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.cameras import Camera
from fipt.scene.confidence import read_confidence
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import read_emitters, read_names
from fipt.scene.environment import EnvironmentMap, edited, read_environment
from fipt.scene.mesh import Mesh
from fipt.scene.samples import read_samples
from fipt.scene.setup import RelightSetup
from fipt.scene.voxels import read_cache
from fipt.settings import dumped
from fipt.stages.render.cameras import chosen_cameras
from fipt.stages.render.changes import UNCHANGED, Changes, change
from fipt.stages.render.lights import apply_setup, lights_alone
from fipt.stages.render.maps import material_maps
from fipt.stages.render.placement import standing
from fipt.stages.render.settings import MaterialsSettings, OlatSettings, RelightSettings, RenderSettings


def write_materials(
    dataset: Path,
    samples: Path,
    model: Path,
    emitters: Path,
    confidence: Path,
    out: Path,
    manifest: Path,
    settings: MaterialsSettings,
    stats: Stats,
) -> None:
    """Write the material maps of a shard's views, materials/{view}.exr, then their manifest."""
    data, shard = Dataset(dataset), read_samples(samples)
    found, sure = read_emitters(emitters), read_confidence(confidence)
    field = load_field(model)
    scale = field.settings.footprint
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
    samples: Path,
    cache: Path,
    model: Path,
    emitters: Path,
    environment: Path | None,
    setup: RelightSetup | None,
    out: Path,
    manifest: Path,
    settings: RenderSettings | RelightSettings,
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
        Of a setup with its own cameras, those to render; of ``samples`` only the settings are used then.
    segments
        fusion.npz, whose ids the setup may name; None: it names connected parts of the mesh.
    """
    data, shard = Dataset(dataset), read_samples(samples)
    own = None if setup is None else setup.cameras
    seen_by = [data.camera(view) for view in shard.views] if own is None else chosen_cameras(own, data, cameras)
    mesh, found, outside = data.mesh(), read_emitters(emitters), read_environment(environment)
    lit, changes = emitter_set(found), UNCHANGED
    if setup is not None:
        room = mesh
        mesh, lit = apply_setup(room, found, setup, read_names(lamps, found))
        outside = edited(outside, setup.environment)
        mesh, lit, changes = change(room, mesh, lit, setup, segments, outside)
    if own:
        stats["warnings"] = standing(RayScene(mesh), seen_by, data.cameras)
        for warning in stats["warnings"]:
            print(f"warning: {warning}")
    said = {} if setup is None else {"setup": setup.model_dump(mode="json", exclude_defaults=True)}
    shining = {"": (lit, outside)}
    _write_views(stage, seen_by, samples, cache, model, mesh, shining, changes, out, manifest, settings, said, stats)


def write_lamps(
    dataset: Path,
    samples: Path,
    cache: Path,
    model: Path,
    emitters: Path,
    environment: Path | None,
    views: Sequence[str],
    out: Path,
    manifest: Path,
    settings: OlatSettings,
    stats: Stats,
) -> None:
    """Path trace views of a shard with each lamp, and the light from outside, alone: olat/{view}.exr, a layer each.

    Light transport is linear in what the lamps emit, so that sums of these pictures are the room under other light.
    """
    data, shard = Dataset(dataset), read_samples(samples)
    wanted = data.accepted(views)
    strange = [view for view in wanted if view not in shard.views]
    if strange:
        raise FiptError(f"{samples} has no samples of the views {', '.join(strange)}", "give views of that shard")
    alone = lights_alone(read_emitters(emitters), read_environment(environment), settings.separate)
    cameras = [data.camera(view) for view in shard.views if view in wanted and alone]
    _write_views(
        "olat", cameras, samples, cache, model, data.mesh(), alone, UNCHANGED, out, manifest, settings, {}, stats
    )


def _write_views(
    stage: str,
    cameras: Sequence[Camera],
    samples: Path,
    cache: Path,
    model: Path,
    mesh: Mesh,
    shining: Mapping[str, tuple[EmitterSet, EnvironmentMap]],
    changes: Changes,
    out: Path,
    manifest: Path,
    settings: RenderSettings | RelightSettings | OlatSettings,
    said: dict[str, Any],
    stats: Stats,
) -> None:
    """Path trace views under each light, a layer of their files, then write the manifest, which also has ``said``.

    Views are looked at with as many rays a pixel as their samples, but anew: the mesh may have new lamps, and samples
    know no lamps.
    """
    grid = int(read_manifest(Path(f"{samples}.manifest.json"), "samples")["settings"]["grid"])
    field = load_field(model)
    scale = field.settings.footprint
    lights = lights_of(mesh, read_cache(cache), field, list(shining.values()), settings, changes)

    def materials(sight: Sight) -> Brdf:
        return changes.materials(field.query(sight.position, sight.footprint * scale), sight)

    rays = grid**2 * len(lights) * sum(camera.width * camera.height for camera in cameras)
    files = []
    with progress(stage, rays * paths_of_ray(settings.spp, grid), " paths") as bar:
        for camera in cameras:
            seen = pictures(
                lights,
                camera,
                materials,
                grid,
                settings.spp,
                settings.denoise,
                settings.seed,
                bar.advance,
                changes.smooth,
            )
            files.append(out / f"{camera.name}.exr")
            write_exr(files[-1], dict(zip(shining, seen, strict=True)))
        stats["paths_per_s"] = bar.rate
    write_manifest(manifest, stage, files, dumped(settings) | said)


def lights_of(
    mesh: Mesh,
    voxels: dict[str, np.ndarray],
    field: Field,
    shining: Sequence[tuple[EmitterSet, EnvironmentMap]],
    settings: RenderSettings | RelightSettings | OlatSettings,
    changes: Changes,
) -> list[Light]:
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
