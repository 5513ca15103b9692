"""Light from outside: the radiance of rays that leave the mesh, as a map over all directions.

The map is equirectangular. For ``up: y`` its centre is seen along -z, its upper edge along +y, and x grows to the
right; for ``up: z`` the centre is seen along +y and the upper edge along +z. A map of one texel is the same everywhere.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.exr import read_rgb
from fipt.formats.files import made_again
from fipt.formats.hdr import read_hdr
from fipt.scene.cameras import Camera
from fipt.scene.samples import FootprintSamples
from fipt.scene.setup import EnvironmentEdit

_MOST_ROWS = 1024
"""Larger maps are averaged down to this: a ray's cone is wider than their texels."""
_MOST = 1e12
"""Radiance that no map has; squares and sums of what is below stay far from the end of float32."""
_ASPECT = (1.9, 2.1)
"""Width over height of an equirectangular map, give or take a cropped row."""


_MODES = ("none", "constant", "map", "given")
_UP = ("y", "z")


@dataclass(frozen=True)
class EnvironmentMap:
    """Radiance of rays that leave the mesh.

    Attributes
    ----------
    mode
        ``none`` (nothing is known: zero), ``constant``, ``map`` (fitted) or ``given``.
    radiance
        (h, w, 3) float32 equirectangular map, texel centres at half integers; (1, 1, 3) where it is constant.
    up
        World axis towards the map's upper edge, ``y`` or ``z``.
    rotation
        Degrees by which the map is turned about that axis, counter-clockwise as seen from above.
    """

    mode: str
    radiance: np.ndarray
    up: str = "y"
    rotation: float = 0.0

    @property
    def known(self) -> bool:
        """Whether anything is known of the outside."""
        return self.mode != "none"

    @property
    def emits(self) -> bool:
        """Whether any light comes from outside."""
        return bool(self.radiance.max() > 0)

    @property
    def mean(self) -> np.ndarray:
        """(3,) mean radiance over all directions."""
        height, width = self.radiance.shape[:2]
        return (self.radiance * solid_angles(height, width)[..., None]).sum(axis=(0, 1)) / (4 * np.pi)

    @property
    def map_from_world(self) -> np.ndarray:
        """(3, 3) rotation from world directions to those of a map with y up."""
        c, s = np.cos(np.radians(self.rotation)), np.sin(np.radians(self.rotation))
        turn = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        return turn if self.up == "y" else turn @ np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])

    def texels(self, directions: np.ndarray) -> np.ndarray:
        """(N, 2) row and column, in texels from the upper left corner, of (N, 3) unit world directions."""
        return texel_of(directions @ self.map_from_world.T, *self.radiance.shape[:2])

    def lookup(self, directions: np.ndarray) -> np.ndarray:
        """(N, 3) float32 radiance seen along (N, 3) unit directions, bilinear; the map closes at its sides."""
        height, width = self.radiance.shape[:2]
        place = self.texels(np.asarray(directions, np.float64)) - 0.5
        low = np.floor(place)
        (ty, tx), (y, x) = (place - low).T[..., None], low.astype(np.int64).T
        rows, columns = np.clip([y, y + 1], 0, height - 1), np.mod([x, x + 1], width)
        texel = self.radiance[rows[:, None], columns[None]]  # (2, 2, N, 3)
        upper, lower = texel[:, 0] * (1 - tx) + texel[:, 1] * tx
        return (upper * (1 - ty) + lower * ty).astype(np.float32)


NOTHING = EnvironmentMap("none", np.zeros((1, 1, 3), np.float32))
"""What is known of the outside where nothing is said."""


def constant(radiance: tuple[float, float, float] | np.ndarray, up: str = "y") -> EnvironmentMap:
    """Return the same radiance (3,) in all directions."""
    return EnvironmentMap("constant", np.asarray(radiance, np.float32).reshape(1, 1, 3), up)


def in_unit(environment: EnvironmentMap, scale: float) -> EnvironmentMap:
    """Return a map with all its light multiplied."""
    return replace(environment, radiance=environment.radiance * np.float32(scale))


def edited(environment: EnvironmentMap, edit: EnvironmentEdit | None) -> EnvironmentMap:
    """Return the background under a light setup: another map or radiance, then its scale, then its turn."""
    if edit is None:
        return environment
    if edit.file is not None:
        environment = read_map(edit.file, environment.up)
    if edit.radiance is not None:
        environment = constant(edit.radiance, environment.up)
    environment = in_unit(environment, 1.0 if edit.scale is None else edit.scale)
    return replace(environment, rotation=environment.rotation + edit.rotation)


def texel_of(directions: np.ndarray, height: int, width: int) -> np.ndarray:
    """(N, 2) row and column in an equirectangular map, of (N, 3) unit directions with y up."""
    x, y, z = directions.T
    u = 0.5 + np.arctan2(x, -z) / (2 * np.pi)
    return np.stack([np.arccos(np.clip(y, -1, 1)) / np.pi * height, u * width], axis=1)


def texel_directions(height: int, width: int) -> np.ndarray:
    """(height * width, 3) unit directions of a map's texel centres, y up."""
    theta, phi = np.meshgrid(
        (np.arange(height) + 0.5) / height * np.pi,
        ((np.arange(width) + 0.5) / width - 0.5) * 2 * np.pi,
        indexing="ij",
    )
    directions = [np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)]
    return np.stack(directions, axis=-1).reshape(-1, 3)


def solid_angles(height: int, width: int) -> np.ndarray:
    """(height, 1) steradians of the texels of each row."""
    edges = np.cos(np.linspace(0, np.pi, height + 1))
    return ((edges[:-1] - edges[1:]) * 2 * np.pi / width)[:, None]


# --- files ----------------------------------------------------------------------------------------


def read_map(path: str | Path, up: str = "y", rotation: float = 0.0) -> EnvironmentMap:
    """Read an equirectangular environment map, OpenEXR or Radiance .hdr.

    Raises
    ------
    FiptError
        If it is missing or damaged, not twice as wide as high, or holds NaN, infinite or negative radiance.
    """
    radiance = read_hdr(path) if Path(path).suffix.lower() == ".hdr" else read_rgb(path)
    return EnvironmentMap("given", _shrunk(checked(radiance, path)), up, rotation)


def checked(radiance: np.ndarray, path: str | Path) -> np.ndarray:
    """Return an equirectangular map that is one; ``path`` names it in errors."""
    if radiance.ndim != 3 or radiance.shape[2] != 3:
        raise FiptError(f"{path} must be a map of shape (height, width, 3); found {radiance.shape}", "export it as RGB")
    height, width = radiance.shape[:2]
    if not _ASPECT[0] <= width / height <= _ASPECT[1] and (height, width) != (1, 1):
        raise FiptError(
            f"{path} must be equirectangular, twice as wide as high; it is {width}x{height}",
            "export the environment in latitude-longitude form",
        )
    for what, bad in (
        ("NaN", np.isnan(radiance)),
        ("infinite", np.isinf(radiance)),
        ("negative", radiance < 0),
        (f"brighter than {_MOST:.0e}", radiance > _MOST),
    ):
        texels = bad.any(axis=-1)
        if texels.any():
            row, column = np.argwhere(texels)[0]
            raise FiptError(
                f"{path} must hold finite radiance >= 0; {int(texels.sum())} texels are {what}, the first at row "
                f"{row}, column {column}",
                "repair the map",
            )
    return radiance


def _shrunk(radiance: np.ndarray) -> np.ndarray:
    """Average a large map down, by area."""
    from PIL import Image

    height, width = radiance.shape[:2]
    if height <= _MOST_ROWS:
        return radiance
    size = (round(width * _MOST_ROWS / height), _MOST_ROWS)
    planes = [Image.fromarray(np.ascontiguousarray(radiance[..., c])) for c in range(3)]
    return np.stack([np.asarray(plane.resize(size, Image.Resampling.BOX)) for plane in planes], axis=-1)


def write_environment(path: str | Path, environment: EnvironmentMap) -> None:
    """Write environment.npz."""
    save_npz(
        path,
        mode=np.array(environment.mode),
        radiance=environment.radiance.astype(np.float32),
        up=np.array(environment.up),
        rotation=np.array(environment.rotation, np.float64),
    )


def read_environment(path: str | Path | None) -> EnvironmentMap:
    """Read environment.npz; without a path nothing is known.

    Raises
    ------
    FiptError
        If it is missing or damaged, or its map is not one.
    """
    if path is None:
        return NOTHING
    arrays = load_npz(path, forms={"mode": "text", "radiance": "amount h w 3", "up": "text", "rotation": "finite"})
    radiance = checked(arrays["radiance"], path)
    for name, allowed in (("mode", _MODES), ("up", _UP)):
        if str(arrays[name]) not in allowed:
            raise FiptError(f"{path}: {name} must be {', '.join(allowed)}; found {arrays[name]}", made_again(path))
    return EnvironmentMap(str(arrays["mode"]), radiance, str(arrays["up"]), float(arrays["rotation"]))


# --- pixels ---------------------------------------------------------------------------------------

_AROUND = np.ones((3, 3), bool)


def open_pixels(samples: FootprintSamples, index: int) -> np.ndarray:
    """(H, W) bool of view number ``index``: pixels that see no surface, nor do the eight around them.

    Gaps of one or two pixels, which scans have in their walls, and the pixels along an edge are so left out.
    """
    pixels = samples.pixels(index)
    empty = np.diff(samples.offsets[pixels.start : pixels.stop + 1]) == 0
    return binary_erosion(empty.reshape(samples.shapes[index]), _AROUND, border_value=1)


def beyond(
    samples: FootprintSamples, cameras: list[Camera], environment: EnvironmentMap
) -> tuple[np.ndarray, np.ndarray]:
    """What the outside adds to pixels of a shard that show the edge of an opening.

    Returns
    -------
    pixel
        (K,) int64 increasing; pixels that are partly covered and lie beside open ones (`open_pixels`).
    radiance
        (K, 3) float32 background radiance times the share of the pixel that no hit covers.
    """
    found = list(_edges(samples, cameras, environment)) if environment.known else []
    if not found:
        return np.empty(0, np.int64), np.empty((0, 3), np.float32)
    pixels, radiances = zip(*found, strict=True)
    return np.concatenate(pixels), np.concatenate(radiances)


def _edges(
    samples: FootprintSamples, cameras: list[Camera], environment: EnvironmentMap
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    for index, camera in enumerate(cameras):
        near = binary_dilation(open_pixels(samples, index), _AROUND, iterations=2).ravel()
        covered = covered_share(samples, index)
        pixel = np.flatnonzero(near & (covered > 0) & (covered < 1 - 1e-6))
        rest = (1 - covered[pixel])[:, None].astype(np.float32)
        first = samples.pixels(index).start
        yield pixel + first, rest * environment.lookup(pixel_directions(camera, pixel))


def covered_share(samples: FootprintSamples, index: int) -> np.ndarray:
    """(pixels,) float64 share of each pixel of view number ``index`` that its samples cover."""
    height, width = samples.shapes[index]
    return np.bincount(
        samples.pixel_of_sample(index), np.asarray(samples.weight[samples.of_view(index)]), height * width
    )


def pixel_directions(camera: Camera, pixel: np.ndarray) -> np.ndarray:
    """(N, 3) float32 unit directions of the rays through the centres of pixels (N,)."""
    rows, columns = np.divmod(pixel, camera.width)
    return camera.directions(columns + 0.5, rows + 0.5)
