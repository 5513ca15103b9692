"""A room: one mesh, and what is known of each of its triangles. Rooms in code are built here.

Their content stands in `fipt.synthetic.rooms`: every material and emitter is known. Rooms from scene files are made in
`fipt.synthetic.modelled`.

All emitting surfaces of rooms in code are seen from one side only (panes close the recesses of walls, lamps their
housings, globes themselves), so one-sided and two-sided emission are the same there. Emitters absorb what falls on
them: observed radiance is emitted radiance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.scene.environment import NOTHING, EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.parts import RoomPart
from fipt.synthetic.rooms import DEFAULT, ROOMS
from fipt.synthetic.rooms.design import PANE
from fipt.synthetic.sky import sky

_MOST_IDS = 65_535
"""Ids are pixels of 16-bit PNG files; 0 is unknown."""


@dataclass(frozen=True)
class RoomPiece:
    """Triangles of one material before they are merged.

    Attributes
    ----------
    name
        Of the part.
    vertices, triangles, uv
        (V, 3) metres, (T, 3) indices, (V, 2) texture coordinates.
    material, semantic
        Indices into the room's materials and semantic names.
    radiance
        (3,) or (T, 3) emitted radiance to the front (the triangles are wound counter-clockwise there); None where it
        emits nothing.
    """

    name: str
    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    material: int
    semantic: int
    radiance: np.ndarray | None = None


@dataclass(frozen=True)
class SyntheticRoom:
    """The finished room: one mesh and what is known of each of its T triangles.

    Attributes
    ----------
    parts, semantics
        Names; ids are index + 1. Parts are in the order of their triangles.
    materials
        Their textures repeat over `uv`.
    mesh
        The merged mesh, metres, y up.
    uv
        (V, 2) float32 texture coordinates.
    part, semantic
        (T,) uint16 ids, from 1.
    material
        (T,) int32 index into `materials`.
    radiance
        (T, 3) float32 radiance emitted to the front, zero where a triangle does not emit.
    outside
        What shines through openings.
    box
        (2, 3) lower and upper corner of the interior, metres.
    exposure
        Factor that radiance and outside have on what the room's author said.
    facts
        What else room.json says of the room.
    unseen
        Names of parts that no view shows.
    """

    parts: tuple[str, ...]
    semantics: tuple[str, ...]
    materials: tuple[RoomMaterial, ...]
    mesh: Mesh
    uv: np.ndarray
    part: np.ndarray
    semantic: np.ndarray
    material: np.ndarray
    radiance: np.ndarray
    outside: EnvironmentMap
    box: np.ndarray
    exposure: float
    facts: dict[str, Any]
    unseen: tuple[str, ...] = ()

    @property
    def emits(self) -> np.ndarray:
        """(T,) bool: whether a triangle emits."""
        return np.asarray(self.radiance.any(axis=1))

    @property
    def emitters(self) -> list[np.ndarray]:
        """Triangle indices of each emitter (one part and one radiance each), by increasing triangle index."""
        emitting = np.flatnonzero(self.emits)
        another = np.diff(self.part[emitting]) != 0
        another |= np.diff(self.radiance[emitting], axis=0).any(axis=1)
        found = np.split(emitting, np.flatnonzero(another) + 1)
        return found if len(emitting) else []

    def exposed(self, factor: float) -> SyntheticRoom:
        """Return the room with all its light times a factor."""
        light = np.float32(factor)
        outside = replace(self.outside, radiance=self.outside.radiance * light)
        return replace(self, radiance=self.radiance * light, outside=outside, exposure=self.exposure * factor)

    def description(self) -> dict[str, Any]:
        """Return the content of room.json: parts, materials and emitting triangles."""
        counts = np.bincount(self.part, minlength=len(self.parts) + 1)
        firsts = np.unique(self.part, return_index=True)[1]
        parts = [
            {
                "id": index + 1,
                "name": name,
                "semantic": int(self.semantic[first]),
                "material": int(self.material[first]),
                "triangles": int(counts[index + 1]),
            }
            for index, (name, first) in enumerate(zip(self.parts, firsts, strict=True))
        ]
        materials = [
            {
                "name": material.name,
                "base_color": _described(material.base_color),
                "roughness": _described(material.roughness),
                "metallic": _described(material.metallic),
                **({"flagged": True} if material.flagged else {}),
            }
            for material in self.materials
        ]
        areas = self.mesh.areas
        emitters = [
            {
                "index": index,
                "part": self.parts[self.part[triangles[0]] - 1],
                "radiance": [round(float(c), 6) for c in self.radiance[triangles[0]]],
                "area": round(float(areas[triangles].sum()), 6),
                "triangles": triangles.tolist(),
            }
            for index, triangles in enumerate(self.emitters)
        ]
        return {
            **self.facts,
            "box": np.round(self.box.astype(float), 4).tolist(),
            "exposure": self.exposure,
            "triangles": len(self.mesh.triangles),
            "semantics": {str(i + 1): name for i, name in enumerate(self.semantics)},
            "parts": parts,
            "materials": materials,
            "emitters": emitters,
        }


def _described(image: np.ndarray) -> Any:
    """Return the value of a constant texture, else words."""
    height, width = image.shape[:2]
    if (height, width) != (1, 1):
        return f"texture of {width}x{height}"
    value = np.round(image[0, 0].astype(float), 6)
    return value.tolist()


def assemble(
    pieces: Sequence[RoomPiece],
    materials: Sequence[RoomMaterial],
    semantics: Sequence[str],
    box: np.ndarray,
    outside: EnvironmentMap = NOTHING,
    exposure: float = 1.0,
    facts: dict[str, Any] | None = None,
) -> SyntheticRoom:
    """Merge pieces into a `SyntheticRoom`, their triangles in order."""
    if max(len(pieces), len(semantics)) > _MOST_IDS:
        raise FiptError(
            f"a room may have {_MOST_IDS} parts and materials; this has {len(pieces)} and {len(semantics)}",
            "join shapes of one material",
        )
    counts = [len(piece.triangles) for piece in pieces]
    offsets = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])

    def per_triangle(values: Sequence[Any] | np.ndarray, dtype: type) -> np.ndarray:
        return np.repeat(np.asarray(values, dtype), counts, axis=0)

    triangles = [piece.triangles + offset for piece, offset in zip(pieces, offsets, strict=False)]
    return SyntheticRoom(
        parts=tuple(piece.name for piece in pieces),
        semantics=tuple(semantics),
        materials=tuple(materials),
        mesh=Mesh(
            np.concatenate([piece.vertices for piece in pieces]).astype(np.float32),
            np.concatenate(triangles).astype(np.int32),
        ),
        uv=np.concatenate([piece.uv for piece in pieces]).astype(np.float32),
        part=per_triangle(np.arange(len(pieces)) + 1, np.uint16),
        semantic=per_triangle([piece.semantic + 1 for piece in pieces], np.uint16),
        material=per_triangle([piece.material for piece in pieces], np.int32),
        radiance=np.concatenate([_radiance(piece) for piece in pieces]).astype(np.float32),
        outside=outside,
        box=np.asarray(box, np.float64),
        exposure=exposure,
        facts=facts or {},
    )


def _radiance(piece: RoomPiece) -> np.ndarray:
    """(T, 3) radiance of a piece's triangles."""
    radiance = np.zeros(3) if piece.radiance is None else piece.radiance
    return np.broadcast_to(radiance, (len(piece.triangles), 3))


@lru_cache(8)
def build(
    seed: int,
    opening: bool = False,
    horizon: tuple[float, float, float] = (8.0, 9.75, 12.5),
    name: str = DEFAULT,
) -> SyntheticRoom:
    """Build a room in code, closed or with open windows; equal seeds give equal rooms, down to every triangle.

    Parameters
    ----------
    seed
        Of its random details.
    opening
        Leave out the windows' panes: the sky is seen and shines in.
    horizon
        Radiance of that sky's horizon.
    name
        Which of `ROOMS`.

    Raises
    ------
    FiptError
        If it has no window to open.
    """
    design = ROOMS[name]
    parts = design.furnish(np.random.default_rng([seed, 1]))
    if opening:
        closed, parts = parts, [part for part in parts if not part.name.startswith(PANE)]
        if len(parts) == len(closed):
            raise FiptError(f"the room {name} has no window to open", "leave synthesize.opening out")
    semantics = design.semantics or tuple(dict.fromkeys(part.semantic for part in parts))
    named = {} if name == DEFAULT else {"room": name}
    room = assemble(
        [_piece(index, part, semantics, design.exposure) for index, part in enumerate(parts)],
        [_material(part) for part in parts],
        semantics,
        np.array([np.zeros(3), design.size]),
        sky(horizon) if opening else NOTHING,
        design.exposure,
        {**named, "seed": seed, "size": list(design.size)},
    )
    return replace(room, unseen=design.unseen)


def _material(part: RoomPart) -> RoomMaterial:
    """Return a part's material; textures of roughness are as large as those of the colour."""
    image = _image(part)
    roughness, metallic = (np.atleast_2d(np.float32(value)) for value in (part.roughness, part.metallic))
    if roughness.shape not in ((1, 1), image.shape[:2]):
        raise ValueError(f"{part.name}: roughness of {roughness.shape} texels, colour of {image.shape[:2]}")
    return RoomMaterial(part.name, image, roughness, metallic)


def _image(part: RoomPart) -> np.ndarray:
    color = np.asarray(part.color, np.float32)
    return color.reshape(1, 1, 3) if color.size == 3 else color


def _piece(index: int, part: RoomPart, semantics: Sequence[str], exposure: float) -> RoomPiece:
    """Return a part as a piece: its texture ends at the centres of its outermost texels, and so never repeats."""
    height, width = _image(part).shape[:2]
    uv = (0.5 + part.shape.uv * (width - 1, height - 1)) / (width, height)
    radiance = None if part.radiance is None else np.multiply(part.radiance, exposure)
    semantic = semantics.index(part.semantic)
    return RoomPiece(part.name, part.shape.vertices, part.shape.triangles, uv, index, semantic, radiance)
