"""The samples stage: footprint samples of all camera rays of a shard, traced once."""

from collections.abc import Sequence

from fipt.errors import FiptError
from fipt.formats.manifests import Stats
from fipt.progress import progress
from fipt.render.footprint import joined, trace_view
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import connected_parts
from fipt.scene.samples import FootprintSamples
from fipt.stages.samples.settings import SamplesSettings


def trace(dataset: Dataset, views: Sequence[str], settings: SamplesSettings, figures: Stats) -> FootprintSamples:
    """Trace the given views; what was found goes into ``figures`` too.

    Views that a check rejected are left out.

    Raises
    ------
    FiptError
        If all rays of a view miss the mesh.
    """
    mesh = dataset.mesh()
    scene, parts = RayScene(mesh), connected_parts(mesh)
    cameras = [dataset.camera(view) for view in dataset.accepted(list(views))]
    results, sparse = [], []
    rays = settings.grid**2
    with progress("samples", sum(c.width * c.height for c in cameras) * rays, " rays") as bar:
        for camera in cameras:
            result = trace_view(scene, parts, camera, settings)
            seen = float((result["counts"] > 0).mean())
            if seen == 0:
                raise FiptError(
                    f"view {camera.name}: all rays miss the mesh",
                    "check the camera's pose and axes, or leave the view out",
                )
            if seen < 0.5:
                sparse.append(camera.name)
            results.append(result)
            bar.advance(camera.width * camera.height * rays)
        figures["rays_per_s"] = bar.rate
    samples = joined(cameras, results)
    figures["samples_per_pixel"] = len(samples.position) / max(samples.first_pixels[-1], 1)
    figures["views_mostly_off_mesh"] = sparse
    return samples
