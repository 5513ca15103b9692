"""The fitted room as an asset: surface, emitters, cameras and outside, in a world with y up."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fipt.meshing.atlas import Atlas
from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh
from fipt.scene.cameras import Camera, up_axis
from fipt.scene.emitters import BACK, BOTH, Emitters, default_name, read_names
from fipt.scene.environment import EnvironmentMap, texel_directions
from fipt.scene.mesh import Mesh

_ROWS = 256
"""Rows of the exported map of the outside, unless ours has more."""


def upright(cameras: list[Camera]) -> np.ndarray:
    """(3, 3) rotation that turns the world axis nearest to the cameras' mean up direction into y.

    The source's world may have any axis up; nothing else in the program needs to know.
    """
    up = up_axis(cameras)
    axis, sign = int(np.abs(up).argmax()), float(up.sum())
    if axis == 1:
        return np.diag([1.0, sign, sign])
    turn = np.zeros((3, 3))
    turn[1, axis] = sign
    if axis == 2:  # z up, as Blender has it: x stays, y becomes -z
        turn[0, 0], turn[2, 1] = 1, -sign
    else:
        turn[0, 1], turn[2, 2] = -sign, 1
    return turn


def room_asset(
    name: str,
    mesh: Mesh,
    atlas: Atlas,
    textures: MaterialTextures,
    emitters: Emitters,
    cameras: list[Camera],
    sky: EnvironmentMap,
    names: Sequence[str] | None = None,
) -> Asset:
    """Put the room together; each emitter is one mesh, or several where its triangles differ in radiance or in sides.

    ``names`` are those of the emitters; None: ``emitter-N``.
    """
    names = read_names(None, emitters) if names is None else names
    turn = upright(cameras)
    mesh = Mesh((mesh.vertices.astype(np.float64) @ turn.T).astype(np.float32), mesh.triangles)
    dark = np.ones(len(mesh.triangles), bool)
    dark[emitters.triangle] = False
    surface = TexturedMesh("surface", *atlas.piece(mesh, np.flatnonzero(dark)), np.zeros(3, np.float32))
    return Asset(
        name=name,
        surface=surface,
        emitters=tuple(_emitting_meshes(mesh, atlas, emitters, names)),
        textures=textures,
        cameras=tuple(_turned(camera, turn) for camera in cameras),
        outside=_outside(sky, turn),
    )


def mesh_name(number: int, name: str) -> str:
    """Name of an emitter's mesh, and of its files: its number, and the name that a person gave it, in ASCII letters.

    The number keeps meshes apart whatever the names are.
    """
    plain = "" if name == default_name(number) else re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return f"emitter_{number}_{plain}" if plain else f"emitter_{number}"


def _emitting_meshes(mesh: Mesh, atlas: Atlas, emitters: Emitters, names: Sequence[str]) -> list[TexturedMesh]:
    pieces = []
    for number, given in enumerate(names):
        own = np.flatnonzero(emitters.emitter == number)
        kinds = np.column_stack([emitters.radiance[own], emitters.sides[own]])
        kinds, kind = np.unique(kinds, axis=0, return_inverse=True)
        for index, (*_, sides) in enumerate(kinds):
            name = mesh_name(number, given) + (f"_{index}" if len(kinds) > 1 else "")
            piece, uv = atlas.piece(mesh, emitters.triangle[own[kind.reshape(-1) == index]])
            if sides == BACK:  # formats know one side: the one that the winding faces
                piece = replace(piece, triangles=np.ascontiguousarray(piece.triangles[:, ::-1]))
            pieces.append(TexturedMesh(name, piece, uv, kinds[index, :3], two_sided=bool(sides == BOTH)))
    return pieces


def _turned(camera: Camera, turn: np.ndarray) -> Camera:
    pose = camera.world_from_camera.copy()
    pose[:3] = turn @ pose[:3]
    return replace(camera, world_from_camera=pose)


def _outside(sky: EnvironmentMap, turn: np.ndarray) -> EnvironmentMap:
    """The outside as a map with y up that needs no further rotation."""
    if sky.radiance.shape[0] == 1:
        return replace(sky, up="y", rotation=0.0)
    rows = max(_ROWS, sky.radiance.shape[0])
    radiance = sky.lookup(texel_directions(rows, 2 * rows) @ turn).reshape(rows, 2 * rows, 3)
    return EnvironmentMap(sky.mode, radiance, "y", 0.0)
