"""How the whole loop does on many rooms: clean and scanned, with their part ids and without; a table in Markdown.

    python -m benchmarks.rooms run office kitchen living_room=FOLDER/dataset --out rooms
    python -m benchmarks.rooms table rooms

``run`` makes each room (a name is a room in code, NAME=FOLDER a dataset of the layout fipt-synthetic), scans its mesh
at two qualities (`benchmarks.scan`), and runs every variant through ``fipt run ... metrics`` below ``--out``: results/,
scans/ and the configuration rooms.yaml stay there, and what is up to date is not made again. ``table`` prints the
figures of what is there, with the command of every row.
"""

import argparse
import json
import logging
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fipt.conventions import LUMINANCE
from fipt.formats.files import write_text

log = logging.getLogger(__name__)

QUALITIES = {"2cm": (0.02, 0.003), "3cm": (0.03, 0.010)}
"""Name -> side of a voxel and standard deviation of a depth of 2 m, metres."""
VIEWS = {"train_views": 16, "val_views": 6, "width": 160, "height": 120, "spp": 96}
NO_IDS = "_no_ids"
COLUMNS = "| scene | kd / a', dB | roughness / metallic L1 | emission IoU | flux | re-rendered, dB | time | command |"


# --- the runs ---------------------------------------------------------------------------------


def configuration(rooms: Mapping[str, str | None], out: Path, variants: list[str]) -> dict[str, Any]:
    """Configuration of the variants of rooms.

    Parameters
    ----------
    rooms
        Name -> folder of a dataset; None: it is the room in code of that name.
    out
        Where everything lies.
    variants
        Some of ``""`` (the room itself) and the keys of `QUALITIES`; each comes with ids and without.
    """
    scenes: dict[str, Any] = {}
    for room, folder in rooms.items():
        clean: dict[str, Any] = {"source": "dataset", "format": "fipt-synthetic", "path": folder}
        if folder is None:
            clean = {"source": "procedural", "room": room, "settings": {"synthesize": VIEWS}}
        scenes[room] = {**clean, "preset": "default"}
        for variant in variants:
            mesh = {"mesh": str(scan_of(out, room, variant))} if variant else {}
            own = {"source": "dataset", "format": "fipt", "path": f"results/{room}/dataset", **mesh}
            own["preset"] = "default"
            if variant:
                scenes[f"{room}_{variant}"] = own
            scenes[f"{room}{variant and '_'}{variant}{NO_IDS}"] = {**own, "settings": {"segment": {"mode": "geometry"}}}
    return {"scenes": scenes}


def scan_of(out: Path, room: str, quality: str) -> Path:
    """The scan-like mesh of a room."""
    return out.resolve() / "scans" / f"{room}_{quality}.ply"


def commands(
    rooms: Mapping[str, str | None], out: Path, variants: list[str]
) -> Iterator[tuple[Path | None, list[str]]]:
    """Commands in order, each with the file that it makes where that need not be made again."""
    scenes = configuration(rooms, out, variants)["scenes"]
    config = str(out.resolve() / "rooms.yaml")
    for room in rooms:
        yield None, ["fipt", "run", room, "dataset", "--configfile", config]
        for quality in filter(None, variants):
            voxel, noise = QUALITIES[quality]
            file = scan_of(out, room, quality)
            scan = [sys.executable, "-m", "benchmarks.scan", f"{out.resolve()}/results/{room}/dataset", str(file)]
            yield file, [*scan, "--voxel", str(voxel), "--noise", str(noise)]
    for scene in scenes:
        base = next(room for room in sorted(rooms, key=len, reverse=True) if scene.startswith(room))
        if scene != base or "" in variants:
            yield None, ["fipt", "run", scene, "metrics", "--configfile", config]


def run(rooms: Mapping[str, str | None], out: Path, variants: list[str], more: list[str]) -> None:
    """Run everything; what fails is named, and the rest goes on."""
    repository = Path(__file__).resolve().parents[1]
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "rooms.yaml", json.dumps(configuration(rooms, out, variants), indent=1) + "\n")
    for file, command in commands(rooms, out, variants):
        if file is not None and file.is_file():
            continue
        scan = "benchmarks.scan" in command
        extra = [] if scan else [text for value in more for text in ("--config", value)]
        program = [str(Path(sys.executable).with_name("fipt")), *command[1:]] if command[0] == "fipt" else command
        log.info("%s", " ".join([*command, *extra]))
        if subprocess.run([*program, *extra], cwd=repository if scan else out, check=False).returncode:
            log.error("failed: %s", " ".join(command))


# --- the table --------------------------------------------------------------------------------


def flux(emitters: list[dict[str, Any]]) -> float:
    """Area times luminance of the radiance, summed over emitters: what a flux to the front is proportional to."""
    return sum(e["area"] * sum(w * c for w, c in zip(LUMINANCE, e["radiance"], strict=True)) for e in emitters)


def flux_ratio(folder: Path) -> float | None:
    """Found over true flux; None where the truth is not known, or there are no emitters."""
    found = sorted(folder.glob("round-*/emitters.json"), key=lambda path: int(path.parent.name.partition("-")[2]))
    room = folder / "dataset" / "room.json"
    if not found or not room.is_file():
        return None
    true = flux(json.loads(room.read_text(encoding="utf-8"))["emitters"])
    return flux(json.loads(found[-1].read_text(encoding="utf-8"))["emitters"]) / true if true > 0 else None


def seconds(folder: Path) -> float:
    """Seconds of all jobs but those that made a known room, one after the other."""
    files = [file for file in (folder / "benchmarks").glob("*.jsonl") if not file.name.startswith("synthesize")]
    return sum(json.loads(file.read_text(encoding="utf-8").splitlines()[-1])["s"] for file in files)


def row(folder: Path, split: str = "val") -> str:
    """One line of the table."""
    figures = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))[split]

    def shown(key: str, form: str) -> str:
        return "-" if figures.get(key) is None else format(figures[key], form)

    ratio, time = flux_ratio(folder), round(seconds(folder))
    cells = [
        folder.name,
        f"{shown('kd_psnr', '.1f')} / {shown('reflectance_psnr', '.1f')}",
        f"{shown('roughness_l1', '.3f')} / {shown('metallic_l1', '.3f')}",
        shown("emission_iou", ".2f"),
        "-" if ratio is None else f"{ratio:.2f}",
        shown("render_psnr", ".1f"),
        f"{time // 60} min {time % 60} s",
        f"`fipt run {folder.name} metrics`",
    ]
    return f"| {' | '.join(cells)} |"


def table(out: Path) -> str:
    """Markdown table of all results below a folder."""
    folders = sorted(path.parent for path in out.glob("results/*/metrics.json"))
    return "\n".join([COLUMNS, "|---" * 8 + "|", *map(row, folders)])


def main() -> int:
    """Run rooms, or print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.rooms", description=__doc__.splitlines()[0])
    parts = parser.add_subparsers(required=True, dest="what")
    runs = parts.add_parser("run", help="make rooms and scans, and run every variant")
    runs.add_argument("rooms", nargs="+", help="name of a room in code, or NAME=FOLDER of a dataset")
    runs.add_argument("--out", type=Path, default=Path("rooms"))
    runs.add_argument("--variants", default=",2cm,3cm", help="comma-separated; nothing is the clean mesh")
    runs.add_argument("--config", action="append", default=[], help="KEY=VALUE for fipt run")
    shows = parts.add_parser("table", help="print the figures of what is there")
    shows.add_argument("out", type=Path)
    args = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if args.what == "table":
        sys.stdout.write(table(args.out) + "\n")
        return 0
    rooms = {name: folder or None for name, _, folder in (room.partition("=") for room in args.rooms)}
    run(rooms, args.out, args.variants.split(","), args.config)
    sys.stdout.write(table(args.out) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
