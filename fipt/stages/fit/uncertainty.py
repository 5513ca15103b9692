"""How far off a fitted material may be: predicted errors of each piece of surface, after the fit.

A piece is what one voxel holds of a part's surface that faces one way. The variance of its kd is the sum of

    ambiguity   P (a (1 - m))^2 + (1 - P) (a m)^2: the part may be metal (probability P) and was taken for none,
                or the other way round (`fipt.stages.fit.material_posterior`)
    residual    r^2, r = mean of |C - C'| / C' kd: what the fitted pixels C' leave of the photographs C; a pixel's
                weight of it is the room's median
    metal       m (r a)^2: the kd of a metal is 0 whatever is left of its photographs, and what a metal explains badly
                may be none
    shading     (kd d)^2, d = ln of the shading over that of round 0: two estimates of the same light, of which one
                reads the photographs' radiance and the other follows paths; what they differ by, either may err
    mixing      q^2 / 12, q = mean share of the pixels that shows other surface: such a piece is told from others by
                its model alone, and of what nothing is known, the variance is 1/12 (anything from 0 to 1 alike)
    outline     P e^2, e^2 = mean of (kd' - kd)^2 over the eight pixels around, kd' = kd C(there) / C, at most 1: the
                outline of surface may lie beside where the mesh has it, and P is the share of such pixels in this
                room: r^2 over the mean of (C(there) / C - 1)^2, where that is largest
    part        (kd d_k)^2, d_k = mean of d over the part: what its pieces do not average out
    room        (kd r_room)^2, r_room = median of |C - C'| / C' over all pieces

residual, shading and mixing count by 1 / (1 + u)^2: of a part that seems to have one colour (`uniformity` u) the pieces
have the part's colour, to that share. The sum v is at most 1/12: 1 / (1 / v + 12).

Each term is multiplied by a constant: variance components, fitted by maximum likelihood (of squared errors that are
exponentially distributed about v) to rooms of known truth; what rooms that were left out say of them stands in
docs/measurements/accuracy.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fipt.model.networks import Field
from fipt.model.reflectance import Brdf, exceeds_reflection, line_in_base_color
from fipt.scene.confidence import Confidence, records
from fipt.scene.samples import FootprintSamples, scattered, scene_box
from fipt.scene.shading import Shading
from fipt.stages.fit.batches import Pixels
from fipt.stages.fit.evidence import piece_resolution, sums_by
from fipt.stages.fit.material_posterior import MaterialPosterior

COMPONENTS = {
    "ambiguity": 1.1, "residual": 5.5, "metal": 3.0, "shading": 0.4, "mixing": 0.4, "outline": 1.0, "part": 0.55,
    "room": 0.08,
}  # fmt: skip
"""What the terms are multiplied by."""
_NOTHING = 1 / 12
"""Variance of a number between 0 and 1 of which nothing is known."""
_DARK = 0.01
"""Share of the mean radiance of a view that counts as dark: added before ratios are taken."""
_UNCHECKED = 0.1
"""d where there is no earlier shading: in round 0 the cache's voxels and noise leave about a tenth."""
_MOST_OFF = 1.0
"""Relative residuals count up to here."""
_LEAST_SHARE = 0.05
"""Pixels' shares that a piece must have before anything is known of it."""
_STEEPEST = 0.9
"""Quantile of contrast above which residuals are those of outlines that lie elsewhere, not of noise."""
_AROUND = tuple((row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1))
"""Places of the pixels around the middle one of nine."""
_WHOLE = 0.99
"""Share of a pixel that the mesh must fill before its radiance is compared."""
_MOST_SAMPLES = 150_000
"""Samples asked at most: fewer than a twentieth of what a fit of 500 steps asks."""
_TINY = 1e-9
_HARDLY = 1.0
"""Pixels: surface of which less tells is taken for what surface is like that no view sees."""
_MOSTLY = 0.5
"""Share of a record's surface of which something must be known."""

_PHOTOGRAPHED = ("residual", "relative", "contrast", "steepness")
_SUMS = ("share", "mixed", "asked", "kd", "base", "roughness", "metallic", "change", "evident", *_PHOTOGRAPHED)


@dataclass(frozen=True)
class FittedPieces:
    """G pieces: means over their samples.

    Attributes
    ----------
    record, segment
        (G,) int64 voxel with facing, and part.
    share
        (G,) pixels' shares that show it; ``evident``: of those that say something of its reflectance.
    mixed, kd, base, roughness, metallic
        (G,) other surface in its pixels, and the fitted material, colours averaged over the channels.
    change
        (G,) ln of the shading over that of round 0.
    residual, relative
        (G,) mean absolute residual, in kd, and relative to the radiance.
    contrast, steepness
        (G,) mean squared difference to the pixels around, likewise.
    """

    record: np.ndarray
    segment: np.ndarray
    share: np.ndarray
    mixed: np.ndarray
    kd: np.ndarray
    base: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    change: np.ndarray
    evident: np.ndarray
    residual: np.ndarray
    relative: np.ndarray
    contrast: np.ndarray
    steepness: np.ndarray


def predict(
    field: Field,
    pixels: Pixels,
    materials: MaterialPosterior,
    uniform: np.ndarray,
    emitter_gain: float,
    earlier: Sequence[Shading] = (),
) -> Confidence:
    """Predicted errors of all surface that the training views see; one view is held in memory at a time.

    Clipped pixels say nothing, nor do those that show an emitter.

    Parameters
    ----------
    field
        The fitted networks.
    materials
        Of the parts.
    uniform
        (S,) how much rather each part has one colour.
    emitter_gain
        Pixels this much brighter than any reflection show an emitter.
    earlier
        Shading of round 0, a shard each; empty in round 0.
    """
    center, side = scene_box(pixels.shards)
    box = center, side, piece_resolution(pixels.shards, side)
    step = max(-(-sum(len(samples.position) for samples in pixels.shards) // _MOST_SAMPLES), 1)
    keys, sums, passed = [], [], 0
    for number, samples in enumerate(pixels.shards):
        for index, (height, width) in enumerate(samples.shapes):
            view = _FittedView(pixels, number, index, scattered(passed, height * width, step))
            passed += height * width
            key, place = np.unique(view.keys(box), return_inverse=True)
            keys.append(key)
            sums.append(sums_by(place.reshape(-1), view.columns(field, emitter_gain, earlier), len(key)))
    key, place = np.unique(np.concatenate(keys), return_inverse=True)
    pieces = _means(key, sums_by(place.reshape(-1), np.concatenate(sums), len(key)))
    terms = components(pieces, materials, uniform)
    variance = bounded(sum((COMPONENTS[name] * term for name, term in terms.items()), np.zeros(len(key))))
    return _merged(pieces, variance, materials, box)


@dataclass(frozen=True)
class _FittedView:
    """One view of one shard, and those of its pixels (K,) that are ``chosen`` to be asked."""

    pixels: Pixels
    number: int
    index: int
    chosen: np.ndarray

    @property
    def samples(self) -> FootprintSamples:
        return self.pixels.shards[self.number]

    @property
    def span(self) -> slice:
        """Its pixels, P."""
        return self.samples.pixels(self.index)

    @property
    def own(self) -> slice:
        """Its samples, N."""
        return self.samples.of_view(self.index)

    @cached_property
    def pixel(self) -> np.ndarray:
        """(N,) pixel of each sample."""
        return self.samples.pixel_of_sample(self.index)

    @cached_property
    def asked(self) -> np.ndarray:
        """(M,) numbers of the samples in its chosen pixels."""
        return np.flatnonzero(np.isin(self.pixel, self.chosen))

    def keys(self, box: tuple[np.ndarray, float, int]) -> np.ndarray:
        """(N,) int64 record and segment of its samples."""
        record = records(self.samples.position[self.own], self.samples.normal[self.own], *box)
        sample, shard = np.arange(self.own.start, self.own.stop), np.full(len(self.pixel), self.number)
        return record << 16 | self.pixels.segment_of(shard, self.span.start + self.pixel, sample)

    def columns(self, field: Field, emitter_gain: float, earlier: Sequence[Shading]) -> np.ndarray:
        """(N, columns of `_SUMS`) what its samples add to their pieces, each times its share."""
        samples, own, pixel = self.samples, self.own.start + self.asked, self.pixel[self.asked]
        shading = np.asarray(self.pixels.shading[self.number][own], np.float32)
        place = field.place(samples.position[own], samples.normal[own])
        brdf = field.query(place, samples.footprint[own] * field.settings.footprint)
        residual, evident = self._residuals(brdf, self._lit(shading, own), emitter_gain)
        change = np.full(len(shading), _UNCHECKED)
        if earlier:
            light, before = shading[:, 0].mean(axis=1), earlier[self.number][own][:, 0].mean(axis=1)
            dark = _DARK * light.mean() + _TINY
            change = np.log((light + dark) / (before + dark))
        one = np.ones(len(own))
        shown = one, brdf.kd.mean(axis=1), brdf.base_color.mean(axis=1), brdf.roughness, brdf.metallic, change
        off = one, (residual[pixel] * brdf.kd).mean(axis=1), residual[pixel].mean(axis=1), *self._contrast(brdf.kd)
        weight = np.asarray(samples.weight[self.own], np.float64)[:, None]
        columns = np.zeros((len(weight), len(_SUMS)))
        columns[:, :1], columns[:, 1:2] = 1, 1 - weight
        columns[self.asked, 2:] = np.column_stack([*shown, *(evident * x for x in off)])
        return weight * columns

    def _lit(self, shading: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Shading (M, outputs, 3) of the samples ``own`` (M,), as the fit was taught by it."""
        shard, pixel = np.full(len(own), self.number), self.span.start + self.pixel[self.asked]
        return self.pixels.lit(shading, self.samples.position[own], self.pixels.segment_of(shard, pixel, own))

    def _contrast(self, kd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M,) mean squared difference to the pixels around the asked ones, in kd (M, 3) and relative to them.

        Masked pixels, which are black, are left out.
        """
        height, width = self.samples.shapes[self.index]
        image = np.asarray(self.pixels.radiance[self.number][self.span], np.float64).reshape(height, width, 3)
        shown = (np.asarray(self.pixels.valid[self.number][self.span]).reshape(height, width) > 0) | image.any(axis=2)
        shown = np.pad(shown, 1, mode="edge")
        image = np.pad(image + _DARK * image.mean() + _TINY, ((1, 1), (1, 1), (0, 0)), mode="edge")
        row, column = np.divmod(self.pixel[self.asked], width)
        contrast, steepness, count = np.zeros(len(kd)), np.zeros(len(kd)), np.zeros(len(kd))
        for down, right in _AROUND:
            other = row + down, column + right
            counts, ratio = shown[other], image[other] / image[row + 1, column + 1]
            contrast += counts * ((np.minimum(kd * ratio, 1) - kd) ** 2).mean(axis=1)
            steepness += counts * (np.clip(ratio - 1, -_MOST_OFF, _MOST_OFF) ** 2).mean(axis=1)
            count += counts
        return contrast / np.maximum(count, 1), steepness / np.maximum(count, 1)

    def _residuals(self, brdf: Brdf, shading: np.ndarray, emitter_gain: float) -> tuple[np.ndarray, np.ndarray]:
        """(P, 3) relative absolute residuals of its pixels, and (M,) bool: the sample's pixel tells something."""
        pixel, count = self.pixel[self.asked], self.span.stop - self.span.start
        weight = np.asarray(self.samples.weight[self.own], np.float64)[self.asked]
        offset, slope = line_in_base_color(shading, brdf.roughness, brdf.metallic)
        covered = np.bincount(pixel, weight, count)
        fitted = sums_by(pixel, weight[:, None] * (offset + slope * brdf.base_color), count)
        fitted /= np.maximum(covered, _TINY)[:, None]
        observed = np.asarray(self.pixels.radiance[self.number][self.span], np.float64)
        dark = _DARK * fitted.sum() / max(3 * np.count_nonzero(covered), 1) + _TINY
        residual = np.minimum(np.abs(observed - fitted) / (fitted + dark), _MOST_OFF)
        emits = np.bincount(pixel, exceeds_reflection(observed[pixel], shading, emitter_gain), count) > 0
        valid, clipped = self.pixels.valid[self.number][self.span], self.pixels.clipped[self.number][self.span]
        return residual, ((valid > 0) & ~clipped & ~emits & (covered > _WHOLE))[pixel]


def _means(key: np.ndarray, total: np.ndarray) -> FittedPieces:
    """Pieces of keys (G,) and sums (G, columns of `_SUMS`); what was not asked is like the rest of its part."""
    _, part = np.unique(key & 0xFFFF, return_inverse=True)
    part = part.reshape(-1)
    whole = sums_by(part, total, int(part.max(initial=-1)) + 1)[part]
    rest = whole * (total[:, :1] / np.maximum(whole[:, :1], _TINY))
    sums = dict(zip(_SUMS, np.where(total[:, 2:3] > 0, total, rest).T, strict=True))
    share, mixed = total[:, 0], total[:, 1]
    asked, evident = np.maximum(sums.pop("asked"), _TINY), sums["evident"]
    of_all = ("kd", "base", "roughness", "metallic", "change")
    means = {name: sums[name] / asked for name in of_all}
    means |= {name: sums[name] / np.maximum(evident, _TINY) for name in _PHOTOGRAPHED}
    evident = evident * share / asked
    return FittedPieces(key >> 16, key & 0xFFFF, share, mixed / np.maximum(share, _TINY), evident=evident, **means)


def components(pieces: FittedPieces, materials: MaterialPosterior, uniform: np.ndarray) -> dict[str, np.ndarray]:
    """The terms of the variance of kd, (G,) each, by their names in `COMPONENTS`, not multiplied yet."""
    segment, share = pieces.segment, pieces.share
    metal = materials.metal(segment)
    alone = 1 / (1 + uniform[segment]) ** 2
    count = len(uniform)
    by_part = np.bincount(segment, share * pieces.change, count) / np.maximum(np.bincount(segment, share, count), _TINY)
    known = pieces.evident > _LEAST_SHARE
    typical = np.median(pieces.relative[known]) if known.any() else _UNCHECKED
    # with one pixel's weight every piece has the room's residual: some have hardly a pixel of their own
    residual = (pieces.evident * pieces.residual + pieces.kd * typical) / (pieces.evident + 1)
    relative = (pieces.evident * pieces.relative + typical) / (pieces.evident + 1)
    wrong = metal * (1 - pieces.metallic) ** 2 + (1 - metal) * pieces.metallic**2
    return {
        "ambiguity": pieces.base**2 * wrong,
        "residual": alone * residual**2,
        "metal": pieces.metallic * (pieces.base * relative) ** 2,
        "shading": alone * (pieces.kd * pieces.change) ** 2,
        "mixing": alone * pieces.mixed**2 * _NOTHING,
        "outline": misplaced(pieces) * pieces.contrast,
        "part": (pieces.kd * by_part[segment]) ** 2,
        "room": (pieces.kd * typical) ** 2,
    }


def misplaced(pieces: FittedPieces) -> float:
    """Share of the pixels beside an outline that show the other side of it: of the steepest pieces, what is left."""
    known = pieces.evident > _LEAST_SHARE
    if not known.any():
        return 0.0
    steep = known & (pieces.steepness >= np.quantile(pieces.steepness[known], _STEEPEST))
    weight = pieces.evident[steep]
    return float(min(weight @ pieces.relative[steep] ** 2 / max(weight @ pieces.steepness[steep], _TINY), 1.0))


def bounded(variance: np.ndarray) -> np.ndarray:
    """The same, at most `_NOTHING`."""
    return 1 / (1 / np.maximum(variance, _TINY) + 1 / _NOTHING)


def _merged(
    pieces: FittedPieces, variance: np.ndarray, materials: MaterialPosterior, box: tuple[np.ndarray, float, int]
) -> Confidence:
    """Errors by voxel and facing: means over the parts that meet there, by their shares."""
    known = pieces.evident > _LEAST_SHARE
    metal = materials.metal(pieces.segment)
    off_metal = metal * (1 - pieces.metallic) + (1 - metal) * pieces.metallic
    errors = np.column_stack([variance, materials.roughness_error(pieces.segment, pieces.roughness), off_metal])
    record, place = np.unique(pieces.record, return_inverse=True)
    place, share = place.reshape(-1), np.maximum(pieces.share, _TINY)[:, None]
    total = sums_by(place, np.concatenate([share, share * errors, share * known[:, None]], axis=1), len(record))
    means = total[:, 1:] / total[:, :1]
    hardly = pieces.evident < _HARDLY
    unseen = errors[hardly if hardly.any() else slice(None)].mean(axis=0)
    return Confidence(
        *box,
        record,
        kd_error=np.sqrt(means[:, 0]).astype(np.float32),
        roughness_error=means[:, 1].astype(np.float32),
        metallic_error=means[:, 2].astype(np.float32),
        known=means[:, 3] > _MOSTLY,
        unseen=np.array([np.sqrt(unseen[0]), *unseen[1:]], np.float32),
    )
