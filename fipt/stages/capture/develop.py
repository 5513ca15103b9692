"""Photographs to HDR views: merge, correct vignetting and white balance, undistort, average down, write."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.conventions import FLAG_MOVED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_SATURATED, LUMINANCE
from fipt.errors import FiptError
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.files import existing_file, write_text
from fipt.formats.hdr import read_hdr
from fipt.progress import progress
from fipt.scene.lens import Lens
from fipt.stages.capture.brackets import Bracket, Capture
from fipt.stages.capture.calibration import Calibration, Noise
from fipt.stages.capture.exposures import RATIO_TOLERANCE, chained, exposure, measured_ratio
from fipt.stages.capture.merge import Gains, Merged, assumed_noise, measured_noise, merge_hat, merge_mosaics
from fipt.stages.capture.mosaic import replace_bad_pixels
from fipt.stages.capture.raw import RawFrame, read_raw
from fipt.stages.capture.settings import CaptureSettings

_CLIPPED_SHORTEST = 0.01
"""Share of clipped pixels in the shortest exposure above which a view is warned about."""

_BAND = 128
"""Rows undistorted at once: their maps stay in the processor's cache."""

_PIXELS_JUDGED = 1_000_000
"""Pixels from which percentiles are taken for the report."""

_INVALID = FLAG_SATURATED | FLAG_OUTSIDE | FLAG_MOVED
"""Flags of pixels that have no weight. What is below the noise is dark, and says so."""

_HALF_LARGEST, _HALF_STEP = 6e4, 6e-8
"""Largest value of 16-bit floats, and their step near zero."""


@dataclass
class View:
    """A developed view.

    Attributes
    ----------
    radiance
        (H, W, 3) float32 linear RGB.
    valid
        (H, W) float32 weight in [0, 1].
    flags
        (H, W) uint32, bits of `fipt.conventions`.
    lens
        The pinhole camera of the picture; None where nothing is known of it.
    floor
        Standard deviation of a dark pixel, in units of radiance; 0 where unknown.
    facts
        For the capture report, plain JSON types.
    """

    radiance: np.ndarray
    valid: np.ndarray
    flags: np.ndarray
    lens: Lens | None
    floor: float = 0.0
    facts: dict[str, Any] = field(default_factory=dict)


def develop_views(
    capture: Capture,
    names: Sequence[str],
    calibration: Calibration,
    out: Path,
    settings: CaptureSettings,
    keep_going: bool = False,
) -> list[Path]:
    """Develop views and write ``out/hdr/VIEW.exr`` and ``out/VIEW.json``; return the files.

    With ``keep_going``, a view that cannot be developed is rejected: its VIEW.json says why, and it has no picture.

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
            print(f"warning: {finding.message}; {finding.remedy}", file=sys.stderr)
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
                print(f"warning: view {name} is rejected: {error}")
                continue
            view.facts["warnings"] = warnings[name] + view.facts.get("warnings", [])
            files += write_view(out, name, view, settings.half)
            bar.advance(note=name)
    return files


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
        view = _from_ldr(bracket, calibration) if bracket.kind == "ldr" else _from_raw(bracket, calibration, settings)
    if settings.downscale > 1:
        view = downscaled(view, settings.downscale)
    view.facts = _facts(bracket, view, calibration) | view.facts
    return view


def write_view(out: Path, name: str, view: View, half: bool) -> list[Path]:
    """Write picture and facts of a view."""
    picture, facts = out / "hdr" / f"{name}.exr", out / f"{name}.json"
    # Half floats lose nothing where their steps are far below the noise and nothing is too bright for them.
    safe = half and view.radiance.max(initial=0) < _HALF_LARGEST and view.floor > 4 * _HALF_STEP
    layers = {"": view.radiance, "valid.Y": view.valid, "flags.Y": view.flags}
    write_exr(picture, layers, half=bool(safe), compression="PIZ")
    write_text(facts, json.dumps(view.facts, indent=1) + "\n")
    return [picture, facts]


# -------------------------------------------------------------------------------------------------------------- RAW


def _from_raw(bracket: Bracket, calibration: Calibration, settings: CaptureSettings) -> View:
    frames = read_frames(bracket, calibration)
    black = np.array(calibration.black) if calibration.black is not None else frames[0].black
    exposures, ratios = bracket_exposures(frames, black, settings.times)
    gains = Gains(np.array(calibration.white_balance), calibration.vignetting)
    noise = sensor_noise(frames, exposures, black, calibration)
    merged = merge_mosaics(frames, exposures, black, noise, gains, settings.saturation, settings.motion)
    radiance = merge_hat(frames, exposures, black, gains) if settings.merge == "hat" else None
    facts = _raw_facts(frames, exposures, ratios, merged, calibration)
    frames.clear()  # a bracket is large
    view = _undistorted(merged, radiance, calibration.lens)
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


def _undistorted(merged: Merged, radiance: np.ndarray | None, lens: Lens | None) -> View:
    """Bring a merged bracket to a pinhole camera; decode its radiance unless it is given."""
    flags = merged.noisy * np.uint8(FLAG_NOISE)
    flags |= merged.saturated * np.uint8(FLAG_SATURATED)
    flags |= merged.moved * np.uint8(FLAG_MOVED)
    # Demosaicing spreads a clipped pixel to its neighbours: they have no weight, though their radiance is no bound.
    valid = cv2.erode(((flags & _INVALID) == 0).view(np.uint8) * np.uint8(255), np.ones((3, 3), np.uint8))
    if lens is None:
        radiance = cv2.LUT(merged.codes, merged.table[None]) if radiance is None else radiance
        return View(radiance, valid / np.float32(255), flags.astype(np.uint32), None, merged.floor)
    pinhole = pinhole_of(lens)
    source = merged.codes if radiance is None else radiance
    view = View(
        np.empty((*valid.shape, 3), np.float32),
        np.empty(valid.shape, np.float32),
        np.empty(valid.shape, np.uint32),
        pinhole,
        merged.floor,
    )
    for top in range(0, pinhole.height, _BAND):
        rows = slice(top, min(top + _BAND, pinhole.height))
        maps = lens_maps(lens, replace(pinhole, height=rows.stop - top, cy=pinhole.cy - top))
        seen = cv2.remap(source, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        view.radiance[rows] = cv2.LUT(seen, merged.table[None]) if radiance is None else seen
        view.flags[rows] = cv2.remap(flags, *maps, cv2.INTER_NEAREST, borderValue=FLAG_OUTSIDE)
        view.valid[rows] = cv2.remap(valid, *maps, cv2.INTER_LINEAR, borderValue=0)
    view.valid /= 255
    return view


def pinhole_of(lens: Lens) -> Lens:
    """The camera of undistorted pictures: square pixels, the principal point in the middle, no distortion."""
    f = float(np.sqrt(lens.fx * lens.fy))
    return Lens(lens.width, lens.height, f, f, lens.width / 2, lens.height / 2)


def lens_maps(lens: Lens, pinhole: Lens) -> tuple[np.ndarray, np.ndarray]:
    """Where each pixel of the pinhole picture lies in the photograph, for `cv2.remap`: two (H, W) float32."""
    size = (pinhole.width, pinhole.height)
    return cv2.initUndistortRectifyMap(lens.matrix, np.array(lens.distortion), None, pinhole.matrix, size, cv2.CV_32FC1)


def to_srgb(radiance: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Linear sRGB from white-balanced camera RGB."""
    if np.abs(matrix - np.eye(3)).max() < 1e-4:
        return radiance
    return cv2.transform(radiance, matrix.astype(np.float32))


def downscaled(view: View, factor: int) -> View:
    """Average radiance and weights over blocks of pixels; a block has the flags of any of its pixels, but for noise."""
    height, width = (n // factor for n in view.valid.shape)
    if min(height, width) < 1:
        raise FiptError(f"capture.downscale {factor} leaves nothing of {view.valid.shape[1]}x{view.valid.shape[0]}")
    used = np.s_[: height * factor, : width * factor]

    def average(values: np.ndarray) -> np.ndarray:
        return cv2.resize(np.ascontiguousarray(values[used]), (width, height), interpolation=cv2.INTER_AREA)

    flags = np.zeros((height, width), np.uint32)
    for bit in (FLAG_SATURATED, FLAG_NOISE, FLAG_OUTSIDE, FLAG_MOVED):
        share = average((view.flags & bit > 0).astype(np.float32))
        # Noise averages out: most of a block must be below it. The others spoil a block by a single pixel.
        flags |= (share > (0.5 if bit == FLAG_NOISE else 0)) * np.uint32(bit)
    lens = view.lens.downscaled(factor) if view.lens is not None else None
    return View(average(view.radiance), average(view.valid), flags, lens, view.floor / factor, view.facts)


# ---------------------------------------------------------------------------------------- merged views, JPEG and PNG


def read_merged(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Read an EXR or HDR picture: (H, W, 3) float32 radiance, and the other layers of an EXR."""
    existing_file(path, "an EXR or HDR picture")
    if path.suffix.lower() == ".exr":
        channels = read_exr(path, required="RGB")
        return np.stack([channels.pop(letter) for letter in "RGB"], axis=-1), channels
    return read_hdr(path), {}


def _passed_through(bracket: Bracket, calibration: Calibration) -> View:
    """A merged view as it is; values that are no numbers get weight 0."""
    radiance, layers = read_merged(bracket.shots[0].path)
    calibration.check_size(radiance.shape[:2], bracket.shots[0].path)
    finite = np.isfinite(radiance).all(axis=-1)
    valid = layers.get("valid.Y", np.ones(finite.shape, np.float32)) * finite
    flags = layers.get("flags.Y", np.zeros(finite.shape)).astype(np.uint32)
    return View(np.where(finite[..., None], radiance, 0), valid.astype(np.float32), flags, None)


def _from_ldr(bracket: Bracket, calibration: Calibration) -> View:
    from fipt.stages.capture.ldr import merge_ldr, read_ldr

    pictures = []
    for shot in bracket.shots:
        pictures.append(read_ldr(shot.path))
        calibration.check_size(pictures[-1].shape[:2], shot.path)
    exposures = [exposure(shot) for shot in bracket.shots]
    radiance, saturated, noisy, clipped = merge_ldr(pictures, exposures, np.array(calibration.response))
    flags = (saturated * np.uint8(FLAG_SATURATED)) | (noisy * np.uint8(FLAG_NOISE))
    valid = (~saturated).astype(np.float32)
    facts = {"exposures": _exposure_facts(bracket, exposures, clipped), "ratios": []}
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


# ------------------------------------------------------------------------------------------------------------ facts


def _raw_facts(
    frames: Sequence[RawFrame],
    exposures: Sequence[float],
    ratios: list[dict[str, Any]],
    merged: Merged,
    calibration: Calibration,
) -> dict[str, Any]:
    """What only the raw frames tell."""
    balance = next((frame.white_balance for frame in frames if frame.white_balance is not None), None)
    warnings = [
        f"{ratio['longer']} to {ratio['shorter']}: the exposures' ratio is {ratio['measured']:.3f}, "
        f"not {ratio['stated']:.3f}"
        for ratio in ratios
        if ratio["differs"]
    ]
    if merged.clipped[-1] > _CLIPPED_SHORTEST:
        warnings.append(f"{merged.clipped[-1]:.1%} of the pixels are clipped in the shortest exposure")
    bracket = Bracket("", "raw", tuple(frame.shot for frame in frames))
    return {
        "exposures": _exposure_facts(bracket, exposures, merged.clipped),
        "ratios": ratios,
        "noise": asdict(merged.noise),
        "measurable_stops": float(np.log2(1 / exposures[-1] / merged.floor)),
        "camera_white_balance": None if balance is None else balance.tolist(),
        "bad_pixels": len(calibration.bad_pixels),
        "warnings": warnings,
    }


def _exposure_facts(bracket: Bracket, exposures: Sequence[float], clipped: Sequence[float]) -> list[dict[str, Any]]:
    """One entry an exposure, longest first: the file, what it states, the exposure used, its clipped share."""
    return [
        {
            "file": shot.path.name,
            "shutter": shot.shutter,
            "aperture": shot.aperture,
            "iso": shot.iso,
            "focal_length": shot.focal_length,
            "exposure": value,
            "clipped": share,
        }
        for shot, value, share in zip(bracket.shots, exposures, clipped, strict=True)
    ]


def _facts(bracket: Bracket, view: View, calibration: Calibration) -> dict[str, Any]:
    """What every view tells; JSON types."""
    step = max(1, int(np.sqrt(view.valid.size / _PIXELS_JUDGED)))
    good = view.radiance[::step, ::step][view.valid[::step, ::step] > 0.5] @ np.float32(LUMINANCE)
    low, high = np.percentile(good, (1, 99.9)) if good.size else (0.0, 0.0)
    low = max(low, view.floor, 1e-12)
    shares = {
        name: np.count_nonzero(view.flags & bit) / view.flags.size
        for name, bit in (
            ("saturated", FLAG_SATURATED),
            ("noisy", FLAG_NOISE),
            ("outside", FLAG_OUTSIDE),
            ("moved", FLAG_MOVED),
        )
    }
    lens = view.lens
    return {
        "view": bracket.view,
        "kind": bracket.kind,
        "ldr": bracket.kind == "ldr",
        "width": view.valid.shape[1],
        "height": view.valid.shape[0],
        "camera": None
        if lens is None
        else {"w": lens.width, "h": lens.height, "fl_x": lens.fx, "fl_y": lens.fy, "cx": lens.cx, "cy": lens.cy},
        "shares": shares,
        "valid": float(view.valid.mean()),
        "scene_stops": float(np.log2(max(high / low, 1.0))),
        "sharpness": sharpness(view),
        "white_balance": list(calibration.white_balance),
        "sources": calibration.sources,
        "time": min((shot.time for shot in bracket.shots if shot.time is not None), default=None),
        "orientation": bracket.shots[0].orientation,
        "warnings": [],
    }


def sharpness(view: View) -> float:
    """Steepest edges of a view: 99.5th percentile of the change of luminance between neighbours, stops a pixel.

    Light below 20 times the noise, and pixels without weight, are left out. Of large views, bands of rows are judged.
    """
    height, width = view.valid.shape
    bands = max(1, min(height // 64, _PIXELS_JUDGED // (64 * width)))
    changes = []
    for top in np.linspace(0, max(height - 64, 0), bands).astype(int):
        rows = slice(top, top + 64)
        luminance = view.radiance[rows] @ np.float32(LUMINANCE)
        floor = max(20 * view.floor, 1e-3 * float(np.median(luminance)), 1e-12)
        stops = cv2.GaussianBlur(np.log2(np.maximum(luminance, floor)), (3, 3), 0)
        change = np.hypot(cv2.Sobel(stops, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(stops, cv2.CV_32F, 0, 1) / 8)
        good = cv2.erode((view.valid[rows] > 0.99).view(np.uint8), np.ones((5, 5), np.uint8)) > 0
        changes.append(change[good])
    judged = np.concatenate(changes)
    return float(np.percentile(judged, 99.5)) if judged.size else 0.0
