"""A view as dense stereo sees it: log radiance, and the maps between its pixels and those of other views.

Pixels are counted by their centres here: the first one is (0, 0). Depth q is inverse, 1 / metres along the viewing
axis; over a plane of the scene it is linear in the image, q(u, v) = m . (u, v, 1).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED, LUMINANCE
from fipt.scene.blocks import blocks
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset

_DARK = 0.01
"""Radiance is raised to this share of the view's median before the logarithm: darker pixels are mostly noise."""
_UNUSABLE = FLAG_SATURATED | FLAG_MOVED | FLAG_OUTSIDE | FLAG_NOISE


@dataclass(frozen=True)
class StereoView:
    """A view for dense stereo.

    Attributes
    ----------
    camera
        Of these pixels.
    light
        (H, W) float32 natural logarithm of luminance; NaN where a pixel counts for nothing.
    noise
        Standard deviation of the noise of ``light``.
    """

    camera: Camera
    light: np.ndarray
    noise: float

    @cached_property
    def intrinsics(self) -> np.ndarray:
        """(3, 3) float64 pixels from image axes."""
        return self.camera.intrinsics

    @cached_property
    def rotation(self) -> np.ndarray:
        """(3, 3) float64 image axes from world axes."""
        return self.camera.extrinsics[:, :3]

    @cached_property
    def rays(self) -> np.ndarray:
        """(H, W, 3) float64 points at depth 1 of the pixels, image axes."""
        rows, columns = np.mgrid[: self.camera.height, : self.camera.width].astype(np.float64)
        return np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(self.intrinsics).T

    def halved(self) -> "StereoView":
        """Half the size, means of 2x2 pixels; a pixel counts where at least half of its four do."""
        fours = blocks(self.light, 2)
        count = np.isfinite(fours).sum(axis=(1, 3))
        light = np.nansum(fours, axis=(1, 3)) / np.maximum(count, 1)
        return StereoView(
            self.camera.reduced(2), np.where(count >= 2, light, np.nan).astype(np.float32), self.noise / 2
        )


def stereo_view(dataset: Dataset, view: str) -> StereoView:
    """Log radiance of a view; saturated, moved and dark pixels and those outside the frame count for nothing."""
    image, weight = dataset.image(view)
    luminance = image @ np.array(LUMINANCE, np.float32)
    usable = weight > 0
    flags = dataset.flags(view)
    if flags is not None:
        usable &= (flags & _UNUSABLE) == 0
    middle = float(np.median(luminance[usable])) if usable.any() else 1.0
    light = np.log(np.maximum(luminance, _DARK * max(middle, 1e-12)))
    light = np.where(usable, light, np.nan).astype(np.float32)
    return StereoView(dataset.camera(view), light, noise_of(light))


def noise_of(light: np.ndarray) -> float:
    """Standard deviation of noise: the middle of second differences, which smooth shading and texture hardly move.

    (Immerkaer 1996, with a median in place of the mean.)
    """
    mask = light[:-2] - 2 * light[1:-1] + light[2:]
    second = mask[:, :-2] - 2 * mask[:, 1:-1] + mask[:, 2:]
    second = second[np.isfinite(second)]
    return float(np.median(np.abs(second)) / 0.6745 / 6.0) if second.size else 0.0


def transfer(reference: StereoView, source: StereoView) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of a source from those of a reference: homogeneous ``p' = A p + b q``.

    Returns
    -------
    A, b
        (3, 3) and (3,) float64; the third coordinate is the depth in the source divided by that in the reference.
    """
    turned = source.rotation @ reference.rotation.T
    shift = source.rotation @ (reference.camera.center - source.camera.center)
    return source.intrinsics @ turned @ np.linalg.inv(reference.intrinsics), source.intrinsics @ shift


def normals_of(view: StereoView, planes: np.ndarray) -> np.ndarray:
    """(H, W, 3) unit world normals, facing the camera, of (3, H, W) planes: q and its slopes along u and v."""
    q, along_u, along_v = planes
    focal = view.intrinsics
    depth_part = q - (along_u * focal[0, 0]) * view.rays[..., 0] - (along_v * focal[1, 1]) * view.rays[..., 1]
    normal = np.stack([along_u * focal[0, 0], along_v * focal[1, 1], depth_part], axis=-1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    return -normal @ view.rotation
