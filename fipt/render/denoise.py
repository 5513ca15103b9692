"""Denoising of Monte Carlo images with Open Image Denoise."""

import numpy as np

_BORDER = 16
"""Mirrored pixels around the image: Open Image Denoise darkens a constant image by up to 30 % in its corners."""


def denoise(
    image: np.ndarray,
    albedo: np.ndarray | None = None,
    normal: np.ndarray | None = None,
    quality: str = "high",
) -> np.ndarray:
    """Denoise a linear HDR image.

    Parameters
    ----------
    image
        (H, W, 3) float32 radiance or shading, finite and >= 0.
    albedo, normal
        Noise-free (H, W, 3) guides: colour in [0, 1] and unit world normals.
    quality
        ``high``, ``balanced`` or ``fast`` (a quarter of the time).

    Returns
    -------
    (H, W, 3) float32.
    """
    import pyoidn

    height, width = image.shape[:2]
    border = [(min(_BORDER, height),) * 2, (min(_BORDER, width),) * 2, (0, 0)]

    def padded(array: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(np.pad(np.asarray(array, np.float32), border, mode="symmetric"))

    guides = {}
    if normal is not None:
        # Open Image Denoise takes a normal only together with an albedo.
        guides = {"normal": padded(normal), "albedo": padded(np.ones_like(image) if albedo is None else albedo)}
    elif albedo is not None:
        guides = {"albedo": padded(albedo)}
    result = pyoidn.denoise(padded(image), hdr=True, clean_aux=bool(guides), quality=quality, **guides)
    inner = np.asarray(result)[border[0][0] :, border[1][0] :][:height, :width]
    return np.maximum(inner, 0.0).astype(np.float32)
