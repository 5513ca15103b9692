"""Whether a result depends on what means nothing: units, place, direction, order of views, idle triangles.

    python -m benchmarks.invariance FOLDER [--only same,turned] [--quick] [--chance]

A small room with truth is made once in FOLDER. Each case is the same room written in another way. It is imported,
fitted with one thread and one seed, and measured against the truth. `same` is the room unchanged, once more. What other
rounding alone does, and another seed, is chance: `--chance` measures it by copies of which a number means nothing.
"""

import argparse
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.jobs import jobs_of, run_all
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.files import write_text
from fipt.scene.mesh import Mesh, read_mesh, write_ply

SETTINGS: dict[str, Any] = {
    "rounds": 1,
    "synthesize": {"train_views": 10, "val_views": 3, "width": 64, "height": 48, "spp": 64},
    "samples": {"grid": 2},
    "cache": {"resolution": 32},
    "bake": {"diffuse_spp": 128, "specular_spp": 32, "smooth_spp": 16},
    "refine": {"diffuse_spp": 64, "specular_spp": 16, "smooth_spp": 8},
    "fit": {"steps": 400, "batch": 1024, "levels": 8, "table_log2": 14, "threads": 1},
    "render": {"spp": 16},
}
QUICK: dict[str, Any] = {
    "bake": {"diffuse_spp": 32, "specular_spp": 8, "smooth_spp": 4},
    "refine": {"diffuse_spp": 16, "specular_spp": 4, "smooth_spp": 4},
    "fit": SETTINGS["fit"] | {"steps": 150, "batch": 512},
}
LIGHT = ("images", "truth")


def radiance(factor: float) -> Callable[[Path], None]:
    """Images, and the emission of the truth, in another unit."""

    def change(folder: Path) -> None:
        for path in sorted(file for name in LIGHT for file in (folder / name).glob("*.exr")):
            channels = read_exr(path)
            lit = [n for n in channels if n in "RGB" or n.startswith("emission.")]
            write_exr(path, channels | {name: channels[name] * np.float32(factor) for name in lit})

    return change


def _write_doubles(path: Path, vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Write a PLY whose positions (V, 3) are doubles: float32 rounds map coordinates to half a metre."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(repr, map(float, row))) for row in vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in triangles]
    write_text(path, "\n".join([*head, *rows]) + "\n")


def placed(matrix: np.ndarray) -> Callable[[Path], None]:
    """Mesh and cameras moved by a (4, 4) similarity."""

    def change(folder: Path) -> None:
        mesh, text = read_mesh(folder / "mesh.ply"), json.loads((folder / "transforms.json").read_text())
        vertices = mesh.vertices.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        _write_doubles(folder / "mesh.ply", vertices, mesh.triangles)
        scale = np.cbrt(np.linalg.det(matrix[:3, :3]))
        for frame in text["frames"]:
            pose = matrix @ np.array(frame["transform_matrix"])
            pose[:3, :3] /= scale
            frame["transform_matrix"] = pose.tolist()
        write_text(folder / "transforms.json", json.dumps(text))

    return change


def reordered(folder: Path) -> None:
    """Frames in the reverse order."""
    text = json.loads((folder / "transforms.json").read_text())
    write_text(folder / "transforms.json", json.dumps(text | {"frames": text["frames"][::-1]}))


def cluttered(folder: Path) -> None:
    """Every triangle twice, and a vertex a thousand kilometres away that none uses."""
    mesh = read_mesh(folder / "mesh.ply")
    vertices = np.concatenate([mesh.vertices, np.array([[1e6, 1e6, 1e6]], np.float32)])
    write_ply(folder / "mesh.ply", Mesh(vertices, np.concatenate([mesh.triangles, mesh.triangles[:, ::-1]])))


def _turned() -> np.ndarray:
    from scipy.spatial.transform import Rotation

    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("yxz", (37, 11, -23), degrees=True).as_matrix()
    return matrix


def _moved(*offset: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


CASES: dict[str, tuple[Callable[[Path], None], dict[str, Any]]] = {
    "same": (lambda folder: None, {}),
    "another seed": (lambda folder: None, {"bake": {"seed": 1}, "fit": {"seed": 1}}),
    "radiance / 2": (radiance(0.5), {}),
    "radiance x 2": (radiance(2.0), {}),
    "radiance x 1.00001": (radiance(1.00001), {}),
    "radiance x 1.4": (radiance(1.4), {}),
    "radiance x 1e-6": (radiance(1e-6), {}),
    "radiance x 1e6": (radiance(1e6), {}),
    "moved by 8 m": (placed(_moved(8, -4, 2)), {}),
    "map coordinates": (placed(_moved(512345, 5412345, 321)), {}),
    "turned": (placed(_turned()), {}),
    "millimetres": (placed(np.diag([1000.0, 1000, 1000, 1])), {"import": {"unit": 0.001}}),
    "views in reverse": (reordered, {}),
    "length x 2": (placed(np.diag([2.0, 2, 2, 1])), {}),
    "triangles twice": (cluttered, {}),
}
CHANCE: dict[str, tuple[Callable[[Path], None], dict[str, Any]]] = {
    **{f"radiance x {1 + k * 1e-5:.5f}": (radiance(1 + k * 1e-5), {}) for k in (1, -1, 2, -2, 3, -3, 4, -4)},
    **{f"seed {k}": (lambda folder: None, {"bake": {"seed": k}, "fit": {"seed": k}}) for k in (1, 2, 3)},
    **{f"moved by {k} km": (placed(_moved(k * 1000 + 0.3, k * 700 + 0.7, k + 0.1)), {}) for k in (40, 50, 60)},
}
"""Copies whose figures differ by chance alone."""


def run(folder: Path, scene: dict[str, Any], settings: dict[str, Any]) -> dict[str, Any]:
    """Make the metrics of a scene in a folder, and return them."""
    (folder / "config").mkdir(parents=True, exist_ok=True)
    (folder / "config" / "config.yaml").write_text(json.dumps({"scenes": {"room": scene}, **SETTINGS, **settings}))
    back = Path.cwd()
    os.chdir(folder)
    try:
        assert run_all(jobs_of(Path(), target="metrics")) == 0
    finally:
        os.chdir(back)
    found: dict[str, Any] = json.loads((folder / "results" / "room" / "metrics.json").read_text())["val"]
    return found


def main() -> None:
    """Measure, and print a row for each case."""
    from shutil import copytree

    parser = argparse.ArgumentParser("python -m benchmarks.invariance", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where rooms and results go")
    parser.add_argument("--only", help="cases, separated by commas; default: all")
    parser.add_argument("--quick", action="store_true", help="fewer samples and steps: larger errors, the same bytes")
    parser.add_argument(
        "--chance", action="store_true", help="copies that differ by chance alone, instead of the cases"
    )
    arguments = parser.parse_args()
    made = arguments.folder.absolute() / "made"
    if not (made / "results").is_dir():
        run(made, {"source": "procedural"}, {})
    known = CASES | CHANCE
    names = arguments.only.split(",") if arguments.only else list(CHANCE if arguments.chance else CASES)
    measures = ("kd_psnr", "roughness_l1", "metallic_l1", "emission_iou", "log_radiance_error")
    print("| case | " + " | ".join(measures) + " |\n|" + "---|" * (len(measures) + 1), flush=True)
    for name in names:
        change, own = known[name]
        settings = QUICK if arguments.quick else {}
        settings = {**settings, **{name: SETTINGS.get(name, {}) | settings.get(name, {}) | own[name] for name in own}}
        place = arguments.folder.absolute() / name.replace(" ", "-").replace("/", "by")
        if not (place / "results" / "room" / "metrics.json").is_file():
            source = place / "source"
            copytree(made / "results" / "room" / "dataset", source, dirs_exist_ok=True)
            for listed in [*source.rglob("*manifest.json"), source / "check_poses.json"]:
                listed.unlink()  # of another run
            change(source)
            found = run(place, {"source": "dataset", "format": "fipt", "path": str(source)}, settings)
        else:
            found = json.loads((place / "results" / "room" / "metrics.json").read_text())["val"]
        print(f"| {name} | " + " | ".join(f"{found[measure]:.4f}" for measure in measures) + " |", flush=True)


if __name__ == "__main__":
    main()
