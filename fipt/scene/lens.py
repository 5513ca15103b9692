"""The lens of a real camera: pinhole intrinsics with Brown-Conrady distortion (the model and names of OpenCV)."""

from dataclasses import dataclass, replace

import numpy as np

_UNDISTORT_STEPS = 30
"""Newton steps at most; lenses need 3 to 6."""


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera, for pictures of one size.

    Attributes
    ----------
    width, height
        Image size in pixels.
    fx, fy, cx, cy
        Focal lengths and principal point in pixels; the centre of the top left pixel is (0.5, 0.5), as everywhere
        in this program (OpenCV has it at (0, 0)).
    distortion
        k1, k2, p1, p2, k3: Brown-Conrady as in OpenCV. All zero for a pinhole camera.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) float64 camera matrix for OpenCV, whose pixel centres are whole numbers."""
        return np.array([[self.fx, 0, self.cx - 0.5], [0, self.fy, self.cy - 0.5], [0, 0, 1.0]])

    @property
    def pinhole(self) -> "Lens":
        """The same camera without distortion: what undistorted pictures are seen through."""
        return replace(self, distortion=(0.0,) * 5)

    def downscaled(self, factor: int) -> "Lens":
        """The lens of pictures averaged over ``factor`` x ``factor`` pixels (what does not fill a block is cut off)."""
        return Lens(
            self.width // factor,
            self.height // factor,
            self.fx / factor,
            self.fy / factor,
            self.cx / factor,
            self.cy / factor,
            self.distortion,
        )

    def distort(self, points: np.ndarray) -> np.ndarray:
        """Return where the lens puts points of the pinhole picture: (..., 2) -> (..., 2) float64, pixels."""
        x, y = self._normalised(points)
        return self._pixels(*_distorted(x, y, self.distortion))

    def undistort(self, points: np.ndarray) -> np.ndarray:
        """Invert `distort` by Newton's method: (..., 2) photographed points -> (..., 2) pinhole points, pixels."""
        x_d, y_d = self._normalised(points)
        x, y = x_d.copy(), y_d.copy()
        for _ in range(_UNDISTORT_STEPS):
            found = _distorted(x, y, self.distortion)
            dx, dy = found[0] - x_d, found[1] - y_d
            if max(np.abs(dx).max(initial=0), np.abs(dy).max(initial=0)) < 1e-12:
                break
            a, b, c, d = _jacobian(x, y, self.distortion)
            determinant = a * d - b * c
            x -= (d * dx - b * dy) / determinant
            y -= (a * dy - c * dx) / determinant
        return self._pixels(x, y)

    def _normalised(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = np.asarray(points, np.float64)
        return (points[..., 0] - self.cx) / self.fx, (points[..., 1] - self.cy) / self.fy

    def _pixels(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=-1)


def _distorted(x: np.ndarray, y: np.ndarray, distortion: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


def _jacobian(x: np.ndarray, y: np.ndarray, distortion: tuple[float, ...]) -> tuple[np.ndarray, ...]:
    """Derivatives dx_d/dx, dx_d/dy, dy_d/dx, dy_d/dy of `_distorted`."""
    k1, k2, p1, p2, k3 = distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d radial / d r2, times 2
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    return (
        radial + x * x * slope + 2 * p1 * y + 6 * p2 * x,
        mixed,
        mixed,
        radial + y * y * slope + 6 * p1 * y + 2 * p2 * x,
    )
