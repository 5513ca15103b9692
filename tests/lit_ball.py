"""A room of six walls in which a bright ball hangs, and what views of it show."""

import numpy as np
import trimesh

from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh

CENTER, RADIUS, RADIANCE = np.array([2.1, 1.6, 1.4]), 0.06, 40.0
WIDTH, HEIGHT, OVER = 80, 60, 4
PLACES = [(0.4, 1.2, 0.4), (3.6, 1.5, 0.5), (0.5, 1.0, 2.6), (3.5, 2.0, 2.5), (2.0, 0.6, 0.4)]


def of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices, np.float32), np.asarray(shape.faces, np.int32))


def box(size: tuple[float, float, float], center: tuple[float, float, float]) -> Mesh:
    made = trimesh.creation.box(size)
    made.apply_translation(center)
    return of(made)


def ball(center: np.ndarray = CENTER, radius: float = RADIUS) -> Mesh:
    made = trimesh.creation.icosphere(3, radius)
    made.apply_translation(center)
    return of(made)


WALLS = box((4, 3, 3), (2, 1.5, 1.5))


def cameras(toward: np.ndarray = CENTER, places=PLACES) -> list[Camera]:
    found = []
    for index, place in enumerate(places):
        back = np.array(place, float) - toward - (0.1, 0.05, 0)  # not in the middle of the picture
        back /= np.linalg.norm(back)
        right = np.cross([0, 1, 0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = np.column_stack([right, np.cross(back, right), back]), place
        found.append(Camera(f"train_{index}", "train", WIDTH, HEIGHT, 60, 60, WIDTH / 2, HEIGHT / 2, pose))
    return found


def shown(mesh: Mesh, shining: np.ndarray, views: list[Camera], level: float = RADIANCE, wall: float = 0.3):
    """What the views show of a mesh some triangles of which emit: means over 4 x 4 rays a pixel."""
    scene, images = RayScene(mesh), {}
    for view in views:
        rows, columns = (np.mgrid[: HEIGHT * OVER, : WIDTH * OVER] + 0.5) / OVER
        _, triangle = scene.intersect(view.center.astype(np.float32), view.directions(columns, rows).reshape(-1, 3))
        fine = np.where(triangle < 0, level, np.where(shining[triangle], level, wall))  # outside is as bright
        grey = fine.reshape(HEIGHT, OVER, WIDTH, OVER).mean(axis=(1, 3))
        images[view.name] = np.repeat(grey[..., None], 3, axis=2), np.ones((HEIGHT, WIDTH))
    return images.__getitem__


def with_shining(*parts: Mesh) -> tuple[Mesh, np.ndarray]:
    """Parts as one mesh, of which the last emits."""
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    triangles = np.concatenate([part.triangles + start for part, start in zip(parts, first, strict=True)])
    mesh = Mesh(np.concatenate([part.vertices for part in parts]), triangles.astype(np.int32))
    return mesh, np.arange(len(mesh.triangles)) >= len(mesh.triangles) - len(parts[-1].triangles)
