"""Shading of the samples of a shard, view by view: sampling plan, denoising, storage. Shared by bake and refine."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fipt.conventions import ROUGHNESS_LEVELS, SHADING_OUTPUTS, SUB_POSITIONS
from fipt.formats.files import atomic_folder, check_disk, check_memory, manifest_beside
from fipt.formats.manifests import Stats, withdraw_manifest, write_manifest
from fipt.progress import progress
from fipt.render.layers import denoise_samples
from fipt.render.points import Points, shade_in_chunks, spread_points
from fipt.render.tracer import Shader
from fipt.scene.dataset import Dataset
from fipt.scene.samples import FootprintSamples
from fipt.scene.shading import Shading, save_shading
from fipt.settings import dumped
from fipt.stages.shade.settings import BakeSettings, RefineSettings

_LEVELS = len(ROUGHNESS_LEVELS)
HOLDS = r"\w+\.(npy|npz|json)"
"""Names in a folder of shading, as a regular expression."""
_BYTES_A_SAMPLE = 2150
"""Of memory, a sample of the largest view: measured 1470 to 1700 in bake, 1810 in refine; its points take 130."""


def sampling_plan(settings: BakeSettings | RefineSettings) -> list[tuple[list[int], list[int]]]:
    """Return kernel runs as (samples of each lobe, outputs taken from the run).

    ``shared``: one run whose rays serve all outputs. ``separate``: one run a lobe, as the paper.
    """
    specular = [settings.smooth_spp] + [settings.specular_spp] * (_LEVELS - 1)
    counts = [settings.diffuse_spp, *specular]
    if settings.sampling == "shared":
        return [(counts, list(range(SHADING_OUTPUTS)))]
    runs = []
    for lobe, count in enumerate(counts):
        only = [count if other == lobe else 0 for other in range(len(counts))]
        runs.append((only, [0] if lobe == 0 else [lobe, lobe + _LEVELS]))
    return runs


def points_per_sample(settings: BakeSettings | RefineSettings) -> int:
    """Points of a footprint sample that share its paths: all that are stored if they divide each lobe's, else one."""
    counts = settings.diffuse_spp, settings.specular_spp, settings.smooth_spp
    return 1 if any(count % SUB_POSITIONS for count in counts) else SUB_POSITIONS


def shade_chunk(
    shader: Shader, chunk: Points, settings: BakeSettings | RefineSettings, per_sample: int = 1
) -> np.ndarray:
    """(N / per_sample, outputs, 3) float32 shading of samples, by N points, by the settings' sampling plan."""
    result = np.empty((len(chunk.position) // per_sample, SHADING_OUTPUTS, 3), np.float32)
    for counts, outputs in sampling_plan(settings):
        result[:, outputs] = shader.shade(chunk, ROUGHNESS_LEVELS, counts, per_sample)[:, outputs]
    return result


def denoise_shading(values: np.ndarray, samples: FootprintSamples, index: int) -> np.ndarray:
    """Denoise the (N, outputs, 3) shading of view number ``index``.

    Ls0 and Ls1 of a level come from the same samples: their sum is denoised and split as the samples split it. The
    smoothest level keeps its detail, since denoisers take reflections for noise.
    """
    rough0, rough1 = values[:, 2 : 1 + _LEVELS], values[:, 2 + _LEVELS :]
    total = rough0 + rough1
    clean = denoise_samples(np.concatenate([values[:, :1], total], axis=1), samples, index, "fast")
    scale = clean[:, 1:] / np.maximum(total, 1e-8)
    result = values.copy()
    result[:, 0] = clean[:, 0]
    result[:, 2 : 1 + _LEVELS], result[:, 2 + _LEVELS :] = rough0 * scale, rough1 * scale
    return result


def write_shading(
    stage: str,
    shader: Shader,
    dataset: Dataset,
    samples: FootprintSamples,
    settings: BakeSettings | RefineSettings,
    out: Path,
    compare: Callable[[Shading, Path], None] | None = None,
) -> Stats:
    """Shade all samples of a shard and write ``out``/shading.npy and the manifest beside ``out``; return figures.

    ``compare`` is given the shading and the folder in which it is stored: it may write more there.
    """
    stats: Stats = {}
    shading = Shading.empty(len(samples.position))
    parts = [samples.of_view(index) for index in range(len(samples.views))]
    needed = _BYTES_A_SAMPLE * max((own.stop - own.start for own in parts), default=0) + shading.nbytes
    check_memory(needed, f"the {stage} shading", "use smaller images, or a smaller samples.grid or views_per_shard")
    check_disk(out.parent, (1 if compare is None else 2) * shading.nbytes, f"the {stage} shading")
    paths, per_sample = sum(sum(counts) for counts, _ in sampling_plan(settings)), points_per_sample(settings)
    with progress(stage, len(samples.position) * paths, " paths") as bar:
        for index, view in enumerate(samples.views):
            camera = dataset.camera(view)
            points = spread_points(samples, index, camera, shader.scene.normals, per_sample, settings.seed)
            values = shade_in_chunks(
                points,
                SHADING_OUTPUTS,
                lambda chunk, _: shade_chunk(shader, chunk, settings, per_sample),
                bar.advance,
                paths,
                per_sample,
            )
            stats["paths_per_s"] = bar.rate
            if settings.denoise:
                values = denoise_shading(values, samples, index)
            assert np.isfinite(values).all(), f"{stage}: NaN in the shading of {view}"
            shading[samples.of_view(index)] = values
    stats["bytes_per_pixel"] = shading.nbytes / max(samples.first_pixels[-1], 1)
    with atomic_folder(out, HOLDS) as folder:
        save_shading(folder, shading)
        if compare is not None:
            compare(shading, folder)
        withdraw_manifest(manifest_beside(out))
    write_shading_manifest(stage, out, settings)
    return stats


def write_shading_manifest(stage: str, out: Path, settings: BakeSettings | RefineSettings) -> None:
    """Write the manifest of the shading folder ``out`` beside it."""
    write_manifest(manifest_beside(out), stage, sorted(out.iterdir()), dumped(settings))
