"""Textures of many materials as one array on the device: looked up by material, tiled, without a branch.

A scene has hundreds of materials. One Mitsuba plugin each would cost a virtual call each, and a shape each, so that
triangles lost their numbers; here the mesh stays one.
"""

from __future__ import annotations  # Mitsuba has no classes before its variant is set

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from fipt.conventions import ROUGHNESS_MIN
from fipt.render.edits import Box, Edit
from fipt.scene.mesh import Mesh


class MaterialMaps(Protocol):
    """What `PackedMaps` needs of a material: float32 images, 1 x 1 where they are constant; row 0 is v = 0.

    Images repeat: (u, v) and (u + 1, v) are the same place. Texel centres are at half integers, values between them
    are bilinear.
    """

    @property
    def base_color(self) -> np.ndarray:
        """(h, w, 3) linear RGB."""
        ...

    @property
    def roughness(self) -> np.ndarray:
        """(h, w)."""
        ...

    @property
    def metallic(self) -> np.ndarray:
        """(h, w)."""
        ...


class PackedMaps:
    """Images (h, w) or (h, w, 3) of several materials, in one array.

    Parameters
    ----------
    images
        One for each material, all of as many channels; float32.
    """

    def __init__(self, images: Sequence[np.ndarray]) -> None:
        sizes = np.array([image.shape[:2] for image in images], np.uint32)
        starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1, dtype=np.int64))])
        channels = 3 if images[0].ndim == 3 else 1
        flat = np.empty((starts[-1], channels), np.float32)
        for image, start in zip(images, starts, strict=False):
            flat[start : start + image.shape[0] * image.shape[1]] = image.reshape(-1, channels)
        self._texels = mi.Float(flat.ravel())
        self._height, self._width, self._start = (mi.UInt32(v.astype(np.uint32)) for v in (*sizes.T, starts[:-1]))

    def lookup(self, kind: type, material: Any, uv: Any, active: Any = True) -> Any:
        """Return the ``kind`` (`Color3f` or `Float`) of materials (mi.UInt32) at places ``uv`` (mi.Point2f)."""
        height, width, start = (
            dr.gather(mi.UInt32, table, material, active) for table in (self._height, self._width, self._start)
        )
        left, right, tx = _neighbours(uv.x, width)
        top, bottom, ty = _neighbours(uv.y, height)

        def texel(row: Any, column: Any) -> Any:
            return dr.gather(kind, self._texels, start + row * width + column, active)

        upper = dr.lerp(texel(top, left), texel(top, right), tx)
        lower = dr.lerp(texel(bottom, left), texel(bottom, right), tx)
        return dr.lerp(upper, lower, ty)


def _neighbours(place: Any, count: Any) -> tuple[Any, Any, Any]:
    """Texels on both sides of a texture coordinate along an axis of ``count`` texels; the share of the second."""
    position = (place - dr.floor(place)) * count - 0.5
    first = dr.floor(position)
    before = dr.select(first < 0, count - 1, mi.UInt32(first))
    after = dr.select(before + 1 == count, 0, before + 1)
    return before, after, position - first


class DeviceMaps:
    """The maps of a room's materials, on the device."""

    def __init__(self, materials: Sequence[MaterialMaps]) -> None:
        self.base_color = PackedMaps([material.base_color for material in materials])
        self.roughness = PackedMaps([np.maximum(material.roughness, ROUGHNESS_MIN) for material in materials])
        self.metallic = PackedMaps([material.metallic for material in materials])


@dataclass(frozen=True)
class MappedMesh:
    """A mesh whose triangles have materials.

    Attributes
    ----------
    mesh
        T triangles, metres.
    uv
        (V, 2) float32 texture coordinates.
    maps
        Of all materials.
    material
        (T,) material of each triangle.
    edits
        Changes of the materials, in order; for a mesh of these T triangles.
    """

    mesh: Mesh
    uv: np.ndarray
    maps: DeviceMaps
    material: np.ndarray
    edits: Sequence[Edit] = ()


class MappedSurface:
    """Reflectance of every place of a mesh, in kernels.

    Parameters
    ----------
    room
        The mesh.

    Attributes
    ----------
    base_color, roughness, metallic
        What a `fipt.render.bsdf` asks for them: ``eval(si, active)``, ``eval_1(si, active)``.
    """

    def __init__(self, room: MappedMesh) -> None:
        number = mi.UInt32(np.ascontiguousarray(room.material, np.uint32))
        places = [_EditPlace(edit.where) for edit in room.edits]
        self.base_color, self.roughness, self.metallic = (
            _MapOnMesh(
                getattr(room.maps, name),
                number,
                [(place, _step(edit, name)) for place, edit in zip(places, room.edits, strict=True)],
            )
            for name in ("base_color", "roughness", "metallic")
        )


def _step(edit: Edit, name: str) -> Callable[[Any], Any]:
    """What an edit makes of a value of the map ``name``."""
    change, tint = edit.change, edit.change.tint
    if name == "base_color" and tint is not None:
        return lambda value: dr.minimum(value * mi.Color3f(*tint), 1)
    wanted = getattr(change, name)
    if wanted is None:
        return lambda value: value
    return lambda value: type(value)(wanted if name != "base_color" else mi.Color3f(*wanted))


class _EditPlace:
    """Where an edit holds."""

    def __init__(self, where: np.ndarray | Box) -> None:
        self._where = where if isinstance(where, Box) else mi.UInt32(where.astype(np.uint32))

    def holds(self, si: Any, active: Any) -> Any:
        if not isinstance(self._where, Box):
            return dr.gather(mi.UInt32, self._where, si.prim_index, active) > 0
        away = si.p - mi.Point3f(*map(float, self._where.center))
        inside = mi.Bool(True)
        for axis, half in zip(self._where.turn.T, self._where.half, strict=True):
            inside &= dr.abs(dr.dot(away, mi.Vector3f(*map(float, axis)))) <= float(half)
        return inside


class _MapOnMesh:
    """Texels on a mesh, with the two methods of a Mitsuba texture that a BSDF calls."""

    def __init__(
        self, texels: PackedMaps, material: Any, steps: Sequence[tuple[_EditPlace, Callable[[Any], Any]]]
    ) -> None:
        self._texels, self._material, self._steps = texels, material, steps

    def eval(self, si: Any, active: Any = True) -> Any:
        return self._at(mi.Color3f, si, active)

    def eval_1(self, si: Any, active: Any = True) -> Any:
        return self._at(mi.Float, si, active)

    def _at(self, kind: type, si: Any, active: Any) -> Any:
        material = dr.gather(mi.UInt32, self._material, si.prim_index, active)
        value = self._texels.lookup(kind, material, si.uv, active)
        for place, step in self._steps:
            value = dr.select(place.holds(si, active), step(value), value)
        return value
