"""Baked shading on disk: one 32-bit word for Ld and one for each roughness level of a sample (docs/adr/0007)."""

from pathlib import Path

import numpy as np

from fipt.conventions import LUMINANCE, ROUGHNESS_LEVELS, SHADING_OUTPUTS
from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, save_npy
from fipt.formats.manifests import ListedFiles
from fipt.scene.samples import FootprintSamples

SHADING, BEFORE = "shading.npy", "before.npy"
"""Names in a folder of shading; of a refined one ``before`` is the shading of the round before."""
_LEVELS = len(ROUGHNESS_LEVELS)
_WORDS = 1 + _LEVELS
_SALTS = 16
_BITS = np.array([(12, 4, 8, 8)] + [(10, 8, 7, 7)] * _LEVELS).T[:, None]
"""(4, 1, words) sizes of a word's fields: luminance; share of Ls1 in it, in Ld's word the salt; red and blue share."""
_SHIFT = (32 - np.cumsum(_BITS, axis=0)).astype(np.uint32)
_TOP = (2**_BITS - 1).astype(np.uint32)
"""Largest code of every field."""
_LOWEST = np.float32(-16)
"""log2 of the smallest luminance that is not zero; the largest is 2^16."""
_STEPS = (2.0 ** _BITS[0] / 32).astype(np.float32)
"""Luminance codes an octave, (1, words)."""
_LUMINANCE = np.array(LUMINANCE, np.float32)
_TINY, _MOST = np.float32(1e-30), np.float32(1e30)
_CHUNK = 1 << 14
"""Samples unpacked at a time: what is worked on stays in the processor's cache."""


class Shading:
    """Shading of H samples, (H, outputs, 3); packed in memory or in a memory map, float32 where it is read.

    Indexing takes a slice or an array of samples. Ls0 and Ls1 of a level share their colour.

    Attributes
    ----------
    words
        (H, 1 + levels) uint32.
    """

    def __init__(self, words: np.ndarray) -> None:
        self.words = words

    @classmethod
    def empty(cls, count: int) -> "Shading":
        """Room for ``count`` samples."""
        return cls(np.zeros((count, _WORDS), np.uint32))

    @classmethod
    def of(cls, values: np.ndarray) -> "Shading":
        """Pack (N, outputs, 3) values of a view's samples."""
        return cls(_packed(np.asarray(values, np.float32)))

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, outputs, 3)."""
        return len(self.words), SHADING_OUTPUTS, 3

    @property
    def nbytes(self) -> int:
        """Bytes on disk."""
        return self.words.nbytes

    def __len__(self) -> int:
        return len(self.words)

    def __getitem__(self, samples: slice | np.ndarray) -> np.ndarray:
        words = np.asarray(self.words[samples])
        values = np.empty((len(words), SHADING_OUTPUTS, 3), np.float32)
        for start in range(0, len(words), _CHUNK):
            values[start : start + _CHUNK] = _unpacked(words[start : start + _CHUNK])
        return values

    def __setitem__(self, samples: slice, values: np.ndarray) -> None:
        """Pack the shading of all samples of a view, float32: the random numbers count from its first sample."""
        self.words[samples] = _packed(values)


def diffuse_shading(shading: Shading | np.ndarray, samples: slice | np.ndarray) -> np.ndarray:
    """(N, 3) Ld of some samples (N,); the rest is not unpacked."""
    if isinstance(shading, Shading):
        return _unpacked(np.asarray(shading.words[samples]), 1)[:, 0]
    return np.asarray(shading[samples], np.float32)[:, 0]


def save_shading(folder: Path, shading: Shading, name: str = SHADING) -> None:
    """Write the shading of a shard into an existing folder."""
    save_npy(folder / name, shading.words)


def read_shading(folder: str | Path, samples: FootprintSamples | None = None, name: str = SHADING) -> Shading:
    """Shading of a shard, memory-mapped; checked against its samples where they are given.

    Of a refined shard it is what was traced; `fipt.scene.change.read_round` joins it with that of the round before.

    Raises
    ------
    FiptError
        If it is missing or is not the shading of ``samples``.
    """
    words = load_npy(ListedFiles(folder).check(Path(folder) / name))
    expected = (len(words) if samples is None else len(samples.position), _WORDS)
    if words.shape != expected or words.dtype != np.uint32:
        raise FiptError(
            f"{folder} must hold shading of shape {expected} uint32 for its samples; found {words.shape} {words.dtype}",
            "give the shading of the same shard, or bake it again",
        )
    return Shading(words)


def _packed(values: np.ndarray) -> np.ndarray:
    """(N, words) uint32 of (N, outputs, 3) values: logarithms of luminances, square roots of shares.

    What rounding would distort is dithered, and the dither subtracted again where it is read: errors have no bias. It
    is keyed by the number of a sample in its view, so that it does not matter how views are spread over shards.
    """
    values = np.clip(values, 0, _MOST)
    color, ls1 = values[:, :_WORDS].copy(), values[:, _WORDS:]
    color[:, 1:] += ls1
    luminance, total = color @ _LUMINANCE, color.sum(axis=-1)
    salt = (np.arange(len(values), dtype=np.uint32) * np.uint32(0x9E3779B9)) >> np.uint32(28)  # golden ratio: spread
    code = np.zeros((4, len(values), _WORDS), np.float32)
    code[0] = (np.log2(np.maximum(luminance, _TINY)) - _LOWEST) * _STEPS
    code[1, :, 1:] = _ratio(ls1 @ _LUMINANCE, luminance[:, 1:])
    code[2], code[3] = _ratio(color[..., 0], total), _ratio(color[..., 2], total)
    code[1:] = np.sqrt(code[1:]) * _TOP[1:].astype(np.float32)
    field = np.clip(np.rint(code + _DITHER[:, salt]), 0, _TOP.astype(np.float32)).astype(np.uint32)
    field[1, :, 0] = salt
    return np.bitwise_or.reduce(field << _SHIFT)


def _unpacked(words: np.ndarray, count: int = _WORDS) -> np.ndarray:
    """(N, outputs, 3) float32 of (N, words), or of their first ``count`` only."""
    top = _TOP[..., :count]
    field = (words[:, :count] >> _SHIFT[..., :count]) & top
    value = field.astype(np.float32)
    # the smallest and the largest code are exact: what is black stays so
    value -= _DITHER[:, field[1, :, 0], :count] * ((field > 0) & (field < top))
    luminance = np.exp2(value[0] / _STEPS[:, :count] + _LOWEST) * (field[0] > 0)
    value /= top.astype(np.float32)
    share, red, blue = np.square(value[1:], out=value[1:])
    green = np.maximum(1 - red - blue, 0)
    r, g, b = _LUMINANCE
    luminance /= r * red + g * green + b * blue  # now the sum of the three
    result = np.empty((len(words), 2 * count - 1, 3), np.float32)
    color, ls1 = result[:, :count], result[:, count:]
    for channel, part in enumerate((red, green, blue)):
        np.multiply(luminance, part, out=color[..., channel])
    np.multiply(color[:, 1:], share[:, 1:, None], out=ls1)
    color[:, 1:] -= ls1
    return result


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.clip(part / np.maximum(whole, _TINY), 0, 1)


def _dithers() -> np.ndarray:
    """(4, salts, words) in (-0.5, 0.5): every field has evenly spaced values, in an order of its own."""
    key = np.arange(4 * _SALTS * _WORDS, dtype=np.uint32).reshape(4, _SALTS, _WORDS)
    for factor in (0x85EBCA6B, 0xC2B2AE35):  # an integer hash, the finaliser of MurmurHash3
        key ^= key >> np.uint32(16)
        key *= np.uint32(factor)
    order = (key ^ (key >> np.uint32(16))).argsort(axis=1)
    return ((order + 0.5) / _SALTS - 0.5).astype(np.float32)


_DITHER = _dithers()
