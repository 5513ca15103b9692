"""How well degraded segment ids of single views are fused: a dataset with true ids, made worse view by view.

    python -m benchmarks.segmentation DATASET [--kind semantic] [--pictures FOLDER]

In every training view the edges between segments are moved by up to 3 pixels along each axis, 15 % of the pixels get
the id of some segment of the view, and ids are numbered anew. What the fusion makes of it is compared with the true ids
under the best assignment of ids to true ids, one to one; beside it, the supplement's plain count, with these numbers
and with the true ones.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from fipt.formats.images import read_ids
from fipt.scene.dataset import Dataset
from fipt.scene.fusion import read_fusion
from fipt.scene.segments import write_view_ids
from fipt.stages.segment.degraded import degraded, renumbered
from fipt.stages.segment.settings import FuseSettings

PLAIN = FuseSettings(
    vote="count", associate="ids", speckles=False, sharpen=0, split=False, pieces="none", island=0, fill=False
)  # fmt: skip
"""The supplement's count of pixels by triangle."""


@dataclass(frozen=True)
class Score:
    """Agreement with the true ids under the best assignment: of pixels of all views, and of seen surface."""

    pixels: float
    surface: float
    segments: int


def best_match(found: np.ndarray, true: np.ndarray, weight: np.ndarray | None = None) -> float:
    """Share (of ``weight``) of elements whose ids agree under the best one-to-one assignment; true 0 does not count."""
    known = true > 0
    table = np.zeros((int(found.max(initial=0)) + 1, int(true.max(initial=0)) + 1))
    np.add.at(table, (found[known], true[known]), 1.0 if weight is None else weight[known])
    table[0] = 0  # what has no id is wrong
    rows, columns = linear_sum_assignment(table, maximize=True)
    total = known.sum() if weight is None else weight[known].sum()
    return float(table[rows, columns].sum() / total)


def run(data: Dataset, folder: Path, kind: str, settings: FuseSettings, new_numbers: bool, seed: int = 0) -> Score:
    """Degrade the training views' ids, fuse them below ``folder``, compare."""
    from fipt.stages.segment.fuse import fuse_views

    for number, view in enumerate(data.views("train")):
        rng = np.random.default_rng([seed, number])
        ids = degraded(data.segments(view, kind), rng)
        ids = renumbered(ids, rng) if new_numbers else ids
        write_view_ids(folder / "views" / f"{view}.npz", ids, np.zeros(int(ids.max()) + 1, np.int32))
    fuse_views(data.root, folder, settings)
    return score(data, folder, kind)


def score(data: Dataset, folder: Path, kind: str) -> Score:
    """Compare the fused parts below ``folder`` with the dataset's ids of a kind."""
    from fipt.stages.segment.views import observe

    views = data.views("train")
    found = np.concatenate([read_ids(folder / "fused" / "part" / f"{view}.png").ravel() for view in views])
    true = np.concatenate([data.segments(view, kind).ravel() for view in views])
    mesh = data.mesh()
    observations = observe(mesh, [data.camera(view) for view in views], folder)
    votes = np.zeros((len(mesh.triangles), int(true.max()) + 1), np.int32)
    np.add.at(votes, (observations.cell[observations.cell >= 0], true[observations.cell >= 0]), 1)
    fusion, about = read_fusion(folder / "fusion.npz")
    surface = best_match(fusion.part, votes.argmax(axis=1), fusion.seen.astype(np.float64))
    return Score(best_match(found, true), surface, len(about["segments"]))


def pictures(data: Dataset, folder: Path, kind: str, out: Path) -> None:
    """Write, of every third view: true ids, degraded ids, fused ids and agreement, side by side."""
    from fipt.formats.images import write_png
    from fipt.scene.segment_colors import heat, in_colors, matching_colors
    from fipt.scene.segments import read_view_ids

    views = data.views("train")
    read = {
        "true": [data.segments(view, kind) for view in views],
        "fused": [read_ids(folder / "fused" / "part" / f"{view}.png") for view in views],
    }
    for number in range(0, len(views), 3):
        true, fused = read["true"][number], read["fused"][number]
        before, _ = read_view_ids(folder / "views" / f"{views[number]}.npz")
        agreement = read_ids(folder / "fused" / "agreement" / f"{views[number]}.png")
        table = matching_colors(zip(read["fused"], read["true"], strict=True))
        row = [in_colors(true), in_colors(before), in_colors(fused, table), heat(agreement / 255)]
        write_png(out / f"{views[number]}.png", np.concatenate(row, axis=1))


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.segmentation", description=__doc__.splitlines()[0])
    parser.add_argument("dataset", type=Path, help="dataset folder with true segment ids")
    parser.add_argument("--kind", default="semantic", help="ids to degrade: semantic or part")
    parser.add_argument("--pictures", type=Path, help="write true, degraded and fused ids of some views here")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    from fipt.render.variant import set_variant

    set_variant()
    data = Dataset(arguments.dataset)
    cases = {
        "plain count": (PLAIN, True),
        "plain count, true numbers": (PLAIN, False),
        "fused": (FuseSettings(), True),
    }
    for name, (settings, new_numbers) in cases.items():
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            found = run(data, folder, arguments.kind, settings, new_numbers, arguments.seed)
            if name == "fused" and arguments.pictures:
                pictures(data, folder, arguments.kind, arguments.pictures)
        print(
            f"{name}: {found.pixels:.2%} of the pixels, {found.surface:.2%} of the surface, {found.segments} segments"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
