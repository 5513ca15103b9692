"""Merging mosaics: against closed forms, on mosaics made here."""

from pathlib import Path

import numpy as np
import pytest

from fipt.stages.capture import merge, noise
from fipt.stages.capture.calibration import Noise, Vignetting
from fipt.stages.capture.exposures import chained, measured_ratio
from fipt.stages.capture.mosaic import demosaic, replace_bad_pixels, tiled
from fipt.stages.capture.raw import RawFrame, Shot

RGGB = np.array([[0, 1], [3, 2]])
BLACK = np.array([512.25, 510.5, 514.0, 511.75])
WHITE = np.full(4, 16383.0)
NOISE = Noise(gain=0.4, read=1.5, iso=100.0)
EXPOSURES = [1 / 4, 1 / 16, 1 / 64, 1 / 256, 1 / 1024]


def frame(electrons_per_second: np.ndarray, seconds: float, rng: np.random.Generator) -> RawFrame:
    """A noisy frame of light in raw units per second, grey."""
    z = electrons_per_second * seconds
    z = z + np.sqrt(NOISE.gain * z + NOISE.read**2) * rng.standard_normal(z.shape)
    raw = np.clip(np.rint(z + tiled(BLACK, RGGB, *z.shape)), 0, 16383).astype(np.uint16)
    return RawFrame(raw, RGGB, BLACK, WHITE, None, None, Shot(Path("a"), seconds, iso=100))


def merged(light: np.ndarray, rng: np.random.Generator, exposures=EXPOSURES, **changes) -> merge.Merged:
    options = {"gains": merge.Gains(), "saturation": 0.98, "motion": 0.03} | changes
    frames = [frame(light, seconds, rng) for seconds in exposures]
    return merge.merge_mosaics(frames, exposures, BLACK, NOISE, **options)


def greens(result: merge.Merged) -> np.ndarray:
    """Radiance at the green pixels, which demosaicing leaves as they are, in raw units per second."""
    return result.table[result.codes[0::2, 1::2, 1]].astype(float) * (WHITE - BLACK)[1]


@pytest.mark.parametrize("level", [2.0, 40.0, 2000.0, 60_000.0, 900_000.0])
def test_the_merge_is_unbiased_and_as_quiet_as_inverse_variance_allows(level: float, np_rng) -> None:
    result = greens(merged(np.full((400, 400), level), np_rng))
    e = np.array(EXPOSURES)
    usable = level * e < 0.95 * 15800
    sigma = (np.sum((e**2 / (NOISE.gain * level * e + NOISE.read**2 + 1 / 12))[usable])) ** -0.5
    assert result.std() == pytest.approx(sigma, rel=0.05)
    assert abs(result.mean() - level) < 4 * sigma / np.sqrt(result.size) + 5e-4 * level


def test_negative_noise_passes_through(np_rng) -> None:
    result = greens(merged(np.zeros((400, 400)), np_rng))
    assert (result < 0).mean() == pytest.approx(0.5, abs=0.02)
    assert abs(result.mean()) < 4 * result.std() / np.sqrt(result.size)


def test_codes_keep_a_hundred_million_to_one_within_a_tenth_of_a_permille() -> None:
    offset, step = 1e-3, np.log1p(1e5 / 1e-3) / 59_000
    values = np.concatenate([-np.geomspace(1e-6, 7e-4, 50), np.geomspace(1e-6, 9e4, 500)]).astype(np.float32)
    decoded = merge.decoding_table(offset, step)[merge.encode(values.copy(), offset, step)]
    assert (np.abs(decoded - values) < 2e-4 * (np.abs(values) + offset)).all()


def test_saturated_pixels_hold_a_lower_bound(np_rng) -> None:
    light = np.full((64, 64), 1000.0)
    light[20:40, 20:40] = 1e9
    result = merged(light, np_rng)
    inside = np.zeros(light.shape, bool)
    inside[20:40, 20:40] = True
    assert (result.saturated == inside).all()
    bound = result.table[result.codes[28:32, 28:32]]
    assert bound == pytest.approx(1 / EXPOSURES[-1], rel=0.01)
    assert result.clipped == pytest.approx([inside.mean()] * 5)


def test_a_bright_colour_alone_is_saturated_as_a_whole(np_rng) -> None:
    light = np.full((64, 64), 1000.0)
    light[20:40:2, 20:40:2] = 1e9  # the red pixels of a patch
    saturated = merged(light, np_rng).saturated
    assert saturated[20:39, 20:39].all()
    assert saturated.sum() <= 20 * 20


def test_vignetting_and_white_balance_are_undone(np_rng) -> None:
    vignetting = Vignetting((100.0, 60.0), 120.0, (-0.3, -0.1))
    rows, columns = np.mgrid[:120, :200].astype(np.float32) + np.float32(0.5)
    falloff = vignetting.falloff(columns, rows)
    assert falloff.min() < 0.65
    tint = tiled(np.array([0.5, 1.0, 0.25, 1.0]), RGGB, 120, 200)
    gains = merge.Gains(np.array([2.0, 1.0, 4.0]), vignetting)
    result = merged(20_000 * falloff * tint, np_rng, gains=gains)
    radiance = result.table[result.codes] * (WHITE - BLACK).mean()
    assert radiance.mean(axis=(0, 1)) == pytest.approx([20_000] * 3, rel=2e-3)
    assert np.abs(radiance[:8, :8] / 20_000 - 1).max() < 0.1


def test_moved_pixels_are_found_and_still_ones_are_not(np_rng) -> None:
    light = np.full((200, 200), 3000.0)
    frames = [frame(light, seconds, np_rng) for seconds in EXPOSURES]
    there = light.copy()
    there[60:100, 80:140] *= 1.6
    frames[1] = frame(there, EXPOSURES[1], np_rng)
    options = (EXPOSURES, BLACK, NOISE, merge.Gains(), 0.98)
    moved = merge.merge_mosaics(frames, *options, 0.03).moved
    true = there != light
    assert (moved & true).sum() / moved.sum() > 0.95
    assert (moved & true).sum() / true.sum() > 0.95
    assert not merge.merge_mosaics(frames, *options, 0.0).moved.any()
    # A lamp that was there in the longest exposure only: clipped there, though the others say it should not be.
    there[60:100, 80:140] = 1e6
    frames[0], frames[1] = frame(there, EXPOSURES[0], np_rng), frame(light, EXPOSURES[1], np_rng)
    moved = merge.merge_mosaics(frames, *options, 0.03).moved
    assert (moved & true).sum() / (moved | true).sum() > 0.95


def test_one_exposure_says_nothing_of_motion(np_rng) -> None:
    assert not merged(np.full((64, 64), 1e5), np_rng, exposures=[1 / 16]).moved.any()


def test_what_is_below_the_noise_of_the_longest_exposure_is_marked(np_rng) -> None:
    light = np.full((128, 128), 2000.0)
    light[:, 64:] = 0.5  # an eighth of a raw unit
    noisy = merged(light, np_rng).noisy
    assert not noisy[:, :60].any()
    assert noisy[:, 68:].mean() > 0.99


def test_noise_is_measured_from_overlapping_exposures(np_rng) -> None:
    light = np.exp(np_rng.normal(7, 2, (40, 50))).repeat(12, 0).repeat(12, 1)
    frames = [frame(light, seconds, np_rng) for seconds in EXPOSURES]
    found = noise.measured_noise(frames, EXPOSURES, BLACK)
    assert found.gain == pytest.approx(NOISE.gain, rel=0.1)
    assert found.read == pytest.approx(np.hypot(NOISE.read, 12**-0.5), rel=0.1)
    assert noise.measured_noise(frames[:1], EXPOSURES[:1], BLACK) is None


def test_ratios_are_measured_whatever_moved(np_rng) -> None:
    light = np.exp(np_rng.normal(9, 1, (40, 50))).repeat(12, 0).repeat(12, 1)
    long, short = frame(light, 1 / 4, np_rng), frame(light, 1 / 4 / 4.13, np_rng)
    short.mosaic[100:160, 100:200] += 3000
    assert measured_ratio(long, short, BLACK, 4.0) == pytest.approx(4.13, rel=2e-3)
    dark = frame(np.zeros((100, 100)), 1.0, np_rng)
    assert measured_ratio(dark, dark, BLACK, 4.0) is None


def test_measured_exposures_hang_on_the_middle_one() -> None:
    assert chained([4.2, None], [16.0, 4.0, 1.0], anchor=1) == pytest.approx([16.8, 4.0, 1.0])


def test_hat_weights_are_those_of_the_supplement() -> None:
    """Even grey without noise, against the formula written out."""
    for level in (1e2, 3e3, 5e4, 7e5, 6e6):
        frames, signals = [], []
        for seconds in EXPOSURES:
            raw = np.clip(np.rint(level * seconds + tiled(BLACK, RGGB, 16, 16)), 0, 16383).astype(np.uint16)
            frames.append(RawFrame(raw, RGGB, BLACK, WHITE, None, None, Shot(Path("a"), seconds)))
            signals.append(((raw - tiled(BLACK, RGGB, 16, 16)) / (WHITE - BLACK)[0])[8, 8])
        top = bottom = 0.0
        for k, (z, seconds) in enumerate(zip(signals, EXPOSURES, strict=True)):
            w = min(max(2 * min(z, 1 - z), 0), 1)
            if (k == 0 and z < 0.5) or (k == 4 and z >= 0.5):
                w = 1
            top, bottom = top + w * z / seconds, bottom + w
        found = merge.merge_hat(frames, EXPOSURES, BLACK, merge.Gains())[8, 8, 0]
        assert found == pytest.approx(top / bottom, rel=5e-3, abs=0.01)


def test_demosaicing_keeps_samples_and_follows_edges(np_rng) -> None:
    for pattern in (RGGB, RGGB[::-1], RGGB[:, ::-1], RGGB[::-1, ::-1]):
        mosaic = np_rng.integers(0, 65535, (32, 48)).astype(np.uint16)
        rgb = demosaic(mosaic, pattern)
        for (i, j), color in np.ndenumerate(pattern):
            assert (rgb[i::2, j::2, (0, 1, 2, 1)[color]] == mosaic[i::2, j::2]).all()
        step = np.where(np.arange(48) < 24, 1000, 50_000).astype(np.uint16) * np.ones((32, 1), np.uint16)
        assert (demosaic(step, pattern)[..., 1] == step).all()


def test_bad_pixels_take_the_mean_of_their_colour() -> None:
    rows, columns = np.indices((20, 20))
    plane = (1000 + 10 * rows + 3 * columns).astype(np.uint16)
    bad = np.array([[0, 0], [7, 9], [7, 11], [19, 4]])
    spoilt = plane.copy()
    spoilt[tuple(bad.T)] = 65535
    replace_bad_pixels(spoilt, bad)
    assert spoilt[7, 9] == pytest.approx(plane[7, 9], abs=1)
    assert np.abs(spoilt.astype(int) - plane).max() < 30
    assert ((spoilt != plane).sum()) <= len(bad)
