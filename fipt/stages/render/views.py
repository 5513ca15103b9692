"""A fitted scene, perhaps changed by a setup, as cameras see it: one file a view, one layer an illumination."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.formats.exr import write_exr
from fipt.formats.files import check_disk, check_memory
from fipt.formats.manifests import withdraw_manifest, write_manifest
from fipt.model.fitted import FittedScene
from fipt.model.networks import Brdf
from fipt.progress import progress
from fipt.render.environment import sky_of
from fipt.render.image import ImageSampling, LitRoom, SurfaceInteractions, render_images
from fipt.render.scene import RayScene
from fipt.render.surface import SurfaceCache, Triangles, emitter_set
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.cameras import Camera
from fipt.scene.emitters import read_names
from fipt.scene.environment import edited
from fipt.scene.mesh import Mesh
from fipt.scene.setup import RelightSetup
from fipt.settings import dumped
from fipt.stages.render.changes import UNCHANGED, Changes, change
from fipt.stages.render.lights import Illumination, apply_setup
from fipt.stages.render.settings import OlatSettings, RelightSettings, RenderSettings

_BYTES_A_PIXEL = 450
"""Of memory while an image is traced: measured 446."""
_BYTES_ON_DISK = 12
"""Of a pixel of a layer in its file: measured 12.1, since noise does not compress."""


@dataclass(frozen=True)
class StagedScene:
    """A fitted scene ready to be rendered.

    Attributes
    ----------
    fitted
        The room as it was fitted. Paths follow its model alone: the photographs' radiance is not read, so that the
        same holds under other light.
    mesh
        The room's, with lights and objects of a setup.
    illuminations
        Layer -> light. All have the same emitting triangles.
    changes
        What a setup changes beside the light.
    """

    fitted: FittedScene
    mesh: Mesh
    illuminations: Mapping[str, Illumination]
    changes: Changes = UNCHANGED

    @classmethod
    def as_fitted(cls, fitted: FittedScene) -> "StagedScene":
        """Return the room under its own light."""
        return cls(fitted, fitted.mesh, {"": Illumination(emitter_set(fitted.emitters), fitted.environment)})

    @classmethod
    def relit(
        cls, fitted: FittedScene, setup: RelightSetup, listed: Path | None = None, segments: Path | None = None
    ) -> "StagedScene":
        """Return the room under a setup.

        Parameters
        ----------
        listed
            emitters.json with the names by which the setup chooses emitters; None: their default names.
        segments
            fusion.npz, whose ids the setup may name; None: it names connected parts of the mesh.

        Raises
        ------
        FiptError
            If the setup names an emitter or a segment that does not exist.
        """
        mesh, lit = apply_setup(fitted.mesh, fitted.emitters, setup, read_names(listed, fitted.emitters))
        environment = edited(fitted.environment, setup.environment)
        mesh, lit, changes = change(fitted.mesh, mesh, lit, setup, segments, environment)
        return cls(fitted, mesh, {"": Illumination(lit, environment)}, changes)

    def materials(self, si: SurfaceInteractions) -> Brdf:
        """Reflectance of points, which the model tells anew: samples know no new surfaces."""
        return self.changes.materials(self.fitted.reflectance(si.position, si.normal, si.footprint, si.triangle), si)

    def lit_rooms(self, max_depth: int) -> list[LitRoom]:
        """Return the room under each of its illuminations, with a tracer of paths of so many vertices."""
        voxels = self.fitted.cache
        scene, nothing = RayScene(self.mesh), np.zeros((len(voxels["key"]), 3), np.float32)
        records = self.changes.records(self.fitted.cached_materials(), voxels["point"], voxels["facing"], scene)
        unknown = np.zeros(len(nothing), bool)
        objects = self.changes.of_triangles(), self.changes.first_object
        surface = SurfaceCache(voxels, nothing, unknown, records, *objects)
        path = PathSettings(max_depth, cache_roughness=1.0, light_at_first=True)

        def lit(light: Illumination) -> LitRoom:
            triangles, sky = Triangles(self.mesh, light.emitters), sky_of(light.environment)
            shader = Shader(scene, triangles, surface, path, sky, self.changes.spots)
            return LitRoom(self.mesh, light.emitters, light.environment, shader)

        return [lit(light) for light in self.illuminations.values()]


@dataclass(frozen=True)
class Destination:
    """Where the images of a stage go: ``folder/{view}.exr``, listed in a manifest."""

    stage: str
    folder: Path
    manifest: Path


def write_views(
    scene: StagedScene,
    cameras: Sequence[Camera],
    settings: RenderSettings | RelightSettings | OlatSettings,
    rays_per_side: int,
    to: Destination,
    noted: Mapping[str, object] | None = None,
) -> float:
    """Path trace views under each illumination, a layer of their files, then write the manifest.

    Views are looked at anew, not through their samples: the mesh may have new emitters, and samples know no emitters.

    Parameters
    ----------
    rays_per_side
        A pixel is looked through by the square of this many rays.
    noted
        What stands in the manifest beside the settings.

    Returns
    -------
    Paths per second.
    """
    sampling = ImageSampling(rays_per_side, settings.spp, settings.denoise, settings.seed)
    largest = max((camera.width * camera.height for camera in cameras), default=0)
    check_memory(_BYTES_A_PIXEL * largest, f"an image of the stage {to.stage}", "use smaller images")
    pixels = sum(camera.width * camera.height for camera in cameras)
    needed = _BYTES_ON_DISK * pixels * len(scene.illuminations)
    check_disk(to.folder, needed, f"the output of the stage {to.stage}")
    rooms = scene.lit_rooms(settings.max_depth)
    withdraw_manifest(to.manifest)
    files = []
    with progress(to.stage, len(rooms) * sampling.paths(cameras), " paths") as bar:
        for camera in cameras:
            images = render_images(rooms, camera, scene.materials, sampling, bar.advance, scene.changes.smooth)
            files.append(to.folder / f"{camera.name}.exr")
            write_exr(files[-1], dict(zip(scene.illuminations, images, strict=True)))
        rate = bar.rate
    write_manifest(to.manifest, to.stage, files, dumped(settings) | dict(noted or {}))
    return rate
