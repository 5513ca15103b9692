"""Other people's layouts into a dataset folder (see `fipt.formats.layouts` for the layouts)."""

import json
import logging
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fipt.errors import FiptError
from fipt.formats.exr import pixels_of
from fipt.formats.files import atomic_folder, check_disk, check_memory, existing_file, write_text
from fipt.formats.images import read_ids, write_png
from fipt.formats.layouts import SEGMENT_FOLDERS, SourceView, known_files
from fipt.formats.manifests import withdraw_manifest, write_manifest
from fipt.formats.places import OwnedPlaces
from fipt.formats.text import MALFORMED
from fipt.scene.cameras import Camera, read_origin, read_radiance_scale, write_transforms
from fipt.scene.dataset import write_views
from fipt.scene.mesh import Mesh, read_geometry, write_ply
from fipt.scene.sources import CAPTURE, ImageSource, read_developed, read_source
from fipt.settings import dumped
from fipt.stages.importing.downscale import downscale
from fipt.stages.importing.encoding import sentences
from fipt.stages.importing.frames import check_layer, write_frames, written_radiance
from fipt.stages.importing.masked import mask_occluders
from fipt.stages.importing.place import (
    Geometry,
    PlacedMesh,
    double_warnings,
    placed,
    scale_warnings,
    undone,
    viewpoint_warnings,
)
from fipt.stages.importing.settings import ImportSettings
from fipt.stages.importing.unit import radiance_scale

log = logging.getLogger(__name__)

_KNOWN = re.compile(
    r"mesh\.ply|transforms\.json|views\.json|room\.json|prepare\.json|check_poses\.json|overlay\.png|images|segments"
    r"|truth|relight_truth|[\w.-]+\.manifest\.json|\..*"
)
"""What may lie in a dataset folder that an import replaces."""

_BYTES_A_PIXEL, _BYTES_OF_MESH = 100, 20
"""Of memory for a pixel of the largest view (measured 82), and for a byte of a PLY mesh (15.5, prepared 10)."""
_BYTES_ON_DISK = 16
"""Of a pixel of a view (measured 11.8 without weights); truth and ids are copied as they are."""

VIEWS_ALONE = "none"
"""Said in place of a mesh: a dataset without one, for what estimates it."""


@dataclass(frozen=True)
class Imported:
    """The dataset's cameras, in the source's order, the source as it was read, what was done to the mesh, warnings."""

    cameras: list[Camera]
    source: ImageSource
    mesh: dict[str, Any]
    warnings: list[str]


@dataclass(frozen=True)
class Beside:
    """What stands beside developed photographs, format ``capture``.

    Attributes
    ----------
    poses
        Of the views, see `fipt.scene.sources.read_poses`.
    segments
        Folder with ``part/VIEW.png`` or ``semantic/VIEW.png``, names in ``{part,semantic}.json``.
    room
        room.json of a known room; default: one beside poses or mesh.
    """

    poses: Path | None = None
    segments: Path | None = None
    room: Path | None = None


def import_scene(
    source: str | Path,
    format: str,
    dataset: str | Path,
    settings: ImportSettings,
    mesh: str | Path | None = None,
    manifest: str | Path | None = None,
    beside: Beside = Beside(),
    mesh_views: Path | None = None,
) -> Imported:
    """Write the dataset folder of a source: complete, with its manifest last, or not at all.

    Parameters
    ----------
    source, format
        Folder (or transforms.json) and layout, see `fipt.formats.layouts`.
    dataset
        Folder to write; an earlier dataset there is replaced.
    mesh
        PLY or OBJ file in the source's world; default: the one that the layout names. `VIEWS_ALONE`: no mesh.
    manifest
        Default: ``import.manifest.json`` in the dataset.
    beside
        Of developed photographs: their poses, and what else is known.
    mesh_views
        transforms.json of imported views that the mesh was made of, near their origin; default: it is as the source.

    Raises
    ------
    FiptError
        The source is incomplete or inconsistent, or the folder must not be replaced.
    """
    parsed = _parsed(source, format, settings, beside.poses)
    dataset = Path(dataset)
    manifest = dataset / "import.manifest.json" if manifest is None else Path(manifest)
    _check_target(dataset, manifest, parsed)
    given = (mesh or parsed.mesh, mesh_views, beside.poses, beside.segments)
    _check_outside(dataset, [frame.image for frame in parsed.frames], given)
    _check_room(dataset, parsed, mesh or parsed.mesh)
    names = _semantic_names(parsed)
    geometry = _geometry(source, mesh or parsed.mesh, mesh_views, settings.unit or 1.0)
    parsed, room = placed(_in_unit(parsed), geometry, settings.unit or 1.0)
    _remove_leftovers(dataset)
    with atomic_folder(dataset, _KNOWN.pattern) as folder:
        cameras, shown, strange = _write_views(folder, parsed, beside, settings.downscale)
        room.figures.update({"images": strange} if strange else {})
        mesh_used, figures = _write_mesh(folder, room, cameras, settings, mesh_views is not None)
        _write_cameras(folder, cameras, parsed, room.origin)
        _copy_known(folder, parsed, beside, mesh)
        _name_segments(folder / "segments", names)
        if settings.overlay and mesh_used is not None:
            _write_overlay(folder, mesh_used, shown)
        withdraw_manifest(manifest)
        withdraw_manifest(dataset / "import.manifest.json")
    files = [path for path in dataset.resolve().rglob("*") if path.is_file()]
    write_manifest(manifest.resolve(), "import", files, {"format": format, **dumped(settings), "scale": parsed.scale})
    return Imported(
        cameras, parsed, figures, [*_unit(parsed), *_moved(parsed, *given[:2]), *sentences(strange, len(cameras))]
    )


def _check_room(dataset: Path, source: ImageSource, mesh: str | Path | None) -> None:
    """Refuse images that are not there, and those and a mesh that memory or the disk is too small for."""
    _check_present(source.frames)
    pixels = [pixels_of(frame.image) for frame in source.frames]
    geometry = Path(mesh).stat().st_size if mesh is not None and Path(mesh).is_file() else 0
    needed = _BYTES_A_PIXEL * max(pixels) + _BYTES_OF_MESH * geometry
    check_memory(needed, "the import", "use smaller images, or a mesh of fewer triangles")
    known = sum(path.stat().st_size for frame in source.frames for path in known_files(frame))
    check_disk(dataset.parent, _BYTES_ON_DISK * sum(pixels) + known + geometry, "the imported dataset")


def _in_unit(source: ImageSource) -> ImageSource:
    """The source with the factor that brings its radiance to the dataset's unit; that of photographs is known."""
    return source if source.photographs else replace(source, scale=radiance_scale(source))


def _unit(source: ImageSource) -> list[str]:
    if source.photographs or source.scale == 1.0:
        return []
    return [
        f"the source's radiance is multiplied by {source.scale:g}, so that the dataset has the level of a photographed "
        "room; emitters.json, setups and the export are in the source's unit (radiance_scale in transforms.json)"
    ]


def _moved(source: ImageSource, mesh: str | Path | None, mesh_views: object) -> list[str]:
    """Say that cameras are not in their original world, unless there is no mesh, or it was made of ``mesh_views``."""
    made = str(mesh) == VIEWS_ALONE or mesh_views is not None
    if made or all(frame.applied is None for frame in source.frames):
        return []
    return [
        "the cameras are in coordinates that applied_transform has changed, and the mesh must be in the same; if it is "
        "in those before (COLMAP's, for most), set import.undo_transform: true"
    ]


def _remove_leftovers(dataset: Path) -> None:
    """Remove what an import that was killed has left beside the dataset."""
    for leftover in dataset.parent.glob(f".{dataset.name}.*.tmp"):
        shutil.rmtree(leftover)


def _geometry(source: str | Path, path: str | Path | None, views: Path | None, unit: float) -> Geometry | None:
    """Vertices and triangles of the room's mesh, in the source's unit and place; None: there are views alone."""
    if path is None:
        raise FiptError(f"{source} has no mesh.ply", "name the room's mesh with --mesh, or --mesh none for views alone")
    if str(path) == VIEWS_ALONE:
        return None
    vertices, triangles = read_geometry(path)
    if views is not None:  # of which the mesh was made: it is in metres, near their origin
        vertices = (vertices + read_origin(views)) / unit
    return vertices, triangles


def _write_views(
    folder: Path, source: ImageSource, beside: Beside, factor: int
) -> tuple[list[Camera], Camera, dict[str, Any]]:
    """Write images, truth and ids, averaged down by a factor; cameras, the one to be shown, what is strange (facts)."""
    cameras, shown, strange = write_frames(folder, source)
    if beside.segments is not None:
        _copy_segments(folder / "segments", beside.segments, cameras)
    if factor > 1:
        cameras = downscale(folder, cameras, factor)
    return cameras, next(camera for camera in cameras if camera.name == shown), strange


def _write_mesh(
    folder: Path, room: PlacedMesh, cameras: Sequence[Camera], settings: ImportSettings, done: bool
) -> tuple[Mesh | None, dict[str, Any]]:
    """Write the mesh, made fit for the pipeline where it asks for that (by itself not if ``done``), and figures.

    Rays are traced for it.
    """
    mesh = room.mesh
    if mesh is None:
        return None, room.figures
    figures: dict[str, Any] = {"prepared": False, "triangles": len(mesh.triangles)}
    warnings = viewpoint_warnings(mesh, cameras)
    if settings.prepare != "never":
        from fipt.render.variant import set_variant

        set_variant()
        warnings += scale_warnings(mesh, cameras, certain=settings.unit is not None)
        warnings += double_warnings(mesh, cameras)
    train = [camera for camera in cameras if camera.split == "train"]
    radiance = partial(written_radiance, folder)
    # a mesh of `fipt mesh` is prepared already: twice, edges and planes suffer
    if settings.prepare == "always" or (settings.prepare == "auto" and not done):
        from fipt.meshing.prepare import prepared

        mesh, figures = prepared(mesh, train, radiance, settings)
    if settings.add_emitters:
        from fipt.stages.importing.added import with_missing_emitters

        mesh, added, said = with_missing_emitters(mesh, train, radiance, figures.get("side_mm", 0.0) / 1e3)
        figures |= added
        warnings += said
    if settings.mask_occluders and settings.prepare != "never" and (done or figures["prepared"]):
        figures["occluded"], said = mask_occluders(folder, mesh, train)
        warnings += said
    figures |= room.figures
    figures["warnings"] = [*room.figures.get("warnings", ()), *warnings]
    write_ply(folder / "mesh.ply", mesh)
    # without the time it took: the same source gives the same files
    lasting = {name: value for name, value in figures.items() if name != "seconds"}
    write_text(folder / "prepare.json", json.dumps(lasting, indent=1) + "\n")
    _warn_outside(cameras, mesh)
    return mesh, figures


def _write_cameras(folder: Path, cameras: list[Camera], source: ImageSource, origin: np.ndarray) -> None:
    """Write transforms.json and views.json, and warn of odd cameras."""
    _warn_shifted(cameras)
    # the unit of photographs is the dataset's, by its exposure; images of a dataset are in a unit of its own
    own = source.frames[0].dataset
    before = 1.0 if own is None else read_radiance_scale(own / "transforms.json")
    scale = 1.0 if source.photographs else source.scale * before
    write_transforms(folder / "transforms.json", cameras, origin=origin, radiance_scale=scale)
    write_views(folder / "views.json", [*(camera.name for camera in cameras), *source.rejected], source.rejected)


def _copy_known(folder: Path, source: ImageSource, given: Beside, mesh: str | Path | None) -> None:
    """Copy what is known of a whole room: room.json, named, beside poses or mesh, or of a dataset; names of its ids."""
    own = source.frames[0].dataset
    places = []
    if own is not None:
        places = [own / "room.json"]
        for kind in SEGMENT_FOLDERS:
            if (folder / "segments" / kind).is_dir() and (own / "segments" / f"{kind}.json").is_file():
                shutil.copyfile(own / "segments" / f"{kind}.json", folder / "segments" / f"{kind}.json")
    elif given.room is not None:
        places = [existing_file(given.room, "what is known of the room")]
    elif given.poses is not None and str(mesh) != VIEWS_ALONE:
        places = [Path(path).parent / "room.json" for path in (given.poses, mesh) if path is not None]
    for place in places:
        if place.is_file():
            shutil.copyfile(place, folder / "room.json")


def _name_segments(folder: Path, names: Mapping[str, str]) -> None:
    """Write the names of the kinds of segments that came without them; only semantic ids have any."""
    for kind in SEGMENT_FOLDERS:
        if (folder / kind).is_dir() and not (folder / f"{kind}.json").is_file():
            ids = {"ids": names if kind == "semantic" else {}}
            write_text(folder / f"{kind}.json", json.dumps(ids, indent=1) + "\n")


def _write_overlay(folder: Path, mesh: Mesh, camera: Camera) -> None:
    """Draw the mesh's edges over a view; rays are traced for it."""
    from fipt.render.variant import set_variant

    set_variant()
    from fipt.stages.importing.overlay import overlay

    write_png(folder / "overlay.png", overlay(mesh, camera, written_radiance(folder, camera.name)[0]))


def _parsed(source: str | Path, format: str, settings: ImportSettings, poses: str | Path | None) -> ImageSource:
    if (format == CAPTURE) != (poses is not None):
        raise FiptError(f"--poses belongs to the format {CAPTURE}, and only to it", "give both or neither")
    if poses is None:
        found = read_source(source, format, settings.val_every)
    else:
        found = read_developed(source, poses, settings.val_every)
        found = found if settings.exposure is None else replace(found, scale=settings.exposure)
    return undone(found) if settings.undo_transform else found


def _check_target(dataset: Path, manifest: Path, source: ImageSource) -> None:
    """Refuse to replace anything but an earlier dataset."""
    place, root = dataset.resolve(), source.root.resolve()
    if place == root or place in root.parents:
        raise FiptError(f"the dataset {dataset} must not hold its source {source.root}", "choose another folder")
    if manifest.resolve().parent not in (place, *place.parents):
        raise FiptError(
            f"the manifest {manifest} must lie in the dataset {dataset} or in a folder above it",
            "choose another path",
        )
    if not dataset.exists():
        return
    if not dataset.is_dir():
        raise FiptError(f"the dataset {dataset} is a file", "choose another folder")
    names = {path.name for path in dataset.iterdir()}
    foreign = sorted(name for name in names if not _KNOWN.fullmatch(name))
    if not foreign and "transforms.json" in names and "views.json" not in names:
        foreign = ["transforms.json"]  # someone's source: a dataset has both
    if foreign:
        raise FiptError(
            f"the folder {dataset} exists and is not a dataset (it holds {foreign[0]})",
            "choose another folder, or delete it",
        )


def _check_outside(dataset: Path, images: Iterable[Path], given: Iterable[str | Path | None]) -> None:
    """Refuse inputs that lie in the folder that is replaced, links followed."""
    owned = OwnedPlaces([("", dataset)])
    for path in (*images, *given):
        if path is not None and owned.owner(path) is not None:
            raise FiptError(f"{path} lies in the dataset {dataset}, which is replaced", "choose another folder")


def _check_present(frames: Iterable[SourceView]) -> None:
    missing = [frame for frame in frames if not frame.image.is_file()]
    if missing:
        raise FiptError(
            f"every frame must have an image; {len(missing)} have none, the first is view "
            f"{missing[0].name}: {missing[0].image}",
            "add the images or remove the frames",
        )


def _warn_outside(cameras: Sequence[Camera], mesh: Mesh) -> None:
    """Warn of cameras outside the mesh's bounds: wrong axes, units, or a mesh of something else."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    outside = [c.name for c in cameras if ((c.center < low) | (c.center > high)).any()]
    if outside:
        log.warning(
            "%d of %d cameras stand outside the mesh's bounds (%s); check axes, units and overlay.png",
            len(outside), len(cameras), ", ".join(outside[:5]),
        )  # fmt: skip


def _warn_shifted(cameras: Sequence[Camera]) -> None:
    """Warn of principal points outside the image."""
    shifted = [camera.name for camera in cameras if camera.is_shifted]
    if shifted:
        log.warning(
            "the principal points of %d of %d cameras lie outside the image (%s); check cx and cy, unless these are "
            "crops or shifted lenses",
            len(shifted), len(cameras), ", ".join(shifted[:5]),
        )  # fmt: skip


def _copy_segments(out: Path, source: Path, cameras: list[Camera]) -> None:
    """Copy id maps of the views, and their names; every view must have one of the right size."""
    if not any((source / kind).is_dir() for kind in SEGMENT_FOLDERS):
        raise FiptError(f"{source} must hold part/ or semantic/ with an id map of every view", "check the path")
    for kind in SEGMENT_FOLDERS:
        if not (source / kind).is_dir():
            continue
        for camera in cameras:
            path = source / kind / f"{camera.name}.png"
            ids = read_ids(path)
            check_layer(ids, camera, path)
            write_png(out / kind / f"{camera.name}.png", ids)
        if (source / f"{kind}.json").is_file():
            shutil.copyfile(source / f"{kind}.json", out / f"{kind}.json")


def _semantic_names(source: ImageSource) -> dict[str, str]:
    """Id -> name as far as meta.json of a FIPT folder tells: id i + 1 is its material i."""
    path = source.root / "meta.json"
    if not path.is_file() or source.frames[0].folder is None:
        return {}
    try:
        materials = json.loads(path.read_text(encoding="utf-8"))["materials"]
        return {str(index): str(entry["name"]) for index, entry in enumerate(materials, start=1)}
    except MALFORMED as error:
        raise FiptError(f"{path} must list materials with names ({error!r})", "correct or remove it") from error
