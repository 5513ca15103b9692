"""The lens of a real camera: pinhole intrinsics with Brown-Conrady distortion (the model and names of OpenCV).

What bends or straightens points and images is OpenCV's: `cv2.projectPoints`, `cv2.undistortPoints`,
`cv2.initUndistortRectifyMap`.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Lens:
    """Intrinsics and distortion of a camera, for images of one size.

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

    def downscaled(self, factor: int) -> "Lens":
        """The lens of images averaged over ``factor`` x ``factor`` pixels (what does not fill a block is cut off)."""
        return Lens(
            self.width // factor,
            self.height // factor,
            self.fx / factor,
            self.fy / factor,
            self.cx / factor,
            self.cy / factor,
            self.distortion,
        )
