"""Where a room on a scanned mesh loses its base colours: kinds of pixels, and what the mesh alone costs.

    python -m benchmarks.scan_errors results/living_room_scan results/living_room

The first is a finished run on a scan, the second has the same room's ``dataset/`` with the true mesh and part ids. For
held-out pixels of each kind it prints their share, their share of the squared error of kd, and kd in dB, three times:

- *fitted*: of the run's material maps;
- *mesh alone*: every pixel has the true kd of the true surface that lies nearest to what the scan shows there (a point
  of a true pixel, of all views). So much is lost by its shape, whatever is fitted;
- *carried*: every pixel has the mean of the true kd of the 16 training pixels that show what lies nearest on the scan,
  by how near it lies. So much is lost if the fit is right in every training pixel, and knows nothing of parts.

The kinds, in this order: the scan is more than a pixel's width off the surface; within two pixels of an emitter; metal;
within a pixel of surface elsewhere in depth; within a pixel of another part; all others.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from fipt.render.scene import RayScene
from fipt.render.variant import set_variant
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset, read_layers

_STEP = 1.5
"""Distance in footprints of a neighbouring pixel's surface from a pixel's plane that is a step in depth."""
_AROUND = 16
"""Training pixels that are averaged."""
_COLUMNS = ("fitted", "mesh alone", "carried")
_KINDS = ("off the surface", "beside an emitter", "metal", "beside a step", "beside a part", "inside")


@dataclass(frozen=True)
class _Seen:
    """What pixel centres show: place and normal (H, W, 3), NaN where nothing is; width of the pixel there (H, W)."""

    place: np.ndarray
    normal: np.ndarray
    footprint: np.ndarray


def seen(scene: RayScene, camera: Camera) -> _Seen:
    """Trace the pixel centres of a view."""
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    directions = camera.directions(columns.ravel(), rows.ravel()).reshape(-1, 3)
    distance, triangle = scene.intersect(camera.center.astype(np.float32), directions)
    distance = np.where(triangle >= 0, distance, np.nan)
    place = camera.center + distance[:, None] * directions
    shape = (camera.height, camera.width)
    return _Seen(
        place.reshape(*shape, 3), scene.normals[triangle].reshape(*shape, 3), (distance / camera.fx).reshape(shape)
    )


def kinds(true: _Seen, scan: _Seen, ids: np.ndarray, truth: dict[str, np.ndarray]) -> np.ndarray:
    """(H, W) int number of each pixel's kind in `_KINDS`."""

    def away(places: np.ndarray) -> np.ndarray:
        return np.abs(((places - true.place) * true.normal).sum(axis=-1)) / true.footprint

    around = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1)]
    step = np.any([away(np.roll(true.place, shift, (0, 1))) > _STEP for shift in around], axis=0)
    step[[0, -1]], step[:, [0, -1]] = False, False  # what is rolled in from the other side
    emits = truth["emission"].any(axis=-1)
    found = [
        ~(away(scan.place) < 1),
        maximum_filter(emits, 5),
        truth["metallic"] > 0.5,
        step,
        maximum_filter(ids, 3) != minimum_filter(ids, 3),
        np.ones(ids.shape, bool),
    ]
    return np.argmax(found, axis=0)


class _Carried:
    """True kd of training pixels, at the places of the scan that they show."""

    def __init__(self, scan: RayScene, data: Dataset) -> None:
        places, colors, widths = [], [], []
        for view in data.views("train"):
            shown, truth = seen(scan, data.camera(view)), data.truth(view)
            assert truth is not None
            known = np.isfinite(shown.place).all(axis=-1)
            places.append(shown.place[known])
            colors.append(truth["kd"][known])
            widths.append(shown.footprint[known])
        self._tree = cKDTree(np.concatenate(places))
        self._color, self._width = np.concatenate(colors), np.concatenate(widths)

    def at(self, places: np.ndarray, widths: np.ndarray) -> np.ndarray:
        """(N, 3) mean at places (N, 3) that pixels of some widths (N,) show, by a Gaussian of half the wider pixel."""
        distance, near = self._tree.query(places, k=_AROUND, workers=-1)
        width = np.maximum(widths[:, None], self._width[near])
        weight = np.exp(-2 * (distance / width) ** 2) / width**2 + 1e-12
        return (self._color[near] * weight[..., None]).sum(axis=1) / weight.sum(axis=1, keepdims=True)


def _true_points(scene: RayScene, data: Dataset) -> tuple[cKDTree, np.ndarray]:
    """Places of the true pixels of all views, and their kd (N, 3)."""
    points, colors = [], []
    for view in (*data.views("train"), *data.views("val")):
        place, truth = seen(scene, data.camera(view)).place, data.truth(view)
        if truth is None:
            raise SystemExit(f"{data.root} has no truth to judge with")
        known = np.isfinite(place).all(axis=-1)
        points.append(place[known])
        colors.append(truth["kd"][known])
    return cKDTree(np.concatenate(points)), np.concatenate(colors)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scan", type=Path, help="results folder of the run on the scan")
    parser.add_argument("true", type=Path, help="results folder whose dataset has the true mesh and part ids")
    options = parser.parse_args()
    set_variant()
    scanned, clean = Dataset(options.scan / "dataset"), Dataset(options.true / "dataset")
    of_scan, of_true = RayScene(scanned.mesh()), RayScene(clean.mesh())
    tree, color = _true_points(of_true, clean)
    carried = _Carried(of_scan, clean)
    count, error = np.zeros(len(_KINDS)), np.zeros((len(_COLUMNS), len(_KINDS)))
    for view in clean.views("val"):
        truth, camera = clean.truth(view), clean.camera(view)
        assert truth is not None
        true, scan = seen(of_true, camera), seen(of_scan, camera)
        kind = kinds(true, scan, clean.segments(view, "part").astype(np.int64), truth)
        counted = np.isfinite(scan.place).all(axis=-1) & np.isfinite(true.place).all(axis=-1)
        counted &= ~truth["emission"].any(axis=-1)
        fitted = read_layers(options.scan / "materials" / f"{view}.exr")["kd"][counted]
        place = scan.place[counted]
        nearest = color[tree.query(place, workers=-1)[1]]
        count += np.bincount(kind[counted], minlength=len(_KINDS))
        for row, kd in enumerate((fitted, nearest, carried.at(place, scan.footprint[counted]))):
            off = ((kd - truth["kd"][counted]) ** 2).mean(axis=1)
            error[row] += np.bincount(kind[counted], off, len(_KINDS))
    _print(count, error)


def _print(count: np.ndarray, error: np.ndarray) -> None:
    """Print pixels (K,) and squared errors (C, K) of each kind, and of all."""
    print(f"{'pixels':20s} share" + "".join(f"   {name:>11s}: share, kd" for name in _COLUMNS))
    for number, name in enumerate((*_KINDS, "all")):
        own = slice(number, number + 1) if number < len(_KINDS) else slice(None)
        columns = "".join(
            f"   {row[own].sum() / row.sum():14.3f} {-10 * np.log10(row[own].sum() / max(count[own].sum(), 1)):6.2f} dB"
            for row in np.maximum(error, 1e-12)
        )
        print(f"{name:20s} {count[own].sum() / count.sum():.3f}{columns}")


if __name__ == "__main__":
    main()
