"""How good the shading of every round is: judged with the true materials, for rooms whose truth is known.

``python -m benchmarks.true_shading results/SCENE`` prints, for each round, kd Ld + ks Ls0 + Ls1 of the true materials
against the training pixels that one sample fills: PSNR of sRGB-encoded radiance, and quantiles of the
ratio. With ``--trace`` it also path traces every 24th of them with the true materials and the emitters that were found:
what is left then is no error of the materials.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from fipt.formats.images import srgb_encode
from fipt.model.networks import Brdf
from fipt.model.reflectance import diffuse_reflectance, specular_reflectance, specular_shading
from fipt.render.points import Points, spread_points
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples, read_samples
from fipt.scene.shading import read_shading
from fipt.scene.voxels import facings, read_cache

_EVERY = 24
_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_TURN = 4
"""Voxels that surface of another facing counts as further away."""


class Truth:
    """Samples that fill a pixel of a surface which does not emit, with what is true there.

    Attributes
    ----------
    data, shard
        The dataset and the samples of its first training shard.
    sample
        (N,) int64 such samples.
    radiance
        (N, 3) observed.
    materials
        True base colour (N, 3), roughness and metallic (N,).
    """

    def __init__(self, root: Path) -> None:
        self.data, self.shard = Dataset(root / "dataset"), read_samples(root / "samples" / "train-000")
        layers = [self.data.truth(view) for view in self.shard.views]
        if not all(layers):
            raise SystemExit(f"{root} has no truth to judge with")
        offsets = np.asarray(self.shard.offsets)
        flat = {name: _joined([layer[name] for layer in layers]) for name in ("base_color", "roughness", "metallic")}
        emits = _joined([layer["emission_mask"] for layer in layers]) > 0
        image = [self.data.image(view) for view in self.shard.views]
        whole = _joined([weight for _, weight in image]) > 0.99
        pixel = np.flatnonzero((np.diff(offsets) == 1) & (np.asarray(self.shard.center) > 0) & ~emits & whole)
        self.sample, self.radiance = offsets[pixel], _joined([photo for photo, _ in image])[pixel]
        self.materials = Brdf(
            flat["base_color"][pixel], np.clip(flat["roughness"][pixel], 0.02, 1), flat["metallic"][pixel]
        )

    def judged(self, shading: np.ndarray, rows: slice = slice(None)) -> str:
        """PSNR and ratio of the radiance that shading (N, outputs, 3) of some rows gives with the true materials."""
        base, metallic = self.materials.base_color[rows], self.materials.metallic[rows][:, None]
        ls0, ls1 = specular_shading(shading, self.materials.roughness[rows])
        kd, ks = diffuse_reflectance(base, metallic), specular_reflectance(base, metallic)
        modelled, seen = kd * shading[:, 0] + ks * ls0 + ls1, self.radiance[rows]
        error = np.mean((srgb_encode(np.maximum(modelled, 0)) - srgb_encode(np.maximum(seen, 0))) ** 2)
        lit = seen.mean(axis=1) > 0.01  # ratios of nothing say nothing
        ratio = np.quantile(modelled.mean(axis=1)[lit] / seen.mean(axis=1)[lit], _QUANTILES)
        return f"{-10 * np.log10(error):6.2f} dB   " + "  ".join(f"{value:.3f}" for value in ratio)

    def traced(self, root: Path, last: Path) -> np.ndarray:
        """Shading of every 24th sample, path traced with true materials and the emitters of round ``last``."""
        from fipt.render.surface import emitter_set
        from fipt.render.tracer import PathSettings
        from fipt.scene.emitters import read_emitters
        from fipt.stages.shade.integrate import points_per_sample, shade_chunk
        from fipt.stages.shade.refine import path_shader
        from fipt.stages.shade.settings import RefineSettings

        cache, settings = read_cache(root / "cache.npz"), RefineSettings()
        size = float(cache["side"]) / int(cache["resolution"])
        place = np.asarray(self.shard.position)[self.sample]
        tree = cKDTree(_turned(place, facings(np.asarray(self.shard.normal)[self.sample]), _TURN * size))
        near = tree.query(_turned(cache["point"], cache["facing"], _TURN * size))[1]
        true = Brdf(
            *(values[near].astype(np.float32) for values in vars(self.materials).values())
        )  # of the nearest sample that faces the same way
        path = PathSettings(settings.max_depth, settings.cache_roughness, settings.light_sampling)
        shader = path_shader(self.data.mesh(), cache, true, emitter_set(read_emitters(last / "emitters.npz")), path)
        per_sample = points_per_sample(settings)
        points = _points(self.data, self.shard, self.sample[::_EVERY], per_sample)
        return shade_chunk(shader, points, settings, per_sample)


def _joined(images: Sequence[np.ndarray]) -> np.ndarray:
    """Pixels of images (H, W) or (H, W, 3), one after the other."""
    return np.concatenate([image.reshape(-1, *image.shape[2:]) for image in images])


def _turned(points: np.ndarray, facing: np.ndarray, turn: float) -> np.ndarray:
    """(N, 6) points, and the axis that they face times ``turn``."""
    axis = np.repeat(np.eye(3), 2, axis=0) * np.tile([[-1.0], [1.0]], (3, 1))
    return np.concatenate([points, turn * axis[facing]], axis=1)


def _points(data: Dataset, shard: FootprintSamples, sample: np.ndarray, per_sample: int) -> Points:
    """Samples of a shard as points to shade, ``per_sample`` a sample."""
    normals = data.mesh().normals
    cameras = [data.camera(view) for view in shard.views]
    views = [spread_points(shard, index, camera, normals, per_sample, 0) for index, camera in enumerate(cameras)]
    rows = (per_sample * sample[:, None] + np.arange(per_sample)).reshape(-1)
    return Points(*(np.concatenate([vars(view)[name] for view in views])[rows] for name in vars(views[0])))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--trace", action="store_true")
    options = parser.parse_args()
    truth = Truth(options.results)
    rounds = sorted(options.results.glob("round-*"), key=lambda path: int(path.name.rpartition("-")[2]))
    print("shading                 PSNR   ratio: " + ", ".join(str(q) for q in _QUANTILES))
    for path in rounds:
        shading = read_shading(path / "shading" / "train-000", truth.shard)[truth.sample]
        print(f"{path.name:20s} {truth.judged(shading)}")
    if options.trace:
        from fipt.render.variant import set_variant

        set_variant()
        traced = truth.traced(options.results, rounds[-1])
        print(f"{'true materials':20s} {truth.judged(traced, slice(None, None, _EVERY))}")


if __name__ == "__main__":
    main()
