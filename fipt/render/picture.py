"""Pictures of the model: rays through many places of every pixel, path traced from what each of them meets.

A pixel is the mean of its rays. Light that changes within a pixel - at the edge of a lamp, of its mirror image, of a
shadow - so has the share there that it has in a photograph.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fipt.conventions import F0_DIELECTRIC
from fipt.model.albedo import reflectance
from fipt.render.denoise import denoise
from fipt.render.footprint import sub_pixel_points
from fipt.render.points import Points, random_keys, shade_in_chunks
from fipt.render.scene import RayScene
from fipt.render.surface import EmitterSet, Materials
from fipt.render.tracer import Shader
from fipt.scene.cameras import Camera
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh


@dataclass(frozen=True)
class Sight:
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

    def part(self, chosen: np.ndarray) -> "Sight":
        """Some of the points, (N,) bool."""
        return Sight(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Light:
    """The room under some light: what shines in it, what comes from outside, and the tracer that knows both."""

    mesh: Mesh
    lit: EmitterSet
    outside: EnvironmentMap
    shader: Shader

    def shown(self, sight: Sight) -> np.ndarray:
        """(N, 3) radiance that the points of the mesh emit towards the viewer."""
        emitted = self.lit.emitted(sight.triangle)
        if not self.lit.two_sided:
            emitted[(sight.normal * self.mesh.normals[sight.triangle]).sum(axis=1) < 0] = 0
        return emitted

    def reflected(self, sight: Sight, brdf: Materials, key: np.ndarray, paths: int, advance: "Advance") -> np.ndarray:
        """(N, 3) radiance kd Ld + ks Ls0(s) + Ls1(s) that points with these materials reflect."""
        points = Points(sight.position, sight.normal, sight.wo, key)
        counts = [paths - paths // 2, paths // 2]

        def shade(chunk: Points, part: slice) -> np.ndarray:
            return self.shader.shade(chunk, [brdf.roughness[part]], counts)

        shading = shade_in_chunks(points, 3, shade, advance, paths)
        m = brdf.metallic[:, None]
        kd, ks = brdf.base_color * (1 - m), F0_DIELECTRIC * (1 - m) + brdf.base_color * m
        return kd * shading[:, 0] + ks * shading[:, 1] + shading[:, 2]


Advance = Callable[[int], None]
"""Is told how many paths are done."""


def paths_of_ray(spp: int, grid: int) -> int:
    """Paths of each of a pixel's grid^2 rays, so that a pixel has ``spp``; each of the two lobes has one at least."""
    return max(-(-spp // grid**2), 2)


def pictures(
    lights: Sequence[Light],
    camera: Camera,
    materials: Callable[[Sight], Materials],
    grid: int,
    spp: int,
    denoised: bool,
    seed: int,
    advance: Advance,
    smooth: Callable[[Sight], Sight] | None = None,
) -> list[np.ndarray]:
    """See a view under each of several lights.

    Parameters
    ----------
    lights
        Of one mesh, and with the same emitting triangles: lamps may differ in what they emit.
    materials
        Reflectance of points.
    grid
        A pixel is looked through by the square of this many rays.
    spp
        Paths a pixel.
    denoised
        Denoise what is reflected, with normals and the share of white light that returns as guides; lamps stay exact.
    smooth
        Gives points the normals that are shaded, where those are not the triangles'.

    Returns
    -------
    (H, W, 3) float32 radiance under each light.
    """
    pixels, rays = camera.width * camera.height, grid**2
    shown, reflected = np.zeros((2, len(lights), pixels, 3), np.float32)
    albedo, normal = np.zeros((2, pixels, 3), np.float32)
    for number, place in enumerate(sub_pixel_points(rays)):
        sight, outward = look(lights[0].shader.scene, camera, place)
        sight = smooth(sight) if smooth else sight
        normal[sight.pixel] += sight.normal / rays
        missed = np.setdiff1d(np.arange(pixels), sight.pixel, assume_unique=True)
        for light, total in zip(lights, shown, strict=True):
            total[sight.pixel] += light.shown(sight) / rays
            total[missed] += light.outside.lookup(outward[missed]) / rays
        matter = sight.part(~np.isin(sight.triangle, lights[0].lit.triangle))  # lamps reflect nothing
        brdf = materials(matter)
        cos = (matter.wo * matter.normal).sum(axis=1)
        albedo[matter.pixel] += reflectance(brdf.base_color, brdf.roughness, brdf.metallic, cos) / rays
        key = random_keys(camera.name, matter.pixel, np.full(len(matter.pixel), number), seed)
        for light, total in zip(lights, reflected, strict=True):
            total[matter.pixel] += light.reflected(matter, brdf, key, paths_of_ray(spp, grid), advance) / rays
    shape = camera.height, camera.width, 3
    guides = np.minimum(albedo, 1).reshape(shape), normal.reshape(shape)
    return [
        exact.reshape(shape) + (_clean(total.reshape(shape), *guides) if denoised else total.reshape(shape))
        for exact, total in zip(shown, reflected, strict=True)
    ]


def look(scene: RayScene, camera: Camera, place: np.ndarray) -> tuple[Sight, np.ndarray]:
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
    return Sight(pixel, position, normal, wo, triangle, (distance[:, 0] / camera.fx).astype(np.float32)), directions


def _clean(picture: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Denoise a picture (H, W, 3); black pixels and colours that nothing sends stay black."""
    bright = picture.any(axis=-1, keepdims=True) & picture.any(axis=(0, 1))
    return np.where(bright, denoise(picture, albedo, normal), 0)
