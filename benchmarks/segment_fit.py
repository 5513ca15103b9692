"""What segments are worth: one room fitted with true ids, fused degraded ids, grown parts and none, side by side.

    fipt run true_ids --configfile config/examples/segmentation.yaml --config data_root=FOLDER
    python -m benchmarks.segment_fit degrade results/true_ids/dataset FOLDER/degraded
    fipt run degraded_ids ... grown ... without ... (the same options)
    python -m benchmarks.segment_fit table results/true_ids results/degraded_ids results/grown results/without

``degrade`` makes the ids of the training views worse as `benchmarks.segmentation` does: 15 % of the pixels random,
edges moved by about 3 pixels, numbers permuted in every view.
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from fipt.formats.images import write_png
from fipt.scene.dataset import Dataset
from fipt.stages.segment.degraded import degraded, renumbered

COLUMNS = {
    "roughness_l1": "roughness L1",
    "metallic_l1": "metallic L1",
    "kd_psnr": "kd, dB",
    "render_psnr": "re-rendering, dB",
}


def degrade(dataset: Path, out: Path, kind: str = "part", seed: int = 0) -> list[Path]:
    """Write degraded ids of the training views as 16-bit PNG, for ``segment.mode: given``."""
    data, files = Dataset(dataset), []
    for number, view in enumerate(data.views("train")):
        rng = np.random.default_rng([seed, number])
        files.append(out / f"{view}.png")
        write_png(files[-1], renumbered(degraded(data.segments(view, kind), rng), rng))
    return files


def table(results: list[Path], split: str = "val") -> str:
    """Markdown table of the figures of several results folders."""
    lines = [f"| {split} | {' | '.join(COLUMNS.values())} |", "|---|" + "---|" * len(COLUMNS)]
    for folder in results:
        figures = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))[split]
        shown = ["-" if figures[key] is None else f"{figures[key]:.4f}" for key in COLUMNS]
        lines.append(f"| {folder.name} | {' | '.join(shown)} |")
    return "\n".join(lines)


def main() -> int:
    """Degrade ids, or print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.segment_fit", description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(required=True, dest="what")
    worse = parts.add_parser("degrade", help="write degraded ids of a dataset")
    worse.add_argument("dataset", type=Path)
    worse.add_argument("out", type=Path)
    worse.add_argument("--kind", default="part", help="ids to degrade: part or semantic")
    side = parts.add_parser("table", help="print roughness, metallic, kd and re-rendering of several results")
    side.add_argument("results", type=Path, nargs="+")
    chosen = parser.parse_args()
    if chosen.what == "degrade":
        print(f"wrote {len(degrade(chosen.dataset, chosen.out, chosen.kind))} id maps to {chosen.out}")
    else:
        print(f"{table(chosen.results)}\n\n{table(chosen.results, 'train')}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
