"""The samples stage: footprint samples of all camera rays of a shard, traced once."""

from collections.abc import Sequence
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import check_disk, check_memory
from fipt.formats.manifests import Stats
from fipt.progress import progress
from fipt.render.footprint import joined, trace_view
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import connected_parts
from fipt.scene.samples import FootprintSamples
from fipt.stages.samples.settings import SamplesSettings

_BYTES_A_RAY = 200
"""Of memory while a view is traced: measured 176 to 212."""
_BYTES_A_PIXEL = 300
"""Of memory for the samples of a pixel until all views are traced: measured 105 and 241."""
_BYTES_ON_DISK = 140
"""Of a pixel's samples in their files: measured 98 to 133, for 1.2 to 1.6 samples a pixel."""


def trace(
    dataset: Dataset, views: Sequence[str], settings: SamplesSettings, figures: Stats, out: Path | None = None
) -> FootprintSamples:
    """Trace the given views; what was found goes into ``figures`` too.

    Views that a check rejected are left out. ``out`` is where the samples will be written: its disk must have room.

    Raises
    ------
    FiptError
        If all rays of a view miss the mesh; if memory or the disk are too small.
    """
    cameras = [dataset.camera(view) for view in dataset.accepted(list(views))]
    rays = settings.grid**2
    pixels = [camera.width * camera.height for camera in cameras]
    _check_memory(pixels, rays)
    if out is not None:
        check_disk(out.parent, _BYTES_ON_DISK * sum(pixels), "a shard of samples")
    mesh = dataset.mesh()
    scene, parts = RayScene(mesh), connected_parts(mesh)
    results, sparse = [], []
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


def _check_memory(pixels: Sequence[int], rays: int) -> None:
    """Refuse what needs more memory than there is: all views' samples, and the rays of the largest view."""
    needed = _BYTES_A_PIXEL * sum(pixels) + _BYTES_A_RAY * rays * max(pixels, default=0)
    check_memory(needed, "tracing the samples", "use smaller images, a smaller samples.grid or views_per_shard")
