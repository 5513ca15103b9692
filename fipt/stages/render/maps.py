"""Material maps: every layer of every view at the surface that the pixel's centre shows."""

from dataclasses import dataclass

import numpy as np

from fipt.conventions import SUB_POSITIONS
from fipt.model.albedo import reflectance
from fipt.model.parts import MaterialModel, seen_materials
from fipt.model.reflectance import Brdf
from fipt.render.surface import emitter_set
from fipt.scene.cameras import Camera
from fipt.scene.confidence import Confidence
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh
from fipt.scene.samples import FootprintSamples


@dataclass(frozen=True)
class FittedSurface:
    """What is known of every place of the surface; methods that tell no confidence have none."""

    model: MaterialModel
    emitters: Emitters
    mesh: Mesh
    confidence: Confidence | None = None


def sample_materials(model: MaterialModel, samples: FootprintSamples, chosen: np.ndarray, average: bool) -> Brdf:
    """Reflectance of samples, averaged over their pieces of surface (or at one point of each).

    Parameters
    ----------
    chosen
        (N,) indices of samples.
    average
        Query every stored point of a sample and take the mean.

    Returns
    -------
    Brdf
        N rows.
    """
    position = np.asarray(samples.position)[chosen]
    footprint = np.asarray(samples.footprint)[chosen]
    normal, triangle = np.asarray(samples.normal)[chosen], np.asarray(samples.triangle)[chosen]
    if not average:
        return seen_materials(model, position, normal, footprint, triangle)
    points = position[:, None] + np.asarray(samples.sub)[chosen].astype(np.float32)
    surface = (np.repeat(values, SUB_POSITIONS, axis=0) for values in (normal, footprint, triangle))
    brdf = seen_materials(model, points.reshape(-1, 3), *surface)
    shape = (len(chosen), SUB_POSITIONS)
    return Brdf(
        brdf.base_color.reshape(*shape, 3).mean(1),
        brdf.roughness.reshape(shape).mean(1),
        brdf.metallic.reshape(shape).mean(1),
    )


def material_maps(
    surface: FittedSurface, samples: FootprintSamples, index: int, camera: Camera, average: bool
) -> dict[str, np.ndarray]:
    """Layers of materials/{view}.exr for view number ``index`` of a shard.

    Returns
    -------
    dict
        ``kd``, ``base_color``, ``reflectance``, ``emission`` (H, W, 3); ``roughness.Y``, ``metallic.Y``,
        ``emission_mask.Y``, ``hit.Y``, and where they are known ``confidence.Y``, ``kd_error.Y``,
        ``roughness_error.Y``, ``metallic_error.Y`` (H, W), float32; 0 where the pixel's centre misses the mesh.
    """
    height, width = samples.shapes[index]
    pixels = samples.pixels(index)
    hit = np.asarray(samples.center[pixels]) > 0
    chosen = np.asarray(samples.offsets[pixels])[hit]
    brdf = sample_materials(surface.model, samples, chosen, average)
    position, normal = np.asarray(samples.position)[chosen], np.asarray(samples.normal)[chosen]
    wo = camera.center - position
    cos = (wo * normal).sum(1) / np.linalg.norm(wo, axis=1)
    layers = {} if surface.confidence is None else surface.confidence.layers(position, normal)
    triangle = np.asarray(samples.triangle)[chosen]
    emission = emitter_set(surface.emitters).emitted(triangle, surface.mesh.front(triangle, normal))

    def spread(values: np.ndarray) -> np.ndarray:
        full = np.zeros((height * width, *values.shape[1:]), np.float32)
        full[hit] = values
        return full.reshape(height, width, *values.shape[1:])

    return {
        "kd": spread(brdf.kd),
        "base_color": spread(brdf.base_color),
        "reflectance": spread(reflectance(brdf.base_color, brdf.roughness, brdf.metallic, cos)),
        "roughness.Y": spread(brdf.roughness),
        "metallic.Y": spread(brdf.metallic),
        **{f"{name}.Y": spread(values) for name, values in layers.items()},
        "emission": spread(emission),
        "emission_mask.Y": spread((emission.max(axis=1) > 0).astype(np.float32)),
        "hit.Y": hit.reshape(height, width).astype(np.float32),
    }
