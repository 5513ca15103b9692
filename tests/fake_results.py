"""A tiny results folder, written without running any stage."""

import json
from pathlib import Path

import numpy as np

from fipt.formats.arrays import save_npz
from fipt.formats.exr import write_exr
from fipt.formats.files import write_text
from fipt.formats.images import to_display, write_png
from fipt.formats.manifests import write_manifest
from fipt.formats.video import write_mp4
from fipt.scene.cameras import Camera, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.emitters import default_name
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.samples import FootprintSamples, write_samples

WIDTH, HEIGHT = 8, 6
VIEWS = {"a": "train", "b": "train", "c": "val"}


def maps() -> dict[str, np.ndarray]:
    """Truth of every view: a grey wall; the top row of pixels is a lamp of radiance 4."""
    shape = (HEIGHT, WIDTH)
    shining = np.zeros(shape, np.float32)
    shining[0] = 1
    return {
        "kd": np.full((*shape, 3), 0.5, np.float32),
        "base_color": np.full((*shape, 3), 0.5, np.float32),
        "reflectance": np.full((*shape, 3), 0.6, np.float32),
        "emission": np.repeat(4 * shining[..., None], 3, axis=2),
        "emission_mask": shining,
        "roughness": np.full(shape, 0.7, np.float32),
        "metallic": np.zeros(shape, np.float32),
    }


def write_maps(path: Path, layers: dict[str, np.ndarray]) -> None:
    """Write layers with the channel names of truth/ and materials/."""
    write_exr(path, {name if a.ndim == 3 else f"{name}.Y": a for name, a in layers.items()})


def write_results(root: Path, truth: bool = True) -> Path:
    """Write the results of a scene whose kd is off by 0.1 and whose render is exact; return root.

    The mesh has four triangles: 0 is the lamp, which the top row of pixels sees, 1 the wall that
    the others see; 2 is found to emit and does not, 3 is never seen.
    """
    data = root / "dataset"
    cameras = [
        Camera(name, split, WIDTH, HEIGHT, 8.0, 8.0, WIDTH / 2, HEIGHT / 2, np.eye(4)) for name, split in VIEWS.items()
    ]
    write_transforms(data / "transforms.json", cameras)
    write_views(data / "views.json", list(VIEWS))
    points = np.random.default_rng(0).random((12, 3)).astype(np.float32)
    write_ply(data / "mesh.ply", Mesh(points, np.arange(12, dtype=np.int32).reshape(4, 3)))
    picture = np.linspace(0.05, 0.9, WIDTH * HEIGHT * 3, dtype=np.float32)
    picture = picture.reshape(HEIGHT, WIDTH, 3)
    known = maps()
    sure = np.tile(np.linspace(0, 1, WIDTH, dtype=np.float32), (HEIGHT, 1))
    estimate = {**known, "kd": known["kd"] + 0.1, "hit": np.ones((HEIGHT, WIDTH), np.float32), "confidence": sure}
    for name, split in VIEWS.items():
        write_exr(data / "images" / f"{name}.exr", {"": picture})
        if truth:
            write_maps(data / "truth" / f"{name}.exr", known)
        write_maps(root / "materials" / f"{name}.exr", estimate)
        if split == "val":
            write_exr(root / "render" / f"{name}.exr", {"": picture})
            write_exr(root / "relight" / "dim" / f"{name}.exr", {"": picture / 2})
            if truth:
                write_exr(data / "relight_truth" / "dim" / f"{name}.exr", {"": picture / 2})
    write_samples(_folder(root / "samples" / "train-000"), samples(["a", "b"]))
    found = [0, 2]
    arrays = {name: np.ones(2, np.int32) for name in ("emitter", "views")}
    arrays |= {name: np.ones(2, np.float32) for name in ("area", "confidence")}
    radiance = np.full((2, 3), 4, np.float32)
    triangles = np.array(found, np.int32)
    save_npz(root / "round-1" / "emitters.npz", triangle=triangles, radiance=radiance, **arrays)
    write_emitters(root, 1)
    return root


def write_emitters(root: Path, count: int) -> None:
    """Write round-1/emitters.json with some emitters."""
    emitter = {"index": 0, "triangles": 2, "area": 0.5, "radiance": [4, 4, 2], "center": [0, 0, 0]}
    emitter |= {"power": 12.5, "views": 2, "confidence": 0.9}
    content = {
        "emitters": [emitter | {"index": index, "name": default_name(index)} for index in range(count)],
    }
    write_text(root / "round-1" / "emitters.json", json.dumps(content))


def write_extras(root: Path) -> None:
    """Write what a report shows when it is there: stats, overlay, setups, a rejected view."""
    run = {"stage": "bake", "version": 1, "fipt": "0.1.0", "wall_s": 75.0, "rays_per_s": 2e6}
    run |= {"peak_memory_bytes": 1_500_000_000, "settings": {"diffuse_spp": 64}}
    write_text(root / "stats" / "bake.round-0.train-000.json", json.dumps(run))
    traced = {"stage": "samples", "wall_s": 1.0, "views_mostly_off_mesh": ["b"]}
    write_text(root / "stats" / "samples.train-000.json", json.dumps(traced))
    write_views(root / "dataset" / "views.json", list(VIEWS), {"a": "it is blurred"})
    write_png(root / "dataset" / "overlay.png", np.full((6, 8, 3), 90, np.uint8))
    setup = {"settings": {"setup": {"emitters": [{"scale": 0.5}]}}}
    write_text(root / "relight" / "dim.val-000.manifest.json", json.dumps(setup))


def olat_layers() -> dict[str, np.ndarray]:
    """Layers of the held-out view: lamp 0 lights the left, the other two the right, the outside a little everywhere."""
    x = np.linspace(0, 1, WIDTH, dtype=np.float32)[None, :, None]
    y = np.linspace(0.2, 1, HEIGHT, dtype=np.float32)[:, None, None]
    colors = np.float32([[0.5, 0.4, 0.2], [0.1, 0.2, 0.6], [0.02, 0.03, 0.01]])
    return dict(
        zip(
            (default_name(0), "rest", "outside"),
            ((1 - x) * y * colors[0], x * y * colors[1], y * x**0 * colors[2]),
            strict=True,
        )
    )


def write_olat(root: Path) -> None:
    """Write the held-out view under each lamp alone; of three emitters two are rendered together."""
    write_emitters(root, 3)
    path = root / "olat" / "c.exr"
    write_exr(path, olat_layers())
    write_manifest(root / "olat.val-000.manifest.json", "olat", [path], {})


def write_camera_setup(root: Path, count: int = 6) -> None:
    """Write what a setup's own cameras see along a path: a picture that grows brighter, and its video."""
    folder = root / "relight" / "walk"
    names = [f"frame-{number:04d}" for number in range(1, count + 1)]
    files = [folder.with_name("walk.mp4"), *(folder / f"{name}.png" for name in names)]
    for number, name in enumerate(names, 1):
        picture = np.full((HEIGHT, WIDTH, 3), number / count, np.float32)
        write_exr(folder / f"{name}.exr", {"": picture})
        write_png(folder / f"{name}.png", to_display(picture))
    write_mp4(files[0], folder, "frame-%04d.png", count, 4, 20)
    cameras = {"path": {"keyframes": [{"view": "a"}, {"view": "b"}], "frames": count}}
    write_manifest(root / "relight" / "walk.manifest.json", "video", files, {"cameras": cameras})


def samples(views: list[str]) -> FootprintSamples:
    """Footprint samples of views: one a pixel, triangle 0 in the top row and 1 below."""
    pixels = len(views) * WIDTH * HEIGHT
    triangle = np.ones((len(views), HEIGHT, WIDTH), np.int32)
    triangle[:, 0] = 0
    return FootprintSamples(
        views=tuple(views),
        shapes=((HEIGHT, WIDTH),) * len(views),
        offsets=np.arange(pixels + 1, dtype=np.int64),
        center=np.ones(pixels, np.uint8),
        position=np.zeros((pixels, 3), np.float32),
        normal=np.ones((pixels, 3), np.float32),
        triangle=triangle.ravel(),
        footprint=np.ones(pixels, np.float32),
        weight=np.ones(pixels, np.float32),
        sub=np.zeros((pixels, 4, 3), np.float16),
        sub_triangle=np.repeat(triangle.reshape(-1, 1), 4, axis=1),
    )


def _folder(path: Path) -> Path:
    path.mkdir(parents=True)
    return path
