"""Give a known room's pictures back: the factorised model with true materials and converged shading.

    fipt run SCENE --configfile FILE
    python -m benchmarks.rendered_back SCENE --configfile FILE [--spp 1024] [--picture OUT.png]

kd Ld + ks Ls0 + Ls1 of the held-out views, path traced by this program with the room's own materials and lamps, against
the pictures that Mitsuba's integrator made: median ratio and PSNR over pixels that show no lamp, and over those inside
surfaces. The two share the scene and nothing else.
"""

import argparse
import sys
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fipt.config import RESULTS, read
from fipt.config.sources.mitsuba import MitsubaRoom
from fipt.conventions import LUMINANCE
from fipt.formats.images import srgb_encode, to_display, write_png
from fipt.model.networks import Brdf
from fipt.progress import progress
from fipt.render.environment import sky_of
from fipt.render.image import ImageSampling, LitRoom, render_images
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, SurfaceCache, Triangles
from fipt.render.tracer import PathSettings, Shader
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import FRONT
from fipt.scene.environment import covered_share
from fipt.scene.samples import read_samples
from fipt.scene.voxels import read_cache
from fipt.stages.evaluate.metrics import psnr
from fipt.synthetic.dataset import built
from fipt.synthetic.room import SyntheticRoom
from fipt.synthetic.settings import SynthesizeSettings
from fipt.synthetic.views import Truth


def true_brdf(truth: Truth, camera: Camera, rays: np.ndarray) -> Brdf:
    """Base colour (N, 3), roughness and metallic (N,) of what a camera's rays (N, 3) meet."""
    found = truth.trace(np.broadcast_to(camera.center.astype(np.float32), rays.shape), rays)
    return Brdf(found["base_color"], found["roughness"], found["metallic"])


def light_of(room: SyntheticRoom, voxels: dict, known: list[tuple[np.ndarray, Brdf]]) -> LitRoom:
    """Return the room under its own light; voxels have the material of the nearest of the known points."""
    _, nearest = cKDTree(np.concatenate([position for position, _ in known])).query(voxels["point"])
    materials = Brdf(
        *(
            np.concatenate([getattr(brdf, key) for _, brdf in known])[nearest]
            for key in ("base_color", "roughness", "metallic")
        )
    )
    lamps = np.flatnonzero(room.emits).astype(np.int32)
    lit = EmitterSet(lamps, room.radiance[lamps], np.full(len(lamps), FRONT, np.int8))
    nothing = np.zeros((len(voxels["key"]), 3), np.float32)
    surface = SurfaceCache(voxels, nothing, np.zeros(len(nothing), bool), materials)
    path = PathSettings(SynthesizeSettings().max_depth, cache_roughness=1.0, light_at_first=True)
    shader = Shader(RayScene(room.mesh), Triangles(room.mesh, lit), surface, path, sky_of(room.outside))
    return LitRoom(room.mesh, lit, room.outside, shader)


def main() -> int:
    """Print the comparison; perhaps draw it."""
    parser = argparse.ArgumentParser("python -m benchmarks.rendered_back", description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--configfile", type=Path, required=True)
    parser.add_argument("--config", nargs="*", default=[], metavar="KEY=VALUE")
    parser.add_argument("--spp", type=int, default=1024, help="paths per pixel")
    parser.add_argument("--picture", type=Path, help="a row a view: the picture, ours, five times the difference")
    arguments = parser.parse_args()
    scene = read([arguments.configfile], arguments.config).scenes[arguments.scene]
    set_variant()
    root = Path(RESULTS, scene.name)
    data = Dataset(root / "dataset")
    file = Path(scene.source.path) if isinstance(scene.source, MitsubaRoom) else None
    room = built(root / "dataset", scene.settings["synthesize"], file)
    truth = Truth(room)
    known = []
    shards = {name: read_samples(root / "samples" / name) for name in scene.views.shards("all")}
    for samples in shards.values():
        for index, view in enumerate(samples.views):
            camera, position = data.camera(view), np.asarray(samples.position[samples.of_view(index)])
            rays = position - camera.center.astype(np.float32)
            known.append((position, true_brdf(truth, camera, rays / np.linalg.norm(rays, axis=1, keepdims=True))))
    light = light_of(room, read_cache(root / "cache.npz"), known)
    grid = scene.settings["samples"].grid
    ratio, error, inside, rows = [], [], [], []
    held_out = [shards[name] for name in scene.views.shards("val")]
    with progress("paths", sum(len(samples.center) for samples in held_out) * arguments.spp, " paths") as bar:
        for samples in held_out:
            for index, view in enumerate(samples.views):
                camera, (image, valid) = data.camera(view), data.image(view)
                brdf = partial(true_brdf, truth, camera)
                sampling = ImageSampling(grid, arguments.spp, denoise=True, seed=0)
                (picture,) = render_images([light], camera, lambda si, brdf=brdf: brdf(-si.wo), sampling, bar.advance)
                pixels, own = samples.pixels(index), samples.of_view(index)
                shines = room.emits[np.asarray(samples.triangle[own])]
                lamp = np.bincount(samples.pixel_of_sample(index), shines, image.shape[0] * image.shape[1]) > 0
                lamp = (lamp | (covered_share(samples, index) < 1)).reshape(image.shape[:2])
                single = np.diff(samples.offsets[pixels.start : pixels.stop + 1]).reshape(image.shape[:2]) == 1
                shown = ~lamp & (valid > 0)
                gray = np.float32(LUMINANCE)
                ratio.append((picture @ gray)[shown] / np.maximum((image @ gray)[shown], 1e-4))
                toned = [srgb_encode(np.clip(part, 0, 1)) for part in (picture, image)]
                square = (toned[0] - toned[1]) ** 2
                error.append(square[shown])
                inside.append(square[shown & single])
                rows.append(
                    np.concatenate(list(map(to_display, (image, picture, 5 * np.abs(picture - image)))), axis=1)
                )
    quartiles = np.percentile(np.concatenate(ratio), [50, 25, 75])
    print(f"{len(ratio)} views, {sum(map(len, ratio))} pixels without lamps, {arguments.spp} paths a pixel")
    print("median ratio {:.3f} (quartiles {:.3f}, {:.3f})".format(*quartiles))
    tone_mapped, within = (psnr(float(np.concatenate(squares).mean())) for squares in (error, inside))
    print(f"PSNR tone-mapped {tone_mapped:.1f} dB, inside surfaces {within:.1f} dB")
    if arguments.picture:
        write_png(arguments.picture, np.concatenate(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
