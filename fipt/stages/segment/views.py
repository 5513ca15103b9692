"""What the views show: the cell at the centre of every pixel, and the segment id that a view gives it."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import on_disk
from fipt.formats.files import check_disk, check_memory
from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera
from fipt.scene.mesh import Mesh
from fipt.scene.segments import nearest_ids, read_view_ids

log = logging.getLogger(__name__)

_SOME = 61
"""Every so many pixels tell how large pixels are on the surface."""
_NUDGE = (0.013, 0.007)
"""Pixels beside the centre where a ray is traced again that found nothing: it may have passed exactly between cells."""
_BYTES_A_PIXEL, _BYTES_A_CELL = 150, 1000
"""Of memory for the fusion, for each pixel of the largest view (measured 120 to 140) and each cell (730 to 965)."""
_BYTES_ON_DISK = 16
"""For each pixel of these views: its cell, cosine and mask, 10 B, and what is written of it."""
_ALIKE = 2
"""Neighbours of eight that a pixel agrees with; with fewer it is a speckle."""


@dataclass(frozen=True)
class CellObservations:
    """Cells that the pixels of all views show, one view after the other, on disk.

    Attributes
    ----------
    cameras
        Of the views.
    cell
        (P,) int32 cell at the pixel's centre, -1 where there is none.
    cosine
        (P,) float16 between the direction to the camera and the cell's normal.
    pixel
        Median width of a pixel on the surface, metres; infinite where no ray hits it.
    """

    cameras: list[Camera]
    cell: np.ndarray
    cosine: np.ndarray
    pixel: float

    def pixels(self, index: int) -> slice:
        """Pixels of view number ``index`` among those of all views."""
        sizes = [camera.width * camera.height for camera in self.cameras[: index + 1]]
        return slice(sum(sizes[:-1]), sum(sizes))

    def of(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Cell (H W,) and cosine (H W,) of the pixels of view number ``index``."""
        own = self.pixels(index)
        return np.asarray(self.cell[own]), np.asarray(self.cosine[own], np.float32)


def observe(mesh: Mesh, cameras: list[Camera], folder: Path) -> CellObservations:
    """Trace the ray through the centre of every pixel; the result lies on the disk of ``folder``.

    Raises
    ------
    FiptError
        If memory or the disk is too small for these views and cells, and for what follows of them.
    """
    sizes = [camera.width * camera.height for camera in cameras]
    pixels = sum(sizes)
    needed = _BYTES_A_PIXEL * max(sizes, default=0) + _BYTES_A_CELL * len(mesh.triangles)
    check_memory(needed, "the fusion of segments", "use smaller images, or a smaller fuse.most_cells")
    check_disk(folder, _BYTES_ON_DISK * pixels, "the fusion of segments")
    scene, empty = RayScene(mesh), on_disk(folder)
    found, cosine, widths, start = empty((pixels,), np.int32), empty((pixels,), np.float16), [], 0
    with progress("looking at cells", pixels, " pixels") as bar:
        for camera in cameras:
            own = slice(start, start + camera.width * camera.height)
            row, column = (values.ravel() + 0.5 for values in np.mgrid[: camera.height, : camera.width])
            directions = camera.directions(column, row)
            distance, cell = scene.intersect(camera.center, directions)
            lost = np.flatnonzero(cell < 0)
            if len(lost):
                beside = camera.directions(column[lost] + _NUDGE[0], row[lost] + _NUDGE[1])
                distance[lost], cell[lost] = scene.intersect(camera.center, beside)
            found[own], cosine[own] = cell, np.abs((scene.normals[cell] * directions).sum(axis=1))
            widths.append(distance[::_SOME][cell[::_SOME] >= 0] / camera.fx)
            start = own.stop
            bar.advance(own.stop - own.start)
    width = np.concatenate(widths)
    return CellObservations(cameras, found, cosine, float(np.median(width)) if len(width) else np.inf)


def view_ids(folder: Path, camera: Camera, other_size: str) -> tuple[np.ndarray, np.ndarray]:
    """Segment ids (H, W) uint16 of a view, 0 = unknown, and the class (K,) int32 of each id.

    Parameters
    ----------
    folder
        Of VIEW.npz.
    other_size
        ``nearest``: ids of another size than the view are resampled, with a warning; ``error``: they are refused.
    """
    path = folder / f"{camera.name}.npz"
    ids, classes = read_view_ids(path)
    if ids.shape == (camera.height, camera.width):
        return ids, classes
    sizes = f"{path} must be {camera.width}x{camera.height} like its view; it is {ids.shape[1]}x{ids.shape[0]}"
    if other_size == "error":
        raise FiptError(sizes, "export the ids at the view's size, or set fuse.other_size: nearest")
    log.warning("%s; the nearest ids are taken", sizes)
    return nearest_ids(ids, (camera.height, camera.width)), classes


def without_speckles(ids: np.ndarray) -> np.ndarray:
    """(H, W) ids, 0 where fewer than two of the eight pixels around have the same."""
    padded = np.pad(ids, 1)
    height, width = ids.shape
    alike = np.zeros(ids.shape, np.uint8)
    for row in range(3):
        for column in range(3):
            if (row, column) != (1, 1):
                alike += padded[row : row + height, column : column + width] == ids
    return np.where(alike >= _ALIKE, ids, 0).astype(ids.dtype)
