"""Photographs to HDR views: merge, correct vignetting and white balance, undistort, average down, write."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.conventions import FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED
from fipt.errors import FiptError
from fipt.formats.exr import check_marks, read_exr, write_exr
from fipt.formats.files import check_disk, check_memory, existing_file, write_text
from fipt.formats.hdr import read_hdr
from fipt.progress import progress
from fipt.stages.capture.brackets import Bracket, Capture
from fipt.stages.capture.calibration import Calibration, Noise
from fipt.stages.capture.copies import check_copies
from fipt.stages.capture.exposures import RATIO_TOLERANCE, chained, exposure, measured_ratio
from fipt.stages.capture.facts import exposure_facts, raw_facts, view_facts
from fipt.stages.capture.merge import Gains, merge_hat, merge_mosaics
from fipt.stages.capture.mosaic import replace_bad_pixels
from fipt.stages.capture.noise import assumed_noise, measured_noise
from fipt.stages.capture.raw import RawFrame, read_raw
from fipt.stages.capture.settings import CaptureSettings
from fipt.stages.capture.view import View, downscaled, lens_maps, pinhole_of, to_srgb, undistorted

log = logging.getLogger(__name__)

_BYTES_A_PIXEL, _BYTES_AN_EXPOSURE = 60, 6
"""Of memory while a view is developed, for each pixel of a photograph, and for each exposure besides: measured 51 and
3.2 (RAW), 52 and 5.3 (JPEG and PNG), 57 (merged)."""
_BYTES_ON_DISK = 16
"""Of a developed view, for each of its pixels: measured 8 to 15."""
_HALF_LARGEST, _HALF_STEP = 6e4, 6e-8
"""Largest value of 16-bit floats, and their step near zero."""


def develop_views(
    capture: Capture,
    names: Sequence[str],
    calibration: Calibration,
    out: Path,
    settings: CaptureSettings,
    keep_going: bool = False,
) -> list[Path]:
    """Develop views and write ``out/hdr/VIEW.exr`` and ``out/VIEW.json``; return the files.

    With ``keep_going``, a view that cannot be developed is rejected: its VIEW.json says why, and it has no image.

    Raises
    ------
    FiptError
        Before anything is written, if a bracket is wrong; then for the first file that cannot be used.
    """
    if not keep_going:
        for name in names:
            capture.bracket(name)
    for finding in capture.findings:
        concerned = set(finding.views) & set(names)
        if concerned and settings.incomplete == "error" and finding.kind == "missing":
            raise FiptError(finding.message, "complete the bracket, or set capture.incomplete to warn")
        if finding.severity == "error" and not finding.views:
            # A file that belongs to no view since it cannot be read: brackets are what the others make of them.
            if settings.incomplete == "error":
                raise FiptError(finding.message, finding.remedy)
            log.warning("%s; %s", finding.message, finding.remedy)
    _check_room(capture, names, calibration, out, settings.downscale)
    warnings = {name: [f.message for f in capture.findings if name in f.views] for name in names}
    files = []
    with progress("develop", len(names), " views") as bar:
        for name in names:
            try:
                view = develop(capture.bracket(name), calibration, settings)
            except FiptError as error:
                if not keep_going:
                    raise
                files.append(out / f"{name}.json")
                write_text(files[-1], json.dumps({"view": name, "rejected": error.message}) + "\n")
                (out / "hdr" / f"{name}.exr").unlink(missing_ok=True)
                log.warning("view %s is rejected: %s", name, error)
                continue
            view.facts["warnings"] = warnings[name] + view.facts.get("warnings", [])
            files += write_view(out, name, view, settings.half)
            bar.advance(note=name)
    return files


def _check_room(capture: Capture, names: Sequence[str], calibration: Calibration, out: Path, downscale: int) -> None:
    """Refuse photographs that memory is too small for, and views that do not fit on the disk."""
    pixels = calibration.width * calibration.height
    exposures = max((len(bracket.shots) for bracket in capture.brackets if bracket.view in names), default=0)
    needed = (_BYTES_A_PIXEL + _BYTES_AN_EXPOSURE * exposures) * pixels
    check_memory(needed, "developing a view", "use smaller photographs")
    check_disk(out, _BYTES_ON_DISK * pixels * len(names) // downscale**2, "the developed views")


def develop(bracket: Bracket, calibration: Calibration, settings: CaptureSettings) -> View:
    """Develop one view."""
    if bracket.kind != calibration.kind:
        raise FiptError(
            f"the calibration must be of {bracket.kind} photographs; it is of {calibration.kind} ones",
            "run fipt calibrate on this capture",
        )
    if bracket.kind == "merged":
        view = _passed_through(bracket, calibration)
    else:
        view = (_from_ldr if bracket.kind == "ldr" else _from_raw)(bracket, calibration, settings)
    if settings.downscale > 1:
        view = downscaled(view, settings.downscale)
    view.facts = view_facts(bracket, view, calibration) | view.facts
    return view


def write_view(out: Path, name: str, view: View, half: bool) -> list[Path]:
    """Write image and facts of a view."""
    image, facts = out / "hdr" / f"{name}.exr", out / f"{name}.json"
    # Half floats lose nothing where their steps are far below the noise and nothing is too bright for them.
    safe = half and view.radiance.max(initial=0) < _HALF_LARGEST and view.floor > 4 * _HALF_STEP
    layers = {"": view.radiance, "valid.Y": view.valid, "flags.Y": view.flags}
    write_exr(image, layers, half=bool(safe), compression="PIZ")
    write_text(facts, json.dumps(view.facts, indent=1) + "\n")
    return [image, facts]


def _from_raw(bracket: Bracket, calibration: Calibration, settings: CaptureSettings) -> View:
    frames = read_frames(bracket, calibration)
    images = check_copies(bracket, [frame.mosaic for frame in frames])
    black = np.array(calibration.black) if calibration.black is not None else frames[0].black
    exposures, ratios = bracket_exposures(frames, black, settings.times)
    gains = Gains(np.array(calibration.white_balance), calibration.vignetting)
    noise = sensor_noise(frames, exposures, black, calibration)
    merged = merge_mosaics(frames, exposures, black, noise, gains, settings.saturation, settings.motion)
    radiance = merge_hat(frames, exposures, black, gains) if settings.merge == "hat" else None
    facts = raw_facts(frames, exposures, ratios, merged, calibration) | {"images": images}
    frames.clear()  # a bracket is large
    view = undistorted(merged, radiance, calibration.lens)
    if settings.color == "srgb" and calibration.color is not None:
        view.radiance = to_srgb(view.radiance, np.array(calibration.color))
    view.facts = facts
    return view


def read_frames(bracket: Bracket, calibration: Calibration) -> list[RawFrame]:
    """Read the RAW files of a bracket, bad pixels replaced.

    Raises
    ------
    FiptError
        If one has another size or mosaic than the calibration or the first one.
    """
    bad = np.array(calibration.bad_pixels, np.int64).reshape(-1, 2)
    frames: list[RawFrame] = []
    for shot in bracket.shots:
        frame = read_raw(shot.path, shot)
        calibration.check_size(frame.shape, shot.path)
        if frames and (frame.pattern != frames[0].pattern).any():
            raise FiptError(
                f"{shot.path} must have the mosaic of {frames[0].shot.path.name}; its colours are arranged otherwise",
                "a bracket must be of one camera",
            )
        replace_bad_pixels(frame.mosaic, bad)
        frames.append(frame)
    return frames


def bracket_exposures(
    frames: Sequence[RawFrame], black: np.ndarray, times: str
) -> tuple[list[float], list[dict[str, Any]]]:
    """Exposures of a bracket, and its stated and measured ratios.

    Parameters
    ----------
    frames
        Longest first.
    black
        (4,) black level by colour index.
    times
        ``snapped``, ``measured`` or ``nominal``, as in the settings. Measured exposures are relative to the snapped
        one of the middle frame.
    """
    stated = [exposure(frame.shot, snap=times != "nominal") for frame in frames]
    ratios = []
    for (long, short), (e_long, e_short) in zip(pairwise(frames), pairwise(stated), strict=True):
        measured = measured_ratio(long, short, black, e_long / e_short)
        differs = measured is not None and abs(measured / (e_long / e_short) - 1) > RATIO_TOLERANCE
        ratios.append(
            {
                "longer": long.shot.path.name,
                "shorter": short.shot.path.name,
                "stated": e_long / e_short,
                "measured": measured,
                "differs": differs,
            }
        )
    if times == "measured":
        return chained([ratio["measured"] for ratio in ratios], stated, len(stated) // 2), ratios
    return stated, ratios


def sensor_noise(
    frames: Sequence[RawFrame], exposures: Sequence[float], black: np.ndarray, calibration: Calibration
) -> Noise:
    """Noise of the calibration if it is for this ISO, else as the bracket shows it, else of a usual sensor."""
    iso = frames[0].shot.iso
    if calibration.noise is not None and iso == calibration.noise.iso:
        return calibration.noise
    return measured_noise(frames, exposures, black) or assumed_noise(frames[0], black)


def read_merged(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read an EXR or HDR image: (H, W, 3) float32 radiance, and the other layers of an EXR."""
    existing_file(path, "an EXR or HDR image")
    if path.suffix.lower() == ".exr":
        channels = read_exr(path, required="RGB")
        return np.stack([channels.pop(letter) for letter in "RGB"], axis=-1), channels
    return read_hdr(path), {}


def _passed_through(bracket: Bracket, calibration: Calibration) -> View:
    """A merged view as it is; values that are no numbers get weight 0."""
    path = bracket.shots[0].path
    radiance, layers = read_merged(path)
    calibration.check_size(radiance.shape[:2], path)
    facts = {"exposures": [], "ratios": [], "images": check_copies(bracket, [radiance])}
    finite = np.asarray(np.isfinite(radiance).all(axis=-1))
    check_marks(path, layers)
    valid = layers.get("valid.Y", np.ones(finite.shape, np.float32)) * finite
    flags = layers.get("flags.Y", np.zeros(finite.shape)).astype(np.uint32)
    return View(np.where(finite[..., None], radiance, 0), valid.astype(np.float32), flags, None, facts=facts)


def _from_ldr(bracket: Bracket, calibration: Calibration, settings: CaptureSettings) -> View:
    from fipt.stages.capture.ldr import check_order, merge_ldr, read_ldr

    images = []
    for shot in bracket.shots:
        images.append(read_ldr(shot.path))
        calibration.check_size(images[-1].shape[:2], shot.path)
    named = check_copies(bracket, images)
    check_order(bracket, images)
    exposures = [exposure(shot, settings.times != "nominal") for shot in bracket.shots]
    radiance, saturated, noisy, clipped = merge_ldr(images, exposures, np.array(calibration.response))
    Gains(vignetting=calibration.vignetting).apply(radiance, 0)
    flags = (saturated * np.uint8(FLAG_SATURATED)) | (noisy * np.uint8(FLAG_NOISE))
    valid = (~saturated).astype(np.float32)
    facts = {"exposures": exposure_facts(bracket, exposures, clipped), "ratios": [], "images": named}
    lens = calibration.lens
    if lens is None:
        return View(radiance, valid, flags.astype(np.uint32), None, facts=facts)
    pinhole = pinhole_of(lens)
    map_x, map_y = lens_maps(lens, pinhole)
    return View(
        cv2.remap(radiance, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        cv2.remap(valid, map_x, map_y, cv2.INTER_LINEAR, borderValue=0),
        cv2.remap(flags, map_x, map_y, cv2.INTER_NEAREST, borderValue=FLAG_OUTSIDE).astype(np.uint32),
        pinhole,
        facts=facts,
    )
