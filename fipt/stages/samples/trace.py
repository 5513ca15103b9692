"""The samples stage: footprint samples of all camera rays of a shard, traced once."""

from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import atomic_folder
from fipt.formats.manifests import Stats, write_manifest
from fipt.progress import progress
from fipt.render.footprint import joined, trace_view
from fipt.render.scene import RayScene
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import connected_parts
from fipt.scene.samples import write_samples
from fipt.settings import dumped
from fipt.stages.samples.settings import SamplesSettings


def write_shard(dataset: Dataset, views: list[str], out: Path, settings: SamplesSettings, stats: Stats) -> None:
    """Trace the given views and write their samples to ``out``, with a manifest beside it.

    Views that a check rejected are left out.

    Raises
    ------
    FiptError
        If all rays of a view miss the mesh.
    """
    mesh = dataset.mesh()
    scene, parts = RayScene(mesh), connected_parts(mesh)
    cameras = [dataset.camera(view) for view in dataset.accepted(views)]
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
        stats["rays_per_s"] = bar.rate
    samples = joined(cameras, results)
    stats["samples_per_pixel"] = len(samples.position) / max(samples.first_pixels[-1], 1)
    stats["views_mostly_off_mesh"] = sparse
    if sparse:
        print(f"warning: more than half of the pixels miss the mesh in {', '.join(sparse)}")
    out = Path(out)
    with atomic_folder(out) as folder:
        names = [file.name for file in write_samples(folder, samples)]
    write_manifest(
        out.with_name(out.name + ".manifest.json"),
        "samples",
        [out / name for name in names],
        dumped(settings),
    )
