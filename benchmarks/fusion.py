"""Time and memory of the fusion of segments: many views of the room in code, cut into many triangles.

    python -m benchmarks.fusion [--views 200] [--triangles 500000]

The ids of the views are true ones, degraded as in `benchmarks.segmentation`. One line is printed: wall time and peak
memory of `fipt fuse`, a process of its own.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.scaling import call, halved
from fipt.stages.segment.degraded import degraded, renumbered

SIZE = (640, 320)


def write_scene(root: Path, views: int, triangles: int) -> int:
    """Write dataset and segments/views of so many views; return the mesh's triangles."""
    from fipt.render.scene import RayScene
    from fipt.render.variant import set_variant
    from fipt.scene.cameras import write_transforms
    from fipt.scene.dataset import write_views
    from fipt.scene.mesh import write_ply
    from fipt.scene.segments import write_view_ids
    from fipt.stages.segment.views import observe
    from fipt.synthetic.poses import OpenSpace, sample_cameras
    from fipt.synthetic.room import build
    from fipt.synthetic.settings import SynthesizeSettings

    set_variant()
    room = build(0)
    settings = SynthesizeSettings(train_views=views, val_views=1, width=SIZE[0], height=SIZE[1])
    tracer = RayScene(room.mesh)
    # the held-out view is not needed, but there has to be one
    cameras = sample_cameras(OpenSpace(room, tracer.intersect, settings.seed), settings)[:views]
    mesh, part = room.mesh, room.part
    observations = observe(mesh, cameras, root)
    for number, camera in enumerate(cameras):
        rng = np.random.default_rng([0, number])
        cell, _ = observations.of(number)
        true = np.where(cell >= 0, part[cell], 0).reshape(camera.height, camera.width)
        ids = renumbered(degraded(true.astype(np.uint16), rng), rng)
        write_view_ids(root / "segments" / "views" / f"{camera.name}.npz", ids, np.zeros(int(ids.max()) + 1, np.int32))
    while len(mesh.triangles) < triangles:
        mesh = halved(mesh)
    write_ply(root / "dataset" / "mesh.ply", mesh)
    write_transforms(root / "dataset" / "transforms.json", cameras)
    write_views(root / "dataset" / "views.json", [camera.name for camera in cameras])
    return len(mesh.triangles)


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.fusion", description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--triangles", type=int, default=500_000, help="at least so many")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        triangles = write_scene(root, arguments.views, arguments.triangles)
        used = call(
            "fuse",
            ["--dataset", "dataset", "--segments", "segments", "--stats", "stats.json"],
            Path("stats.json"),
            root,
        )
    print(
        f"fusion of {arguments.views} views of {SIZE[0]}x{SIZE[1]} on {triangles:,} triangles: {used.seconds:.0f} s "
        f"({used.processor:.0f} s of processor), peak {used.peak / 1e3:.2f} GB"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
