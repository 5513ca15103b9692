"""What the furniture of the rooms in code is made of: parts, outlines, a few materials."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fipt.synthetic.shapes import Shape, box, rod, turned_body
from fipt.synthetic.textures import Rgb

SEMANTICS = (
    "wall", "ceiling", "floor", "window", "lamp", "door", "rug", "sofa", "chair", "table",
    "cupboard", "shelf", "book", "picture", "vase", "plant", "curtain",
)  # fmt: skip
"""Semantic names; their ids start at 1."""


@dataclass(frozen=True)
class RoomPart:
    """One object of one material.

    Attributes
    ----------
    name
        Unique in the room.
    semantic
        What it is called; the living room's are `SEMANTICS`.
    shape
        Its triangles.
    color
        Base colour: RGB, or a (h, w, 3) texture over the shape's texture coordinates.
    roughness
        In [0.02, 1]; or a (h, w) texture as large as the colour's.
    metallic
        In [0, 1].
    radiance
        Emitted radiance before the room's exposure, RGB or (T, 3) for the shape's triangles; None where it emits
        nothing.
    """

    name: str
    semantic: str
    shape: Shape
    color: Any
    roughness: Any = 1.0
    metallic: float = 0.0
    radiance: Any = None


BRASS, COPPER, STEEL, SILVER = (
    dict[str, Any](color=color, metallic=1.0)
    for color in ((0.83, 0.62, 0.30), (0.86, 0.47, 0.31), (0.60, 0.61, 0.63), (0.78, 0.77, 0.74))
)
BLACK: Rgb = (0.0, 0.0, 0.0)
WHITE_PAINT: Rgb = (0.70, 0.69, 0.66)

OUTLINES = {
    "lamp housing": "0.335 0.02, 0.335 0.005, 0.345 0, 0.36 0, 0.37 0.01, 0.37 0.105",
    "lamp stand": "0 0, 0.085 0, 0.085 0.012, 0.02 0.022, 0.011 0.035, 0.011 0.275, 0.035 0.282,0.035 0.288, 0 0.288",
    "table top": "0 0, 0.40 0, 0.425 0.006, 0.433 0.02, 0.425 0.034, 0.41 0.038, 0 0.038",
    "copper vase": "0 0, 0.055 0, 0.085 0.04, 0.10 0.09, 0.092 0.14, 0.06 0.19, 0.038 0.225,"
    "0.034 0.25, 0.048 0.285, 0.044 0.285, 0.028 0.25, 0 0.245",
    "ceramic vase": "0 0, 0.06 0, 0.10 0.06, 0.115 0.13, 0.10 0.20, 0.055 0.27, 0.04 0.33,"
    "0.055 0.36, 0.048 0.36, 0.03 0.33, 0 0.32",
    "bowl": "0 0, 0.05 0, 0.10 0.03, 0.13 0.07, 0.122 0.07, 0.094 0.038, 0.05 0.014, 0 0.012",
    "drum": "0 0, 0.19 0, 0.2 0.011, 0.2 0.44, 0.19 0.455, 0 0.455",
    "mug": "0 0, 0.038 0, 0.042 0.01, 0.042 0.095, 0.037 0.095, 0.036 0.015, 0 0.012",
    "small pot": "0 0, 0.07 0, 0.095 0.17, 0.085 0.17, 0.07 0.03, 0 0.03",
    "plant pot": "0 0, 0.13 0, 0.14 0.01, 0.18 0.30, 0.185 0.33, 0.165 0.33, 0.16 0.29, 0 0.28",
}
"""Outlines for `lathed`."""


def lathed(outline: str, segments: int = 32) -> Shape:
    """Body of revolution; the outline is pairs "radius height" between commas, from the bottom over the outside."""
    points = [tuple(map(float, pair.split())) for pair in outline.split(",")]
    return turned_body(points, segments)


def cushion(width: float, height: float, depth: float, radius: float) -> Shape:
    """Cushion-like box."""
    return box((width, height, depth), radius, 2)


def upright_rods(xs: Sequence[float], zs: Sequence[float], top: float, radius: float) -> list[Shape]:
    """Upright rods at all pairs of x and z."""
    return [rod((x, 0.001, z), (x, top, z), radius, 8) for x in xs for z in zs]


def palette(*colors: Rgb) -> np.ndarray:
    """Texture whose texels `Shape.tinted` picks."""
    return np.array(colors, np.float32)[None]
