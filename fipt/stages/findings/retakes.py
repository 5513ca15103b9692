"""Training views rendered with the model, small: what the emitters and materials found give, against photographs.

A photograph is reduced by averaging whole blocks of pixels, and the camera is made as much coarser: its pixels then see
exactly these blocks, so that both images integrate over the same surface.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fipt.model.fitted import FittedScene
from fipt.model.networks import Brdf
from fipt.render.environment import sky_of
from fipt.render.image import ImageSampling, LitRoom, SurfaceInteractions, render_images, trace_pixels
from fipt.render.scene import RayScene
from fipt.render.surface import SurfaceCache, Triangles, emitter_set
from fipt.render.tracer import PathSettings, Shader
from fipt.scene.blocks import block_mean
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.stages.findings.settings import FindingsSettings

_RAYS_PER_SIDE = 2
_CENTER = np.array([0.5, 0.5])


@dataclass(frozen=True)
class Retake:
    """A training view, reduced to H x W pixels, and the model's rendering of it.

    Attributes
    ----------
    camera
        The reduced camera.
    photo, render
        (H, W, 3) float32 radiance.
    weight
        (H, W) float32 weight of the photograph's pixels in [0, 1]; 0 where the mesh is missed or a pixel is clipped.
    position, normal
        (H, W, 3) float32 surface at the pixel's centre, metres; 0 where there is none.
    triangle
        (H, W) int32, -1 where there is none.
    emits
        (H, W) bool: an emitter is at the centre.
    """

    camera: Camera
    photo: np.ndarray
    render: np.ndarray
    weight: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    triangle: np.ndarray
    emits: np.ndarray


def lit_room(fitted: FittedScene, max_depth: int) -> LitRoom:
    """Return the room under its own light, paths following the model alone: photographs' radiance is not read."""
    voxels, emitters = fitted.cache, emitter_set(fitted.emitters)
    nothing, unknown = np.zeros((len(voxels["key"]), 3), np.float32), np.zeros(len(voxels["key"]), bool)
    surface = SurfaceCache(voxels, nothing, unknown, fitted.cached_materials())
    path = PathSettings(max_depth, cache_roughness=1.0, light_at_first=True)
    triangles = Triangles(fitted.mesh, emitters)
    shader = Shader(RayScene(fitted.mesh), triangles, surface, path, sky_of(fitted.environment))
    return LitRoom(fitted.mesh, emitters, fitted.environment, shader)


def retakes(data: Dataset, fitted: FittedScene, views: Sequence[str], settings: FindingsSettings) -> list[Retake]:
    """Render views at a reduced size, and reduce their photographs."""
    room = lit_room(fitted, settings.max_depth)
    sampling = ImageSampling(_RAYS_PER_SIDE, settings.spp, denoise=True, seed=settings.seed)

    def materials(si: SurfaceInteractions) -> Brdf:
        return fitted.reflectance(si.position, si.normal, si.footprint)

    return [_retake(data, room, reduced(data.camera(view), settings.width), materials, sampling) for view in views]


def reduced(camera: Camera, width: int) -> tuple[Camera, int]:
    """Return the camera with pixels as large as whole blocks, about ``width`` of them a row, and a block's side."""
    block = max(round(camera.width / width), 1)
    return camera.reduced(block), block


def _retake(data, room, reduced_camera, materials, sampling) -> Retake:
    camera, block = reduced_camera
    photo, valid = data.image(camera.name)
    valid = valid * ~data.clipped(camera.name)
    weight = block_mean(valid, block)
    mean = block_mean(photo * valid[..., None], block) / np.maximum(weight, 1e-9)[..., None]
    (render,) = render_images([room], camera, materials, sampling, lambda _: None)
    si, _ = trace_pixels(room.shader.scene, camera, _CENTER)
    pixels, shape = camera.width * camera.height, (camera.height, camera.width)
    position, normal = np.zeros((2, pixels, 3), np.float32)
    position[si.pixel], normal[si.pixel] = si.position, si.normal
    triangle = np.full(pixels, -1, np.int32)
    triangle[si.pixel] = si.triangle
    return Retake(
        camera,
        mean.astype(np.float32),
        render.astype(np.float32),
        np.where(triangle.reshape(shape) >= 0, weight, 0).astype(np.float32),
        position.reshape(*shape, 3),
        normal.reshape(*shape, 3),
        triangle.reshape(shape),
        np.isin(triangle, room.emitters.triangle).reshape(shape),
    )
