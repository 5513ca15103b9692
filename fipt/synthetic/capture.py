"""Writes a simulated capture: a folder of RAW brackets and calibration frames, and the truth beside them.

OUT/DSC00001.dng ...            brackets, numbered in the order in which they were taken
OUT/calibration/{checkerboard,charuco,flat,dark,white}/*.dng
OUT/captures.tsv                view and file of every frame, with what the file's EXIF says
OUT/transforms.json             pinhole cameras of the undistorted views, with poses
OUT/mesh.ply                    where the room's mesh is known
OUT/truth/camera.json           what calibration should find
OUT/truth/VIEW.exr              what development should find (`fipt.synthetic.camera.view_truth`)

A shard of views writes its brackets and their truth; everything else is written once.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import write_text
from fipt.progress import progress
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.mesh import Mesh, write_ply
from fipt.synthetic import calibration
from fipt.synthetic.camera import (
    Optics,
    ShutterTime,
    camera_from_xyz,
    camera_rgb,
    defects,
    expose_source,
    exposures,
    ghost,
    optics,
    optics_within,
    read_out,
    reference_time,
    view_truth,
    white_level,
)
from fipt.synthetic.dng import Header, write_dng
from fipt.synthetic.settings import SimulatedCamera

START = datetime(2026, 1, 2, 10, 0, 0)
"""When the first bracket begins; calibration frames were taken in the hour before."""

_PAUSE, _WALK = 0.5, 20.0
"""Seconds between the frames of a bracket, and from one view to the next."""
_F_NUMBER, _ISO, _SENSOR_WIDTH_MM = 8.0, 100, 36.0
_REPEATS = 4
"""Flat, dark and white frames."""


# --- one view ---------------------------------------------------------------------------------


def frame_names(index: int, camera: SimulatedCamera) -> list[str]:
    """File names of the bracket of the view ``index``, in the order in which they were taken."""
    return [f"DSC{index * camera.exposures + k + 1:05d}.dng" for k in range(camera.exposures)]


def order(index: int, camera: SimulatedCamera) -> list[int]:
    """Exposures (shortest = 0) of the view ``index`` in the order in which they were taken."""
    if not camera.shuffled:
        return list(range(camera.exposures))
    return np.random.default_rng([camera.seed, 6, index]).permutation(camera.exposures).tolist()


def write_bracket(
    out: Path, index: int, image: np.ndarray, planes: Optics, camera: SimulatedCamera, **header: Any
) -> list[Path]:
    """Photograph one view.

    Parameters
    ----------
    out
        Folder of the capture.
    index
        Place of the view among all views of the capture: gives file names and times.
    image
        (h, w, 3) float32 radiance of ``planes.source``.
    planes, camera
        The camera.
    **header
        What the files shall say otherwise than `header_of`: ``orientation``, ``model``, ...

    Returns
    -------
    list of Path
        Its frames, in the order in which they were taken, and its truth.
    """
    name = planes.view.name
    moved = ghost(image, planes, camera) if name in camera.ghosts else None
    signal = expose_source(image, planes, camera)
    disturbed = signal if moved is None else expose_source(moved.image, planes, camera)
    frames = exposures(camera)
    bracket = sum(frame.seconds + _PAUSE for frame in frames) + _WALK
    time = START + index * timedelta(seconds=bracket)
    files = []
    for file, frame in zip(frame_names(index, camera), order(index, camera), strict=True):
        light = disturbed if moved is not None and frame == moved.frame else signal
        raw = read_out(light, frames[frame].seconds, camera, f"{name}/{frame}")
        files.append(out / file)
        said = replace(header_of(frames[frame].printed, time, planes, camera), **header)
        write_dng(files[-1], raw, said)
        time += timedelta(seconds=frames[frame].seconds + _PAUSE)
    files.append(out / "truth" / f"{name}.exr")
    write_exr(files[-1], view_truth(image, planes, camera, moved))
    return files


def header_of(printed: Fraction | None, time: datetime, planes: Optics, camera: SimulatedCamera) -> Header:
    """What the files of this camera say."""
    white = camera_rgb(camera).sum(axis=1)
    sensor = planes.sensor
    return Header(
        pattern=camera.pattern,
        black=camera.black_levels,
        white=white_level(camera),
        color_matrix=camera_from_xyz(camera),
        neutral=tuple((white / white.max()).tolist()),
        exposure=printed,
        f_number=_F_NUMBER,
        iso=_ISO,
        focal_length=round(sensor.fx / sensor.width * _SENSOR_WIDTH_MM, 1),
        focal_length_35=sensor.fx * np.hypot(36, 24) / np.hypot(sensor.width, sensor.height),  # by diagonal
        time=time,
    )


# --- the whole capture ------------------------------------------------------------------------


def write_calibration(
    out: Path, cameras: Sequence[Camera], camera: SimulatedCamera, mesh: Mesh | None = None
) -> list[Path]:
    """Write all of a capture but its brackets: calibration frames, table, cameras, mesh, truth of the camera.

    Parameters
    ----------
    out
        Folder of the capture.
    cameras
        All its views, in the order in which they are photographed.
    camera
        The simulated camera.
    mesh
        The room's mesh, where it is known.
    """
    planes = optics(one_camera(cameras), camera)
    absent = set(camera.ghosts) - {view.name for view in cameras}
    if absent:
        raise FiptError(
            f"synthesize.raw.ghosts must name views of the scene; {', '.join(sorted(absent))} is none",
            "choose among " + ", ".join(view.name for view in cameras[:8]),
        )
    files = _write_frames(out / "calibration", planes, camera)
    files += [out / "captures.tsv", out / "transforms.json", out / "truth" / "camera.json"]
    write_text(files[-3], table(cameras, camera))
    write_transforms(files[-2], list(cameras))
    write_text(files[-1], json.dumps(camera_truth(planes, camera), indent=1) + "\n")
    if mesh is not None:
        files.append(out / "mesh.ply")
        write_ply(files[-1], mesh)
    return files


def one_camera(cameras: Sequence[Camera]) -> Camera:
    """Return the first camera, after checking that all have its size and intrinsics."""
    known = {(c.width, c.height, c.fx, c.fy, c.cx, c.cy) for c in cameras}
    if len(known) != 1:
        raise FiptError(
            f"a capture has one camera: all views must have the same size and intrinsics; found {len(known)}",
            "simulate one capture for each of them",
        )
    return cameras[0]


def _write_frames(folder: Path, planes: Optics, camera: SimulatedCamera) -> list[Path]:
    frames = exposures(camera)
    middle, longest = frames[len(frames) // 2], frames[-1]
    scene = [(kind, image, middle) for kind in camera.boards for image in calibration.boards(planes, camera, kind)]
    scene += [("flat", calibration.even(planes), middle)] * _REPEATS
    scene += [("dark", calibration.even(planes, 0.0), longest)] * _REPEATS
    scene += [("white", calibration.grey_card(planes), middle)]
    files: list[Path] = []
    time = START - timedelta(hours=1)
    for number, (kind, image, exposure) in enumerate(scene, 1):
        # Lit so that white fills the pixels to the same share at this shutter time.
        lit = calibration.FILL * camera.white_radiance * reference_time(camera) / exposure.seconds
        signal = expose_source(image * np.float32(lit), planes, camera)
        raw = read_out(signal, exposure.seconds, camera, f"calibration/{kind}/{number}")
        files.append(folder / kind / f"DSC{number:05d}.dng")
        write_dng(files[-1], raw, header_of(exposure.printed, time, planes, camera))
        time += timedelta(seconds=10)
    return files


def table(cameras: Sequence[Camera], camera: SimulatedCamera) -> str:
    """Content of captures.tsv: one line a frame."""
    frames = exposures(camera)
    lines = ["view\tfile\tshutter\taperture\tiso"]
    for index, view in enumerate(cameras):
        for file, frame in zip(frame_names(index, camera), order(index, camera), strict=True):
            lines.append(f"{view.name}\t{file}\t{frames[frame].printed}\t{_F_NUMBER:g}\t{_ISO}")
    return "\n".join(lines) + "\n"


def camera_truth(planes: Optics, camera: SimulatedCamera) -> dict[str, object]:
    """Content of truth/camera.json: what calibration should find, and the scale of radiance.

    ``radiance_of_full_second`` is the radiance that saturates green on the optical axis in one true second: radiance =
    it times (raw - black) / (white - black) / seconds / relative sensitivity / vignetting.
    """
    sensor = planes.sensor
    bad = defects((sensor.height, sensor.width), camera)
    poses = [calibration.board_pose(sensor, camera, k) for k in range(camera.calibration_frames)]

    def listed(indices: np.ndarray) -> list[list[int]]:
        return np.stack(np.unravel_index(indices, (sensor.height, sensor.width)), axis=-1).tolist()

    def described(exposure: ShutterTime) -> dict[str, object]:
        return {"printed": str(exposure.printed), "seconds": exposure.seconds}

    return {
        "sensor": asdict(sensor),
        "scale": camera.scale,
        "vignetting": camera.vignetting,
        "pattern": camera.pattern,
        "black": np.add(camera.black_levels, camera.dark_offset).tolist(),
        "white": white_level(camera),
        "sensitivity": camera.sensitivity,
        "camera_rgb_from_srgb": camera_rgb(camera).tolist(),
        "radiance_of_full_second": camera.white_radiance * reference_time(camera),
        "exposures": [described(frame) for frame in exposures(camera)],
        "board": {
            "corners": camera.board,
            "square": camera.square,
            "marker": calibration.MARKER * camera.square,
            "dictionary": calibration.DICTIONARY,
            "camera_from_board": [pose.tolist() for pose in poses],
        },
        "hot_pixels": listed(bad.hot),
        "dead_pixels": listed(bad.dead),
        "ghosts": list(camera.ghosts),
    }


def simulate_capture(
    images: Iterable[np.ndarray],
    cameras: Sequence[Camera],
    settings: SimulatedCamera,
    out: str | Path,
    mesh: Mesh | None = None,
) -> list[Path]:
    """Turn any posed HDR views into a capture.

    Parameters
    ----------
    images
        (h, w, 3) float32 linear radiance, one for each camera.
    cameras
        Pinhole cameras of the images; all of one size and with the same intrinsics. The views of the capture are
        smaller, since the sensor sees more than a view: scale and margins come off.
    settings
        The simulated camera.
    out
        Folder to write.
    mesh
        The room's mesh, where it is known.

    Returns
    -------
    list of Path
        What was written; transforms.json holds the views that development should give.
    """
    out = Path(out)
    one_camera(cameras)
    planes = [optics_within(camera, settings) for camera in cameras]
    views = [plane.view for plane in planes]
    files = write_calibration(out, views, settings, mesh)
    with progress("capture", len(views), " views") as bar:
        for index, (image, plane) in enumerate(zip(images, planes, strict=True)):
            files += write_bracket(out, index, image, plane, settings)
            bar.advance(note=plane.view.name)
    return files
