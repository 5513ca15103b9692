"""Calibration of a camera from frames of a board, of an even surface, of darkness and of a white reference."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.scene import boards
from fipt.scene.lens import Lens
from fipt.stages.capture import lensfun
from fipt.stages.capture.brackets import Capture, photographs
from fipt.stages.capture.calibration import Calibration, Noise, Vignetting, read_calibration
from fipt.stages.capture.mosaic import tiled
from fipt.stages.capture.raw import LDR_SUFFIXES, RawFrame, Shot, read_raw
from fipt.stages.capture.settings import CaptureSettings

FOLDER = "calibration"
"""Subfolder of a capture folder that holds calibration frames in folders named by kind."""

KINDS = ("dark", "flat", "checkerboard", "charuco", "white")

XYZ_FROM_SRGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
"""CIE XYZ from linear sRGB under D65 (IEC 61966-2-1)."""

_BINOMIAL = np.array([0.25, 0.5, 0.25])

_BLOCKS = 30
"""Blocks along the shorter side of a flat field, whose means the vignetting curve is fitted to."""

_TERMS = 4
"""Coefficients of the vignetting polynomial: up to r^8."""

_MODELS = {
    "k1, k2": cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    "k1, k2, k3": cv2.CALIB_ZERO_TANGENT_DIST,
    "k1, k2, p1, p2": cv2.CALIB_FIX_K3,
    "k1, k2, p1, p2, k3": 0,
}
"""Distortion models, simplest first."""

_WORTH = 0.95
"""Reprojection error of a richer model over that of a simpler one, at most."""

_CLIPPED = 0.98
"""Share of the range above which a calibration frame counts as clipped."""


def calibration_frames(folder: Path) -> dict[str, list[Path]]:
    """Kind -> its frames in ``folder/calibration/KIND/``; kinds without frames are left out."""
    frames = {}
    for kind in KINDS:
        place = folder / FOLDER / kind
        if place.is_dir() and any(place.iterdir()):
            frames[kind] = photographs(place)[1]
    return frames


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

        first = read_ldr(capture.brackets[0].shots[0].path)
        start = _start(capture, first.shape[:2])
        start = replace(start, response=tuple(map(tuple, response(capture).tolist())))
        return _finish(_with_lens(start, frames, settings, capture.brackets[0].shots[0]), frames)
    first_frame = read_raw(capture.brackets[0].shots[0].path, capture.brackets[0].shots[0])
    found = _start(capture, first_frame.shape)
    with progress("calibrate", sum(map(len, frames.values())), " frames") as bar:
        found = _with_dark(found, frames.get("dark", []), bar)
        found = _with_flats(found, frames.get("flat", []), bar)
        found = _with_lens(found, frames, settings, first_frame.shot, bar)
        found = _with_white(found, frames.get("white", []), settings, first_frame, bar)
        found = _with_color(found, first_frame.camera_from_xyz)
    flat, own = found.figures.get("vignetting", {}).get("aperture"), first_frame.shot.aperture
    if flat and own and abs(flat / own - 1) > 0.05:
        sentence = f"flat fields at f/{flat:g} for photographs at f/{own:g}: vignetting depends on the aperture"
        found = replace(found, absent=(*found.absent, sentence))
    return _finish(found, frames)


def _start(capture: Capture, shape: tuple[int, int]) -> Calibration:
    return Calibration(capture.kind, capture.brackets[0].shots[0].camera, width=shape[1], height=shape[0])


def _of_merged(capture: Capture) -> Calibration:
    from fipt.stages.capture.develop import read_merged

    shape = read_merged(capture.brackets[0].shots[0].path)[0].shape
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


# ---------------------------------------------------------------------------------------------------- dark and flat


def _with_dark(found: Calibration, paths: Sequence[Path], bar: Any) -> Calibration:
    """Black levels and hot pixels from the mean of the dark frames."""
    if not paths:
        return found
    total, noises = None, []
    for path in paths:
        frame = _read(path, found)
        values = frame.mosaic.astype(np.float32)
        total = values if total is None else total + values
        noises.append(1.4826 * np.median(np.abs(values[::2, ::2] - np.median(values[::2, ::2]))))
        bar.advance()
    mean, read = total / len(paths), max(float(np.median(noises)), 12**-0.5)
    black = np.zeros(4)
    hot = np.zeros(mean.shape, bool)
    for (i, j), colour in np.ndenumerate(frame.pattern):
        part = mean[i::2, j::2]
        middle = np.median(part)
        hot[i::2, j::2] = part > middle + max(12 * read, 0.002 * frame.range[colour])
        black[colour] = part[~hot[i::2, j::2]].mean()
        darker = frame.range[colour] * 0.25
        if black[colour] - frame.black[colour] > darker:
            raise FiptError(
                f"{paths[0]} must be dark; its mean is {black[colour] - frame.black[colour]:.0f} above the file's "
                f"black level {frame.black[colour]:g}",
                "photograph it with the lens cap on",
            )
    # Differences of neighbours of one colour have twice the variance; the mean of frames has 1/n of it.
    spread = mean[:, 2:] - mean[:, :-2]
    calm = spread[np.abs(spread) < 6 * read * np.sqrt(2 / len(paths)) + 0.5]
    read = float(np.std(calm) / np.sqrt(2 / len(paths)))
    return replace(
        found,
        black=tuple(black.tolist()),
        bad_pixels=tuple(map(tuple, np.argwhere(hot).tolist())),
        sources={**found.sources, "black": _from(paths, "dark"), "bad_pixels": _from(paths, "dark")},
        figures={**found.figures, "read_noise": read, "hot_pixels": int(hot.sum())},
    )


def _with_flats(found: Calibration, paths: Sequence[Path], bar: Any) -> Calibration:
    """Vignetting from pictures of an even surface; the sensor's noise where dark frames are there too."""
    if not paths:
        return found
    blocks, gains, total = [], [], np.float32(0)
    for path in paths:
        frame = _read(path, found)
        signal = _signal(frame, found)
        means = _block_means(signal, frame.pattern)
        _check_flat(path, frame, signal, means, found)
        blocks.append(means / np.median(means, axis=(0, 1)))
        gains.append(_photon_gain(signal, found.figures.get("read_noise", 0.0)))
        total = total + signal
        bar.advance()
    dead = _dead_pixels(total)
    mean = np.mean(blocks, axis=0).mean(axis=2)
    vignetting, profile, spread = fit_vignetting(mean, found.width, found.height)
    noise = found.noise
    if "read_noise" in found.figures and frame.shot.iso:
        noise = Noise(float(np.median(gains)), found.figures["read_noise"], frame.shot.iso)
    curve = {"curve": profile, "spread": spread, "aperture": frame.shot.aperture, "corner": _corner(vignetting, found)}
    sources = {**found.sources, "vignetting": _from(paths, "flat field")}
    if noise is not None:
        sources["noise"] = "dark frames and flat fields"
    return replace(
        found,
        vignetting=vignetting,
        noise=noise,
        bad_pixels=tuple(sorted({*found.bad_pixels, *dead})),
        sources=sources,
        figures={**found.figures, "vignetting": curve, "dead_pixels": len(dead)},
    )


def _dead_pixels(light: np.ndarray) -> list[tuple[int, int]]:
    """(row, column) of pixels that see less than 70 % of what those of their colour around them see."""
    dead = np.zeros(light.shape, bool)
    for i, j in np.ndindex(2, 2):
        part = np.ascontiguousarray(light[i::2, j::2])
        dead[i::2, j::2] = part < 0.7 * cv2.medianBlur(part, 5)
    return list(map(tuple, np.argwhere(dead).tolist()))


def fit_vignetting(means: np.ndarray, width: int, height: int) -> tuple[Vignetting, list[list[float]], float]:
    """Fit an even polynomial about a fitted centre to means of blocks of pixels.

    Parameters
    ----------
    means
        (rows, columns) mean light of blocks of pixels, from the top left, as large as `_block` says.
    width, height
        Of the picture, pixels.

    Returns
    -------
    vignetting
        The polynomial, 1 in its centre.
    profile
        [radius, measured light] for a plot: medians of rings, radius 1 = half the diagonal.
    spread
        Root mean square of the relative residuals.
    """
    from scipy.optimize import least_squares

    radius, block = np.hypot(width, height) / 2, _block((height, width))
    y, x = np.meshgrid(*(block * (np.arange(n) + 0.5) for n in means.shape), indexing="ij")
    light = means / means.max()

    def solved(center: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        r2 = ((x - center[0]) ** 2 + (y - center[1]) ** 2) / radius**2
        powers = r2.ravel()[:, None] ** np.arange(_TERMS + 1)
        factors, *_ = np.linalg.lstsq(powers, light.ravel(), rcond=None)
        return factors, light.ravel() - powers @ factors, r2

    middle = np.array([width / 2, height / 2])
    reach = 0.1 * np.array([width, height])
    best = least_squares(lambda c: solved(c)[1], middle, bounds=(middle - reach, middle + reach), x_scale=reach)
    factors, residual, r2 = solved(best.x)
    coefficients = tuple((factors[1:] / factors[0]).tolist())
    vignetting = Vignetting((float(best.x[0]), float(best.x[1])), float(radius), coefficients)
    ring = np.minimum((np.sqrt(r2) * 24).astype(int), 24).ravel()
    measured = light.ravel() / factors[0]
    profile = [
        [round((r + 0.5) / 24, 4), round(float(np.median(measured[ring == r])), 5)] for r in np.unique(ring).tolist()
    ]
    return vignetting, profile, float(np.sqrt(np.mean((residual / light.ravel()) ** 2)))


def _check_flat(path: Path, frame: RawFrame, signal: np.ndarray, means: np.ndarray, found: Calibration) -> None:
    full = tiled(frame.range, frame.pattern, *frame.shape)
    clipped = float((signal > _CLIPPED * full).mean())
    if clipped > 0.001:
        raise FiptError(
            f"{path} must be an even surface below the sensor's limit; {clipped:.1%} of its pixels are clipped",
            "photograph the flat field shorter",
        )
    light = means.mean(axis=2)
    rows, columns = (_block(frame.shape) * (np.arange(n) + 0.5) for n in light.shape)
    r = np.hypot(rows[:, None] - found.height / 2, columns - found.width / 2) / np.hypot(found.width, found.height) * 2
    ratio = float(light[r > 0.75].mean() / light[r < 0.25].mean())
    if ratio > 1.005:
        raise FiptError(
            f"{path} must be brightest near its centre; its corners are {ratio:.2f} times brighter",
            "photograph an evenly lit surface, out of focus, without a shadow of the camera",
        )


def _block_means(signal: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """(rows, columns, 4) means by colour index of blocks of pixels (`_block`)."""
    block = _block(signal.shape)
    rows, columns = (n // block for n in signal.shape)
    means = np.empty((rows, columns, 4))
    half = block // 2
    for (i, j), colour in np.ndenumerate(pattern):
        part = signal[i::2, j::2][: rows * half, : columns * half]
        means[..., colour] = part.reshape(rows, half, columns, half).mean(axis=(1, 3))
    return means


def _block(shape: tuple[int, int]) -> int:
    """Side of the blocks in pixels: even, so that they hold whole cells of the mosaic."""
    return max(2, min(shape) // _BLOCKS // 2 * 2)


def _photon_gain(signal: np.ndarray, read: float) -> float:
    """Variance of an even surface over its light, from neighbours of one colour."""
    middle = signal[:, 2:-2]
    bend = signal[:, :-4] - 2 * middle + signal[:, 4:]  # blind to slopes; its variance is 6 times a pixel's
    light = np.maximum((signal[:, :-4] + middle + signal[:, 4:]) / 3, 1.0)
    spread = 1.4826 * np.median(np.abs(bend) / np.sqrt(light))
    return float(max(spread**2 / 6 - read**2 * np.mean(1 / light), 1e-6))


def _corner(vignetting: Vignetting, found: Calibration) -> float:
    x, y = np.float32([0, found.width, 0, found.width]), np.float32([0, 0, found.height, found.height])
    return float(vignetting.falloff(x, y).mean())


# ------------------------------------------------------------------------------------------------------------- lens


def _with_lens(
    found: Calibration,
    frames: dict[str, list[Path]],
    settings: CaptureSettings,
    shot: Shot,
    bar: Any = None,
) -> Calibration:
    """Intrinsics and distortion: from boards, else by the lens's name, else the focal length alone."""
    for kind, corners_of in (("charuco", _charuco_corners), ("checkerboard", _checkerboard_corners)):
        if kind in frames:
            return _from_boards(found, kind, frames[kind], corners_of, settings, bar)
    if settings.lensfun and shot.lens:
        fallback = lensfun.look_up(shot, found.width, found.height, settings.lensfun_distance)
        if fallback is not None:
            return _with_lensfun(found, *fallback)
        found = replace(found, absent=(*found.absent, f"lens {shot.lens!r} is not in lensfun's database"))
    if shot.focal_length_35:
        # Equivalents are by diagonal: that of 36 x 24 mm is 43.27 mm.
        f = shot.focal_length_35 / np.hypot(36, 24) * np.hypot(found.width, found.height)
        lens = Lens(found.width, found.height, float(f), float(f), found.width / 2, found.height / 2)
        return replace(found, lens=lens, sources={**found.sources, "lens": "EXIF focal length"})
    return found


def _with_lensfun(found: Calibration, name: str, lens: Lens, vignetting: Vignetting | None) -> Calibration:
    sources = {**found.sources, "lens": f"lensfun: {name}"}
    if found.vignetting is None and vignetting is not None:
        found = replace(found, vignetting=vignetting)
        sources["vignetting"] = sources["lens"]
    return replace(found, lens=lens, sources=sources)


def _from_boards(
    found: Calibration, kind: str, paths: Sequence[Path], corners_of: Any, settings: CaptureSettings, bar: Any
) -> Calibration:
    objects, images, used = [], [], []
    for path in paths:
        corners = corners_of(_grey(path, found), settings)
        if corners is not None:
            objects.append(corners[0].astype(np.float32))
            images.append(corners[1].astype(np.float32))
            used.append(path.name)
        if bar is not None:
            bar.advance()
    size = f"{settings.board_columns}x{settings.board_rows} inner corners"
    if not used:
        names = ", ".join(path.name for path in paths)
        raise FiptError(
            f"no {kind} of {size} was found in any of {len(paths)} frames of {paths[0].parent}: {names}",
            "check capture.board_columns and board_rows; the whole board must be visible, sharp and evenly lit",
        )
    if len(used) < 3:
        raise FiptError(
            f"a {kind} of {size} must be found in at least 3 frames of {paths[0].parent}; found in {len(used)} of "
            f"{len(paths)}: {', '.join(used)}",
            "photograph the board from more sides",
        )
    shape = (found.width, found.height)
    # A richer model must pay: one that follows the noise of the corners bends the corners of the picture.
    best, model = None, ""
    for name, flags in _MODELS.items():
        rms, matrix, distortion, _, _ = cv2.calibrateCamera(objects, images, shape, None, None, flags=flags)
        if best is None or rms < _WORTH * best[0]:
            best, model = (rms, matrix, distortion.ravel()[:5]), name
    rms, matrix, distortion = best
    lens = Lens(
        *shape,
        *(float(v) for v in (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])),
        tuple(float(v) for v in distortion),
    )
    figures = {"kind": kind, "rms": float(rms), "frames": used, "not_found": len(paths) - len(used), "model": model}
    return replace(
        found,
        lens=lens,
        sources={**found.sources, "lens": _from(used, kind)},
        figures={**found.figures, "board": figures},
    )


def _checkerboard_corners(grey: np.ndarray, settings: CaptureSettings) -> tuple[np.ndarray, np.ndarray] | None:
    size = (settings.board_columns, settings.board_rows)
    ok, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not ok:
        return None
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    points = np.stack([columns, rows, np.zeros_like(rows)], axis=-1).reshape(-1, 3) * settings.board_square
    return points, boards.refined(grey, corners.reshape(-1, 2), 0.4) + 0.5


def _charuco_corners(grey: np.ndarray, settings: CaptureSettings) -> tuple[np.ndarray, np.ndarray] | None:
    markers = boards.dictionary(settings.board_dictionary, "capture.board_dictionary")
    inner = (settings.board_columns, settings.board_rows)
    board = boards.charuco_board(inner, settings.board_square, settings.board_marker, markers)
    found = boards.charuco_corners(grey, board, 8)
    return None if found is None else found[:2]


def _grey(path: Path, found: Calibration) -> np.ndarray:
    """(H, W) uint8 picture for corner detection: the square root of the light, vignetting corrected."""
    if path.suffix.lower() in LDR_SUFFIXES:
        from fipt.stages.capture.ldr import read_ldr

        picture = read_ldr(path)
        found.check_size(picture.shape[:2], path)
        return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    frame = _read(path, found)
    light = _signal(frame, found) / tiled(frame.range.astype(np.float32), frame.pattern, *frame.shape)
    # Boards are grey: with its colours brought to one level, the mosaic is a grey picture of full resolution.
    for i, j in np.ndindex(2, 2):
        light[i::2, j::2] /= max(float(light[i::2, j::2].mean()), 1e-6)
    if found.vignetting is not None:
        rows, columns = (np.arange(n, dtype=np.float32) + np.float32(0.5) for n in frame.shape)
        light /= found.vignetting.falloff(columns[None], rows[:, None])
    # (1, 2, 1) / 4 in both directions cancels what the mosaic leaves of a colour cast exactly.
    light = cv2.sepFilter2D(light, cv2.CV_32F, _BINOMIAL, _BINOMIAL)
    top = 1.05 * np.percentile(light[::7, ::7], 99.5)
    return (np.sqrt(np.clip(light / top, 0, 1)) * 255 + 0.5).astype(np.uint8)


# ---------------------------------------------------------------------------------------------------- white balance


def _with_white(
    found: Calibration, paths: Sequence[Path], settings: CaptureSettings, first: RawFrame, bar: Any
) -> Calibration:
    """Gains from the middle of the white frames, else those of the capture's first frame."""
    gains, source = np.ones(3), "nothing (gains 1)"
    if settings.white_balance == "reference" and paths:
        colours = []
        for path in paths:
            frame = _read(path, found)
            signal = _signal(frame, found)
            height, width = (n // 4 * 2 for n in frame.shape)
            middle = signal[height // 4 * 2 :, width // 4 * 2 :][:height, :width]
            light = np.zeros(4)
            for (i, j), colour in np.ndenumerate(frame.pattern):
                light[colour] = np.mean(middle[i::2, j::2])
            if (light > 0.95 * frame.range).any() or (light < 0.01 * frame.range).any():
                shares = ", ".join(f"{share:.0%}" for share in (light / frame.range)[:3])
                raise FiptError(
                    f"{path} must show white between 1 and 95 % of the sensor range; red, green, blue are at {shares}",
                    "photograph the white reference with another exposure",
                )
            light /= frame.range
            colours.append([light[0], (light[1] + light[3]) / 2, light[2]])
            bar.advance()
        mean = np.mean(colours, axis=0)
        gains, source = mean[1] / mean, _from(paths, "white reference")
    elif settings.white_balance != "none" and first.white_balance is not None:
        gains, source = first.white_balance, f"the camera ({first.shot.path.name})"
    return replace(
        found,
        white_balance=tuple(float(gain) for gain in gains),
        sources={**found.sources, "white_balance": source},
    )


def _with_color(found: Calibration, camera_from_xyz: np.ndarray | None) -> Calibration:
    """Linear sRGB from white-balanced camera RGB, both with white at (1, 1, 1)."""
    if camera_from_xyz is None:
        return replace(found, absent=(*found.absent, "no colour matrix is known: colours stay the camera's own"))
    camera_from_srgb = camera_from_xyz @ XYZ_FROM_SRGB
    matrix = np.linalg.inv(camera_from_srgb / camera_from_srgb.sum(axis=1, keepdims=True))
    return replace(
        found,
        color=tuple(map(tuple, matrix.tolist())),
        sources={**found.sources, "color": "colour matrix of the camera"},
    )


# ---------------------------------------------------------------------------------------------------------- helpers


def _read(path: Path, found: Calibration) -> RawFrame:
    frame = read_raw(path)
    found.check_size(frame.shape, path)
    return frame


def _signal(frame: RawFrame, found: Calibration) -> np.ndarray:
    """(H, W) float32 raw values above black."""
    black = frame.black if found.black is None else np.array(found.black)
    return frame.mosaic - tiled(black.astype(np.float32), frame.pattern, *frame.shape)


def _from(paths: Sequence[Any], what: str) -> str:
    return f"{what} ({len(paths)} frame{'s' if len(paths) != 1 else ''})"


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
