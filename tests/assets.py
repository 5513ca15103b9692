"""A small room as an asset: every wall has a colour of its own, and every quarter of a wall a shade of it."""

import numpy as np

from fipt.scene.asset import Asset, MaterialTextures, TexturedMesh
from fipt.scene.cameras import Camera
from fipt.scene.environment import NOTHING, EnvironmentMap
from tests import scenes

TILE = 16
"""Texels along a wall."""


def camera(name="view", x=0.0, width=32, height=24, cx=None, split="val", fy=None, cy=None) -> Camera:
    """Looks along -z from (x, 1.2, 2.8), a little down."""
    pose = np.eye(4)
    c, s = np.cos(-0.15), np.sin(-0.15)
    pose[1:3, 1:3] = [[c, -s], [s, c]]
    pose[:3, 3] = x, 1.2, 2.8
    cx = width / 2 if cx is None else cx
    return Camera(name, split, width, height, 26.0, fy or 26.0, cx, height / 2 if cy is None else cy, pose)


def textures(roughness=1.0, metallic=0.0) -> MaterialTextures:
    """Six tiles side by side, each of four shades."""
    rng = np.random.default_rng(3)
    color = rng.integers(60, 230, (2, 12, 3)).astype(np.uint8)
    color = np.repeat(np.repeat(color, TILE // 2, axis=0), TILE // 2, axis=1)
    level = np.full(color.shape[:2], 255, np.uint8)
    return MaterialTextures(color, np.uint8(level * roughness), np.uint8(level * metallic))


def room(outside: EnvironmentMap = NOTHING, cameras=None, walls=6, **materials) -> Asset:
    """A box [-2, 2] x [0, 2.5] x [-2, 3] with two emitters; its first ``walls`` walls."""
    box = scenes.box((-2, 0, -2), (2, 2.5, 3))
    mesh = type(box)(box.vertices[: 4 * walls], box.triangles[: 2 * walls])
    quarter = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    uv = np.concatenate([np.add(quarter, (wall, 0)) / (6, 1) for wall in range(walls)]).astype(np.float32)
    none = np.zeros(3, np.float32)
    # one far from any wall, seen from both sides; one small, whose inside nobody sees
    sheet = scenes.emitter_quad((-0.6, 0.6), 2.0, (-0.5, 0.7))
    small = scenes.turned(scenes.box((1.2, 0.6, 0.0), (1.3, 0.7, 0.1)))
    emitters = tuple(
        TexturedMesh(f"emitter_{n}", mesh, np.zeros((len(mesh.vertices), 2), np.float32), np.float32(radiance), n == 0)
        for n, (mesh, radiance) in enumerate(((sheet, (5, 4, 3)), (small, (20, 30, 60))))
    )
    cameras = (camera(), camera("side", 0.7, cx=13.0, cy=14.5, split="train")) if cameras is None else cameras
    return Asset(
        "room",
        TexturedMesh("surface", mesh, uv, none),
        emitters,
        textures(**materials),
        tuple(cameras),
        outside,
    )
