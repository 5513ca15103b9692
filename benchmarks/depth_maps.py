"""Depth maps as multi-view stereo gives them, of a room whose true mesh is known: for work on what comes after.

    python -m benchmarks.depth_maps results/NAME/dataset depth [--noise 0.004] [--texture 0.02]
    python -m benchmarks.depth_maps results/NAME/dataset rgbd --sensor 0.01

Depth of the true mesh from the training views. Noise has the standard deviation ``--noise`` metres at 2 m, grows with
the square of the depth, and neighbours share it, since windows overlap. Unknown are pixels whose surroundings show less
than ``--texture`` of contrast in log radiance (bare walls), those at outlines, and some at random; a few are wrong.

With ``--sensor``, depth is that of a depth camera instead: PNG of 16 bits in millimetres, for `depth.given`, with noise
of so many metres in every pixel by itself, 0 at outlines.
"""

import argparse
import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, uniform_filter

from fipt.conventions import LUMINANCE
from fipt.formats.images import write_png
from fipt.render.scene import RayScene
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.depth_maps import DepthMap, write_depth_map

log = logging.getLogger(__name__)

WINDOW = 7
"""Side of the window, pixels, that stereo would compare."""
SHARED = 1.5
"""Standard deviation, pixels, of the filter that makes neighbours' noise alike."""
OUTLINE = 0.03
"""Relative step of depth between neighbours that is an outline."""
SENSED = 0.15
"""The same for a depth camera: floors that are seen at a slant have none."""
LOST, WRONG = 0.05, 0.005
"""Shares of pixels that are unknown, and that hold a wrong depth."""
NORMALS = 4.0
"""Standard deviation of the normals' error at 2 m, degrees."""


@dataclass(frozen=True)
class StereoSettings:
    """How good the depth is: ``noise`` at 2 m, metres; least ``texture``, contrast in log radiance."""

    noise: float = 0.004
    texture: float = 0.02


def true_depth(scene: RayScene, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) depth of a view, metres, 0 where it sees nothing, and (H, W, 3) normals that face it."""
    shape = camera.height, camera.width
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns, rows).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center, directions)
    along = directions.astype(np.float64) @ -camera.world_from_camera[:3, 2]
    depth = np.where(triangle >= 0, distance * along, 0.0).reshape(shape)
    normal = scene.normals[triangle]
    return depth, (normal * -np.sign((normal * directions).sum(axis=1, keepdims=True))).reshape(*shape, 3)


def simulated(
    scene: RayScene, camera: Camera, radiance: np.ndarray, settings: StereoSettings, rng: np.random.Generator
) -> DepthMap:
    """Depth map of one view with (H, W, 3) radiance."""
    depth, normal = true_depth(scene, camera)
    shape = depth.shape
    luminance = radiance @ np.array(LUMINANCE)
    seen = np.log(luminance + 0.02 * max(float(np.median(luminance)), 1e-9))
    contrast = np.sqrt(np.maximum(uniform_filter(seen**2, WINDOW) - uniform_filter(seen, WINDOW) ** 2, 0))
    step = maximum_filter(depth, 3) / np.maximum(minimum_filter(depth, 3), 1e-6) - 1
    known = (depth > 0) & (contrast > settings.texture) & (rng.random(shape) > LOST)
    known &= step < OUTLINE
    grain = gaussian_filter(rng.standard_normal(shape), SHARED)
    error = settings.noise * (depth / 2) ** 2 * grain / grain.std()
    depth = depth + error
    wrong = rng.random(shape) < WRONG
    depth = np.where(wrong, depth * rng.uniform(0.6, 1.2, shape), depth)
    tilt = np.stack([gaussian_filter(rng.standard_normal(shape), SHARED) for _ in range(3)], axis=-1)
    normal = normal + np.radians(NORMALS) * (depth / 2)[..., None] * tilt / tilt.std()
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    confidence = np.where(known, np.clip(contrast / (contrast + settings.texture), 0, 1), 0)
    return DepthMap(
        np.where(known, depth, 0).astype(np.float32),
        confidence.astype(np.float32),
        np.where(known[..., None], normal, 0).astype(np.float32),
    )


def sensed(scene: RayScene, camera: Camera, noise: float, rng: np.random.Generator) -> np.ndarray:
    """(H, W) uint16 millimetres that a depth camera with noise of so many metres tells; 0 at outlines."""
    depth, _ = true_depth(scene, camera)
    step = maximum_filter(depth, 3) / np.maximum(minimum_filter(depth, 3), 1e-6) - 1
    millimetres = np.rint(1000 * (depth + rng.normal(0, noise, depth.shape)))
    return np.where((depth > 0) & (step < SENSED), np.clip(millimetres, 1, 65535), 0).astype(np.uint16)


def main() -> int:
    """Write the depth maps of a dataset's training views."""
    parser = argparse.ArgumentParser("python -m benchmarks.depth_maps", description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, help="dataset folder of a room with a true mesh")
    parser.add_argument("out", type=Path, help="folder to write")
    defaults = StereoSettings()
    parser.add_argument("--noise", type=float, default=defaults.noise, help="standard deviation at 2 m, metres")
    parser.add_argument("--texture", type=float, default=defaults.texture, help="least contrast in log radiance")
    parser.add_argument("--sensor", type=float, help="noise of a depth camera, metres: PNG files in place of EXR")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    set_variant()
    dataset, rng = Dataset(args.dataset), np.random.default_rng(args.seed)
    settings, scene = StereoSettings(args.noise, args.texture), RayScene(dataset.mesh())
    args.out.mkdir(parents=True, exist_ok=True)
    for view in dataset.views("train"):
        if args.sensor is not None:
            millimetres = sensed(scene, dataset.camera(view), args.sensor, rng)
            write_png(args.out / f"{view}.png", millimetres)
            log.info("%s: %.0f %% known", view, 100 * (millimetres > 0).mean())
            continue
        found = simulated(scene, dataset.camera(view), dataset.image(view)[0], settings, rng)
        write_depth_map(args.out / f"{view}.exr", found)
        log.info("%s: %.0f %% known", view, 100 * found.known.mean())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
