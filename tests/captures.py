"""Small simulated captures, sound or with one fault: what the tests of RAW development read.

    capture = write(tmp_path / "raw")                          # two views, five exposures, calibration
    capture = write(tmp_path / "raw", faults=("missing frame",))
    capture = write(tmp_path / "raw", size=(48, 32), pattern="GBRG", exposures=3)

Views show one smooth, coloured image with a lamp, an edge and a dark corner (`scene_image`), so that nothing has to be
rendered. Every capture has its truth beside it: `Capture.truth` and truth/camera.json.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from fipt.scene.cameras import Camera
from fipt.scene.dataset import read_layers
from fipt.synthetic import calibration
from fipt.synthetic import capture as writer
from fipt.synthetic.camera import Optics, expose_source, exposures, optics, read_out, reference_time
from fipt.synthetic.dng import write_dng
from fipt.synthetic.settings import SimulatedCamera

SIZE = (64, 48)
"""Width and height of a view; the sensor has twice that."""

SMALL = {"calibration_frames": 9, "full_well": 40_000.0, "scale": 2}
"""Settings of the camera that differ from the program's defaults, for speed."""


@dataclass(frozen=True)
class Capture:
    """A capture on disk.

    Attributes
    ----------
    folder
        Where it is.
    cameras
        Its undistorted views.
    optics
        The planes of each view.
    settings
        The simulated camera.
    """

    folder: Path
    cameras: list[Camera]
    optics: list[Optics]
    settings: SimulatedCamera

    def frames(self, view: str) -> list[Path]:
        """Files of a view that were written, in the order in which they were taken."""
        index = [camera.name for camera in self.cameras].index(view)
        return [self.folder / name for name in writer.frame_names(index, self.settings)]

    def calibration(self, kind: str) -> list[Path]:
        """Calibration frames: checkerboard, flat, dark or white."""
        return sorted((self.folder / "calibration" / kind).glob("*.dng"))

    def truth(self, view: str) -> dict[str, np.ndarray]:
        """Radiance under ``""`` and the shares ``saturated``, ``outside`` and ``moved`` of a view."""
        return read_layers(self.folder / "truth" / f"{view}.exr")

    @property
    def camera_truth(self) -> dict[str, Any]:
        """What calibration should find."""
        return json.loads((self.folder / "truth" / "camera.json").read_text(encoding="utf-8"))


def cameras(count: int = 2, size: tuple[int, int] = SIZE) -> list[Camera]:
    """Views side by side, 70 degrees wide."""
    width, height = size
    focal = 0.714 * width
    found = []
    for index in range(count):
        pose = np.eye(4)
        pose[0, 3] = 0.2 * index
        split = "val" if index == 1 else "train"
        found.append(Camera(f"{split}_{index:03d}", split, width, height, focal, focal, width / 2, height / 2, pose))
    return found


def scene_image(camera: Camera, emitter: float = 30.0) -> np.ndarray:
    """(h, w, 3) float32 radiance for a camera: gradients of colour, an edge, a lamp, a dark corner."""
    columns, rows = np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5
    x, y = np.meshgrid((columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy)
    x = x + camera.center[0]
    tint = np.stack([1 + 0.4 * np.sin(3 * x), 1 + 0 * x, 1 + 0.4 * np.cos(2 * y)], axis=-1)
    level = 0.35 * np.exp(0.8 * np.sin(2 * x + y)) * np.where(x + 0.3 * y > 0.3, 0.25, 1.0)
    level = np.where((x < -0.45) & (y > 0.3), 0.01, level)
    image = tint * level[..., None]
    image[np.hypot(x - 0.1, y + 0.25) < 0.08] = (emitter, 0.85 * emitter, 0.7 * emitter)
    return image.astype(np.float32)


def write(
    folder: Path,
    views: int = 2,
    size: tuple[int, int] = SIZE,
    faults: Sequence[str] = (),
    scene: Callable[[Camera], np.ndarray] = scene_image,
    header: Mapping[str, Any] | None = None,
    **camera: Any,
) -> Capture:
    """Write a capture.

    Parameters
    ----------
    folder
        Where to.
    views
        How many; the second one is held out.
    size
        Width and height of the undistorted views.
    faults
        Names in `FAULTS`; each spoils the first view or the calibration, as its docstring says.
    scene
        Image of a source camera.
    header
        What the files of the brackets say otherwise: ``{"make": "SONY", "model": "ILCE-7M3", "lens": ...}``.
    **camera
        Settings of the simulated camera.
    """
    settings = SimulatedCamera(**{**SMALL, **camera})
    listed = cameras(views, size)
    planes = [optics(view, settings) for view in listed]
    writer.write_calibration(folder, listed, settings)
    for index, plane in enumerate(planes):
        writer.write_bracket(folder, index, scene(plane.source), plane, settings, **(header or {}))
    made = Capture(folder, listed, planes, settings)
    for fault in faults:
        FAULTS[fault](made)
    return made


# --- faults -----------------------------------------------------------------------------------


def _missing_frame(made: Capture) -> None:
    """The second frame of the first view is gone."""
    made.frames(made.cameras[0].name)[1].unlink()


def _doubled_exposure(made: Capture) -> None:
    """The third frame of the first view was taken with the second one's shutter time."""
    _retake(made, frame=2, like=1)


def _wrong_size(made: Capture) -> None:
    """The third frame of the first view is 16 pixels narrower."""
    _retake(made, frame=2, crop=16)


def _other_orientation(made: Capture) -> None:
    """The third frame of the first view was taken upright, says its EXIF."""
    _retake(made, frame=2, orientation=6)


def _other_camera(made: Capture) -> None:
    """The third frame of the first view comes from another body."""
    _retake(made, frame=2, model="Other camera", serial="0002")


def _mixed_iso(made: Capture) -> None:
    """The third frame of the first view has ISO 400, says its EXIF."""
    _retake(made, frame=2, iso=400)


def _mixed_aperture(made: Capture) -> None:
    """The third frame of the first view has f/5.6, says its EXIF."""
    _retake(made, frame=2, f_number=5.6)


def _no_exposure_time(made: Capture) -> None:
    """The third frame of the first view does not say how long it was exposed."""
    _retake(made, frame=2, exposure=None)


def _no_mosaic(made: Capture) -> None:
    """The third frame of the first view is linear RGB (sRAW), not a mosaic."""
    path = made.frames(made.cameras[0].name)[2]
    plane, settings = made.optics[0], made.settings
    flat = np.full((plane.sensor.height, plane.sensor.width, 3), 5000, np.uint16)
    write_dng(path, flat, writer.header_of(exposures(settings)[2].printed, writer.START, plane, settings))


def _truncated(made: Capture) -> None:
    """The second frame of the first view ends in the middle."""
    path = made.frames(made.cameras[0].name)[1]
    os.truncate(path, path.stat().st_size // 2)


def _not_raw(made: Capture) -> None:
    """The second frame of the first view is text."""
    made.frames(made.cameras[0].name)[1].write_text("this is no photograph\n", encoding="utf-8")


def _clipped_shortest(made: Capture) -> None:
    """The first view is 400 times as bright: most of its shortest exposure is clipped."""
    plane = made.optics[0]
    writer.write_bracket(made.folder, 0, 400 * scene_image(plane.source), plane, made.settings)


def _dark_centred_flat(made: Capture) -> None:
    """The flat fields are darker in the middle than in the corners (something hung before the lens)."""
    plane = made.optics[0]
    height, width = plane.source.height, plane.source.width
    rows, columns = np.mgrid[:height, :width] + 0.5
    r2 = ((rows / height - 0.5) ** 2 + (columns / width - 0.5) ** 2) * 2
    _recalibrate(made, "flat", calibration.even(plane) * (0.2 + 0.8 * r2)[..., None].astype(np.float32))


def _board_absent(made: Capture) -> None:
    """No checkerboard stands before the camera in any of the checkerboard frames."""
    _recalibrate(made, "checkerboard", calibration.even(made.optics[0], 0.5))


FAULTS: dict[str, Callable[[Capture], None]] = {
    "missing frame": _missing_frame,
    "doubled exposure": _doubled_exposure,
    "wrong size": _wrong_size,
    "other orientation": _other_orientation,
    "other camera": _other_camera,
    "mixed iso": _mixed_iso,
    "mixed aperture": _mixed_aperture,
    "no exposure time": _no_exposure_time,
    "no mosaic": _no_mosaic,
    "truncated": _truncated,
    "not raw": _not_raw,
    "clipped shortest": _clipped_shortest,
    "dark-centred flat": _dark_centred_flat,
    "board absent": _board_absent,
}
"""What can be wrong with a capture."""


def _retake(made: Capture, frame: int, like: int | None = None, crop: int = 0, **header: Any) -> None:
    """Take a frame of the first view (shortest = 0) again, with another exposure, narrower, or with other EXIF."""
    plane, settings = made.optics[0], made.settings
    series = exposures(settings)
    taken = series[frame if like is None else like]
    signal = expose_source(scene_image(plane.source), plane, settings)
    raw = read_out(signal, taken.seconds, settings, f"again/{frame}")[:, : signal.shape[1] - crop]
    time = writer.START + timedelta(seconds=sum(s.seconds + 0.5 for s in series[:frame]))
    described = replace(writer.header_of(taken.printed, time, plane, settings), **header)
    place = writer.order(0, settings).index(frame)
    path = made.frames(made.cameras[0].name)[place]
    write_dng(path, raw, described)


def _recalibrate(made: Capture, kind: str, image: np.ndarray) -> None:
    """Take all calibration frames of a kind again, of another image whose white is 1."""
    plane, settings = made.optics[0], made.settings
    taken = exposures(settings)[settings.exposures // 2]
    lit = calibration.FILL * settings.white_radiance * reference_time(settings) / taken.seconds
    signal = expose_source(image * np.float32(lit), plane, settings)
    described = writer.header_of(taken.printed, writer.START - timedelta(hours=1), plane, settings)
    for number, path in enumerate(made.calibration(kind)):
        write_dng(path, read_out(signal, taken.seconds, settings, f"again/{kind}/{number}"), described)
