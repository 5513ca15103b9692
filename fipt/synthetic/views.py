"""HDR views of the room, lit as it is or by a setup, and ground truth for every pixel."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fipt.model.albedo import reflectance
from fipt.render.denoise import denoise
from fipt.render.edits import Edit, Segments, without
from fipt.render.objects import appended, light_mesh, objects_in
from fipt.render.reference import EmittingMesh, PathTracer, SurfaceProbe, load_scene
from fipt.render.spots import spots_of
from fipt.render.texels import DeviceMaps, MappedMesh, MaterialMaps
from fipt.scene.cameras import Camera
from fipt.scene.emitters import chosen_emitters, edited_radiance
from fipt.scene.environment import edited
from fipt.scene.mesh import Mesh, closed
from fipt.scene.objects import MeshObject
from fipt.scene.setup import AreaLight, MeshLight, RelightSetup, SphereLight, SpotLight
from fipt.synthetic.room import SyntheticRoom
from fipt.synthetic.settings import SynthesizeSettings
from fipt.synthetic.shapes import panel

_SUB = 4
"""Sub-pixels along each side of a pixel for averaged truth."""

_PROBES, _PROBE_WIDTH, _PROBE_SPP = 8, 64, 64
"""Pictures by which a room is exposed: their number, width in pixels, paths a pixel."""


# --- light setups -----------------------------------------------------------------------------


def lights(
    room: SyntheticRoom, setup: RelightSetup | None = None, gone: np.ndarray | None = None
) -> list[EmittingMesh]:
    """Return the room's lamps under a light setup: edited, without triangles that are ``gone``, then the new lights.

    An edit's ``index`` counts the room's lamps by their first triangle, as room.json lists them; their names are those
    of their parts there, and ``emitter-N``. Within an edit a new radiance comes first, then the colour (luminance
    kept), then the scale.
    """
    setup = setup or RelightSetup()
    names = [room.parts[room.part[triangles[0]] - 1] for triangles in room.emitters]
    edits = [(edit, chosen_emitters(edit, names)) for edit in setup.emitters]
    found = []
    for index, triangles in enumerate(room.emitters):
        radiance = room.radiance[triangles[0]].astype(np.float64)
        for edit, chosen in edits:
            if index in chosen:
                radiance = edited_radiance(radiance[None], edit)[0]
        if gone is not None and gone[triangles].any():
            triangles = triangles[~gone[triangles]]
            if not len(triangles):
                continue
        used, local = np.unique(room.mesh.triangles[triangles], return_inverse=True)
        found.append(EmittingMesh(_mesh(room.mesh.vertices[used], local.reshape(-1, 3)), radiance))
    return found + area_lights(setup)


def area_lights(setup: RelightSetup | None) -> list[EmittingMesh]:
    """Return the new lights of a setup that have a surface."""
    return [new_light(light) for light in setup.lights if not isinstance(light, SpotLight)] if setup else []


def new_light(light: AreaLight) -> EmittingMesh:
    """Return the triangles of a light that a setup adds.

    A quad's first side is perpendicular to its normal and to y (to x where the quad lies level), its
    second to the normal and the first; it shines to both sides.
    """
    import trimesh

    radiance = np.array(light.radiance, float)
    if isinstance(light, MeshLight):
        mesh = light_mesh(light)
        return EmittingMesh(mesh, radiance, two_sided=not closed(mesh))
    center = np.array(light.center, float)
    if isinstance(light, SphereLight):
        ball = trimesh.creation.icosphere(3, light.radius)
        return EmittingMesh(_mesh(ball.vertices + center, ball.faces), radiance)
    normal = np.array(light.normal, float)
    normal /= np.linalg.norm(normal)
    u = np.cross(normal, (0.0, 1.0, 0.0) if abs(normal[1]) < 0.9 else (1.0, 0.0, 0.0))
    u *= light.size[0] / np.linalg.norm(u)
    v = np.cross(normal, u) * light.size[1] / light.size[0]
    quad = panel(center - u / 2 - v / 2, u, v)
    return EmittingMesh(_mesh(quad.vertices, quad.triangles), radiance, two_sided=True)


def _mesh(vertices: np.ndarray, triangles: np.ndarray) -> Mesh:
    return Mesh(np.asarray(vertices, np.float32), np.asarray(triangles, np.int32))


@dataclass(frozen=True)
class Changed:
    """What a setup changes beside the light, in a known room.

    Attributes
    ----------
    gone
        (T,) bool: triangles of the room that it removes.
    edits
        Other materials, in order.
    objects
        What it puts in.
    """

    gone: np.ndarray
    edits: Sequence[Edit] = ()
    objects: Sequence[MeshObject] = ()


def changed(room: SyntheticRoom, setup: RelightSetup | None) -> Changed:
    """Return what a setup changes beside the light; its segments are the connected parts of the room's mesh."""
    if setup is None:
        return Changed(np.zeros(len(room.mesh.triangles), bool))
    up = room.outside.up
    segments = Segments(room.mesh, None, up)
    gone = segments.removed(setup)
    around = appended(without(room.mesh, gone), *(light.mesh for light in area_lights(setup)))
    return Changed(gone, segments.edits(setup), objects_in(around, setup.objects, up))


def render_tracer(
    room: SyntheticRoom,
    setup: RelightSetup | None,
    max_depth: int,
    maps: DeviceMaps | None = None,
    change: Changed | None = None,
) -> PathTracer:
    """Make the reference path tracer of the room under a setup.

    ``maps`` are those of its materials, and ``change`` what the setup changes, if at hand.
    """
    change = change or changed(room, setup)
    solid = np.flatnonzero(~room.emits & ~change.gone)
    surface = MappedMesh(
        Mesh(room.mesh.vertices, room.mesh.triangles[solid]),
        room.uv,
        maps or DeviceMaps(room.materials),
        room.material[solid],
        [edit.of_triangles(solid) for edit in change.edits],
    )
    scene = load_scene(
        surface,
        lights(room, setup, change.gone),
        edited(room.outside, setup and setup.environment),
        change.objects,
        spots_of(setup.lights) if setup else (),
    )
    return PathTracer(scene, max_depth)


# --- ground truth -----------------------------------------------------------------------------


class Truth:
    """What the room holds at the first hit of any ray.

    Parameters
    ----------
    room
        The room; its triangles keep their numbers.
    added
        New lights that a setup puts into it: they follow as further triangles, with part id 0.
    maps
        Of the room's materials, if at hand.
    change
        What else a setup changes; objects follow the lights, with part id 0.
    """

    def __init__(
        self,
        room: SyntheticRoom,
        added: Sequence[EmittingMesh] = (),
        maps: DeviceMaps | None = None,
        change: Changed | None = None,
    ) -> None:
        vertices, triangles, uv = [room.mesh.vertices], [room.mesh.triangles], [room.uv]
        self._known = {"part": room.part, "semantic": room.semantic, "emission": room.radiance}
        material = [room.material]
        for light in added:
            count = len(light.mesh.triangles)
            triangles.append(light.mesh.triangles + sum(map(len, vertices)))
            vertices.append(light.mesh.vertices)
            uv.append(np.zeros((len(light.mesh.vertices), 2), np.float32))
            material.append(np.zeros(count, np.int32))
            for key, column in self._known.items():
                rows = np.broadcast_to(light.radiance if key == "emission" else 0, (count, *column.shape[1:]))
                self._known[key] = np.concatenate([column, rows.astype(column.dtype)])
        materials: list[MaterialMaps] = list(room.materials)
        edits: Sequence[Edit] = ()
        if change is not None:
            triangles[0], edits = without(room.mesh, change.gone).triangles, change.edits
            for thing in change.objects:
                count = len(thing.mesh.triangles)
                triangles.append(thing.mesh.triangles + sum(map(len, vertices)))
                vertices.append(thing.mesh.vertices)
                uv.append(thing.uv)
                material.append(thing.material + len(materials))
                materials += thing.materials
                for key, column in self._known.items():
                    self._known[key] = np.concatenate([column, np.zeros((count, *column.shape[1:]), column.dtype)])
            edits = [edit.extended(sum(map(len, triangles))) for edit in edits]
        mesh = Mesh(np.concatenate(vertices), np.concatenate(triangles))
        if len(materials) > len(room.materials):
            maps = DeviceMaps(materials)
        self._one_sided = len(room.mesh.triangles)
        maps = maps or DeviceMaps(room.materials)
        self._surface = SurfaceProbe(MappedMesh(mesh, np.concatenate(uv), maps, np.concatenate(material), edits))
        self.intersect = self._surface.intersect

    def trace(self, origins: np.ndarray, directions: np.ndarray) -> dict[str, np.ndarray]:
        """Return what (N, 3) rays meet first.

        Returns
        -------
        dict
            ``part``, ``semantic`` (N,) uint16, 0 where nothing is hit; (N, 3) float32
            ``base_color``, ``emission``, ``normal``; (N,) float32 ``roughness``, ``metallic``,
            ``cos``. ``normal`` faces the ray, ``cos`` is the cosine between the two. Lamps have
            base colour 0, roughness 1 and metallic 0, on their dark side too.
        """
        found = self._surface.materials(origins, directions)
        triangle, normal = found.pop("triangle"), found["normal"]
        hit = triangle >= 0
        toward = -(normal * directions).sum(axis=1)
        for key, column in self._known.items():
            found[key] = np.where(hit.reshape(-1, *[1] * (column.ndim - 1)), column[triangle], 0)
        emitter = found["emission"].any(axis=1)
        dark = emitter & (toward < 0) & (triangle < self._one_sided)
        found["emission"][dark] = 0
        found["base_color"][emitter], found["roughness"][emitter], found["metallic"][emitter] = 0, 1, 0
        return found | {"normal": normal * np.sign(toward)[:, None], "cos": np.abs(toward)}


@dataclass(frozen=True)
class ViewTruth:
    """Ground truth of one view.

    Attributes
    ----------
    layers
        Layers of truth/{view}.exr by channel name: (H, W, 3) or (H, W) float32.
    ids
        ``part`` and ``semantic``: (H, W) uint16.
    guides
        ``albedo`` and ``normal`` for the denoiser: (H, W, 3) float32 means over the pixel.
    """

    layers: dict[str, np.ndarray]
    ids: dict[str, np.ndarray]
    guides: dict[str, np.ndarray]


def view_truth(truth: Truth, camera: Camera) -> ViewTruth:
    """Look up the ground truth of a view.

    Everything belongs to the surface at the pixel's centre; base colour, roughness and metallic (hence kd and a') are
    the means over those of 4 x 4 sub-pixels that lie on the centre's part.
    """
    rows, columns = np.mgrid[: camera.height, : camera.width]

    def trace(dx: float, dy: float) -> dict[str, np.ndarray]:
        directions = camera.directions((columns + dx).ravel(), (rows + dy).ravel())
        origins = np.broadcast_to(camera.center.astype(np.float32), directions.shape)
        return truth.trace(origins, directions)

    center = trace(0.5, 0.5)
    mean = {key: np.zeros(center[key].shape) for key in ("base_color", "roughness", "metallic")}
    weight = np.zeros(len(center["part"]))
    albedo, normal = np.zeros_like(center["base_color"]), np.zeros_like(center["base_color"])
    for index in range(_SUB**2):
        sub = trace((index % _SUB + 0.5) / _SUB, (index // _SUB + 0.5) / _SUB)
        same = sub["part"] == center["part"]
        for key, total in mean.items():
            total[same] += sub[key][same]
        weight += same
        # Lamps count as white: the denoiser's own convention.
        albedo += sub["base_color"] + np.asarray(sub["emission"].any(axis=1))[:, None]
        normal += sub["normal"]
    for key, total in mean.items():
        some = weight > 0
        mean[key] = center[key].copy()
        mean[key][some] = (total[some].T / weight[some]).T
    color, roughness, metallic = mean.values()

    emission = center["emission"]
    mask = np.asarray(emission.any(axis=1))
    reflects = (center["part"] > 0) & ~mask
    total = reflectance(color, roughness, metallic, center["cos"])
    layers = {
        "kd": color * (1 - metallic[:, None]),
        "base_color": color,
        "reflectance": np.where(reflects[:, None], total, 0),
        "emission": emission,
        "roughness.Y": roughness,
        "metallic.Y": metallic,
        "emission_mask.Y": mask,
    }

    def as_image(values: np.ndarray, dtype: type = np.float32) -> np.ndarray:
        return values.reshape(*rows.shape, *values.shape[1:]).astype(dtype)

    return ViewTruth(
        {name: as_image(values) for name, values in layers.items()},
        {kind: as_image(center[kind], np.uint16) for kind in ("part", "semantic")},
        {"albedo": as_image(albedo / _SUB**2), "normal": as_image(normal / _SUB**2)},
    )


# --- images -----------------------------------------------------------------------------------


def path_seed(seed: int, view: str) -> int:
    """Return the seed of a view's paths: it knows the view's name, not who renders it with whom."""
    return zlib.crc32(f"{seed}/{view}".encode())


def render_views(
    room: SyntheticRoom,
    cameras: Sequence[Camera],
    settings: SynthesizeSettings,
    setup: RelightSetup | None = None,
) -> Iterator[tuple[Camera, np.ndarray, ViewTruth]]:
    """Render views, in their own light or under a setup.

    Parameters
    ----------
    room, cameras
        What to render.
    settings
        Paths per pixel, depth, denoising, seed.
    setup
        Edited and new lights; None keeps the room's own. Edits of lamps leave the truth's layers
        as they are: those describe the room itself.

    Yields
    ------
    camera, (H, W, 3) float32 radiance, ground truth
    """
    maps = DeviceMaps(room.materials)
    change = changed(room, setup)
    tracer = render_tracer(room, setup, settings.max_depth, maps, change)
    truth = Truth(room, area_lights(setup), maps, change if setup else None)
    for camera in cameras:
        known = view_truth(truth, camera)
        image = tracer.render(camera, settings.spp, path_seed(settings.seed, camera.name))
        if settings.denoise:
            image = denoise(image, albedo=known.guides["albedo"], normal=known.guides["normal"])
        yield camera, image, known


def render_probes(room: SyntheticRoom, cameras: Sequence[Camera], settings: SynthesizeSettings) -> Iterator[np.ndarray]:
    """Yield small noisy pictures (h, w, 3) of at most `_PROBES` of the cameras, spread over them."""
    tracer = render_tracer(room, None, settings.max_depth)
    for camera in cameras[:: -(-len(cameras) // _PROBES)]:
        scale = min(_PROBE_WIDTH / camera.width, 1.0)
        small = replace(
            camera, width=max(round(camera.width * scale), 1), height=max(round(camera.height * scale), 1),
            fx=camera.fx * scale, fy=camera.fy * scale, cx=camera.cx * scale, cy=camera.cy * scale,
        )  # fmt: skip
        yield tracer.render(small, _PROBE_SPP, path_seed(settings.seed, f"probe {camera.name}"))
