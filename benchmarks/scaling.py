"""How time and memory grow with the work: views, resolution and triangles, each doubled three times.

    python -m benchmarks.scaling [--out docs] [--quick]     plots, about 10 minutes on 2 cores
    python -m benchmarks.scaling --load 202 [--steps 40]    cache, fit and emitters of so many views of 640x320

Every stage is one process, as in the workflow, so that its peak of memory is its own. The load test makes samples,
shading and pictures of that size without rendering any: two views of the room in code, over and over, as files of their
own (about 25 MB a view in a temporary folder).
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.jobs import jobs_of
from benchmarks.report import machine
from fipt.cli.process import set_thread_defaults
from fipt.config import RESULTS
from fipt.formats.files import atomic, write_text
from fipt.scene.mesh import Mesh, read_mesh, write_ply


@dataclass(frozen=True)
class Work:
    """Size of a scene: training views (and one held out), pixels of a view, how often each triangle is cut in two."""

    views: int = 6
    pixels: int = 4800
    cuts: int = 0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, 4 to 3."""
        width = round((self.pixels * 4 / 3) ** 0.5)
        return width, round(width * 3 / 4)


@dataclass(frozen=True)
class Usage:
    """Of one process.

    Attributes
    ----------
    seconds
        The stage's own wall time, without loading Python and libraries.
    processor
        Seconds of all its threads, with loading them: other programs on the machine disturb it less.
    peak
        Largest resident memory, MB: with the pages of mapped files that the system keeps.
    private
        The part of it that is not files, MB, as seen 20 times a second; None where the system does not tell.
    """

    seconds: float
    processor: float
    peak: float
    private: float | None


AXES = {"views": "training views", "pixels": "pixels a view", "triangles": "triangles"}
SETTINGS = {
    "synthesize": {"spp": 8, "denoise": False},
    "cache": {"resolution": 128},
    "bake": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4, "denoise": False},
    "refine": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4, "denoise": False},
    "fit": {"steps": 20},
    "render": {"spp": 4, "denoise": False},
}
"""Few samples: what matters is how cost grows."""


def call(verb: str, options: Sequence[str], stats: Path, folder: Path) -> Usage:
    """Run a verb, whose options make it write ``stats``, in a process of its own, in ``folder``."""
    command = [sys.executable, "-m", "fipt.cli.main", verb, *options]
    seen: dict[str, float] = {}
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
        pid = 0
        while pid == 0:
            for name, value in _memory(process.pid).items():
                seen[name] = max(value, seen.get(name, 0))
            time.sleep(0.05)
            pid, status, used = os.wait4(process.pid, os.WNOHANG)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            log.seek(0)
            raise SystemExit(f"fipt {verb} failed:\n{log.read()}")
    figures = json.loads((folder / stats).read_text())
    # not the stage's own figure where there is a better one: Linux counts this process's memory in at the start
    peak = seen.get("VmHWM", figures["peak_memory_bytes"] / 1e6)
    return Usage(figures["wall_s"], used.ru_utime + used.ru_stime, peak, seen.get("RssAnon"))


def _memory(pid: int) -> dict[str, float]:
    """Peak of a stage's resident memory and what of it belongs to no file now, MB; empty without /proc.

    The process that was called only watches the one that works.
    """
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
        children = [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in _children(task)]
    except OSError:
        return {}
    fields = (line.split() for line in lines if line.startswith(("VmHWM:", "RssAnon:")))
    found = {name.rstrip(":"): int(value) / 1e3 for name, value, _ in fields}
    for below in map(_memory, children):
        found = {name: max(value, below.get(name, 0)) for name, value in found.items()}
    return found


def _children(task: Path) -> list[str]:
    """Numbers of the processes that a thread has started."""
    return (task / "children").read_text().split()


def halved(mesh: Mesh) -> Mesh:
    """Every triangle cut in two across its longest side; the surface stays the same."""
    corners = mesh.corners
    longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).argmax(axis=1)
    turned = np.take_along_axis(mesh.triangles, (longest[:, None] + np.arange(3)) % 3, axis=1)
    a, b, c = turned.T
    ends, middle = np.unique(np.sort(np.stack([a, b], axis=1), axis=1), axis=0, return_inverse=True)
    new = mesh.vertices[ends].mean(axis=1)
    m = len(mesh.vertices) + middle.reshape(-1)
    triangles = np.concatenate([np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)])
    return Mesh(np.concatenate([mesh.vertices, new]).astype(np.float32), triangles.astype(np.int32))


def chain(work: Work, root: Path) -> tuple[dict[str, Usage], int]:
    """Run all stages on a scene of that size below ``root``; usage by stage, and its triangles."""
    width, height = work.size
    made = {"train_views": work.views, "val_views": 1, "width": width, "height": height} | SETTINGS["synthesize"]
    settings = SETTINGS | {"synthesize": made}
    # One shard for all views of a split, so that a stage's peak of memory is that of all of them.
    config = {"scenes": {"room": {"source": "procedural", "settings": settings}}, "rounds": 1, "views_per_shard": 1000}
    usage: dict[str, Usage] = {}
    mesh = root / RESULTS / "room" / "dataset" / "mesh.ply"
    for job in jobs_of(root, config):
        if job.verb == "samples" and "samples" not in usage:
            _cut(mesh, work.cuts)
        stats = Path(job.options[job.options.index("--stats") + 1])
        used = call(job.verb, job.options, stats, root)
        before = usage.get(job.verb, Usage(0, 0, 0, None))
        usage[job.verb] = Usage(
            used.seconds + before.seconds,
            used.processor + before.processor,
            max(used.peak, before.peak),
            max(filter(None, [used.private, before.private]), default=None),
        )
    return usage, len(read_mesh(mesh).triangles)


def _cut(path: Path, times: int) -> None:
    """Cut every triangle of a dataset's mesh in two so often."""
    mesh = read_mesh(path)
    for _ in range(times):
        mesh = halved(mesh)
    if times:
        write_ply(path, mesh)
        path.with_name("room.json").unlink()  # it names triangles that are no more


def growth(base: Work, doublings: int) -> dict[str, list[dict[str, object]]]:
    """Run the chain with each kind of work doubled so often; what was used, by kind of work."""
    done: dict[Work, dict[str, object]] = {}
    grown = {
        "views": [replace(base, views=base.views * 2**k) for k in range(doublings + 1)],
        "pixels": [replace(base, pixels=base.pixels * 2**k) for k in range(doublings + 1)],
        "triangles": [replace(base, cuts=k) for k in range(doublings + 1)],
    }
    for work in dict.fromkeys(work for several in zip(*grown.values(), strict=True) for work in several):
        with tempfile.TemporaryDirectory() as folder:
            usage, triangles = chain(work, Path(folder))
        width, height = work.size
        amount = {"views": work.views, "pixels": width * height, "triangles": triangles}
        done[work] = amount | {"stages": {name: asdict(used) for name, used in usage.items()}}
        print(json.dumps(done[work]), file=sys.stderr, flush=True)
    return {axis: [done[work] for work in several] for axis, several in grown.items()}


def draw(path: Path, found: Mapping[str, Sequence[Mapping]], caption: str) -> None:
    """Draw seconds and peak memory of the stages that cost most against each kind of work."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

    figure = Figure(figsize=(11, 9.5), layout="constrained", facecolor="white")
    axes = figure.subplots(3, 3, sharey="row")
    rows_of = {"seconds": "seconds", "processor": "processor seconds", "peak": "peak resident memory, MB"}
    colors = ["#777777", "#0b6e99", "#c0561f", "#2f8f4e", "#7a4fa3"]
    colors += ["#c9a21b", "#b83a5e", "#3fa7a0", "#8a6d4b", "#111111"]
    cost = {
        stage: sum(rows[-1]["stages"][stage]["processor"] for rows in found.values())
        for stage in found["views"][0]["stages"]
    }
    least = sorted(cost.values(), reverse=True)[: len(colors)][-1]
    stages = [stage for stage in cost if cost[stage] >= least]  # in the order they ran
    for column, (axis, title) in enumerate(AXES.items()):
        rows = found[axis]
        x = [row[axis] for row in rows]
        for stage, color in zip(stages, colors, strict=False):
            look = {"color": color, "marker": "o", "markersize": 3.5, "linewidth": 1.4, "label": stage}
            for part, figures in zip(axes[:, column], rows_of, strict=True):
                part.plot(x, [row["stages"][stage][figures] for row in rows], **look)
        straight = np.array([x[0], x[-1]]) / x[0]
        for part in axes[:2, column]:
            part.plot(straight * x[0], straight, color="#bbbbbb", linestyle="--", linewidth=1, zorder=0)
        for part in axes[:, column]:
            part.set_xscale("log")
            part.set_xticks(x, [f"{value:,}" for value in x])
            part.xaxis.set_minor_locator(NullLocator())
            part.set_xlabel(title)
            part.grid(color="#e8e8e8", linewidth=0.6)
            part.set_axisbelow(True)
    for part, label in zip(axes[:, 0], rows_of.values(), strict=True):
        part.set_ylabel(label)
    for part in axes[:2, 0]:
        part.set_yscale("log")
        part.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        part.yaxis.set_minor_formatter(NullFormatter())
    axes[0, 0].set_title("dashed: in proportion", loc="left", fontsize=8, color="#777777")
    axes[2, 0].set_ylim(bottom=0)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right center", frameon=False)
    figure.supxlabel(caption, fontsize=8, color="#555555")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=130)


# --- many views -----------------------------------------------------------------------------------

SIZE, SHARD = (640, 320), 16


def write_load(root: Path, views: int) -> tuple[int, int]:
    """Write dataset, samples and shading of so many views; return pixels and bytes of arrays that are mapped."""
    from fipt.conventions import SHADING_OUTPUTS
    from fipt.formats.exr import write_exr
    from fipt.formats.images import write_png
    from fipt.render.footprint import trace_view
    from fipt.render.scene import RayScene
    from fipt.render.variant import set_variant
    from fipt.scene.cameras import write_transforms
    from fipt.scene.mesh import connected_parts
    from fipt.scene.samples import FootprintSamples, write_samples
    from fipt.scene.shading import Shading, save_shading
    from fipt.stages.samples.settings import SamplesSettings
    from fipt.synthetic.poses import OpenSpace, sample_cameras
    from fipt.synthetic.room import build
    from fipt.synthetic.settings import SynthesizeSettings
    from fipt.synthetic.views import Truth

    set_variant()
    rng, (width, height) = np.random.default_rng(0), SIZE
    settings = SynthesizeSettings(train_views=2, val_views=1, width=width, height=height)
    room = build(0)
    two = sample_cameras(OpenSpace(room, Truth(room).intersect, 0), settings)[:2]
    names = [f"v{number:03d}" for number in range(views)]
    cameras = [replace(two[k % 2], name=name, split="train") for k, name in enumerate(names)]
    data = root / "dataset"
    write_ply(data / "mesh.ply", room.mesh)
    write_transforms(data / "transforms.json", cameras)
    tracer, parts = RayScene(room.mesh), connected_parts(room.mesh)
    traced, light = [trace_view(tracer, parts, camera, SamplesSettings()) for camera in two], []
    for k, result in enumerate(traced):
        first = np.minimum(np.cumsum(result["counts"]) - result["counts"], len(result["triangle"]) - 1)
        triangle = result["triangle"][first].reshape(height, width)
        picture = rng.random((len(room.mesh.triangles), 3), np.float32)[triangle]
        for name in names[k::2]:
            write_exr(data / "images" / f"{name}.exr", {"": picture})
            write_png(data / "segments" / "part" / f"{name}.png", (triangle % 500 + 1).astype(np.uint16))
        light.append(Shading.of(rng.random((len(result["triangle"]), SHADING_OUTPUTS, 3), np.float32)).words)
    for start in range(0, views, SHARD):
        own = range(start, min(start + SHARD, views))
        arrays = {name: np.concatenate([traced[k % 2][name] for k in own]) for name in traced[0]}
        offsets = np.concatenate([[0], np.cumsum(arrays.pop("counts"))]).astype(np.int64)
        shard = f"train-{start // SHARD:03d}"
        for kind in ("samples", "shading"):
            (root / kind / shard).mkdir(parents=True)
        samples = FootprintSamples(tuple(names[k] for k in own), ((height, width),) * len(own), offsets, **arrays)
        write_samples(root / "samples" / shard, samples)
        save_shading(root / "shading" / shard, Shading(np.concatenate([light[k % 2] for k in own])))
    mapped = sum(file.stat().st_size for kind in ("samples", "shading") for file in (root / kind).rglob("*.npy"))
    return views * width * height, mapped


def load(views: int, steps: int) -> dict[str, object]:
    """Run cache, emitters and fit on many views; what they used."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        print(f"writing {views} views of {SIZE[0]}x{SIZE[1]} to {root}", file=sys.stderr, flush=True)
        pixels, mapped = write_load(root, views)
        found: dict[str, object] = {"views": views, "size": SIZE, "pixels": pixels, "mapped_mb": mapped / 1e6}
        samples, shading = (",".join(map(str, sorted((root / kind).iterdir()))) for kind in ("samples", "shading"))
        train = {"dataset": "dataset", "samples": samples}
        for verb, options, settings in (
            ("cache", {"out": "cache.npz"}, {}),
            ("emitters", {"shading": shading, "out": "emitters.npz"}, {}),
            ("fit", {"shading": shading, "emitters": "emitters.npz", "out": "model.safetensors"}, {"steps": steps}),
        ):
            stats = Path("stats", f"{verb}.json")
            named = train | options | {"settings": json.dumps(settings), "stats": stats}
            words = [word for name, value in named.items() for word in (f"--{name}", str(value))]
            found[verb] = asdict(call(verb, words, stats, root))
            print(f"{verb}: {found[verb]}", file=sys.stderr, flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser("python -m benchmarks.scaling", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder of JSON and picture; default: docs, or none with --quick")
    parser.add_argument("--quick", action="store_true", help="one doubling of a smaller scene: shows that it runs")
    parser.add_argument("--load", type=int, metavar="VIEWS", help="instead: stages on so many views of 640x320")
    parser.add_argument("--steps", type=int, default=40, help="steps of the fit of --load")
    arguments = parser.parse_args()
    set_thread_defaults()
    out = arguments.out or (None if arguments.quick else Path(__file__).resolve().parent.parent / "docs")
    about = machine("CPU", os.cpu_count() or 1)
    if arguments.load:
        found: dict[str, object] = {"load": load(arguments.load, arguments.steps) | {"machine": about}}
    else:
        base, doublings = (Work(2, 1200), 1) if arguments.quick else (Work(), 3)
        found = {"growth": growth(base, doublings), "machine": about}
    print(json.dumps(found, indent=1))
    if out is not None:
        path = out / "scaling.json"
        known = json.loads(path.read_text()) if path.is_file() else {}
        write_text(path, json.dumps(known | found, indent=1) + "\n")
        if "growth" in found:
            caption = f"the room in code; {about['cpu']}, {about['cores']} cores; {about['date']}"
            draw(out / "images" / "scaling.png", found["growth"], caption)
    return 0


if __name__ == "__main__":
    sys.exit(main())
