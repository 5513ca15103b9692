"""The hits stage: first hits of all camera rays of a shard, traced once."""

from pathlib import Path

from fipt.errors import FiptError
from fipt.io.dataset import Dataset
from fipt.io.files import atomic_folder
from fipt.io.hits import write_hits
from fipt.io.manifests import Stats, write_manifest
from fipt.io.meshes import connected_parts
from fipt.progress import progress
from fipt.render.first_hits import joined, trace_view
from fipt.render.scene import RayScene
from fipt.settings import Hits as HitsSettings
from fipt.settings import dumped


def write_shard(dataset: Dataset, views: list[str], out: Path, settings: HitsSettings, stats: Stats) -> None:
    """Trace the given views and write their hits to ``out``, with a manifest beside it.

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
    with progress("hits", sum(c.width * c.height for c in cameras) * rays, " rays") as bar:
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
    hits = joined(cameras, results)
    stats["hits_per_pixel"] = len(hits.position) / max(hits.first_pixels[-1], 1)
    stats["views_mostly_off_mesh"] = sparse
    if sparse:
        print(f"warning: more than half of the pixels miss the mesh in {', '.join(sparse)}")
    out = Path(out)
    with atomic_folder(out) as folder:
        names = [file.name for file in write_hits(folder, hits)]
    write_manifest(
        out.with_name(out.name + ".manifest.json"),
        "hits",
        [out / name for name in names],
        dumped(settings),
    )
