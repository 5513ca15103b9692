"""Calibration of a camera from frames of a board, of an even surface, of darkness and of a white reference."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from fipt.formats.files import check_memory
from fipt.progress import progress
from fipt.stages.capture.brackets import Capture
from fipt.stages.capture.calibrate_color import with_color, with_white
from fipt.stages.capture.calibrate_lens import with_lens
from fipt.stages.capture.calibrate_sensor import with_dark, with_flats
from fipt.stages.capture.calibration import Calibration, read_calibration
from fipt.stages.capture.calibration_frames import calibration_frames
from fipt.stages.capture.raw import read_raw
from fipt.stages.capture.settings import CaptureSettings

_BYTES_A_PIXEL = 260
"""Of memory, for each pixel of a photograph: measured 215 to 247, whatever the number of frames."""


def calibrate(capture: Capture, settings: CaptureSettings) -> Calibration:
    """Find out everything about the camera of a capture that its calibration frames, or lensfun, tell.

    A ``calibration.json`` in the capture folder is taken as it is.

    Raises
    ------
    FiptError
        If a frame cannot be used: the message names it.
    """
    given = capture.folder / "calibration.json"
    if given.is_file():
        return read_calibration(given)
    frames = calibration_frames(capture.folder)
    if capture.kind == "merged":
        return _of_merged(capture)
    if capture.kind == "ldr":
        from fipt.stages.capture.ldr import read_ldr, response

        first = read_ldr(capture.usual_shot.path)
        start = _start(capture, first.shape[:2])
        start = replace(start, response=tuple(map(tuple, response(capture, settings.times != "nominal").tolist())))
        return _finish(with_lens(start, frames, settings, capture.usual_shot), frames)
    first_frame = read_raw(capture.usual_shot.path, capture.usual_shot)
    found = _start(capture, first_frame.shape)
    check_memory(_BYTES_A_PIXEL * found.width * found.height, "the calibration", "use smaller photographs")
    with progress("calibrate", sum(map(len, frames.values())), " frames") as bar:
        found = with_dark(found, frames.get("dark", []), bar)
        found = with_flats(found, frames.get("flat", []), bar)
        found = with_lens(found, frames, settings, first_frame.shot, bar)
        found = with_white(found, frames.get("white", []), settings, first_frame, bar)
        found = with_color(found, first_frame.camera_from_xyz)
    flat, own = found.figures.get("vignetting", {}).get("aperture"), first_frame.shot.aperture
    if flat and own and abs(flat / own - 1) > 0.05:
        sentence = f"flat fields at f/{flat:g} for photographs at f/{own:g}: vignetting depends on the aperture"
        found = replace(found, absent=(*found.absent, sentence))
    return _finish(found, frames)


def _start(capture: Capture, shape: tuple[int, int]) -> Calibration:
    return Calibration(capture.kind, capture.usual_shot.camera, width=shape[1], height=shape[0])


def _of_merged(capture: Capture) -> Calibration:
    from fipt.stages.capture.develop import read_merged

    shape = read_merged(capture.usual_shot.path)[0].shape
    sentence = "the views are merged already: they are taken as they are, without any correction"
    return replace(_start(capture, shape[:2]), absent=(sentence,))


def _finish(found: Calibration, frames: dict[str, list[Path]]) -> Calibration:
    """Say what is absent, and what is done instead."""
    absent = []
    unused = [kind for kind in ("dark", "flat", "white") if kind in frames and found.kind == "ldr"]
    if unused:
        absent.append(f"{', '.join(unused)} frames are not used for JPEG and PNG, which the camera has processed")
    if found.kind == "raw" and "dark" not in frames:
        absent.append("no dark frame: black levels as the files state, hot pixels are not known")
    if found.vignetting is None:
        absent.append("no flat field: vignetting is not corrected, corners stay too dark")
    if found.lens is None or not any(found.lens.distortion):
        absent.append("no board frames: distortion is not corrected")
    if found.lens is None:
        absent.append("no focal length is known: the intrinsics are left to pose estimation")
    if found.kind == "raw" and "white" not in frames:
        absent.append("no white reference: white balance from " + found.sources.get("white_balance", "nothing"))
    return replace(found, absent=(*found.absent, *absent))


def summary(calibration: Calibration) -> str:
    """What was found, for the terminal."""
    lines = [f"{part.replace('_', ' ')}: {source}" for part, source in sorted(calibration.sources.items())]
    board = calibration.figures.get("board")
    if board:
        lines.append(f"reprojection error: {board['rms']:.3f} pixels rms ({board['model']})")
    if "vignetting" in calibration.figures:
        lines.append(f"light in the corners: {calibration.figures['vignetting']['corner']:.3f} of the centre")
    if calibration.lens:
        lens = calibration.lens
        lines.append(f"focal length {lens.fx:.1f}, {lens.fy:.1f}, centre {lens.cx:.1f}, {lens.cy:.1f} pixels")
        lines.append("distortion " + json.dumps([round(k, 5) for k in lens.distortion]))
    return "\n".join([*lines, *calibration.absent])
