"""Plane sweep: a first depth of every pixel, from planes that face the camera or lie along the world's axes."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from fipt.stages.geometry.stereo_view import StereoView, transfer

_WINDOW = 7
"""Side of the windows of correlation, pixels."""
_FILLED = 0.5
"""Share of a window that a source must show."""
_STEP = 1.0
"""Pixels that the picture in the source that moves most moves between neighbouring planes, about."""
_MOST_PLANES = 256
"""Planes of a direction, at most."""
BEST, LEAST = 3, 2
"""Sources whose correlation counts, the best ones among those that show a window, at most and at least: the others may
not see the surface."""
UNSEEN = -2.0
"""Correlation with a source that shows too little of a window: below any other."""


def sweep(reference: StereoView, sources: Sequence[StereoView], nearest: float) -> tuple[np.ndarray, np.ndarray]:
    """Try planes of the world's axes and facing the camera.

    Parameters
    ----------
    nearest
        Least distance of a surface, metres.

    Returns
    -------
    planes
        (3, H, W) float32: inverse depth and its slopes along u and v.
    score
        (H, W) float32 in [-1, 1]: mean correlation with the best sources that show the window; -1 where only one does.
    """
    shape = reference.light.shape
    planes, score = np.zeros((3, *shape), np.float32), np.full(shape, -2.0, np.float32)
    window = _Windows(reference)
    shown = [window.light_of(source) for source in sources]
    transfers = [transfer(reference, source) for source in sources]
    for plane, form in _forms(reference, transfers, nearest):
        usable = (plane > 0) & (plane < 1 / nearest)
        found = _Best(shape)
        for light, (turn, shift) in zip(shown, transfers, strict=True):
            found.add(window.correlation(light, turn + np.outer(shift, form)))
        mean = found.mean
        better = (mean > score) & usable
        score[better] = mean[better]
        planes[0][better] = plane[better]
        planes[1][better], planes[2][better] = form[0], form[1]
    planes[0][score < -1] = 1 / (4 * nearest)
    return planes, np.maximum(score, -1.0)


def _forms(
    reference: StereoView, transfers: Sequence[tuple[np.ndarray, np.ndarray]], nearest: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Inverse depth over the image of every plane, (H, W) float32, and its form m, (3,)."""
    back = np.linalg.inv(reference.intrinsics)
    axes = reference.rotation @ np.concatenate([np.eye(3), -np.eye(3)], axis=1)
    columns, rows = reference.camera.width, reference.camera.height
    v, u = np.mgrid[:rows, :columns].astype(np.float32)
    some = np.stack([u[::8, ::8], v[::8, ::8], np.ones_like(u[::8, ::8])], axis=-1).reshape(-1, 3)
    for direction in (np.array([0.0, 0.0, 1.0]), *axes.T):
        form = back.T @ direction
        unit = some @ form  # inverse depth of the plane at distance 1
        seen = unit > 0.05
        if not seen.any():
            continue
        points, unit = some[seen], unit[seen]
        # planes nearer than that would lie before the nearest surface in all of the image
        most = 1 / (nearest * float(np.median(unit)))
        motion = max(_motion(turn, shift, points, unit, most, (columns, rows)) for turn, shift in transfers)
        count = int(np.clip(motion / _STEP, 8, _MOST_PLANES))
        for inverse in most * (np.arange(count) + 0.5) / count:
            m = form * inverse
            yield m[0].astype(np.float32) * u + np.float32(m[1]) * v + np.float32(m[2]), m


def _motion(
    turn: np.ndarray, shift: np.ndarray, points: np.ndarray, unit: np.ndarray, most: float, size: tuple[int, int]
) -> float:
    """Pixels that the picture moves in a source from far planes to near ones, the most among points in its frame."""
    steps = np.linspace(0, most, 9)
    seen = points @ turn.T + (unit * steps[:, None])[..., None] * shift
    ahead = seen[..., 2] > 0.05
    pixel = seen[..., :2] / np.where(ahead, seen[..., 2], 1.0)[..., None]
    inside = ahead & (pixel > -0.2 * np.array(size)).all(-1) & (pixel < 1.2 * np.array(size)).all(-1)
    moved = np.linalg.norm(np.diff(pixel, axis=0), axis=-1)
    fast = moved[inside[1:] & inside[:-1]]
    return float(np.quantile(fast, 0.9)) * 8 if fast.size else 0.0


class _Windows:
    """Sums over the windows of a reference."""

    def __init__(self, reference: StereoView) -> None:
        self.known = np.isfinite(reference.light).astype(np.float32)
        self.offset = float(np.nanmean(reference.light)) if self.known.any() else 0.0
        self.light = np.where(self.known > 0, reference.light - self.offset, 0.0).astype(np.float32)
        self.noise = reference.noise**2 + 1e-8

    def light_of(self, source: StereoView) -> np.ndarray:
        """(H, W, 2) float32 light of a source, over this one's mean, and 1 where it is known."""
        known = np.isfinite(source.light)
        light = np.where(known, source.light - self.offset, 0.0)
        return cv2.merge([light.astype(np.float32), known.astype(np.float32)])

    def correlation(self, source: np.ndarray, homography: np.ndarray) -> np.ndarray:
        """(H, W) float32 zero-mean normalised correlation with a source, brought here; `UNSEEN` if it tells little.

        Parameters
        ----------
        source
            What `light_of` returns.
        """
        rows, columns = self.light.shape
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        light, mask = cv2.split(cv2.warpPerspective(source, homography, (columns, rows), flags=flags))
        mask = (mask > 0.99) * self.known
        a, b = self.light * mask, light * mask
        share = _window_mean(mask)
        scale = 1 / np.maximum(share, 1e-6)
        mean_a, mean_b = _window_mean(a) * scale, _window_mean(b) * scale
        variance_a = np.maximum(_window_mean(a * a) * scale - mean_a * mean_a, 0) + self.noise
        variance_b = np.maximum(_window_mean(b * b) * scale - mean_b * mean_b, 0) + self.noise
        together = _window_mean(a * b) * scale - mean_a * mean_b
        return np.where(share > _FILLED, together / np.sqrt(variance_a * variance_b), UNSEEN)


def _window_mean(values: np.ndarray) -> np.ndarray:
    """(H, W) float32 mean over the window of every pixel; beyond the image there is 0. Faster than many at once."""
    return cv2.boxFilter(values, -1, (_WINDOW, _WINDOW), borderType=cv2.BORDER_CONSTANT)


class _Best:
    """Mean of the best values of every pixel, of those that are not `UNSEEN`."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.values = [np.full(shape, UNSEEN, np.float32) for _ in range(BEST)]

    def add(self, value: np.ndarray) -> None:
        """Sort a value in."""
        for place, held in enumerate(self.values):
            self.values[place] = np.maximum(held, value)
            value = np.minimum(held, value)

    @property
    def mean(self) -> np.ndarray:
        """(H, W) float32 over what was seen; -1 where that is too little."""
        values = np.stack(self.values)
        seen = values > UNSEEN
        count = seen.sum(axis=0)
        total = np.where(seen, values, 0).sum(axis=0)
        return np.where(count >= LEAST, total / np.maximum(count, 1), -1.0).astype(np.float32)
