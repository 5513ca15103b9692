"""Segment ids that exist already: images of ids by view, or a label for every triangle of the mesh.

A folder holds ``VIEW.png`` or ``VIEW.exr``, directly or in ``part/``; ``semantic/`` beside ``part/`` gives the classes.
Images hold one channel of ids, or colours that ``table.json`` turns into ids:

    [{"id": 1, "color": [255, 0, 0], "class": "wall"}, ...]

``color`` and ``class`` may be left out. Without classes in the table, semantic ids are the classes, and
``semantic.json`` may name them. Black is unknown where the table does not list it.
"""

import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.arrays import load_npz
from fipt.formats.exr import read_exr
from fipt.formats.images import is_deep
from fipt.formats.text import MALFORMED
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import face_property
from fipt.scene.samples import FootprintSamples
from fipt.scene.segments import LARGEST_ID, check_classes, nearest_ids, no_ids
from fipt.stages.segment.settings import GivenSegments
from fipt.strict_json import parse_json

log = logging.getLogger(__name__)

TABLE = "table.json"
_SUFFIXES = (".png", ".exr")


class GivenIds:
    """Ids from ``settings.path``.

    Attributes
    ----------
    names
        Class -> name, as far as the files name them.
    warnings
        What was noticed so far, for people.
    """

    def __init__(self, data: Dataset, shard: FootprintSamples, settings: GivenSegments) -> None:
        self.data, self.shard, self.settings = data, shard, settings
        self.path = Path(settings.path or "").expanduser()
        self.warnings: list[str] = []
        self.names: dict[int, str] = {}
        self._labels: np.ndarray | None = None
        self._classes: np.ndarray | None = None
        self._table: dict[tuple[int, ...], int] | None = None
        self._class_of: dict[int, int] = {}
        if self.path.is_dir():
            self._files = id_images(self.path, self.shard.views)  # all of them, before anything is done
            self._read_names()
        elif self.path.is_file():
            self._labels, self._classes = triangle_labels(self.path, settings.property, len(data.mesh().triangles))
        else:
            raise _nothing(self.path)

    def views(self) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """The views of the shard.

        Yields
        ------
        View, ids (H, W) uint16 with 0 = unknown, classes (K,) int32 of the ids.
        """
        for index, view in enumerate(self.shard.views):
            if self._labels is not None and self._classes is not None:
                ids, classes = self._seen(index, self._labels), self._classes
            else:
                ids, classes = self._read(view)
            if not ids.any():
                self._warn(f"{view} has no segment id at all")
            yield view, ids, classes

    def _seen(self, index: int, labels: np.ndarray) -> np.ndarray:
        """(H, W) uint16 of ``labels`` (T,): that of the triangle at each pixel's centre."""
        shard, pixels = self.shard, self.shard.pixels(index)
        hit = shard.center[pixels] > 0
        ids = np.zeros(len(hit), np.uint16)
        ids[hit] = labels[shard.triangle[shard.offsets[pixels][hit]]]
        return ids.reshape(shard.shapes[index])

    def _read(self, view: str) -> tuple[np.ndarray, np.ndarray]:
        files = self._files[view]
        maps = {kind: self._fitted(read_id_image(path, self._table), view, path) for kind, path in files.items()}
        kind = "semantic" if "semantic" in maps else "part"
        classes = self._classes_of(maps[kind], kind, files[kind])
        if "part" in maps and "semantic" in maps:
            return maps["part"], class_of_ids(maps["part"], classes[maps["semantic"]])
        return maps[kind], classes

    def _classes_of(self, ids: np.ndarray, kind: str, path: Path) -> np.ndarray:
        """(K,) int32 class of every id of an image: as the table has it, else semantic ids are classes."""
        count = int(ids.max(initial=0)) + 1
        if not self._class_of:
            return np.arange(count, dtype=np.int32) if kind == "semantic" else np.zeros(count, np.int32)
        classes = np.zeros(count, np.int32)
        for k in np.unique(ids[ids > 0]):
            if int(k) not in self._class_of:
                raise FiptError(
                    f"{self.path / TABLE} must give the class of every id; it misses id {k} of "
                    f"{path.relative_to(self.path)}",
                    "add the id to the table, with its class",
                )
            classes[k] = self._class_of[int(k)]
        return classes

    def _fitted(self, ids: np.ndarray, view: str, path: Path) -> np.ndarray:
        """Ids at the size of their view."""
        camera = self.data.camera(view)
        shape, found = (camera.height, camera.width), ids.shape
        if found == shape:
            return ids
        sizes = f"{found[1]}x{found[0]}, its view {shape[1]}x{shape[0]}"
        if self.settings.other_size == "error":
            raise FiptError(
                f"{path} must have the size of its view; it has {sizes}", "or set segment.other_size: nearest"
            )
        self._warn(f"{path} has {sizes}: the nearest ids were taken")
        return nearest_ids(ids, shape)

    def _read_names(self) -> None:
        """Tables beside the images: colours and classes of ids, names of classes."""
        table, named = self.path / TABLE, self.path / "semantic.json"
        if table.is_file():
            entries = _table_entries(table)
            self._table = {tuple(e["color"]): e["id"] for e in entries if "color" in e}
            order = sorted({e["class"] for e in entries if "class" in e})
            self.names = dict(enumerate(order, start=1))
            self._class_of = {e["id"]: order.index(e["class"]) + 1 for e in entries if "class" in e}
        if not self._class_of and named.is_file():
            try:
                content = parse_json(named.read_text(encoding="utf-8"))
                self.names = {int(k): str(name) for k, name in content.get("ids", content).items()}
            except MALFORMED as error:
                raise FiptError(f"{named} must map ids to names ({error})", "correct or remove it") from error

    def _warn(self, text: str) -> None:
        log.warning("%s", text)
        self.warnings.append(text)


def id_folders(path: Path) -> dict[str, Path]:
    """Kind of ids (part, semantic) -> folder of its images, below a folder or the folder itself."""
    return {kind: path / kind for kind in ("part", "semantic") if (path / kind).is_dir()} or {"part": path}


def id_images(path: Path, views: Iterable[str]) -> dict[str, dict[str, Path]]:
    """View -> kind -> its image of ids in a folder.

    Raises
    ------
    FiptError
        If a view has none.
    """
    files: dict[str, dict[str, Path]] = {view: {} for view in views}
    for kind, folder in id_folders(path).items():
        for view, own in files.items():
            found = [file for suffix in _SUFFIXES if (file := folder / f"{view}{suffix}").is_file()]
            own |= {kind: found[0]} if found else {}
        absent = [view for view, own in files.items() if kind not in own]
        if absent:
            raise FiptError(
                f"{folder} must hold VIEW.png or VIEW.exr of every training view; {', '.join(absent[:8])} missing",
                "add them, named as the views",
            )
    return files


def check_ids(path: Path, views: Iterable[str]) -> None:
    """Look for what `GivenIds` will read.

    Raises
    ------
    FiptError
        If there is nothing, or a folder has no ids of a view.
    """
    if path.is_dir():
        id_images(path, views)
    elif not path.is_file():
        raise _nothing(path)


def _nothing(path: Path) -> FiptError:
    return FiptError(f"segment.path {path} does not exist", "name a folder of ids, or a PLY or NPZ file")


def id_files(path: Path) -> list[Path]:
    """Every file that ids are read from: when one changes, they are read again."""
    if not path.is_dir():
        return [path]
    found = [file for folder in id_folders(path).values() for file in folder.iterdir() if file.suffix in _SUFFIXES]
    return sorted([*found, *(file for file in (path / TABLE, path / "semantic.json") if file.is_file())])


def read_id_image(path: Path, table: Mapping[tuple[int, ...], int] | None) -> np.ndarray:
    """(H, W) uint16 ids of an image: one channel of whole numbers, or colours of a table.

    Raises
    ------
    FiptError
        If it cannot be read, an id is no whole number from 0 to 65,535, or a colour is not in the table.
    """
    values = _channel(path) if path.suffix == ".exr" else _pixels(path, bool(table))
    if values.ndim == 3:
        return _of_colors(values, path, table)
    bad = no_ids(values)
    if bad.any():
        raise FiptError(
            f"{path} must hold whole ids from 0 to {LARGEST_ID}; {int(bad.sum())} pixels do not, such as "
            f"{values[bad][0]:g}",
            "number the segments anew, without filtering",
        )
    return values.astype(np.uint16)


def _channel(path: Path) -> np.ndarray:
    channels = read_exr(path)
    first, *others = channels.values()
    if not all(np.array_equal(first, other) for other in others):  # grey images are often written as RGB
        raise FiptError(
            f"{path} must have one channel of ids; found {', '.join(sorted(channels))}", "write ids, or colours as PNG"
        )
    return first


def _pixels(path: Path, colored: bool) -> np.ndarray:
    """(H, W) ids of a grey PNG, (H, W, 3) colours of another; a palette has ids unless colours are asked for."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            if image.format != "PNG":
                raise FiptError(f"{path} must be a PNG; it holds {image.format}, which may change ids", "export PNG")
            whole = image.mode in ("L", "I", "I;16") or (image.mode == "P" and not colored)
            if not whole and is_deep(path):
                raise FiptError(f"{path} must have 8 bits a colour; it has 16", "export 8 bits, or grey ids")
            values = np.array(image if whole else image.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow raises for damaged files
        raise FiptError(f"{path} is not a readable PNG ({error})", "replace the file") from error
    return values


def _of_colors(values: np.ndarray, path: Path, table: Mapping[tuple[int, ...], int] | None) -> np.ndarray:
    if not table:
        raise FiptError(
            f"{path} is a colour image, but {TABLE} with the id of each colour is missing or has none",
            f'write {TABLE} beside it: [{{"id": 1, "color": [255, 0, 0]}}, ...], or export grey ids',
        )
    known = {(0, 0, 0): 0} | dict(table)
    codes = np.array([r << 16 | g << 8 | b for r, g, b in known])
    order = np.argsort(codes)
    seen = values.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1])
    place = order[np.minimum(np.searchsorted(codes, seen, sorter=order), len(codes) - 1)]
    strange = codes[place] != seen
    if strange.any():
        row, column = np.argwhere(strange)[0]
        raise FiptError(
            f"{path}: {int(strange.sum())} pixels have colours that {TABLE} does not list, the first at row {row}, "
            f"column {column}: {values[row, column].tolist()}",
            "add the colour, or export without smoothing and lossy compression",
        )
    return np.array(list(known.values()), np.uint16)[place]


def _table_entries(path: Path) -> list[dict[str, Any]]:
    """Checked entries of a table: id, and colour and class where they stand there."""
    try:
        entries = [dict(entry) for entry in parse_json(path.read_text(encoding="utf-8"))]
        for entry in entries:
            _check_entry(entry)
        for kind in ("color", "id"):  # of which each means one thing
            counts = Counter(str(entry[kind]) for entry in entries if kind in entry)
            twice = next((value for value, count in counts.items() if count > 1), None)
            if twice is not None:
                raise ValueError(f"{kind} {twice} is there twice")
    except MALFORMED as error:
        raise FiptError(
            f"{path} is not a table of ids ({error})", 'write [{"id": 1, "color": [255, 0, 0], "class": "wall"}, ...]'
        ) from error
    return entries


def _check_entry(entry: Mapping[str, Any]) -> None:
    """Raise ValueError where an entry of a table is no id, or has a colour or class that is none."""
    color = entry.get("color", [0, 0, 0])
    if type(entry["id"]) is not int or not 0 <= entry["id"] <= LARGEST_ID:
        raise ValueError(f"id {entry['id']}: ids are whole numbers from 0 to {LARGEST_ID}")
    if not isinstance(color, list) or len(color) != 3 or any(type(c) is not int or not 0 <= c <= 255 for c in color):
        raise ValueError(f"color {color}: three numbers from 0 to 255")
    if not isinstance(entry.get("class", ""), str):
        raise ValueError(f"class {entry['class']}: a name")


def class_of_ids(ids: np.ndarray, semantic: np.ndarray) -> np.ndarray:
    """(K,) int32 class of every id: the one that most of its pixels have; 0 where that is unknown."""
    codes, votes = np.unique(ids.astype(np.int64) << 16 | semantic, return_counts=True)
    order = np.argsort(votes, kind="stable")
    classes = np.zeros(int(ids.max(initial=0)) + 1, np.int32)
    classes[codes[order] >> 16] = codes[order] & 0xFFFF  # the last write, with the most votes, stays
    classes[0] = 0
    return classes


def triangle_labels(path: Path, name: str, triangles: int) -> tuple[np.ndarray, np.ndarray]:
    """(T,) uint16 label of every triangle, and (K,) int32 class of every label, 0 = unknown.

    Parameters
    ----------
    path
        PLY with a face property ``name``; or npz with an array ``name`` (T,) and perhaps ``classes`` (K,).
    triangles
        T, of the room's mesh.
    """
    if path.suffix.lower() == ".npz":
        arrays = load_npz(path, required=(name,))
        labels, classes = arrays[name], arrays.get("classes")
    elif path.suffix.lower() == ".ply":
        labels, classes = face_property(path, name), None
    else:
        raise FiptError(f"segment.path {path} must be a folder, a PLY or an NPZ file", "convert the labels")
    if labels.shape != (triangles,):
        raise FiptError(
            f"{path} must have a label for each of the mesh's {triangles} triangles; {name} has shape {labels.shape}",
            "label the mesh that the scene uses, its triangles in the same order",
        )
    if labels.dtype.kind not in "biuf":
        raise FiptError(f"{path}: labels must be numbers; {name} holds {labels.dtype}", "number the segments")
    bad = no_ids(labels)
    if bad.any():
        raise FiptError(
            f"{path}: labels must be whole numbers from 0 to {LARGEST_ID}; triangle {int(np.argmax(bad))} has "
            f"{labels[bad][0]}",
            "number the segments anew",
        )
    count = int(labels.max(initial=0)) + 1
    if classes is None:
        classes = np.zeros(count, np.int32)
    elif classes.ndim != 1 or len(classes) < count:
        raise FiptError(
            f"{path} must give the class of every label; classes has {len(classes)} entries, the largest label is "
            f"{count - 1}",
            "write a class for each label, index = label",
        )
    check_classes(path, classes)
    return labels.astype(np.uint16), classes.astype(np.int32)
