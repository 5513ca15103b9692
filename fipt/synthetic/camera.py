"""A simulated camera: linear HDR views in, raw values of an exposure bracket out.

Light takes this way: a pinhole image of the scene (the *source*, wider than the view that is wanted) is sampled
where each pixel of the sensor looks (Brown-Conrady distortion), darkened towards the corners, filtered by the colour of
the pixel, collected for the shutter time, and read out: photon noise, read noise, black level, rounding, clipping.

Three image planes occur. The *view* is the undistorted image that development shall give. The *sensor* has `scale`
pixels along each pixel of the view, the same field at its middle, and the distortion. The *source* is a pinhole image
with the sensor's pixel pitch and margins as wide as the sensor sees; the view is the mean of its scale x scale blocks.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fipt.conventions import XYZ_FROM_SRGB
from fipt.errors import FiptError
from fipt.scene.blocks import block_mean
from fipt.scene.cameras import Camera
from fipt.synthetic.settings import SimulatedCamera

PRINTED_TIMES = (
    *(30, 25, 20, 15, 13, 10, 8, 6, 5, 4, "3.2", "2.5", 2, "1.6", "1.3", 1, "0.8", "0.6", "0.5", "0.4", "1/3"),
    *("1/4", "1/5", "1/6", "1/8", "1/10", "1/13", "1/15", "1/20", "1/25", "1/30", "1/40", "1/50", "1/60", "1/80"),
    *("1/100", "1/125", "1/160", "1/200", "1/250", "1/320", "1/400", "1/500", "1/640", "1/800", "1/1000", "1/1250"),
    *("1/1600", "1/2000", "1/2500", "1/3200", "1/4000", "1/5000", "1/6400", "1/8000"),
)
"""What cameras print for shutter times of 2^(n/3) seconds, n = 15 down to -39."""

_SLOWEST, _FASTEST = 15, -39
_ROWS = 256
"""Rows worked on at once. It is part of the order of the random numbers."""
_NODES = 65
"""Nodes of the spline that holds the undistorted position of every sensor point."""


# --- shutter ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class ShutterTime:
    """One frame of a bracket: the shutter time that the camera prints, and the true one in seconds."""

    printed: Fraction
    seconds: float


def exposures(camera: SimulatedCamera) -> list[ShutterTime]:
    """Return the frames of a bracket, shortest first.

    True times are 2^(n/3) seconds, off by ``shutter_error`` in the same way whenever that time is set.
    """
    step = max(round(3 * camera.step), 1)
    last = min(round(3 * np.log2(camera.longest)), _SLOWEST)
    thirds = [last - step * k for k in reversed(range(camera.exposures))]
    if thirds[0] < _FASTEST:
        raise FiptError(
            f"synthesize.raw: {camera.exposures} exposures {camera.step:g} EV apart below {camera.longest:g} s need "
            f"shutter times shorter than 1/8000 s",
            "take fewer exposures, smaller steps or a longer longest one",
        )
    return [ShutterTime(Fraction(PRINTED_TIMES[_SLOWEST - n]), 2 ** (n / 3) * _shutter(n, camera)) for n in thirds]


def _shutter(n: int, camera: SimulatedCamera) -> float:
    draw = np.random.default_rng([camera.seed, 1, n - _FASTEST]).standard_normal()
    return float(np.exp(camera.shutter_error * draw))


def reference_time(camera: SimulatedCamera) -> float:
    """Seconds, without the shutter's error, in which ``white_radiance`` saturates green: the shortest exposure."""
    return exposures(camera.model_copy(update={"shutter_error": 0.0}))[0].seconds


# --- geometry ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sensor:
    """Size and intrinsics of the sensor.

    Attributes
    ----------
    width, height
        Pixels.
    fx, fy, cx, cy
        Focal lengths and principal point, pixels; the centre of the top left pixel is (0.5, 0.5).
    distortion
        k1, k2, p1, p2, k3 as OpenCV defines them.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float]

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) float64 intrinsics, in this program's pixel coordinates."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], float)

    def distort(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Map points of the plane z = 1 (x right, y down) to (columns, rows) of the sensor, pixels."""
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        across = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        down = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return self.fx * across + self.cx, self.fy * down + self.cy

    def undistort(self, columns: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Invert `distort`, to 1e-9."""
        import cv2

        points = np.stack([np.ravel(columns), np.ravel(rows)], axis=-1).astype(np.float64)
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
        found = cv2.undistortPoints(points[:, None], self.matrix, np.array(self.distortion), criteria=stop)[:, 0]
        x, y = found.T.reshape(2, *np.shape(columns))
        back = np.stack(self.distort(x, y))
        error = np.hypot(*(back - (columns, rows))) / self.fx
        if not (error < 1e-9).all():
            raise FiptError(
                f"synthesize.raw.distortion {self.distortion} cannot be inverted over the whole sensor",
                "use weaker distortion or a narrower field of view",
            )
        return x, y

    def falloff(self, columns: np.ndarray, rows: np.ndarray, vignetting: tuple[float, ...]) -> np.ndarray:
        """Relative illumination at sensor points: 1 on the optical axis."""
        half = np.hypot(self.width, self.height) / 2
        r2 = ((columns - self.cx) ** 2 + (rows - self.cy) ** 2) / half**2
        a, b, c = vignetting
        return np.maximum(1 + r2 * (a + r2 * (b + r2 * c)), 0)


@dataclass(frozen=True)
class Optics:
    """The three image planes of a capture, for one place of the camera.

    Attributes
    ----------
    view
        The undistorted pinhole view that development shall give.
    sensor
        What takes the frames.
    source
        Pinhole camera of the image that must be known to simulate them.
    left, top
        Where the view begins in the source, source pixels.
    """

    view: Camera
    sensor: Sensor
    source: Camera
    left: int
    top: int


def optics(view: Camera, camera: SimulatedCamera) -> Optics:
    """Lay sensor and source around a view that is wanted."""
    scale = camera.scale
    across, down = camera.principal_offset
    sensor = Sensor(
        view.width * scale, view.height * scale, view.fx * scale, view.fy * scale,
        view.cx * scale + across, view.cy * scale + down, camera.distortion,
    )  # fmt: skip
    # What the sensor sees is bounded by what its border sees.
    t = np.linspace(0, 1, 257)
    ring = np.concatenate([np.stack(edge) for edge in ((t, 0 * t), (t, 0 * t + 1), (0 * t, t), (0 * t + 1, t))], 1)
    x, y = sensor.undistort(ring[0] * sensor.width, ring[1] * sensor.height)
    columns, rows = sensor.fx * x + view.cx * scale, sensor.fy * y + view.cy * scale
    left, top = (int(max(np.ceil(-side.min()) + 1, 1)) for side in (columns, rows))
    right = int(max(np.ceil(columns.max() - sensor.width) + 1, 1))
    bottom = int(max(np.ceil(rows.max() - sensor.height) + 1, 1))
    source = Camera(
        view.name, view.split, sensor.width + left + right, sensor.height + top + bottom,
        sensor.fx, sensor.fy, view.cx * scale + left, view.cy * scale + top, view.world_from_camera,
    )  # fmt: skip
    return Optics(view, sensor, source, left, top)


def optics_within(source: Camera, camera: SimulatedCamera) -> Optics:
    """Lay sensor and view into a pinhole image that is given: the largest view around its middle."""
    scale = camera.scale
    for margin in range(min(source.width, source.height) // (2 * scale)):
        width, height = source.width // scale - 2 * margin, source.height // scale - 2 * margin
        if min(width, height) < 1:
            break
        view = Camera(
            source.name, source.split, width, height, source.fx / scale, source.fy / scale,
            source.cx / scale - margin, source.cy / scale - margin, source.world_from_camera,
        )  # fmt: skip
        found = optics(view, camera)
        left, top = margin * scale, margin * scale
        fits = found.left <= left and found.top <= top
        fits &= found.source.width - found.left <= source.width - left
        fits &= found.source.height - found.top <= source.height - top
        if fits:
            return Optics(view, found.sensor, source, left, top)
    raise FiptError(
        f"view {source.name} of {source.width}x{source.height} pixels is too small for a sensor with this distortion",
        "use larger images or weaker distortion",
    )


# --- light on the sensor ----------------------------------------------------------------------


def camera_rgb(camera: SimulatedCamera) -> np.ndarray:
    """(3, 3) float64 camera RGB from linear sRGB."""
    return np.diag(camera.sensitivity) @ np.reshape(camera.mixing, (3, 3))


def camera_from_xyz(camera: SimulatedCamera) -> np.ndarray:
    """(3, 3) float64 camera RGB from CIE XYZ under D65: the DNG's ColorMatrix1."""
    return camera_rgb(camera) @ np.linalg.inv(XYZ_FROM_SRGB)


def expose_source(image: np.ndarray, planes: Optics, camera: SimulatedCamera) -> np.ndarray:
    """Return what each pixel of the sensor collects in the reference time.

    Parameters
    ----------
    image
        (h, w, 3) float32 radiance of the source camera, linear sRGB.
    planes, camera
        The camera.

    Returns
    -------
    (H, W) float32 mosaic without noise; 1 saturates.
    """
    from scipy.interpolate import RectBivariateSpline
    from scipy.ndimage import map_coordinates

    sensor, source = planes.sensor, planes.source
    if image.shape != (source.height, source.width, 3):
        raise FiptError(
            f"the image of {source.name} must be {source.width}x{source.height}; it is "
            f"{image.shape[1]}x{image.shape[0]}",
            "render it for the source camera",
        )
    # The undistorted position is smooth: a cubic spline through a few exact nodes is good to 1e-4 pixels.
    down, across = np.linspace(0, sensor.height, _NODES), np.linspace(0, sensor.width, _NODES)
    x, y = sensor.undistort(*np.meshgrid(across, down))
    column_of = RectBivariateSpline(down, across, source.fx * x + source.cx - 0.5)
    row_of = RectBivariateSpline(down, across, source.fy * y + source.cy - 0.5)
    matrix = (camera_rgb(camera) / camera.white_radiance).astype(np.float32)
    signal = np.empty((sensor.height, sensor.width), np.float32)
    for letter in "RGB":
        channel = image @ matrix["RGB".index(letter)]
        for place in (k for k in range(4) if camera.pattern[k] == letter):
            for start in range(0, sensor.height, _ROWS):
                rows = np.arange(start + place // 2, min(start + _ROWS, sensor.height), 2)
                columns = np.arange(place % 2, sensor.width, 2)
                if not len(rows) or not len(columns):
                    continue
                at = rows + 0.5, columns + 0.5
                # Linear interpolation is the mean of the source over a square of the pixel's size.
                light = map_coordinates(channel, (row_of(*at), column_of(*at)), order=1, mode="nearest")
                falloff = sensor.falloff(columns + 0.5, rows[:, None] + 0.5, camera.vignetting)
                signal[rows[0] : rows[-1] + 1 : 2, place % 2 :: 2] = light * falloff
    return signal


# --- read-out ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Defects:
    """Bad pixels of a sensor, the same in all its frames.

    Attributes
    ----------
    hot, dead
        Indices into the flat mosaic.
    glow
        What the hot ones collect without light in the longest exposure; 1 saturates.
    """

    hot: np.ndarray
    dead: np.ndarray
    glow: np.ndarray


def defects(shape: tuple[int, int], camera: SimulatedCamera) -> Defects:
    """Choose the bad pixels of a sensor."""
    rng = np.random.default_rng([camera.seed, 2])
    count = shape[0] * shape[1]
    hot, dead = round(camera.hot_pixels * count), round(camera.dead_pixels * count)
    chosen = rng.choice(count, hot + dead, replace=False)
    return Defects(np.sort(chosen[:hot]), np.sort(chosen[hot:]), rng.uniform(0.1, 1.0, hot))


def white_level(camera: SimulatedCamera) -> int:
    """Raw value at saturation."""
    return camera.white_level or 2**camera.bits - 1


def read_out(signal: np.ndarray, seconds: float, camera: SimulatedCamera, key: str) -> np.ndarray:
    """Expose the sensor and read it out.

    Parameters
    ----------
    signal
        (H, W) float32 from `expose_source`.
    seconds
        True shutter time.
    camera
        Its noise, levels and defects.
    key
        Name of the frame: the key of its noise.

    Returns
    -------
    (H, W) uint16 raw values.
    """
    rng = np.random.default_rng([camera.seed, 3, zlib.crc32(key.encode())])
    ratio = seconds / reference_time(camera)
    bad = defects(signal.shape, camera)
    if len(bad.hot) or len(bad.dead):
        signal = signal.copy()
        signal.flat[bad.dead] = 0
        # Dark current does not pass the lens: it is counted in the same unit, on top of the light.
        signal.flat[bad.hot] += bad.glow / (exposures(camera)[-1].seconds / reference_time(camera))
    white = white_level(camera)
    black = np.add(camera.black_levels, camera.dark_offset).reshape(2, 2)
    gain = (white - np.mean(camera.black_levels)) / camera.full_well
    raw = np.empty(signal.shape, np.uint16)
    for start in range(0, len(signal), _ROWS):
        part = signal[start : start + _ROWS]
        # Far beyond saturation the number of electrons does not matter, but the generator has a limit.
        collected = np.clip(part.astype(np.float64) * ratio, 0, 8) * camera.full_well
        electrons = rng.poisson(collected) + camera.read_noise * rng.standard_normal(part.shape, np.float32)
        level = np.tile(black, (len(part) // 2 + 1, part.shape[1] // 2 + 1))[: len(part), : part.shape[1]]
        raw[start : start + _ROWS] = np.clip(np.rint(level + gain * electrons), 0, white)
    return raw


# --- truth ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ghost:
    """An object that stands in one exposure only.

    Attributes
    ----------
    frame
        Index of that exposure, shortest first.
    image
        (h, w, 3) float32 source image of that moment.
    """

    frame: int
    image: np.ndarray


def ghost(image: np.ndarray, planes: Optics, camera: SimulatedCamera) -> Ghost:
    """Put a grey disc into the middle exposure of a view.

    It is four times as bright as the median behind it, or a quarter of that where it would be near saturation.
    """
    rng = np.random.default_rng([camera.seed, 4, zlib.crc32(planes.view.name.encode())])
    height, width = image.shape[:2]
    row, column = rng.uniform(0.35, 0.65, 2) * (height, width)
    rows, columns = np.mgrid[:height, :width] + 0.5
    disc = np.hypot(rows - row, columns - column) < 0.1 * width
    frame, behind = camera.exposures // 2, np.median(image[disc])
    ratio = exposures(camera)[frame].seconds / reference_time(camera) * camera_rgb(camera).sum(axis=1).max()
    shown = image.copy()
    shown[disc] = behind * (4 if 4 * behind * ratio < 0.7 * camera.white_radiance else 0.25)
    return Ghost(frame, shown)


def view_truth(
    image: np.ndarray, planes: Optics, camera: SimulatedCamera, moved: Ghost | None = None
) -> dict[str, np.ndarray]:
    """Return what development should find in a view.

    Returns
    -------
    dict
        Layers of an EXR file: ``""`` (H, W, 3) float32 radiance; ``saturated.Y``, ``outside.Y``, ``moved.Y``
        (H, W) float32, the share of the pixel whose shortest exposure is clipped in any channel, that the sensor does
        not see, and that a ghost changed (by 5 % and by five times the noise of that exposure).
    """
    view, sensor, scale = planes.view, planes.sensor, camera.scale
    window = np.s_[planes.top : planes.top + sensor.height, planes.left : planes.left + sensor.width]
    inside = image[window]
    x = (np.arange(sensor.width) + 0.5 - view.cx * scale) / sensor.fx
    y = (np.arange(sensor.height) + 0.5 - view.cy * scale) / sensor.fy
    columns, rows = sensor.distort(x[None], y[:, None])
    seen = (columns >= 0) & (columns < sensor.width) & (rows >= 0) & (rows < sensor.height)
    falloff = sensor.falloff(columns, rows, camera.vignetting)[..., None]
    frames, matrix = exposures(camera), camera_rgb(camera).T.astype(np.float32)

    def collected(image: np.ndarray, frame: int) -> np.ndarray:
        ratio = frames[frame].seconds / reference_time(camera)
        return np.minimum(image @ matrix / camera.white_radiance * falloff * ratio, 1)

    changed = np.zeros(seen.shape, bool)
    if moved is not None:
        before, after = collected(inside, moved.frame), collected(moved.image[window], moved.frame)
        noise = np.sqrt(before / camera.full_well + (camera.read_noise / camera.full_well) ** 2)
        changed = (np.abs(after - before) > np.maximum(0.05 * before, 5 * noise)).any(axis=-1)
    masks = {"saturated.Y": (collected(inside, 0) >= 1).any(axis=-1), "outside.Y": ~seen, "moved.Y": changed}
    return {"": block_mean(inside, scale)} | {name: block_mean(mask, scale) for name, mask in masks.items()}
