"""Writes a room, in code or of a scene file, and its views as a dataset."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import check_memory, existing_file, write_text
from fipt.formats.images import write_png
from fipt.formats.text import MALFORMED
from fipt.progress import progress
from fipt.render.crowding import doubled_parts
from fipt.render.reach import LightPoints, points_on, unreached
from fipt.render.scene import RayScene
from fipt.scene.cameras import Camera, read_transforms, write_transforms
from fipt.scene.dataset import Dataset, rejected_views, write_views
from fipt.scene.mesh import read_mesh, write_ply
from fipt.scene.setup import RelightSetup
from fipt.synthetic.board import with_board
from fipt.synthetic.camera import optics
from fipt.synthetic.capture import simulate_capture, write_bracket, write_calibration
from fipt.synthetic.modelled import exposure_of, modelled
from fipt.synthetic.poses import OpenSpace, coverage, sample_cameras
from fipt.synthetic.room import SyntheticRoom, build
from fipt.synthetic.settings import SynthesizeSettings
from fipt.synthetic.views import Truth, ViewTruth, render_views, view_truth

log = logging.getLogger(__name__)

_BYTES_A_PIXEL = 600
"""Of memory while an image is traced, with its truth: measured 595."""
_ALIKE = 0.98
"""Cosine of the angle by which estimated cameras are turned otherwise than the true ones, at least: 11 degrees."""
_LISTED = 8
"""Pairs of parts that a warning names."""


def write_room(
    folder: Path, settings: SynthesizeSettings, scene: Path | None = None
) -> tuple[list[Path], dict[str, float], list[str]]:
    """Write mesh, cameras, names of ids and the room's description.

    Parameters
    ----------
    folder
        Dataset to write.
    settings
        Of room, views and camera.
    scene
        Scene file; None for the room in code.

    Returns
    -------
    files
        What was written.
    shown
        How much of the surface the training views show.
    warnings
        About emitters whose light reaches nothing that the views see, and parts that stand in one place.
    """
    room = _made(settings, scene)
    for note in room.facts.get("notes", ()):
        log.info("%s", note)
    space = OpenSpace(room, Truth(room).intersect, settings.seed)
    cameras = sample_cameras(space, settings)
    shown = coverage(space, cameras)
    log.info(
        "%d training views show %.1f%% of the surface that is visible, %.1f%% at least twice",
        settings.train_views,
        100 * shown["seen"],
        100 * shown["seen_twice"],
    )
    if scene:
        room = room.exposed(exposure_of(room, cameras[: settings.train_views], settings))
    files = _write_names(folder, room)
    write_ply(folder / "mesh.ply", room.mesh)
    write_views(folder / "views.json", [camera.name for camera in cameras])
    write_transforms(folder / "transforms.json", cameras)
    write_text(folder / "room.json", json.dumps({**room.description(), "coverage": shown}, indent=1) + "\n")
    warnings = _idle_emitters(room, cameras) + _crowded(room)
    for warning in warnings:
        log.warning("%s", warning)
    files += [folder / name for name in ("mesh.ply", "views.json", "transforms.json", "room.json")]
    return files, shown, warnings


def _idle_emitters(room: SyntheticRoom, cameras: Sequence[Camera]) -> list[str]:
    """Warnings about emitters whose light reaches nothing that the cameras see."""
    points = [LightPoints(points_on(room.mesh.vertices, room.mesh.triangles[own])) for own in room.emitters]
    idle = unreached(RayScene(room.mesh), cameras, points) if points else []
    names = [room.parts[room.part[room.emitters[number][0]] - 1] for number in idle]
    return [
        f"{name} emits light that reaches nothing the views see: it is outside the room, or shut in" for name in names
    ]


def _crowded(room: SyntheticRoom) -> list[str]:
    """Warnings about parts of which triangles stand in the same place."""
    pairs = doubled_parts(room.mesh, room.part, room.parts)
    said = [
        f"{one} and {other} have {count} triangles in the same place: rays meet now one, now the other"
        for one, other, count in pairs[:_LISTED]
    ]
    more = len(pairs) - _LISTED
    return [*said, f"and so have {more} more pairs of parts"] if more > 0 else said


def write_images(
    folder: Path,
    names: Sequence[str],
    settings: SynthesizeSettings,
    scene: Path | None = None,
    setup: RelightSetup | None = None,
    setup_name: str | None = None,
) -> tuple[list[Path], float]:
    """Render views and write them with their truth, or only the picture under a light setup.

    Returns
    -------
    files
        What was written.
    rate
        Paths per second.
    """
    cameras = _cameras(folder, names, settings if setup_name is None else None)
    largest = max((camera.width * camera.height for camera in cameras), default=0)
    check_memory(_BYTES_A_PIXEL * largest, "an image of the room", "use smaller images")
    room = built(folder, settings, scene)
    paths = [camera.width * camera.height * settings.spp for camera in cameras]
    files: list[Path] = []
    with progress("synthesize", sum(paths), " paths") as bar:
        for done, (camera, image, truth) in zip(paths, render_views(room, cameras, settings, setup), strict=True):
            if setup_name is None:
                files += _write_truth(folder, camera, truth)
                files.append(folder / "images" / f"{camera.name}.exr")
            else:
                files.append(folder / "relight_truth" / setup_name / f"{camera.name}.exr")
            write_exr(files[-1], {"": image})
            bar.advance(done, camera.name)
        return files, bar.rate


def write_brackets(
    folder: Path, out: Path, names: Sequence[str], settings: SynthesizeSettings, scene: Path | None = None
) -> tuple[list[Path], float]:
    """Photograph views with the simulated camera instead of writing their pictures; their truth goes to the dataset.

    Parameters
    ----------
    folder
        Dataset with the room.
    out
        Folder of the capture; brackets are numbered by the view's place among all views.
    names, settings, scene
        Which views, and how, of which room.

    Returns
    -------
    files
        What was written, in both folders.
    rate
        Paths per second.
    """
    room = built(folder, settings, scene)
    every = [camera.name for camera in read_transforms(folder / "transforms.json")]
    chosen = [(every.index(camera.name), camera) for camera in _cameras(folder, names, settings)]
    planes = [optics(camera, settings.raw) for _, camera in chosen]
    # As many paths for a pixel of the view, which is the mean of several of the source.
    spp = max(settings.spp // settings.raw.scale**2, 1)
    rendered = render_views(room, [p.source for p in planes], settings.model_copy(update={"spp": spp}))
    truth, files = Truth(room), []
    paths = [p.source.width * p.source.height * spp for p in planes]
    with progress("synthesize", sum(paths), " paths") as bar:
        for done, (index, camera), plane, (_, image, _) in zip(paths, chosen, planes, rendered, strict=True):
            files += _write_truth(folder, camera, view_truth(truth, camera))
            files += write_bracket(out, index, image, plane, settings.raw)
            bar.advance(done, camera.name)
        return files, bar.rate


def write_capture_rest(folder: Path, out: Path, settings: SynthesizeSettings) -> list[Path]:
    """Write what a capture of the room has once: calibration frames, table of frames, cameras and mesh."""
    names = [camera.name for camera in read_transforms(folder / "transforms.json")]
    mesh = read_mesh(folder / "mesh.ply")
    return write_calibration(out, _cameras(folder, names, settings), settings.raw, mesh)


def photograph(folder: Path, out: Path, settings: SynthesizeSettings) -> list[Path]:
    """Turn the pictures of any dataset into a capture; return its files."""
    dataset = Dataset(folder)
    images = (dataset.image(camera.name)[0] for camera in dataset.cameras)
    return simulate_capture(images, dataset.cameras, settings.raw, out, dataset.mesh())


def write_truths(
    folder: Path,
    names: Sequence[str],
    settings: SynthesizeSettings,
    scene: Path | None = None,
    true_cameras: Path | None = None,
) -> list[Path]:
    """Write truth and ids of a dataset's views, whose pictures are developed photographs of the room.

    Parameters
    ----------
    true_cameras
        transforms.json of where the room was photographed from; default: the dataset's own. Estimated cameras stand in
        coordinates of their own.
    """
    room = built(folder, settings, scene)
    truth = Truth(room)
    files = _write_names(folder, room)
    # Developed photographs have the size that development gave them.
    cameras = _cameras(folder, names, None)
    if true_cameras is not None:
        cameras = _placed_as(cameras, true_cameras)
        if _turned_otherwise(read_transforms(folder / "transforms.json"), read_transforms(true_cameras)):
            log.warning(
                "the cameras of %s are not turned to each other as those of %s: are they of another room?",
                *(true_cameras, folder),
            )
    for camera in cameras:
        found = view_truth(truth, camera)
        if not found.ids["part"].any():
            raise FiptError(
                f"view {camera.name} must see the room; its camera in {true_cameras or folder} sees nothing of it",
                "give the transforms.json of where this room was photographed from, with --cameras",
            )
        files += _write_truth(folder, camera, found)
    return files


def _placed_as(cameras: Sequence[Camera], path: Path) -> list[Camera]:
    """Cameras where a transforms.json has those of the same names."""
    places = {camera.name: camera.world_from_camera for camera in read_transforms(path)}
    missing = [camera.name for camera in cameras if camera.name not in places]
    if missing:
        raise FiptError(f"{path} must have a camera of every view; {', '.join(missing[:8])} missing", "add them")
    return [replace(camera, world_from_camera=places[camera.name]) for camera in cameras]


def _turned_otherwise(cameras: Sequence[Camera], true: Sequence[Camera]) -> bool:
    """Whether one rotation brings no two cameras of the same names onto each other, by the median over neighbours."""
    places = {camera.name: camera.world_from_camera[:3, :3] for camera in true}
    turns = [places[c.name] @ c.world_from_camera[:3, :3].T for c in cameras if c.name in places]
    cosines = [(np.trace(a @ b.T) - 1) / 2 for a, b in pairwise(turns)]
    return bool(cosines) and float(np.median(cosines)) < _ALIKE


def built(folder: Path, settings: SynthesizeSettings, scene: Path | None) -> SyntheticRoom:
    """Return the room that the folder holds, which must be the one that settings and scene file say."""
    path = existing_file(folder / "room.json", "the room")
    try:
        described = {key: value for key, value in json.loads(path.read_bytes()).items() if key != "coverage"}
        exposure = float(described.get("exposure", 1.0)) if scene else 1.0
    except MALFORMED as error:
        raise FiptError(
            f"{path} is not the description of a room ({error!r})", "run fipt synthesize-room again"
        ) from error
    room = _made(settings, scene).exposed(exposure)
    if described != room.description():
        raise _another(folder)
    return room


def _made(settings: SynthesizeSettings, scene: Path | None) -> SyntheticRoom:
    room = modelled(scene, settings) if scene else build(settings.seed, settings.opening, settings.sky, settings.room)
    return with_board(room, settings.board) if settings.board.enabled else room


def _another(folder: Path) -> FiptError:
    return FiptError(f"{folder} holds a room made with other settings", "run fipt synthesize-room again")


def _write_names(folder: Path, room: SyntheticRoom) -> list[Path]:
    names = {
        "part": {str(index + 1): name for index, name in enumerate(room.parts)},
        "semantic": {str(index + 1): name for index, name in enumerate(room.semantics)},
    }
    files = []
    for kind, table in names.items():
        files.append(folder / "segments" / f"{kind}.json")
        write_text(files[-1], json.dumps(table, indent=1) + "\n")
    return files


def _write_truth(folder: Path, camera: Camera, truth: ViewTruth) -> list[Path]:
    layers = folder / "truth" / f"{camera.name}.exr"
    write_exr(layers, truth.layers)
    files = [layers]
    for kind, ids in truth.ids.items():
        files.append(folder / "segments" / kind / f"{camera.name}.png")
        write_png(files[-1], ids)
    return files


def _cameras(folder: Path, names: Sequence[str], settings: SynthesizeSettings | None) -> list[Camera]:
    """Read the cameras of some views, without those that a check rejected; check their size against settings."""
    cameras = {camera.name: camera for camera in read_transforms(folder / "transforms.json")}
    sizes = {(camera.width, camera.height) for camera in cameras.values()}
    if settings is not None and sizes != {(settings.width, settings.height)}:
        raise _another(folder)
    rejected = rejected_views(folder)
    names = [name for name in names if name not in rejected]
    unknown = [name for name in names if name not in cameras]
    if unknown:
        raise FiptError(
            f"{folder} has no view {', '.join(unknown)}",
            "choose among " + ", ".join(list(cameras)[:8]),
        )
    return [cameras[name] for name in names]
