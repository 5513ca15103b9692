"""Images of the model: rays through many places of every pixel, path traced from what each of them meets.

A pixel is the mean of its rays. Light that changes within a pixel - at the edge of an emitter, of its mirror image, of
a shadow - so has the share there that it has in a photograph.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fipt.model.albedo import reflectance
from fipt.model.reflectance import diffuse_reflectance, specular_reflectance
from fipt.render.denoise import denoise
from fipt.render.footprint import sub_pixel_points
from fipt.render.points import Points, random_keys, shade_in_chunks
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, Materials
from fipt.render.tracer import Shader
from fipt.scene.cameras import Camera
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh

Advance = Callable[[int], None]
"""Is told how many paths are done."""


@dataclass(frozen=True)
class SurfaceInteractions:
    """What rays through one place of every pixel meet: N points of the mesh.

    Attributes
    ----------
    pixel
        (N,) int64 increasing.
    position, normal, wo
        (N, 3) float32: the point (metres), the unit normal turned to the viewer, the unit direction to the viewer.
    triangle
        (N,) int32.
    footprint
        (N,) float32 width of the pixel there, metres.
    """

    pixel: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    wo: np.ndarray
    triangle: np.ndarray
    footprint: np.ndarray

    def subset(self, chosen: np.ndarray) -> "SurfaceInteractions":
        """Some of the points, (N,) bool."""
        return SurfaceInteractions(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class ImageSampling:
    """How finely an image is sampled.

    Attributes
    ----------
    rays_per_side
        A pixel is looked through by the square of this many rays.
    spp
        Paths a pixel, spread over its rays.
    denoise
        Denoise what is reflected, with normals and the share of white light that returns as guides; emitters stay
        exact.
    seed
        Of the random numbers.
    """

    rays_per_side: int
    spp: int
    denoise: bool
    seed: int

    @property
    def rays(self) -> int:
        """Rays of a pixel."""
        return self.rays_per_side**2

    @property
    def paths_of_ray(self) -> int:
        """Paths of each ray, so that a pixel has ``spp``; each of the two lobes has one at least."""
        return max(-(-self.spp // self.rays), 2)

    def paths(self, cameras: Sequence[Camera]) -> int:
        """Paths of the images of cameras, under one light."""
        return self.rays * sum(camera.width * camera.height for camera in cameras) * self.paths_of_ray


@dataclass(frozen=True)
class LitRoom:
    """The room under some light: what emits in it, what comes from outside, and the tracer that knows both."""

    mesh: Mesh
    emitters: EmitterSet
    environment: EnvironmentMap
    shader: Shader

    def emitted(self, si: SurfaceInteractions) -> np.ndarray:
        """(N, 3) radiance that the points of the mesh emit towards the viewer."""
        return self.emitters.emitted(si.triangle, self.mesh.front(si.triangle, si.normal))

    def reflected(
        self, si: SurfaceInteractions, brdf: Materials, key: np.ndarray, paths: int, advance: Advance
    ) -> np.ndarray:
        """(N, 3) radiance kd Ld + ks Ls0(s) + Ls1(s) that points with these materials reflect."""
        points = Points(si.position, si.normal, si.wo, key)
        counts = [paths - paths // 2, paths // 2]

        def shade(chunk: Points, part: slice) -> np.ndarray:
            return self.shader.shade(chunk, [brdf.roughness[part]], counts)

        shading = shade_in_chunks(points, 3, shade, advance, paths)
        m = brdf.metallic[:, None]
        kd, ks = diffuse_reflectance(brdf.base_color, m), specular_reflectance(brdf.base_color, m)
        return kd * shading[:, 0] + ks * shading[:, 1] + shading[:, 2]


def render_images(
    rooms: Sequence[LitRoom],
    camera: Camera,
    materials: Callable[[SurfaceInteractions], Materials],
    sampling: ImageSampling,
    advance: Advance,
    smooth: Callable[[SurfaceInteractions], SurfaceInteractions] | None = None,
) -> list[np.ndarray]:
    """Render a view of a room under each of several lights.

    Parameters
    ----------
    rooms
        Of one mesh, and with the same emitting triangles: they may differ in what these emit.
    materials
        Reflectance of points.
    smooth
        Gives points the normals that are shaded, where those are not the triangles'.

    Returns
    -------
    (H, W, 3) float32 radiance under each light.
    """
    pixels, rays = camera.width * camera.height, sampling.rays
    emitted, reflected = np.zeros((2, len(rooms), pixels, 3), np.float32)
    albedo, normal = np.zeros((2, pixels, 3), np.float32)
    for number, place in enumerate(sub_pixel_points(rays)):
        si, outward = trace_pixels(rooms[0].shader.scene, camera, place)
        si = smooth(si) if smooth else si
        normal[si.pixel] += si.normal / rays
        missed = np.setdiff1d(np.arange(pixels), si.pixel, assume_unique=True)
        for room, total in zip(rooms, emitted, strict=True):
            total[si.pixel] += room.emitted(si) / rays
            total[missed] += room.environment.lookup(outward[missed]) / rays
        si = si.subset(~np.isin(si.triangle, rooms[0].emitters.triangle))  # emitters reflect nothing
        brdf = materials(si)
        cos = (si.wo * si.normal).sum(axis=1)
        albedo[si.pixel] += reflectance(brdf.base_color, brdf.roughness, brdf.metallic, cos) / rays
        key = random_keys(camera.name, si.pixel, np.full(len(si.pixel), number), sampling.seed)
        for room, total in zip(rooms, reflected, strict=True):
            total[si.pixel] += room.reflected(si, brdf, key, sampling.paths_of_ray, advance) / rays
    shape = camera.height, camera.width, 3
    guides = np.minimum(albedo, 1).reshape(shape), normal.reshape(shape)
    return [
        exact.reshape(shape) + (_clean(total.reshape(shape), *guides) if sampling.denoise else total.reshape(shape))
        for exact, total in zip(emitted, reflected, strict=True)
    ]


def trace_pixels(scene: RayScene, camera: Camera, place: np.ndarray) -> tuple[SurfaceInteractions, np.ndarray]:
    """Trace the rays through one place (2,) in [0, 1)^2 of every pixel; also their (H * W, 3) unit directions."""
    rows, columns = np.divmod(np.arange(camera.width * camera.height), camera.width)
    directions = camera.directions(columns + place[0], rows + place[1])
    distance, triangle = scene.intersect(camera.center, directions)
    pixel = np.flatnonzero(triangle >= 0)
    ray, distance, triangle = directions[pixel], distance[pixel, None], triangle[pixel]
    normal = scene.normals[triangle]
    normal = np.where((normal * ray).sum(axis=1, keepdims=True) > 0, -normal, normal)
    points = camera.center + distance * ray, normal, -ray
    position, normal, wo = (values.astype(np.float32) for values in points)
    footprint = (distance[:, 0] / camera.fx).astype(np.float32)
    return SurfaceInteractions(pixel, position, normal, wo, triangle, footprint), directions


def _clean(image: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Denoise an image (H, W, 3); pixels that reflect nothing and colours that nothing sends stay black.

    A pixel that reflects may be black by chance: what its neighbours lend it is its share of the light.
    """
    reflects = albedo.any(axis=-1, keepdims=True) & image.any(axis=(0, 1))
    return np.where(reflects, denoise(image, albedo, normal), 0)
