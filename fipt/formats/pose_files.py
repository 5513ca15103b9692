"""Poses that other programs have estimated: COLMAP models, Metashape XML, RealityCapture CSV.

Read with the standard library alone, since plans are made from them (see `fipt.formats.layouts`).

====================  ==========================================================  ============================
program               file                                                        camera axes in the file
====================  ==========================================================  ============================
COLMAP                folder with cameras and images as .txt or .bin              x right, y down, looks along +z
Metashape             .xml of "Export cameras"                                    x right, y down, looks along +z
RealityCapture        .csv "Internal/External camera parameters"                  heading, pitch, roll; z is up
====================  ==========================================================  ============================

Poses come out with OpenGL axes. Distortion is that of the photographs: a developed view has none.
"""

from __future__ import annotations

import csv
import math
import struct
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fipt.errors import FiptError
from fipt.formats.text import MALFORMED

Rows = tuple[tuple[float, ...], ...]

_COLMAP_PARAMETERS = {
    "SIMPLE_PINHOLE": (0, 3, True),
    "PINHOLE": (1, 4, False),
    "SIMPLE_RADIAL": (2, 4, True),
    "RADIAL": (3, 5, True),
    "OPENCV": (4, 8, False),
    "FULL_OPENCV": (6, 12, False),
}
"""Model -> its number in binary files, number of parameters, one focal length or two."""

_COLMAP_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""What follows the principal point, as far as a model has it."""

_FAR = 1e8
"""Coordinates above this are on no planet of ours; those of a map are brought near the origin by an import."""


@dataclass(frozen=True)
class Posed:
    """A pose: view name, 4x4 world_from_camera (OpenGL axes), what is stated of intrinsics (pixels) and distortion."""

    name: str
    world_from_camera: Rows
    intrinsics: Mapping[str, float]


def is_pose_file(path: str | Path) -> bool:
    """Whether `read_pose_file` reads this kind of file or folder."""
    path = Path(path)
    return path.suffix.lower() in (".xml", ".csv") or any((path / f"images{end}").is_file() for end in (".bin", ".txt"))


def read_pose_file(path: str | Path) -> list[Posed]:
    """Read the poses of a COLMAP folder, a Metashape XML or a RealityCapture CSV file.

    Raises
    ------
    FiptError
        The file is damaged, holds a camera that is no perspective one, or positions that are no metres on Earth.
    """
    path = Path(path)
    readers = {".xml": _metashape, ".csv": _reality_capture}
    read = readers.get(path.suffix.lower(), _colmap)
    try:
        found = read(path)
    except FiptError as error:
        message = error.message if str(path) in error.message else f"{path}: {error.message}"
        raise FiptError(message, error.remedy) from error
    except (*MALFORMED, OSError, struct.error, csv.Error, ElementTree.ParseError) as error:
        raise FiptError(f"{path} is not a readable list of cameras ({error!r})", "export the cameras again") from error
    if not found:
        raise FiptError(f"{path} must hold at least one pose; it holds none", "align the images first, then export")
    for posed in found:
        place = [row[3] for row in posed.world_from_camera[:3]]
        if not all(math.isfinite(x) and abs(x) < _FAR for x in place):
            raise FiptError(
                f"{path}, {posed.name}: positions must be metres; found {', '.join(f'{x:g}' for x in place)}",
                "export the cameras again",
            )
    return found


# --- COLMAP -------------------------------------------------------------------------------------


def pose_model_files(path: str | Path) -> list[str]:
    """Files that poses are read from: those of COLMAP's model where ``path`` is its folder, else the file itself."""
    folder = Path(path)
    if not folder.is_dir():
        return [str(path)]
    ending = "bin" if _is_binary(folder) else "txt"
    return [str(folder / f"{name}.{ending}") for name in ("cameras", "images")]


def _is_binary(folder: Path) -> bool:
    """Whether a model of COLMAP's is read from its binary files."""
    return (folder / "images.bin").is_file()


def _colmap(folder: Path) -> list[Posed]:
    if _is_binary(folder):
        cameras, images = _colmap_binary(folder)
    else:
        cameras, images = _colmap_text(folder)
    found = []
    for name, camera, quaternion, translation in images:
        w, x, y, z = (value / math.hypot(*quaternion) for value in quaternion)
        rotation = (  # camera from world, row by row
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        )
        turned = tuple(zip(*rotation, strict=True))
        place = [-sum(a * t for a, t in zip(row, translation, strict=True)) for row in turned]
        pose = _opengl([(*row, p) for row, p in zip(turned, place, strict=True)])
        found.append(Posed(_view(name), pose, cameras[camera]))
    return found


_ColmapImage = tuple[str, int, Sequence[float], Sequence[float]]
"""Name, camera, quaternion (w first), translation; both camera from world."""


def _colmap_text(folder: Path) -> tuple[dict[int, dict[str, float]], list[_ColmapImage]]:
    cameras = {}
    for line in _lines(folder / "cameras.txt"):
        if line:
            number, model, width, height, *parameters = line.split()
            cameras[int(number)] = _colmap_intrinsics(model, int(width), int(height), [float(p) for p in parameters])
    images: list[_ColmapImage] = []
    # Every second line lists the points of the image above, and may be empty.
    for line in list(_lines(folder / "images.txt"))[::2]:
        if line:
            _, *numbers, camera, name = line.split(maxsplit=9)
            values = [float(value) for value in numbers]
            images.append((name, int(camera), values[:4], values[4:7]))
    return cameras, images


def _lines(path: Path) -> Iterator[str]:
    if not path.is_file():
        raise FiptError(f"a COLMAP model lacks {path}", "export the whole model as text or binary")
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            yield line.strip()


def _colmap_binary(folder: Path) -> tuple[dict[int, dict[str, float]], list[_ColmapImage]]:
    names = {number: (model, count) for model, (number, count, _) in _COLMAP_PARAMETERS.items()}
    if not (folder / "cameras.bin").is_file():
        raise FiptError(f"a COLMAP model lacks {folder / 'cameras.bin'}", "export the whole model as text or binary")
    data, cameras = _Bytes((folder / "cameras.bin").read_bytes()), {}
    for _ in range(*data.take("<Q")):
        number, model, width, height = data.take("<iiQQ")
        if model not in names:
            raise FiptError(f"{folder}: cameras must be pinholes; found COLMAP's model {model}", "undistort first")
        name, count = names[model]
        cameras[number] = _colmap_intrinsics(name, width, height, data.take(f"<{count}d"))
    data = _Bytes((folder / "images.bin").read_bytes())
    images: list[_ColmapImage] = []
    for _ in range(*data.take("<Q")):
        _, *pose, camera = data.take("<i7di")
        name = data.text()
        (points,) = data.take("<Q")
        data.place += points * 24
        images.append((name, camera, pose[:4], pose[4:]))
    return cameras, images


class _Bytes:
    """Reads values one after the other."""

    def __init__(self, content: bytes) -> None:
        self.content, self.place = content, 0

    def take(self, form: str) -> tuple:
        values = struct.unpack_from(form, self.content, self.place)
        self.place += struct.calcsize(form)
        return values

    def text(self) -> str:
        end = self.content.index(b"\0", self.place)
        found = self.content[self.place : end].decode("utf-8")
        self.place = end + 1
        return found


def _colmap_intrinsics(model: str, width: int, height: int, parameters: Sequence[float]) -> dict[str, float]:
    if model not in _COLMAP_PARAMETERS:
        raise FiptError(f"cameras must be pinholes; found COLMAP's {model}", "undistort the images first")
    fx, *rest = parameters
    fy, cx, cy, *distortion = (fx, *rest) if _COLMAP_PARAMETERS[model][2] else rest
    pinhole = {"w": width, "h": height, "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}
    return pinhole | dict(zip(_COLMAP_DISTORTION, distortion, strict=False))


# --- Metashape ----------------------------------------------------------------------------------


def _metashape(path: Path) -> list[Posed]:
    chunks = ElementTree.parse(path).getroot().findall("chunk")
    if len(chunks) != 1:
        raise FiptError(f"{path} must be Metashape's export of one chunk; it has {len(chunks)}", "export one chunk")
    chunk = chunks[0]
    sensors = {sensor.get("id"): _metashape_intrinsics(sensor) for sensor in chunk.iter("sensor")}
    whole, found = _metashape_world(chunk.find("transform")), []
    components = {each.get("id"): each.find("transform") for each in chunk.iterfind("components/component")}
    worlds = {number: _metashape_world(each) for number, each in components.items() if each is not None}
    for camera in chunk.iter("camera"):
        text = camera.findtext("transform")
        if text is None:  # not aligned
            continue
        # newer exports give a transform to each component of aligned cameras
        world = worlds.get(camera.get("component_id"), next(iter(worlds.values())) if len(worlds) == 1 else whole)
        values = _numbers(text, 16)
        rows = [values[start : start + 4] for start in (0, 4, 8)]
        linear = [[sum(a * b for a, b in zip(row, column, strict=True)) for column in zip(*rows, strict=True)]
                  for row in world[0]]  # fmt: skip
        pose = [(*row[:3], world[1] * row[3] + shift) for row, shift in zip(linear, world[2], strict=True)]
        name = _view(camera.get("label", ""))
        found.append(Posed(name, _opengl(pose), sensors.get(camera.get("sensor_id"), {})))
    return found


def _metashape_world(transform: ElementTree.Element | None) -> tuple[list[list[float]], float, list[float]]:
    """Rotation (3 rows), scale and shift of a chunk; none means the identity."""
    texts = {} if transform is None else {child.tag: child.text for child in transform}
    turn = _numbers(texts.get("rotation") or "1 0 0 0 1 0 0 0 1", 9)
    scale = float(texts.get("scale") or 1)
    return [turn[0:3], turn[3:6], turn[6:9]], scale, _numbers(texts.get("translation") or "0 0 0", 3)


def _metashape_intrinsics(sensor: ElementTree.Element) -> dict[str, float]:
    if sensor.get("type", "frame") != "frame":
        raise FiptError(
            f"cameras must be perspective ones; Metashape's sensor {sensor.get('label')} is {sensor.get('type')}",
            "leave its images out",
        )
    calibrations = sensor.findall("calibration")
    adjusted = [c for c in calibrations if c.get("class") == "adjusted"] or calibrations
    size = sensor.find("resolution")
    if not adjusted or size is None or adjusted[0].findtext("f") is None:
        return {}
    width, height = float(size.get("width", 0)), float(size.get("height", 0))
    f = float(adjusted[0].findtext("f", ""))
    # The principal point is stated from the middle of the image.
    cx, cy = (float(adjusted[0].findtext(key, "0")) for key in ("cx", "cy"))
    pinhole = {"w": width, "h": height, "fl_x": f, "fl_y": f, "cx": width / 2 + cx, "cy": height / 2 + cy}
    terms = {key: adjusted[0].findtext(key) for key in ("k1", "k2", "k3", "k4", "p1", "p2")}
    return pinhole | {key: float(text) for key, text in terms.items() if text is not None}


def _numbers(text: str, count: int) -> list[float]:
    values = [float(word) for word in text.split()]
    if len(values) != count:
        raise ValueError(f"{count} numbers expected, found {len(values)}")
    return values


# --- RealityCapture -----------------------------------------------------------------------------


def _reality_capture(path: Path) -> list[Posed]:
    with open(path, encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file, skipinitialspace=True))
    found = []
    for row in rows:
        values = {key.lstrip("#").strip(): value for key, value in row.items() if key}
        place = [float(values[key]) for key in ("x", "y", "alt")]
        heading, pitch, roll = (math.radians(float(values[key])) for key in ("heading", "pitch", "roll"))
        # Angles of a camera that looks straight down with its top to the north: those axes are OpenGL's.
        turn = _product(_product(_about(2, -heading), _about(0, pitch)), _about(1, roll))
        pose = (*((*row, p) for row, p in zip(turn, place, strict=True)), (0.0, 0.0, 0.0, 1.0))
        found.append(Posed(_view(values["name"]), pose, {}))
    return found


def _about(axis: int, angle: float) -> list[list[float]]:
    """Rotation about a world axis, counter-clockwise."""
    c, s = math.cos(angle), math.sin(angle)
    a, b = [other for other in range(3) if other != axis] if axis != 1 else (2, 0)
    rows = [[float(i == j) for j in range(3)] for i in range(3)]
    rows[a][a], rows[a][b], rows[b][a], rows[b][b] = c, -s, s, c
    return rows


def _product(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[sum(x * y for x, y in zip(row, column, strict=True)) for column in zip(*b, strict=True)] for row in a]


# --- common -------------------------------------------------------------------------------------


def _opengl(rows: Sequence[Sequence[float]]) -> Rows:
    """4x4 pose of a camera with OpenGL axes, from 3x4 rows of one with y down that looks along +z."""
    return (*((row[0], -row[1], -row[2], row[3]) for row in rows), (0.0, 0.0, 0.0, 1.0))


def _view(label: str) -> str:
    """A view is called as its image, without folder and ending."""
    return PurePosixPath(label.replace("\\", "/")).stem
