"""A room as other programs take it: one textured surface, emitters, cameras.

The world of an asset has y up and metres. Texture coordinates have their origin at the upper left corner of the
textures, v pointing down; texel (row, column) is centred at u = (column + 0.5) / width, v = (row + 0.5) / height.
"""

from dataclasses import dataclass, replace

import numpy as np

from fipt.formats.images import srgb_decode
from fipt.scene.cameras import Camera
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh, closed

SHEET_GAP = 0.001
"""Distance of the two faces of a two-sided emitter in formats whose area lights have one side, metres."""


@dataclass(frozen=True)
class TexturedMesh:
    """A mesh with texture coordinates.

    Attributes
    ----------
    name
        Letters, digits and ``_``.
    mesh
        Triangles, metres.
    uv
        (V, 2) float32 texture coordinates.
    radiance
        (3,) what an emitter emits; zero for the surface that only reflects, and for an emitter that is off.
    two_sided
        Whether an emitter shines from both sides, or from the one that its winding faces.
    """

    name: str
    mesh: Mesh
    uv: np.ndarray
    radiance: np.ndarray
    two_sided: bool = True

    @property
    def closed(self) -> bool:
        """Whether each edge belongs to two triangles, so that nobody sees the inside."""
        return closed(self.mesh)


@dataclass(frozen=True)
class MaterialTextures:
    """Materials of the surface, as 8-bit textures of one size.

    Attributes
    ----------
    base_color
        (h, w, 3) uint8, sRGB encoded.
    roughness, metallic
        (h, w) uint8, in proportion: 255 is 1.
    """

    base_color: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray

    @property
    def linear_color(self) -> np.ndarray:
        """(h, w, 3) float32 linear base colour."""
        table = srgb_decode(np.arange(256) / 255.0).astype(np.float32)
        return table[self.base_color]


@dataclass(frozen=True)
class Asset:
    """A room.

    Attributes
    ----------
    name
        Of the scene.
    surface
        What reflects.
    emitters
        What shines; emitters absorb what falls on them.
    textures
        Of the surface.
    cameras
        The views.
    outside
        Light that comes from outside the mesh; its map has y up.
    """

    name: str
    surface: TexturedMesh
    emitters: tuple[TexturedMesh, ...]
    textures: MaterialTextures
    cameras: tuple[Camera, ...]
    outside: EnvironmentMap

    @property
    def sheets(self) -> list[TexturedMesh]:
        """Emitters as area lights of one side: those of two sides with their backs."""
        return [*self.emitters, *(back(emitter) for emitter in self.emitters if emitter.two_sided)]


def back(piece: TexturedMesh) -> TexturedMesh:
    """Return the other side of an emitter: its triangles turned over and moved back a little, each by itself."""
    mesh = piece.mesh
    corners = mesh.corners - SHEET_GAP * mesh.normals[:, None]
    triangles = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)[:, ::-1]
    turned = Mesh(corners.reshape(-1, 3).astype(np.float32), np.ascontiguousarray(triangles))
    return replace(piece, name=f"{piece.name}_back", mesh=turned, uv=piece.uv[mesh.triangles].reshape(-1, 2))


def intensity(piece: TexturedMesh) -> np.ndarray:
    """(3,) radiant intensity of a point light in an emitter's place: its mean over all directions.

    A convex body shows a quarter of its area on average; a sheet of two sides half, of one side a quarter.
    """
    share = 0.5 if piece.two_sided and not piece.closed else 0.25
    return share * piece.mesh.areas.sum() * piece.radiance.astype(np.float64)


def mitsuba_map(outside: EnvironmentMap) -> np.ndarray:
    """(h, w, 3) float32 map of the outside as Mitsuba's ``envmap`` takes it.

    Its maps begin at -z, and their first and last rows lie at the poles; ours have a centre at -z and rows between.
    """
    rows, columns = max(outside.radiance.shape[0], 2) + 1, 2 * max(outside.radiance.shape[0], 2)
    theta = np.clip(np.linspace(0, np.pi, rows), 1e-4, np.pi - 1e-4)[:, None]  # columns differ up to the poles
    phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    parts = np.broadcast_arrays(np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi))
    directions = np.stack(parts, axis=-1).reshape(-1, 3)
    return outside.lookup(directions).reshape(rows, columns, 3)
