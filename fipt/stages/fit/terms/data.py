"""The data term: rendered pixels against the photographs.

    C_h   = (1 - alpha) (kd Ld + ks Ls0(s) + Ls1(s)) + alpha C_obs    a footprint sample
    C     = sum over the pixel's samples of w C_h  +  C_out           a pixel
    L     = mean over the batch's pixels of v |srgb(C) - srgb(C_obs)|^2

    alpha        emission mask: what of the sample is the surface's own light
    kd, ks, s    fitted reflectance; Ld, Ls0, Ls1 baked shading (`fipt.model.reflectance`)
    C_obs        observed radiance of the pixel, or of its part that shows the mesh
    w            share of the pixel that the sample covers
    C_out        light from outside in pixels at the edge of an opening
    v            weight of the pixel
    srgb         the sRGB curve, which goes on above 1

Two things differ from the paper, where settings ask for it. A pixel that shows an emitter, if only in part, says
nothing of reflectance: it teaches the mask alone. A clipped pixel is a lower bound: it does so too, and what is
brighter agrees with it. Where emitters are known before the fit there is no mask, and such pixels count for nothing.
"""

import torch

from fipt.model.reflectance import exceeds_reflection
from fipt.model.srgb import srgb
from fipt.stages.fit.batches import Batch

_EMITS = 0.1
"""Emission mask above which a surface counts as an emitter while the fit goes on."""


def data_term(batch: Batch, reflected: torch.Tensor, mask: torch.Tensor | None, emitter_gain: float) -> torch.Tensor:
    """L of a batch.

    Parameters
    ----------
    reflected
        (H, 3) reflected radiance of the samples.
    mask
        (H,) emission mask alpha; None without.
    emitter_gain
        Pixels this much brighter than any reflection teach no reflectance; 0: they teach as all others do.
    """
    fixed, valid = batch.clipped, batch.valid
    if emitter_gain > 0:
        fixed = fixed | shows_emitter(batch, mask, emitter_gain)
    if mask is None:
        valid, sample = torch.where(fixed, 0.0, valid), reflected
    else:
        alpha = mask[:, None]
        reflected = torch.where(fixed[batch.owner][:, None], reflected.detach(), reflected)
        sample = (1 - alpha) * reflected + alpha * batch.on_mesh[batch.owner]
    pixel = gathered(sample, batch.owner, batch.weight, len(batch.radiance))
    if batch.beyond is not None:
        pixel = pixel + batch.beyond
    difference = srgb(pixel) - srgb(batch.radiance)
    difference = torch.where(batch.clipped[:, None], difference.clamp(max=0.0), difference)
    return (valid * difference.square().mean(1)).mean()


def shows_emitter(batch: Batch, mask: torch.Tensor | None, gain: float) -> torch.Tensor:
    """(B,) bool: pixels that show an emitter, by their radiance or by the mask (H,), if only in part."""
    emits = exceeds_reflection(batch.on_mesh[batch.owner], batch.shading, gain)
    if mask is not None:
        emits = emits | (mask.detach() > _EMITS)
    pixel = torch.zeros(len(batch.radiance), dtype=torch.bool, device=emits.device)
    pixel[batch.owner[emits]] = True
    return pixel


def gathered(values: torch.Tensor, owner: torch.Tensor, weight: torch.Tensor, pixels: int) -> torch.Tensor:
    """Sum (H, 3) values of samples, by weight, into (B, 3) pixels."""
    return values.new_zeros(pixels, 3).index_add(0, owner, values * weight[:, None])
