"""The stage export: files in, a folder for other programs out."""

import json
from pathlib import Path

import numpy as np

from fipt import __version__
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.formats.files import ANYTHING, atomic_folder, check_disk, check_memory, write_text
from fipt.formats.images import to_display, write_png
from fipt.formats.manifests import Stats, withdraw_manifest, write_manifest
from fipt.meshing.atlas import Atlas, texels, unwrap
from fipt.model.store import load_field
from fipt.render.exported import SPECULAR, principled_textures
from fipt.scene.asset import Asset, mitsuba_map
from fipt.scene.cameras import read_origin, write_transforms
from fipt.scene.confidence import read_confidence
from fipt.scene.dataset import Dataset
from fipt.scene.emitters import Emitters, in_source_unit, read_emitters, read_names
from fipt.scene.environment import in_unit, read_environment
from fipt.scene.mesh import Mesh, connected_parts, write_ply
from fipt.scene.samples import read_samples
from fipt.settings import dumped
from fipt.stages.export.blender import write_blender
from fipt.stages.export.cameras import write_colmap
from fipt.stages.export.gltf import write_glb
from fipt.stages.export.mitsuba_files import write_mitsuba
from fipt.stages.export.room import room_asset, upright
from fipt.stages.export.settings import ExportSettings
from fipt.stages.export.stage import ExportInputs
from fipt.stages.export.textures import confidence_texture, coverage, emission_texture, surface_brdf, surface_textures
from fipt.stages.export.usd import write_usd

_FACTS = "export.json"
_BYTES_A_TEXEL, _BYTES_A_TRIANGLE, _BYTES_BESIDES = 180, 6000, 300_000_000
"""Of memory for a texel of the atlas (measured 176), for a triangle (5700), and for what is compared at once."""
_BYTES_ON_DISK = 40
"""For a texel: all files as they are before they are compressed (measured 1 to 1.4 for even walls)."""
_FILLED = 0.7
"""Share of the atlas that shows surface, at least (measured 0.74 to 0.82)."""


def write_export(inputs: ExportInputs, settings: ExportSettings) -> Stats:
    """Write the room for other programs, complete or not at all, the manifest last.

    Raises
    ------
    FiptError
        If ``out`` holds something else than an earlier export.
    """
    out = inputs.out
    if out.exists() and not (out / _FACTS).is_file() and any(out.iterdir()):
        raise FiptError(f"the folder {out} exists and is no export", "choose another folder, or delete it")
    data, confidence = Dataset(inputs.dataset), read_confidence(inputs.confidence)
    mesh = data.mesh()
    emitters = in_source_unit(read_emitters(inputs.emitters, mesh), data.radiance_scale)
    outside = in_unit(read_environment(inputs.environment), 1 / data.radiance_scale)
    field = load_field(inputs.model)
    seen = coverage(field, mesh, [read_samples(folder) for folder in inputs.samples])
    layout = _layout(settings, seen.typical)
    check_room(mesh, layout, out)
    atlas = unwrap(mesh, _groups(mesh, emitters), *layout)
    known = texels(atlas)
    scale = field.settings.footprint
    brdf = surface_brdf(field, mesh, atlas, known, seen, settings.samples, scale)
    textures = surface_textures(brdf, emitters, atlas, known)
    asset = room_asset(
        inputs.name, mesh, atlas, textures, emitters, data.cameras, outside, read_names(inputs.emitter_names, emitters)
    )
    emission = emission_texture(emitters, atlas, known)
    withdraw_manifest(inputs.manifest)
    with atomic_folder(out, ANYTHING) as folder:
        _write_textures(folder / "textures", asset, emission, confidence_texture(confidence, mesh, atlas, known))
        write_glb(folder / "scene.glb", asset, settings.point_size)
        write_usd(folder / "scene.usdc", asset, "textures")
        _write_emitters(folder / "emitters.ply", asset)
        outside_map = mitsuba_map(asset.outside) if asset.outside.emits else None
        principled = principled_textures(textures)
        write_mitsuba(folder / "mitsuba", asset, principled, SPECULAR, outside_map, settings.max_depth)
        write_blender(folder / "blender.py", asset)
        write_colmap(folder / "cameras" / "colmap", asset.cameras)
        write_transforms(folder / "cameras" / "transforms.json", list(asset.cameras))
        turned = upright(data.cameras), read_origin(inputs.dataset / "transforms.json")
        _write_facts(folder / _FACTS, asset, atlas, turned, float(emission.max()))
    files = [path for path in out.rglob("*") if path.is_file()]
    write_manifest(inputs.manifest, "export", files, dumped(settings))
    return {"texels": len(known.index), "atlas": [atlas.width, atlas.height]}


def check_room(mesh: Mesh, layout: tuple[float, int, int], out: Path) -> None:
    """Refuse textures that memory or the disk is too small for, before the mesh is unwrapped."""
    density, _, longest = layout
    texels_of_room = int(min(float(mesh.areas.sum()) * density**2 / _FILLED, longest**2))
    remedy = "use a smaller export.max_resolution or export.texel_density"
    needed = _BYTES_A_TEXEL * texels_of_room + _BYTES_A_TRIANGLE * len(mesh.triangles) + _BYTES_BESIDES
    check_memory(needed, "the export", remedy)
    check_disk(out.parent, _BYTES_ON_DISK * texels_of_room, "the export")


def _groups(mesh: Mesh, emitters: Emitters) -> np.ndarray:
    """(T,) group of each triangle; emitters have their own, so that their black does not bleed into what is around."""
    groups = connected_parts(mesh)
    groups[emitters.triangle] += groups.max() + 1
    return groups


def _layout(settings: ExportSettings, typical: float) -> tuple[float, int, int]:
    """Texels along a metre, texels between charts, longest side."""
    density = settings.texel_density or 2 / typical
    return density, settings.padding, settings.max_resolution


def _write_textures(folder: Path, asset: Asset, emission: np.ndarray, confidence: np.ndarray) -> None:
    """Write the atlas's textures."""
    textures, strength = asset.textures, float(emission.max()) or 1.0
    packed = np.stack([np.zeros_like(textures.roughness), textures.roughness, textures.metallic], axis=-1)
    images = {
        "base_color": textures.base_color,
        "metallic_roughness": packed,
        "roughness": textures.roughness,
        "metallic": textures.metallic,
        "emission": to_display(emission / strength),
        "confidence": confidence,
    }
    for name, pixels in images.items():
        write_png(folder / f"{name}.png", pixels)
    maps = {"emission": emission}
    if asset.outside.emits:
        maps["environment"] = asset.outside.radiance
    for name, radiance in maps.items():
        write_exr(folder / f"{name}.exr", {"": radiance})


def _write_emitters(path: Path, asset: Asset) -> None:
    """Write the emitting triangles with the colours of their light."""
    vertices = [emitter.mesh.vertices for emitter in asset.emitters]
    starts = np.cumsum([0, *map(len, vertices)])
    triangles = [emitter.mesh.triangles + start for emitter, start in zip(asset.emitters, starts, strict=False)]
    colors = [
        np.tile(to_display(emitter.radiance / (emitter.radiance.max() or 1.0)), (len(emitter.mesh.vertices), 1))
        for emitter in asset.emitters
    ]
    empty = [np.empty((0, 3), np.float32)], [np.empty((0, 3), np.int32)], [np.empty((0, 3), np.uint8)]
    joined = [np.concatenate(a + b) for a, b in zip(empty, (vertices, triangles, colors), strict=True)]
    write_ply(path, Mesh(joined[0], joined[1].astype(np.int32)), joined[2])


def _write_facts(
    path: Path, asset: Asset, atlas: Atlas, turned: tuple[np.ndarray, np.ndarray], strength: float
) -> None:
    """Write what the other files cannot say: emitters, density, how the world was turned, from which origin."""
    turn, origin = turned
    content = {
        "generator": f"fipt {__version__}",
        "scene": asset.name,
        "axes": "y up, metres, right-handed; cameras look along -z",
        "room_from_source": turn.tolist(),
        "source_origin": origin.tolist(),
        "atlas": {
            "width": atlas.width,
            "height": atlas.height,
            "texels_per_metre": atlas.density,
            "charts": atlas.charts,
            "vertices": len(atlas.vertex),
            "triangles": len(atlas.triangles),
        },
        "emission_strength": strength,
        "emitters": [
            {
                "name": emitter.name,
                "triangles": len(emitter.mesh.triangles),
                "area": float(emitter.mesh.areas.sum()),
                "radiance": emitter.radiance.astype(float).tolist(),
                "two_sided": emitter.two_sided,
                "low": emitter.mesh.vertices.min(axis=0).astype(float).tolist(),
                "high": emitter.mesh.vertices.max(axis=0).astype(float).tolist(),
            }
            for emitter in asset.emitters
        ],
    }
    write_text(path, json.dumps(content, indent=1) + "\n")
