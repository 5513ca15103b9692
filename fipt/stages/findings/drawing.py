"""Pictures of findings: photograph, rendering and difference side by side; a plan of the room; marked photographs."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fipt.scene.cameras import Camera, up_axis
from fipt.scene.display import tone_mapped
from fipt.scene.emitters import Emitters
from fipt.scene.mesh import Mesh, points_of

_HEIGHT = 240
"""Of an image in a row, pixels."""
_GAP = 6
_LABEL = 16
"""Height of the line of text above an image, pixels."""
_LINE = np.array([255, 0, 200], np.uint8)
"""Colour of an outline."""
_RANGE = 0.5
"""Natural logarithm of the ratio of two radiances that has the last colour."""
_POINTS = 20_000
"""Points of the mesh in a plan."""
_SLICE = 0.8
"""Share of the room's height, from the floor, that a plan shows: ceilings would hide all else."""


def row(images: Mapping[str, np.ndarray], outlined: np.ndarray | None = None) -> np.ndarray:
    """Put images (H, W, 3) uint8 side by side, each below its name.

    Parameters
    ----------
    outlined
        (H, W) bool: what is outlined in each.
    """
    from PIL import Image, ImageDraw

    scaled = [_scaled(image, outlined) for image in images.values()]
    width = sum(image.shape[1] + _GAP for image in scaled) - _GAP
    sheet = Image.new("RGB", (width, _HEIGHT + _LABEL), "white")
    pen, left = ImageDraw.Draw(sheet), 0
    for name, image in zip(images, scaled, strict=True):
        pen.text((left + 2, 2), name, fill="black")
        sheet.paste(Image.fromarray(image), (left, _LABEL))
        left += image.shape[1] + _GAP
    return np.array(sheet)


def compared(
    photo: np.ndarray,
    other: np.ndarray,
    exposure: float,
    name: str = "rendered",
    outlined: np.ndarray | None = None,
) -> np.ndarray:
    """Photograph, another image (H, W, 3 radiance) and the logarithm of their ratio side by side."""
    shown = {
        "photograph": tone_mapped(photo, exposure),
        name: tone_mapped(other, exposure),
        f"{name} darker (blue), brighter (red)": ratio_map(other, photo),
    }
    return row(shown, outlined)


def ratio_map(image: np.ndarray, photo: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: blue where an image is darker than the photograph, red where it is brighter."""
    from matplotlib import colormaps

    value = np.clip(log_ratio(image, photo) / (2 * _RANGE) + 0.5, 0, 1)
    return colormaps["RdBu_r"](value, bytes=True)[..., :3]


def log_ratio(image: np.ndarray, photo: np.ndarray) -> np.ndarray:
    """(...,) natural logarithm of the ratio of two radiances (..., 3).

    A little is added to both, so that the dark, which noise decides, does not count.
    """
    little = 0.02 * float(np.median(photo.mean(axis=-1))) + 1e-6
    return np.log((image.mean(axis=-1) + little) / (photo.mean(axis=-1) + little))


def spread_over(shape: tuple[int, int], rows: np.ndarray, columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Image (h, w, ...) of values (N, ...) at rows and columns (N,) of an evenly strided grid of a (H, W) view."""
    step = np.diff(np.unique(rows))
    stride = int(step.min()) if len(step) else 1
    image = np.zeros((-(-shape[0] // stride), -(-shape[1] // stride), *values.shape[1:]), values.dtype)
    image[rows // stride, columns // stride] = values
    return image


def plan(
    mesh: Mesh,
    cameras: Sequence[Camera],
    emitters: Emitters,
    marks: Sequence[tuple[str, Sequence[float] | np.ndarray]],
    colored: tuple[np.ndarray, np.ndarray, str] | None = None,
) -> np.ndarray:
    """Draw the room from above: surface, cameras, emitters, and marked places.

    Parameters
    ----------
    marks
        Text and world position (3,) of each.
    colored
        Points (N, 3), values (N,) that colour them (about 0, red is more), and what these are.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    up = up_axis(list(cameras))
    across = [axis for axis in range(3) if up[axis] == 0]
    figure = Figure(figsize=(6.4, 5.2), dpi=100, layout="constrained")
    canvas, axes = FigureCanvasAgg(figure), figure.add_subplot()
    _draw_surface(axes, mesh, up, across)
    if colored is not None:
        points, values, name = colored
        drawn = axes.scatter(*points[:, across].T, c=values, s=14, cmap="RdBu_r", vmin=-_RANGE, vmax=_RANGE)
        figure.colorbar(drawn, label=name, shrink=0.7)
    eyes = np.array([camera.center for camera in cameras])
    ahead = np.array([-camera.world_from_camera[:3, 2] for camera in cameras])
    axes.quiver(*eyes[:, across].T, *ahead[:, across].T, color="tab:blue", width=0.004, scale=18)
    axes.scatter(*eyes[:, across].T, s=14, color="tab:blue", label="cameras")
    if len(emitters.triangle):
        centers = mesh.corners[emitters.triangle].mean(axis=1)
        axes.scatter(*centers[:, across].T, s=26, color="gold", edgecolors="black", label="emitters found")
    for text, place in marks:
        x, y = np.asarray(place)[across]
        axes.plot(x, y, "x", color="crimson", markersize=12, markeredgewidth=3)
        axes.annotate(text, (x, y), color="crimson", xytext=(6, 6), textcoords="offset points")
    axes.set_aspect("equal")
    if np.cross(np.eye(3)[across[0]], np.eye(3)[across[1]]) @ up < 0:
        axes.invert_yaxis()  # or the room would be seen in a mirror
    axes.set_xlabel(f"{'xyz'[across[0]]}, metres")
    axes.set_ylabel(f"{'xyz'[across[1]]}, metres")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw_surface(axes: Any, mesh: Mesh, up: np.ndarray, across: Sequence[int]) -> None:
    areas = mesh.areas
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(areas), _POINTS, p=areas / areas.sum())
    points = points_of(mesh.corners[chosen], *rng.random((_POINTS, 2)).T)
    height = points @ up
    low = height < height.min() + _SLICE * np.ptp(height)
    axes.scatter(*points[low][:, across].T, s=0.6, color="0.6", linewidths=0)


def _scaled(image: np.ndarray, outlined: np.ndarray | None) -> np.ndarray:
    """An image at the height of a row, the outline drawn in."""
    from PIL import Image
    from scipy.ndimage import binary_dilation, binary_erosion

    size = max(1, round(image.shape[1] * _HEIGHT / image.shape[0])), _HEIGHT
    result = np.array(Image.fromarray(np.ascontiguousarray(image)).resize(size, Image.Resampling.BICUBIC))
    if outlined is not None and outlined.any():
        mask = np.array(Image.fromarray(np.uint8(255) * outlined).resize(size, Image.Resampling.BILINEAR)) > 127
        result[binary_dilation(mask, iterations=1) & ~binary_erosion(mask, iterations=1)] = _LINE
    return result
