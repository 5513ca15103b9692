"""Reflectance: the terms of the paper (Eq. 3 to 6), each defined here and nowhere else.

    kd = a (1 - m)                    diffuse reflectance
    ks = F0 (1 - m) + a m             specular reflectance at normal incidence
    Lr = kd Ld + ks Ls0(s) + Ls1(s)   reflected radiance

    a           base colour, linear RGB in [0, 1]
    m           metallic, in [0, 1]
    s           perceptual roughness, in [0.02, 1]
    F0          reflectance of a dielectric, 0.04
    Ld          diffuse shading: incoming light times the cosine over pi
    Ls0, Ls1    specular shading without and with the Fresnel term's power, known at the levels of ``ROUGHNESS_LEVELS``
                and linear between them

Formulas are written once and serve NumPy arrays, torch tensors and, for kd and ks, Dr.Jit arrays.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.conventions import F0_DIELECTRIC, ROUGHNESS_LEVELS

_LEVELS = len(ROUGHNESS_LEVELS)
_DARKEST = 1e-4
"""Radiance that is added to the brightest reflection."""


def diffuse_reflectance(base_color: Any, metallic: Any) -> Any:
    """Kd of base colours and metallics that broadcast against each other."""
    return base_color * (1 - metallic)


def specular_reflectance(base_color: Any, metallic: Any) -> Any:
    """Ks of base colours and metallics that broadcast against each other."""
    return F0_DIELECTRIC * (1 - metallic) + base_color * metallic


@dataclass(frozen=True)
class Brdf:
    """Reflectance at N points, torch or numpy, float32.

    Attributes
    ----------
    base_color
        (N, 3) linear RGB in [0, 1].
    roughness
        (N,) perceptual, in [0.02, 1].
    metallic
        (N,) in [0, 1].
    """

    base_color: Any
    roughness: Any
    metallic: Any

    @property
    def kd(self) -> Any:
        """(N, 3) diffuse reflectance."""
        return diffuse_reflectance(self.base_color, self.metallic[:, None])

    @property
    def ks(self) -> Any:
        """(N, 3) specular reflectance at normal incidence."""
        return specular_reflectance(self.base_color, self.metallic[:, None])


def specular_shading(shading: Any, roughness: Any) -> tuple[Any, Any]:
    """Ls0(s) and Ls1(s): interpolated linearly in roughness between the baked levels.

    Parameters
    ----------
    shading
        (H, outputs, 3): Ld, Ls0 of every level, Ls1 of every level; torch or numpy.
    roughness
        (H, ...) of the same library, in [0.02, 1]; with numpy also one number for all samples.

    Returns
    -------
    Ls0, Ls1
        (H, ..., 3).
    """
    plain = isinstance(shading, np.ndarray)
    s = np.asarray(roughness) if plain else roughness
    levels = np.array(ROUGHNESS_LEVELS) if isinstance(s, np.ndarray) else s.new_tensor(ROUGHNESS_LEVELS)
    low = ((s[..., None] >= levels).sum(-1) - 1).clip(0, _LEVELS - 2)
    t = ((s - levels[low]) / (levels[low + 1] - levels[low]))[..., None]
    rows = np.arange(len(shading)).reshape(-1, *[1] * (s.ndim - 1)) if s.ndim else slice(None)

    def at(first: int) -> Any:
        lower, upper = shading[rows, first + low], shading[rows, first + low + 1]
        return lower * (1 - t) + upper * t if plain else lower.lerp(upper, t)

    return at(1), at(1 + _LEVELS)


def line_in_base_color(shading: np.ndarray, roughness: Any, metallic: Any) -> tuple[np.ndarray, np.ndarray]:
    """Reflected radiance as a line in the base colour: Lr = A + B a, for each sample and channel.

    Both reflectances are linear in a, so that A is Lr for a = 0, and B = (1 - m) Ld + m Ls0(s).

    Parameters
    ----------
    shading
        (N, outputs, 3).
    roughness, metallic
        Numbers, or (N,) each.

    Returns
    -------
    A, B
        (N, 3) each.
    """
    return line_of_lobes(shading[:, 0], *specular_shading(shading, roughness), metallic)


def line_of_lobes(ld: np.ndarray, ls0: np.ndarray, ls1: np.ndarray, metallic: Any) -> tuple[np.ndarray, np.ndarray]:
    """`line_in_base_color` of shading (N, 3) that is known for the roughness; metallic is a number, or (N,)."""
    m = np.asarray(metallic)[..., None]
    return specular_reflectance(0.0, m) * ls0 + ls1, diffuse_reflectance(1.0, m) * ld + m * ls0


def reflected(brdf: Brdf, shading: Any, queries: int) -> tuple[Any, Any]:
    """Reflected radiance Lr of H samples, averaged over the points at which each was asked (torch).

    Parameters
    ----------
    brdf
        Of H * ``queries`` points, those of a sample adjacent.
    shading
        (H, outputs, 3).

    Returns
    -------
    radiance
        (H, 3).
    specular
        (H,) mean over RGB of its specular part, ks Ls0(s) + Ls1(s).
    """
    count = len(shading)
    ls0, ls1 = specular_shading(shading, brdf.roughness.view(count, queries))
    specular = brdf.ks.view(count, queries, 3) * ls0 + ls1
    diffuse = brdf.kd.view(count, queries, 3) * shading[:, None, 0]
    return (diffuse + specular).mean(1), specular.mean((1, 2))


def brightest_reflection(shading: Any) -> Any:
    """(H,) mean over RGB of what a white surface or a mirror would show, the brighter; torch or numpy (H, outputs, 3).

    A little is added, so that noise in the dark does not pass for emission.
    """
    mirror = shading[:, 1 : 1 + _LEVELS] + shading[:, 1 + _LEVELS :]
    if isinstance(shading, np.ndarray):
        return np.maximum(shading[:, 0], mirror.max(axis=1)).mean(axis=1) + _DARKEST
    return shading[:, 0].maximum(mirror.amax(1)).mean(1) + _DARKEST


def exceeds_reflection(radiance: Any, shading: Any, gain: float) -> Any:
    """(H,) bool: samples of radiance (H, 3) that is ``gain`` times brighter than any reflection: they emit."""
    return radiance.mean(1) > gain * brightest_reflection(shading)
