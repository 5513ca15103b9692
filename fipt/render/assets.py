"""What Mitsuba's own loaders read for us: mesh files, spectra, optical constants of metals, models of the sky."""

# The stubs of Mitsuba name the arrays of one variant, those of Dr.Jit others: the same values seem to be of two types.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false, reportReturnType=false

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mitsuba as mi
import numpy as np

from fipt.errors import FiptError
from fipt.render.scene import vectors
from fipt.scene.environment import texel_directions

_NEGATIVE = re.compile(rb"^f[^\n]*[ \t/]-\d", re.MULTILINE)
_SKY_ROWS, _SKY_FINER = 256, 6
"""Rows of a sky's map, and how many directions are averaged along each side of its texels (the sun is small)."""


@dataclass(frozen=True)
class LoadedMesh:
    """A mesh file as it is.

    Attributes
    ----------
    vertices
        (V, 3) float32.
    triangles
        (T, 3) int32, in file order; polygons are cut into fans.
    normals
        (V, 3) float32 vertex normals, or None.
    uv
        (V, 2) float32, or None. Mitsuba has v = 0 in the first row of an image.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    normals: np.ndarray | None = None
    uv: np.ndarray | None = None


def load_mesh(kind: str, path: Path | None = None, mirrored: bool = False, **options: bool | int) -> LoadedMesh:
    """Load a mesh by a Mitsuba plugin: ``obj``, ``ply``, ``serialized`` or ``cube``.

    Parameters
    ----------
    kind, path
        Plugin and file.
    mirrored
        Whether the shape's transform mirrors. Mitsuba computes normals that the file lacks after the transform, so
        they turn to the other side; those of the file stay.
    **options
        ``shape_index``, ``flip_tex_coords``, as Mitsuba has them.

    Raises
    ------
    FiptError
        If the file is damaged.
    """
    sides = np.array((-1 if mirrored else 1, 1, 1), np.float32)
    entry = {"type": kind, "to_world": mi.ScalarTransform4f().scale(sides.tolist()), **options}
    try:
        if path is None:
            return _arrays(mi.load_dict(entry), sides)
        if kind != "obj" or not _NEGATIVE.search(path.read_bytes()):
            return _arrays(mi.load_dict(entry | {"filename": str(path.absolute())}), sides)
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / path.name
            copy.write_bytes(_positive(path.read_bytes()))
            return _arrays(mi.load_dict(entry | {"filename": str(copy)}), sides)
    except (RuntimeError, ValueError, IndexError) as error:
        text = str(error).rpartition("Error while loading")[2]
        raise FiptError(f"{path} is not a readable {kind} mesh ({text})", "repair or replace the file") from error


def _arrays(shape: mi.Shape, sides: np.ndarray) -> LoadedMesh:
    """Return the mesh's arrays; ``sides`` takes back that it was mirrored."""
    found = mi.traverse(shape)

    def array(key: str, width: int, kind: type) -> np.ndarray | None:
        values = np.array(found[key]) if key in found else np.empty(0)
        return values.reshape(-1, width).astype(kind) if values.size else None

    vertices, triangles = array("vertex_positions", 3, np.float32), array("faces", 3, np.int32)
    if vertices is None or triangles is None:
        return LoadedMesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    normals = array("vertex_normals", 3, np.float32)
    if normals is not None:
        normals = normals * sides
    return LoadedMesh(vertices * sides, triangles, normals, array("vertex_texcoords", 2, np.float32))


def _positive(text: bytes) -> bytes:
    """Rewrite an OBJ file whose faces count backwards from the last vertex; Mitsuba only counts forwards."""
    counts = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = []
    for line in text.splitlines():
        words = line.split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            for place, word in enumerate(words[1:], 1):
                numbers = word.split(b"/")
                for k, total in enumerate(list(counts.values())[: len(numbers)]):
                    if numbers[k].startswith(b"-"):
                        numbers[k] = b"%d" % (total + 1 + int(numbers[k]))
                words[place] = b"/".join(numbers)
            line = b" ".join(words)
        lines.append(line)
    return b"\n".join(lines) + b"\n"


def spectrum_rgb(wavelengths: np.ndarray, values: np.ndarray, reflects: bool) -> np.ndarray:
    """Linear RGB (3,) of a spectrum over wavelengths in nm.

    Reflectance is what it looks like under daylight (D65), so that a flat spectrum is grey.
    """
    args = (list(map(float, wavelengths)), list(map(float, values)))
    return np.array(mi.spectrum_list_to_srgb(*args, bounded=reflects, d65=reflects), float).reshape(3)


@cache
def metal(name: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Refractive index eta and extinction k, each (3,) RGB, of a metal that Mitsuba names; None if it knows none."""
    if not re.fullmatch(r"[\w-]+", name):
        return None
    try:
        found = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
    except RuntimeError:
        return None
    eta, k = (np.broadcast_to(np.array(found[f"{key}.value"], float).ravel(), 3) for key in ("eta", "k"))
    return eta, k


def sky_map(options: Mapping[str, float | list[float]], turn: np.ndarray) -> np.ndarray:
    """(h, w, 3) float32 map (`fipt.scene.environment`, y up) of Mitsuba's model of sky and sun.

    Parameters
    ----------
    options
        Those of Mitsuba's plugin, colours as three numbers; ``sun_direction`` is not turned.
    turn
        (3, 3) rotation from the plugin's axes, z up, to those of the map.

    Raises
    ------
    ValueError
        If Mitsuba refuses the options.
    """
    to_world = np.eye(4)
    to_world[:3, :3] = turn
    entry = {"type": "sunsky", "to_world": mi.ScalarTransform4f(to_world), **options}
    if "albedo" in options:
        entry["albedo"] = {"type": "rgb", "value": options["albedo"]}
    try:
        emitter = mi.load_dict(entry)
    except RuntimeError as error:
        reason = str(error).rpartition('type "sunsky": ')[2]
        raise ValueError(re.sub(r"^\[[^]]*\] ", "", " ".join(reason.split()))) from error
    rows, columns = _SKY_ROWS * _SKY_FINER, 2 * _SKY_ROWS * _SKY_FINER
    directions = texel_directions(rows, columns)
    si = mi.SurfaceInteraction3f()
    si.wi = -vectors(directions, mi.Vector3f)
    values = np.array(emitter.eval(si)).T.reshape(_SKY_ROWS, _SKY_FINER, 2 * _SKY_ROWS, _SKY_FINER, 3)
    return np.maximum(values.mean(axis=(1, 3)), 0).astype(np.float32)
