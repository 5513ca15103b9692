"""Measure this program beside a plain implementation of the published method.

    python -m benchmarks [--scene demo | --scene results/NAME] [--quick] [--threads 2] [--out docs]

Prints a table of ratios. A full run also writes OUT/benchmarks.json and OUT/images/benchmark.png.
"""

import argparse
import os
import sys
import time
from pathlib import Path

from fipt.cli.process import set_thread_defaults


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__.splitlines()[0])
    parser.add_argument("--scene", default="demo", help="demo: the room in code; or the results folder of a scene")
    parser.add_argument("--quick", action="store_true", help="small sizes: shows that everything runs, not how fast")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="CPU threads; default: all cores")
    parser.add_argument("--out", type=Path, help="folder of JSON and picture; default: docs, or none with --quick")
    arguments = parser.parse_args()
    out = arguments.out or (None if arguments.quick else Path(__file__).resolve().parent.parent / "docs")

    set_thread_defaults()
    import torch

    from fipt.errors import FiptError
    from fipt.render.variant import set_variant

    start = time.perf_counter()

    def say(what: str) -> None:
        print(f"[{time.perf_counter() - start:4.0f} s] {what}", file=sys.stderr, flush=True)

    try:
        backend = set_variant(threads=arguments.threads)
        torch.set_num_threads(arguments.threads)

        from benchmarks import report, scene, suite

        about = report.machine(backend.device_name, arguments.threads)
        say(f"scene: {arguments.scene}")
        measured = scene.demo_room() if arguments.scene == "demo" else scene.of_results(Path(arguments.scene))
        size = suite.QUICK if arguments.quick else suite.FULL
        rows, curves = suite.measure(measured, backend.torch_device, size, say)
        about["scene"] = f"{measured.name}, {len(measured.mesh.triangles)} triangles"
        about["samples"] = len(measured.some(size.samples).position)
        say("done")
        caption = (
            f"{about['scene']}, {about['samples']} samples; {about['cpu']}, {arguments.threads} threads, "
            f"{backend.device_name}; {about['date']}"
        )
        print(f"{caption}\n\n{report.table(rows)}")
        if out is not None:
            report.write_json(out / "benchmarks.json", about, rows, curves)
            report.draw(out / "images" / "benchmark.png", curves, about["samples"], caption)
            print(f"\nwritten: {out}/benchmarks.json, {out}/images/benchmark.png")
    except FiptError as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
