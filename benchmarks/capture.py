"""Measure the development of RAW brackets on a simulated camera, whose truth is known.

    python -m benchmarks.capture [--quick] [--out FILE]

Prints the relative radiance error of an undistorted HDR view for both ways to merge, with the lens as calibrated from
simulated frames alone and with the true one; and seconds and memory of a bracket of 5 x 24 megapixels on one core.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from fractions import Fraction
from pathlib import Path

import numpy as np

from fipt.scene.cameras import Camera
from fipt.stages.capture.settings import CaptureSettings
from fipt.synthetic.settings import SimulatedCamera

CAMERA = SimulatedCamera(scale=1, principal_offset=(2.5, -1.5), dark_offset=(1.3, -0.7, 2.1, 0.4))
"""14 bits, a black level for each position, vignetting 0.53 in the corner, k1 = -0.10, nominal times, 5 x 2 EV."""

_SUB = 4


def picture(camera: Camera) -> np.ndarray:
    """(H, W, 3) float32 radiance: coloured tiles with textures of several periods, a shadow, lamps, a dark corner.

    It is as sharp as lenses make it: a point is a Gaussian of 0.7 pixels.
    """
    from scipy.ndimage import gaussian_filter

    total = np.zeros((camera.height, camera.width, 3))
    for k in range(_SUB * _SUB):
        columns = np.arange(camera.width) + (k % _SUB + 0.5) / _SUB
        rows = np.arange(camera.height) + (k // _SUB + 0.5) / _SUB
        total += _radiance(*np.meshgrid((columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy))
    return gaussian_filter(total / _SUB**2, (0.7, 0.7, 0)).astype(np.float32)


def _radiance(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    tiles = np.floor((x + 2) * 7) * 31 + np.floor((y + 2) * 7) * 17
    textured = np.sin(tiles * 12.9898) > 0
    hue = 0.5 + 0.4 * np.sin(tiles[..., None] * np.array([1.3, 2.1, 3.7]))
    period = 0.02 * 2.0 ** (np.abs(tiles) % 3)
    wave = np.sin(2 * np.pi * (x * np.cos(tiles) + y * np.sin(tiles)) / period)
    reflectance = np.clip(hue * (1 + 0.3 * (textured * wave)[..., None]), 0.02, 0.95)
    light = 0.5 * np.exp(1.2 * np.sin(2.2 * x + 0.6) + 0.8 * np.cos(3 * y)) * np.where(x + 0.3 * y > 0.35, 0.12, 1.0)
    image = reflectance * light[..., None]
    for u, v, radius, radiance in ((-0.3, -0.35, 0.06, 40.0), (0.45, -0.3, 0.03, 25.0), (0.1, 0.35, 0.04, 12.0)):
        image[np.hypot(x - u, y - v) < radius] = radiance * np.array([1.0, 0.86, 0.7])
    image[(np.abs(x + 0.5) < 0.08) & (np.abs(y - 0.3) < 0.08)] *= 0.03
    return image


def error_table(width: int, height: int, folder: Path) -> list[dict[str, object]]:
    """Simulate one view and its calibration frames, develop it in every way, compare with the truth."""
    import cv2

    from fipt.scene.dataset import read_layers
    from fipt.scene.lens import Lens
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.calibrate import calibrate
    from fipt.stages.capture.develop import develop
    from fipt.synthetic import capture as writer
    from fipt.synthetic.camera import optics

    focal = 0.714 * width
    view = Camera("view", "train", width, height, focal, focal, width / 2, height / 2, np.eye(4))
    planes = optics(view, CAMERA)
    writer.write_calibration(folder, [view], CAMERA)
    writer.write_bracket(folder, 0, picture(planes.source), planes, CAMERA)
    camera = json.loads((folder / "truth" / "camera.json").read_text())
    truth = read_layers(folder / "truth" / "view.exr")
    capture = read_capture(folder)
    found = calibrate(capture, CaptureSettings())
    sensor = camera["sensor"]
    exact = replace(found, lens=Lens(**{**sensor, "distortion": tuple(sensor["distortion"])}))
    true = truth[""]
    log = np.log(np.maximum(true.mean(axis=2), 1e-6))
    slope = cv2.dilate(np.hypot(cv2.Sobel(log, -1, 1, 0), cv2.Sobel(log, -1, 0, 1)) / 8, np.ones((7, 7)))
    rows = []
    for lens, calibration in (("calibrated", found), ("true", exact)):
        for merge in ("mosaic", "hat"):
            start = time.process_time()
            developed = develop(capture.bracket("view"), calibration, CaptureSettings(merge=merge))
            seconds = time.process_time() - start
            error = developed.radiance * camera["radiance_of_full_second"] / true - 1
            good = (developed.valid > 0.99) & (truth["outside"] == 0) & (truth["saturated"] == 0)
            flat = good & (slope < 0.005)
            bright = flat & (true.mean(axis=2) > 8)
            p50, p90, p99 = 100 * np.percentile(np.abs(error[good]), (50, 90, 99))
            rows.append(
                {
                    "merge": merge,
                    "lens": lens,
                    "p50": p50,
                    "p90": p90,
                    "p99": p99,
                    "flats": 100 * float(np.mean(error[flat])),
                    "highlights": 100 * float(np.mean(error[bright])),
                    "seconds": seconds,
                }
            )
    board = found.figures["board"]
    print(
        f"calibration: {board['rms']:.3f} pixels rms ({board['model']}), focal length {found.lens.fx:.2f} for "
        f"{sensor['fx']:.2f}, k1 {found.lens.distortion[0]:.4f} for {sensor['distortion'][0]}, light in the corners "
        f"{found.figures['vignetting']['corner']:.3f}\n"
    )
    return rows


def printed(rows: list[dict[str, object]]) -> str:
    """The table of errors, as Markdown."""
    head = (
        "| merge | lens | p50 | p90 | p99 | bias in flats | bias in highlights | CPU |\n"
        "|---|---|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(
        "| {merge} | {lens} | {p50:.2f} % | {p90:.2f} % | {p99:.1f} % | {flats:+.2f} % | {highlights:+.2f} % | "
        "{seconds:.2f} s |".format(**row)
        for row in rows
    )


def write_large_bracket(folder: Path, width: int, height: int) -> None:
    """Write five raw files, 2 EV apart, of smooth light with noise: for speed, not for errors."""
    import cv2

    from fipt.conventions import XYZ_FROM_SRGB
    from fipt.synthetic.dng import Header, write_dng

    rng = np.random.default_rng(0)
    light = cv2.resize(rng.normal(0, 1.6, (40, 60)).astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    light = 0.02 * np.exp(light)
    light[height // 4 : height // 3, width // 3 : width // 2] = 40  # a lamp
    noise = rng.standard_normal((height, width), np.float32)
    start = datetime(2026, 1, 2, 10)
    series = (
        (Fraction(1, 1000), -10),
        (Fraction(1, 250), -8),
        (Fraction(1, 60), -6),
        (Fraction(1, 15), -4),
        (Fraction(1, 4), -2),
    )
    for k, (printed_time, power) in enumerate(series):
        electrons = light * (2.0 ** (power + 4) * 40_000)
        electrons += np.sqrt(electrons + 9) * np.roll(noise, 977 * k)
        raw = np.clip(np.rint(512.25 + electrons * (15871 / 50_000)), 0, 16383).astype(np.uint16)
        header = Header(
            "RGGB", (512.25, 511.5, 513.0, 512.75), 16383, np.linalg.inv(XYZ_FROM_SRGB), (0.55, 1.0, 0.65),
            printed_time, 8.0, 100, 24.0, 24.0, start + timedelta(seconds=k),
        )  # fmt: skip
        write_dng(folder / f"DSC{k:05d}.dng", raw, header)


def speed(folder: Path, width: int, height: int) -> dict[str, float]:
    """Develop a large bracket in a process of its own, on one core: reading, merging, undistorting, writing."""
    write_large_bracket(folder, width, height)
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.capture", "--develop", str(folder)],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    return json.loads(run.stdout.splitlines()[-1])


def develop_large(folder: Path) -> None:
    """Develop the bracket in ``folder`` on one core and print seconds and memory as JSON."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    import cv2

    from fipt.scene.lens import Lens
    from fipt.stages.capture.brackets import read_capture
    from fipt.stages.capture.calibration import Calibration, Noise, Vignetting
    from fipt.stages.capture.develop import develop_views

    cv2.setNumThreads(1)
    capture = read_capture(folder)
    from fipt.stages.capture.raw import read_raw

    shape = read_raw(capture.brackets[0].shots[0].path).shape
    height, width = shape
    calibration = Calibration(
        "raw", None, width, height,
        noise=Noise(0.317, 1.0, 100.0),
        vignetting=Vignetting((width / 2, height / 2), float(np.hypot(width, height) / 2), (-0.35, -0.17, 0.05)),
        lens=Lens(
            width, height, 0.714 * width, 0.714 * width, width / 2 + 9, height / 2 - 7, (-0.1, 0.01, 0.0, 0.0, 0.0)
        ),
        white_balance=(1.8, 1.0, 1.5),
    )  # fmt: skip
    wall, cpu = time.perf_counter(), time.process_time()
    develop_views(capture, [capture.brackets[0].view], calibration, folder / "out", CaptureSettings())
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    print(json.dumps({"wall": wall, "cpu": cpu, "peak": peak}))


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.capture", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small pictures: shows that everything runs")
    parser.add_argument("--out", type=Path, help="write the figures here too, JSON")
    parser.add_argument("--develop", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.develop:
        develop_large(arguments.develop)
        return 0
    in_folder: Callable[[], tempfile.TemporaryDirectory] = tempfile.TemporaryDirectory
    with in_folder() as place:
        rows = error_table(*((480, 320) if arguments.quick else (1200, 800)), Path(place))
    print(printed(rows))
    with in_folder() as place:
        figures = speed(Path(place), *((1200, 800) if arguments.quick else (6000, 4000)))
    print(
        f"\nbracket of 5, {'1' if arguments.quick else '24'} megapixels, one core: {figures['wall']:.1f} s "
        f"({figures['cpu']:.1f} s of CPU), {figures['peak'] / 1e9:.2f} GB at most"
    )
    if arguments.out:
        arguments.out.write_text(json.dumps({"errors": rows, "bracket_24mp": figures}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
