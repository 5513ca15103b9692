"""Denoising of Monte Carlo images with Open Image Denoise."""

import numpy as np


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

    guides = {}
    if normal is not None:
        # Open Image Denoise takes a normal only together with an albedo.
        guides["normal"] = np.ascontiguousarray(normal, np.float32)
        guides["albedo"] = np.ascontiguousarray(np.ones_like(image) if albedo is None else albedo, np.float32)
    elif albedo is not None:
        guides["albedo"] = np.ascontiguousarray(albedo, np.float32)
    color = np.ascontiguousarray(image, np.float32)
    result = pyoidn.denoise(color, hdr=True, clean_aux=bool(guides), quality=quality, **guides)
    return np.maximum(np.asarray(result), 0.0).astype(np.float32)
