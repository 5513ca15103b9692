"""Every format that is read: a small sound file, its reader, and ways to damage it.

    python -m tests.faults.formats [--inputs 10000] [--only exr,png]

feeds so many damaged files of each format to its reader and prints a row for each: how many were refused in one line,
how many still read, the seconds, and what else came of it. The tests do the same with fewer.
"""

import argparse
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npy, load_npz, save_npy, save_npz
from fipt.formats.exr import read_exr, write_exr
from fipt.formats.hdr import read_hdr
from fipt.formats.images import read_ids, read_pixels, write_png
from fipt.formats.manifests import read_manifest, write_manifest
from fipt.formats.pose_files import read_pose_file
from fipt.formats.views import read_rejected
from fipt.formats.yaml import read_yaml
from fipt.scene.cameras import Camera, read_transforms, write_transforms
from fipt.scene.dataset import read_layers, write_views
from fipt.scene.mesh import read_mesh, write_ply
from fipt.scene.objects import read_object
from fipt.scene.review import read_review
from fipt.scene.setup import parse_setup
from fipt.scene.sources import read_poses, read_source
from fipt.stages.capture.brackets import read_capture
from fipt.stages.capture.calibration import Calibration, Noise, read_calibration, write_calibration
from fipt.stages.capture.ldr import read_ldr
from fipt.stages.capture.raw import read_raw, read_shot
from fipt.synthetic.dng import Header, write_dng
from fipt.synthetic.scenefile.xml import read_tree
from tests import objects
from tests.layouts import WRITERS, room, write_obj

Reader = Callable[[Path], object]
Writer = Callable[[Path], object]
SLOW = 10.0
"""Seconds of the processor that no file takes."""


def _npy(path: Path) -> None:
    save_npy(path, np.arange(60, dtype=np.float32).reshape(20, 3))


def _npz(path: Path) -> None:
    save_npz(path, a=np.arange(40), b=np.eye(3))


def _exr(path: Path) -> None:
    write_exr(path, {"": np.random.default_rng(0).random((6, 8, 3)).astype(np.float32)})


def _layers(path: Path) -> None:
    write_exr(path, {"kd": np.full((6, 8, 3), 0.5, np.float32), "roughness.Y": np.ones((6, 8), np.float32)}, half=True)


def _hdr(path: Path) -> None:
    rows = np.random.default_rng(0).integers(1, 255, (6, 8, 4), np.uint8)
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 6 +X 8\n" + rows.tobytes())


def _png(path: Path) -> None:
    write_png(path, np.arange(48, dtype=np.uint16).reshape(6, 8))


def _photo(path: Path) -> None:
    """A JPEG or PNG photograph with an exposure time."""
    from PIL import Image

    image = Image.fromarray(np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8))
    exif = image.getexif()
    exif.get_ifd(0x8769).update({0x829A: 0.25, 0x829D: 8.0})
    image.save(path, exif=exif)


def _dng(path: Path) -> None:
    noon = datetime(2026, 6, 1, 12)
    header = Header("RGGB", (512.0,) * 4, 16383, np.eye(3), (1.0, 1.0, 1.0), Fraction(1, 4), 8.0, 100, 24.0, 24.0, noon)
    write_dng(path, np.random.default_rng(0).integers(512, 16383, (24, 32)).astype(np.uint16), header)


def _table(path: Path) -> None:
    """A capture whose brackets stand in a table; its photographs are sound."""
    for name in ("a", "b"):
        _photo(path.parent / f"{name}.jpg")
    path.write_text("view\tfile\tshutter\nroom\ta.jpg\t0.25\nroom\tb.jpg\t0.0625\n")


def _layout(name: str) -> tuple[Writer, Reader]:
    """Writer of a layout in the folder of a file, and reader of its cameras."""
    return lambda path: (WRITERS[name](path.parent), None)[1], lambda path: read_source(path.parent, name)


def _dataset(path: Path) -> None:
    write_transforms(path, [Camera(name, "train", 8, 6, 4.0, 4.0, 4.0, 3.0, np.eye(4)) for name in "ab"])


def _manifest(path: Path) -> None:
    write_manifest(path, "samples", [], {"grid": 2})


def _colmap(path: Path) -> None:
    (path.parent / "cameras.txt").write_text("1 PINHOLE 8 6 4 4 4 3\n")
    path.write_text("1 1 0 0 0 1 2 3 1 a.jpg\n\n2 0.7 0 0.7 0 1 2 3 1 b.jpg\n1 2 3\n")


def _colmap_binary(path: Path) -> None:
    """Both files of a model: one is damaged, the other is sound."""
    pinhole = struct.pack("<QiiQQ4d", 1, 1, 1, 8, 6, 4, 4, 4, 3)
    image = struct.pack("<i7di", 1, 1, 0, 0, 0, 1, 2, 3, 1) + b"a.jpg\0" + struct.pack("<Q2dq", 1, 2, 3, -1)
    (path.parent / "cameras.bin").write_bytes(pinhole)
    (path.parent / "images.bin").write_bytes(struct.pack("<Q", 1) + image)


def _metashape(path: Path) -> None:
    matrix = " ".join(map(str, np.eye(4).ravel()))
    path.write_text(
        '<document><chunk><sensors><sensor id="0" type="frame"><resolution width="8" height="6"/><calibration>'
        '<f>4</f></calibration></sensor></sensors><cameras><camera label="a.jpg" sensor_id="0"><transform>'
        f"{matrix}</transform></camera></cameras></chunk></document>"
    )


def _reality(path: Path) -> None:
    path.write_text("#name,x,y,alt,heading,pitch,roll\na.jpg,1,2,3,10,20,30\n")


def _yaml(path: Path) -> None:
    path.write_text("scenes:\n  room: {source: procedural}\nfit: {steps: 3, seed: 0}\nonly: [room]\n")


def _setup(path: Path) -> None:
    path.write_text(
        "emitters:\n  - {name: lamp, scale: 0.5}\nlights:\n"
        "  - {shape: sphere, center: [1, 2, 3], radius: 0.1, radiance: [1, 1, 1]}\n"
    )


def _review(path: Path) -> None:
    path.write_text("mesh_triangles: 40\nemitters:\n- name: lamp\n  triangles: 1-3\n  verdict: accept\n")


def _calibration(path: Path) -> None:
    write_calibration(path, Calibration("raw", "a camera", 8, 6, (512.0,) * 4, ((1, 2),), Noise(2.0, 3.0, 100.0)))


def _scene(path: Path) -> None:
    path.write_text(
        '<scene version="3.0.0"><default name="a" value="2"/><shape type="cube"><transform name="to_world">'
        '<scale value="$a"/><translate x="1" y="2" z="3"/></transform><bsdf type="diffuse">'
        '<rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></shape></scene>'
    )


def _field(path: Path) -> None:
    from fipt.model.networks import Field, SceneBox
    from fipt.model.settings import NetworkSettings
    from fipt.model.store import save_field

    settings = NetworkSettings(levels=1, table_log2=8)
    save_field(path, Field(settings, SceneBox((0.0, 0.0, 0.0), 2.0)), settings)


def _load_field(path: Path) -> object:
    from fipt.model.store import load_field

    return load_field(path)


FORMATS: dict[str, tuple[str, Writer, Reader]] = {
    "npy": ("a.npy", _npy, load_npy),
    "npz": ("a.npz", _npz, load_npz),
    "exr": ("a.exr", _exr, read_exr),
    "exr-layers": ("a.exr", _layers, read_layers),
    "hdr": ("a.hdr", _hdr, read_hdr),
    "png-ids": ("a.png", _png, read_ids),
    "png-mask": ("a.png", _png, lambda path: read_pixels(path, "a mask", "L")),
    "jpeg": ("a.jpg", _photo, read_ldr),
    "jpeg-exif": ("a.jpg", _photo, read_shot),
    "dng": ("a.dng", _dng, read_raw),
    "dng-exif": ("a.dng", _dng, read_shot),
    "captures.tsv": ("captures.tsv", _table, lambda path: read_capture(path.parent)),
    "ply": ("a.ply", lambda path: write_ply(path, room()), read_mesh),
    "obj": ("a.obj", lambda path: write_obj(path, room()), read_mesh),
    "object-obj": ("a.obj", objects.write_obj, read_object),
    "object-glb": ("a.glb", objects.write_square_glb, read_object),
    "nerfstudio": ("transforms.json", *_layout("nerfstudio")),
    "poses": ("transforms.json", _layout("nerfstudio")[0], read_poses),
    "dataset": ("transforms.json", _dataset, read_transforms),
    "fipt-real": ("cam.txt", *_layout("fipt-real")),
    "manifest": ("a.manifest.json", _manifest, lambda path: read_manifest(path, "samples")),
    "views": ("views.json", lambda path: write_views(path, ["a", "b"], {"b": "blurred"}), read_rejected),
    "calibration": ("calibration.json", _calibration, read_calibration),
    "colmap-text": ("images.txt", _colmap, lambda path: read_pose_file(path.parent)),
    "colmap-images": ("images.bin", _colmap_binary, lambda path: read_pose_file(path.parent)),
    "colmap-cameras": ("cameras.bin", _colmap_binary, lambda path: read_pose_file(path.parent)),
    "metashape": ("a.xml", _metashape, read_pose_file),
    "realitycapture": ("a.csv", _reality, read_pose_file),
    "yaml": ("a.yaml", _yaml, read_yaml),
    "setup": ("a.yaml", _setup, lambda path: parse_setup(str(path))),
    "review": ("a.yaml", _review, read_review),
    "scene-xml": ("a.xml", _scene, read_tree),
    "safetensors": ("a.safetensors", _field, _load_field),
}
"""Name -> file, what writes it, what reads it."""


def judged(read: Reader, path: Path) -> bool:
    """Whether a file is read; else one line must say why, with a file of its folder, within seconds."""
    start, said = time.process_time(), ""
    try:
        read(path)
    except FiptError as error:
        said = str(error)
        assert "\n" not in said, said
        assert str(path.parent) in said, said
    assert time.process_time() - start < SLOW
    return not said


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes cut, flipped, repeated, replaced by what parsers fall over."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        place = int(rng.integers(0, max(1, len(out))))
        match int(rng.integers(0, 6)):
            case 0:
                del out[place:]
            case 1 if out:
                out[place] ^= 1 << int(rng.integers(0, 8))
            case 2:
                out[place : place + 4] = bytes(rng.integers(0, 256, 4, np.uint8))
            case 3:
                out[place:place] = out[place : place + int(rng.integers(1, 40))]
            case 4:
                del out[place : place + int(rng.integers(1, 40))]
            case _:
                out[place : place + 1] = SPITEFUL[int(rng.integers(0, len(SPITEFUL)))]
    return bytes(out)


SPITEFUL = [
    b"1e999", b"-1", b"9" * 400, b"nan", b"null", b"\xff\xfe", b"\0", b"{", b"[" * 1500, b'"', b"-0", b"1e-400",
    b"\x7f\xff\xff\xff", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"true", b"2147483648", b"&a [*a]", b"!!python/none",
]  # fmt: skip


def damaged(name: str, folder: Path, inputs: int, seed: int = 0) -> Counter[str]:
    """Give so many damaged files of a format to its reader; what came of them, by number.

    Raises
    ------
    AssertionError, Exception
        Whatever is not one line; the file is left in the folder.
    """
    file, write, read = FORMATS[name]
    path = folder / file
    write(path)
    whole = path.read_bytes()
    read(path)
    rng, found = np.random.default_rng((len(name), seed)), Counter[str]()
    for _ in range(inputs):
        path.write_bytes(mutated(whole, rng))
        found["read" if judged(read, path) else "refused"] += 1
    return found


def _row(name: str, inputs: int) -> str:
    """Feed a format; a row of the table. What goes wrong is written to standard error, and the rest is fed too."""
    start, found, wrong = time.monotonic(), Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        seed = 0
        while (left := inputs - found.total() - wrong.total()) > 0:
            try:
                found += damaged(name, Path(folder), min(left, 500), seed)
            except Exception as error:  # noqa: BLE001 - told
                wrong[f"{type(error).__name__}: {str(error)[:90]!r}"] += 500
                print("".join(traceback.format_exception(error)[-3:]), file=sys.stderr)
            seed += 1
    words = ", ".join(wrong) or "-"
    return f"| {name} | {inputs} | {found['refused']} | {found['read']} | {time.monotonic() - start:.0f} | {words} |"


def main() -> None:
    """Print a row for each format."""
    parser = argparse.ArgumentParser("python -m tests.faults.formats", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inputs", type=int, default=10_000, help="damaged files of each format")
    parser.add_argument("--only", help="formats, separated by commas; default: all")
    arguments = parser.parse_args()
    names: list[Any] = arguments.only.split(",") if arguments.only else list(FORMATS)
    print("| format | inputs | refused in one line | still read | seconds | other |\n|---|---|---|---|---|---|")
    for name in names:
        print(_row(name, arguments.inputs), flush=True)


if __name__ == "__main__":
    main()
