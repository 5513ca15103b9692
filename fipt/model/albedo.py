"""Directional albedo of the specular lobe, tabulated once by quadrature (numpy)."""

from functools import lru_cache

import numpy as np

from fipt.conventions import ROUGHNESS_MIN
from fipt.model.reflectance import diffuse_reflectance, specular_reflectance

_COSINES = np.linspace(0.02, 1.0, 50)
_ROUGHNESSES = np.linspace(ROUGHNESS_MIN, 1.0, 50)
_SAMPLES = 64


def specular_albedo(cos: np.ndarray | float, roughness: float, samples: int = 256) -> tuple[np.ndarray, np.ndarray]:
    """Integrate the specular lobe without its reflectance ks (paper, Eq. 6 with Li = 1).

    Parameters
    ----------
    cos
        (...,) n.o in (0, 1].
    roughness
        In [0.02, 1].
    samples
        Along each side of the square that is summed over; even.

    Returns
    -------
    A0, A1
        (...,) E[(1 - Fc) w] and E[Fc w], with w the weight of sampling GGX half vectors.
    """
    u = (np.arange(samples) + 0.5) / samples
    v, u2 = np.meshgrid(u, u[: samples // 2], indexing="ij")  # both halves of the circle are alike
    u1, share = 1 - v**3, 3 * v**2  # dense in the tail of narrow lobes, where Fc is large
    cos = np.asarray(cos, np.float64)[..., None, None]
    alpha2 = roughness**4
    ch = np.sqrt((1 - u1) / (u1 * (alpha2 - 1) + 1))
    sh = np.sqrt(np.maximum(1 - ch**2, 0))
    so = np.sqrt(1 - cos**2)
    oh = so * sh * np.cos(2 * np.pi * u2) + cos * ch
    ni = 2 * oh * ch - cos
    k = (roughness + 1) ** 2 / 8
    g = 1 / ((np.maximum(ni, 0) * (1 - k) + k) * (cos * (1 - k) + k))
    w = share * np.where((ni > 0) & (oh > 0), g * oh * ni / np.maximum(ch, 1e-6), 0.0)
    away = np.maximum(1 - oh, 0)
    grazing = np.square(np.square(away)) * away * w
    return (w - grazing).mean((-2, -1)), grazing.mean((-2, -1))


@lru_cache(1)
def _table() -> np.ndarray:
    return np.stack([np.stack(specular_albedo(_COSINES, s, _SAMPLES), axis=-1) for s in _ROUGHNESSES], axis=1)


def albedo_terms(cos: np.ndarray, roughness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A0 and A1 of `specular_albedo` for arrays (...,), bilinearly from a table (error below 0.005)."""
    table = _table()
    x = np.clip((np.asarray(cos) - _COSINES[0]) / (_COSINES[1] - _COSINES[0]), 0, len(_COSINES) - 1.001)
    y = np.clip(
        (np.asarray(roughness) - _ROUGHNESSES[0]) / (_ROUGHNESSES[1] - _ROUGHNESSES[0]),
        0,
        len(_ROUGHNESSES) - 1.001,
    )
    i, j = x.astype(int), y.astype(int)
    fx, fy = (x - i)[..., None], (y - j)[..., None]
    value = (table[i, j] * (1 - fx) + table[i + 1, j] * fx) * (1 - fy) + (
        table[i, j + 1] * (1 - fx) + table[i + 1, j + 1] * fx
    ) * fy
    return value[..., 0].astype(np.float32), value[..., 1].astype(np.float32)


def reflectance(base_color: np.ndarray, roughness: np.ndarray, metallic: np.ndarray, cos: np.ndarray) -> np.ndarray:
    """Material reflectance a' = kd + ks A0 + A1 of (..., 3) base colours and (...,) scalars; (..., 3) float32."""
    a0, a1 = albedo_terms(cos, roughness)
    m = np.asarray(metallic)[..., None]
    kd, ks = diffuse_reflectance(base_color, m), specular_reflectance(base_color, m)
    return (kd + ks * a0[..., None] + a1[..., None]).astype(np.float32)
