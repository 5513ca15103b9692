"""What a surface of a modelled room is made of."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoomMaterial:
    """Base colour, roughness and metallic, each an image over [0, 1]^2 that repeats; 1x1 where it is constant.

    Attributes
    ----------
    name
        Unique within a room.
    base_color
        (h, w, 3) float32 linear RGB; row 0 is v = 0, column 0 is u = 0, texel centres at half integers.
    roughness, metallic
        (h, w) float32; their sizes may differ from that of the base colour.
    flagged
        Whether it stands in for something that is missing or unknown.
    """

    name: str
    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    flagged: bool = False
