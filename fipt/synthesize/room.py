"""A furnished living room of 5.0 x 4.0 x 2.7 m, y up, with every material and lamp known.

All emitting surfaces are seen from one side only (the pane closes the wall's recess, the ceiling
lamp its housing, the globe itself), so one-sided and two-sided emission are the same here. They
absorb what falls on them: observed radiance is emitted radiance.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fipt.io.meshes import Mesh
from fipt.settings import SimulatedBoard
from fipt.synthesize.board import board_part, described
from fipt.synthesize.furniture import SEMANTICS, SIZE, Part, furnish
from fipt.synthesize.shapes import joined

EXPOSURE = 2.5
"""Factor on every lamp, chosen once so that the median pixel of a view is about 0.25."""

_ATLAS_WIDTH = 1024


@dataclass(frozen=True)
class Room:
    """The finished room: one mesh and what is known of each of its T triangles.

    Attributes
    ----------
    seed
        Seed of its random details.
    parts
        Parts in the order of their triangles; part ids are index + 1.
    mesh
        The merged mesh, metres.
    uv
        (V, 2) float32 texture coordinates into `atlas`.
    atlas
        (h, w, 3) float32 base colours; row 0 is v = 0.
    part, semantic
        (T,) uint16 ids, from 1.
    roughness, metallic
        (T,) float32.
    radiance
        (T, 3) float32 emitted radiance, zero where a triangle does not emit.
    board
        What room.json says of the board in the room; None where there is none.
    """

    seed: int
    parts: tuple[Part, ...]
    mesh: Mesh
    uv: np.ndarray
    atlas: np.ndarray
    part: np.ndarray
    semantic: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    radiance: np.ndarray
    board: dict[str, Any] | None = None

    @property
    def emits(self) -> np.ndarray:
        """(T,) bool: whether a triangle emits."""
        return self.radiance.any(axis=1)

    @property
    def emitters(self) -> list[np.ndarray]:
        """Triangle indices of each lamp (one part each), by increasing triangle index."""
        emits = self.emits
        return [
            np.flatnonzero((self.part == index + 1) & emits)
            for index, part in enumerate(self.parts)
            if part.radiance is not None
        ]

    def description(self) -> str:
        """Return the content of room.json: parts, materials and emitting triangles."""
        parts = []
        for index, part in enumerate(self.parts):
            textured = isinstance(part.color, np.ndarray)
            parts.append(
                {
                    "id": index + 1,
                    "name": part.name,
                    "semantic": SEMANTICS.index(part.semantic) + 1,
                    "base_color": "texture" if textured else [float(c) for c in part.color],
                    "roughness": part.roughness,
                    "metallic": part.metallic,
                    "triangles": int(np.count_nonzero(self.part == index + 1)),
                }
            )
        emitters = []
        for index, triangles in enumerate(self.emitters):
            emitters.append(
                {
                    "index": index,
                    "part": self.parts[self.part[triangles[0]] - 1].name,
                    "radiance": [round(float(c), 6) for c in self.radiance[triangles[0]]],
                    "area": round(float(self.mesh.areas[triangles].sum()), 6),
                    "triangles": triangles.tolist(),
                }
            )
        content = {
            "seed": self.seed,
            "size": list(SIZE),
            "triangles": len(self.mesh.triangles),
            "semantics": {str(i + 1): name for i, name in enumerate(SEMANTICS)},
            "parts": parts,
            "emitters": emitters,
        }
        if self.board is not None:
            content["board"] = self.board
        return json.dumps(content, indent=1) + "\n"


@lru_cache(4)
def build(seed: int, opening: bool = False, board: SimulatedBoard | None = None) -> Room:
    """Build the room, closed or with an open window; equal seeds give equal rooms, down to the order of triangles.

    A ``board`` comes last, so that all else keeps its numbers.
    """
    parts = furnish(np.random.default_rng([seed, 1]), opening)
    if board is None:
        return assemble(seed, parts)
    return replace(assemble(seed, [*parts, board_part(board)]), board=described(board))


def assemble(seed: int, parts: Sequence[Part]) -> Room:
    """Merge parts into a `Room`: one mesh, one texture atlas, one value of each kind a triangle."""
    images = [np.atleast_3d(np.asarray(part.color, np.float32)) for part in parts]
    images = [image.reshape(1, 1, 3) if image.size == 3 else image for image in images]
    atlas, corners = pack([image.shape[:2] for image in images])
    merged = joined([part.shape for part in parts])
    counts = [len(part.shape.triangles) for part in parts]
    uv = []
    for part, image, (row, column) in zip(parts, images, corners, strict=True):
        height, width = image.shape[:2]
        # One texel of padding on every side, so that no lookup mixes in a neighbour.
        padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
        atlas[row : row + height + 2, column : column + width + 2] = padded
        texel = (column + 1.5, row + 1.5) + part.shape.uv * (width - 1, height - 1)
        uv.append(texel / (atlas.shape[1], atlas.shape[0]))

    def per_triangle(values: Sequence, dtype: type) -> np.ndarray:
        return np.repeat(np.asarray(values, dtype), counts, axis=0)

    lit = [np.multiply(part.radiance or (0, 0, 0), EXPOSURE) for part in parts]
    return Room(
        seed=seed,
        parts=tuple(parts),
        mesh=Mesh(merged.vertices.astype(np.float32), merged.triangles.astype(np.int32)),
        uv=np.concatenate(uv).astype(np.float32),
        atlas=atlas,
        part=per_triangle(np.arange(len(parts)) + 1, np.uint16),
        semantic=per_triangle([SEMANTICS.index(part.semantic) + 1 for part in parts], np.uint16),
        roughness=per_triangle([part.roughness for part in parts], np.float32),
        metallic=per_triangle([part.metallic for part in parts], np.float32),
        radiance=per_triangle(lit, np.float32),
    )


def pack(sizes: Sequence[tuple[int, int]]) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Place (height, width) images with one texel of padding in rows of an atlas.

    Returns
    -------
    atlas
        (h, 1024, 3) float32 zeros.
    corners
        (row, column) of each padded image.
    """
    corners: list[tuple[int, int]] = [(0, 0)] * len(sizes)
    row = column = tallest = 0
    for index in sorted(range(len(sizes)), key=lambda i: -sizes[i][0]):
        height, width = sizes[index][0] + 2, sizes[index][1] + 2
        if column + width > _ATLAS_WIDTH:
            row, column, tallest = row + tallest, 0, 0
        corners[index] = (row, column)
        column, tallest = column + width, max(tallest, height)
    return np.zeros((row + tallest, _ATLAS_WIDTH, 3), np.float32), corners
