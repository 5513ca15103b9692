"""Setups in the relight stage against Mitsuba's own lights, BSDF and integrator: objects, spots, edits, what vanishes.

A small room has one material and one emitter; both renderers get the same setup, and their images must agree.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from fipt.model.networks import Brdf
from fipt.scene.emitters import FRONT, Emitters
from fipt.scene.environment import NOTHING
from fipt.scene.mesh import connected_parts, write_ply
from fipt.scene.setup import RelightSetup
from fipt.stages.cache.settings import CacheSettings
from fipt.stages.samples.settings import SamplesSettings
from fipt.synthetic.material import RoomMaterial
from fipt.synthetic.room import RoomPiece, assemble
from tests import scenes
from tests.objects import write_cube_glb

GREY = (0.6, 0.55, 0.5)
WIDTH, HEIGHT, BLOCK = 24, 16, 4
EMITTER = (6.0, 5.0, 4.0)


def room():
    """Walls, a block that stands on the floor, an emitter below the ceiling."""
    block = scenes.turned(scenes.box((-0.75, -0.96875, -0.625), (-0.25, -0.5, -0.125)))
    emitter = scenes.emitter_quad((-0.3, 0.3), 0.95, (-0.3, 0.3))
    pieces = [
        RoomPiece(name, mesh.vertices, mesh.triangles, np.zeros((len(mesh.vertices), 2)), 0, 0, light)
        for name, mesh, light in (
            ("walls", scenes.box((-1, -1, -1), (1, 1, 1)), None),
            ("block", block, None),
            ("emitter", emitter, EMITTER),
        )
    ]
    one = np.ones((1, 1), np.float32)
    material = RoomMaterial("grey", np.float32([[GREY]]), 0.5 * one, 0 * one)
    return assemble(pieces, [material], ["grey"], np.array([[-1, -1, -1], [1, 1, 1]]))


class Grey:
    """A field of one material."""

    settings = SimpleNamespace(footprint=1.0)

    def place(self, points, normals):
        return points

    def query(self, points, footprint, triangle=None):
        n = len(points)
        return Brdf(np.tile(np.float32(GREY), (n, 1)), np.full(n, 0.5, np.float32), np.zeros(n, np.float32))

    def finest_at(self, points):
        return np.zeros(len(points), np.float32)


CAMERA = scenes.look_at("a", (0.75, 0.3, 0.9), (-0.2, -0.6, -0.3), width=WIDTH, height=HEIGHT, focal=16.0)


def emitters(made):
    (emitter,) = made.emitters
    ones = np.ones(len(emitter), np.float32)
    return Emitters(
        emitter.astype(np.int32), made.radiance[emitter], made.mesh.areas[emitter].astype(np.float32),
        0 * emitter.astype(np.int32), ones, ones, 0 * ones, ones > 1, np.full(len(emitter), FRONT, np.int8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def known(backend):
    """The room and its voxels."""
    from fipt.stages.cache.build import build

    made = room()
    # the voxels lie around what views see: these see the whole room
    around = [scenes.look_at("a", (x, 0, z), (-x, -x / 2, -z)) for x in (-0.9, 0.9) for z in (-0.9, 0.9)]
    samples = [traced(made.mesh, camera) for camera in around]
    dark = np.zeros((around[0].width * around[0].height, 3), np.float32)
    image = (dark, dark[:, 0] + 1, dark[:, 0] > 1)
    voxels = build(made.mesh, samples, [image] * len(samples), CacheSettings(resolution=32))
    return SimpleNamespace(room=made, voxels=voxels)


def traced(mesh, camera=CAMERA):
    from fipt.render.footprint import joined, trace_view
    from fipt.render.scene import RayScene

    return joined([camera], [trace_view(RayScene(mesh), connected_parts(mesh), camera, SamplesSettings(grid=5))])


def ours(known, setup, spp=512, depth=5):
    """The image of the relight stage, without denoising; what the pixels' centres see and its materials."""
    from fipt.model.fitted import FittedScene
    from fipt.render.image import ImageSampling, render_images, trace_pixels
    from fipt.stages.render.changes import change
    from fipt.stages.render.lights import Illumination, apply_setup
    from fipt.stages.render.views import StagedScene

    setup = RelightSetup.model_validate(setup)
    mesh, lit = apply_setup(known.room.mesh, emitters(known.room), setup)
    mesh, lit, changes = change(known.room.mesh, mesh, lit, setup, None, NOTHING)
    fitted = FittedScene(known.room.mesh, Grey(), cache=known.voxels)
    scene = StagedScene(fitted, mesh, {"": Illumination(lit, NOTHING)}, changes)
    (room,) = scene.lit_rooms(depth)
    sampling = ImageSampling(5, spp, denoise=False, seed=0)
    (image,) = render_images([room], CAMERA, scene.materials, sampling, lambda done: None, changes.smooth)
    si = changes.smooth(trace_pixels(room.shader.scene, CAMERA, np.array([0.5, 0.5]))[0])
    assert len(si.pixel) == WIDTH * HEIGHT  # the room is closed
    return image, si, scene.materials(si)


def theirs(known, setup, spp=512, depth=5):
    from fipt.synthetic.views import render_tracer

    return render_tracer(known.room, RelightSetup.model_validate(setup), depth).render(CAMERA, spp, 1)


def assert_alike(a, b, mean=0.02, each=0.08):
    """Images agree: in the mean, and block by block, where 16 pixels have averaged most noise away."""

    def blocks(image):
        return image.reshape(HEIGHT // BLOCK, BLOCK, WIDTH // BLOCK, BLOCK, 3).mean(axis=(1, 3))

    a, b = blocks(a.astype(float)), blocks(b.astype(float))
    assert np.abs(a.mean(axis=(0, 1)) / b.mean(axis=(0, 1)) - 1).max() < mean
    away = np.abs(a - b) / (b + b.mean())
    assert away.max() < each, away.max()


NIGHT = [{"scale": 0}]
RED_CUBE = {
    "shape": "cube", "size": 0.5, "position": [0.3, 0.2, -0.3], "rotation": [0, 30, 0], "drop": True,
    "base_color": [0.8, 0.02, 0.02], "roughness": 0.8,
}  # fmt: skip
SPOT = {
    "shape": "spot", "position": [-0.5, 0.8, 0.6], "target": [0.2, -1, -0.3], "cone_angle": 60, "soft_edge": 12,
    "intensity": [4, 3, 2],
}  # fmt: skip


def test_a_spot_a_red_object_and_a_block_that_is_gone(known):
    setup = {"emitters": NIGHT, "lights": [SPOT], "objects": [RED_CUBE], "remove": [{"at": [-0.5, -0.45, -0.375]}]}
    image, samples, _ = ours(known, setup)
    assert_alike(image, theirs(known, setup))
    assert not np.isin(samples.triangle, np.arange(12, 24)).any()  # the block's triangles
    assert (samples.triangle >= len(known.room.mesh.triangles)).any()
    # the object tints what it stands on: the same without its red
    grey = ours(known, setup | {"objects": [RED_CUBE | {"base_color": [0.4, 0.4, 0.4]}]})[0]
    walls = samples.triangle < 12
    ratio = (image / grey).reshape(-1, 3)[walls]
    assert np.median(ratio[:, 0]) > 1.02 * np.median(ratio[:, 1])


def test_a_metal_sphere_a_mesh_light_and_edited_materials(known, tmp_path):
    write_ply(tmp_path / "light.ply", scenes.turned(scenes.box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1))))
    setup = {
        "emitters": [{"color": [1, 0.6, 0.3], "scale": 0.5}],
        "lights": [
            {"shape": "mesh", "file": str(tmp_path / "light.ply"), "position": [-0.6, 0, 0.1], "rotation": [0, 45, 20],
             "radiance": [0.5, 1, 4]},
        ],
        "objects": [
            {"shape": "sphere", "size": 0.6, "position": [0.3, 0.5, -0.3], "drop": True, "base_color": [0.9, 0.8, 0.6],
             "roughness": 0.6, "metallic": 1.0},
        ],
        "materials": [
            {"at": [-0.24, -0.6, -0.375], "base_color": [0.1, 0.3, 0.8], "roughness": 0.3, "metallic": 0.5},
            {"box": {"center": [0, -1, 0.2], "size": [0.9, 0.1, 0.5], "rotation": 30}, "tint": [0.2, 1.2, 0.2]},
        ],
    }  # fmt: skip
    image, samples, brdf = ours(known, setup)
    assert_alike(image, theirs(known, setup), mean=0.03)
    block = np.isin(samples.triangle, np.arange(12, 24))
    np.testing.assert_allclose(brdf.base_color[block], np.tile([0.1, 0.3, 0.8], (block.sum(), 1)), rtol=1e-5)
    np.testing.assert_allclose(brdf.metallic[block], 0.5, rtol=1e-5)
    ball = samples.triangle >= samples.triangle.max() - 5000
    center = np.array([0.3, -0.7, -0.3])
    away = samples.position[ball] - center
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), 0.3, atol=2e-3)  # it has fallen to the floor
    np.testing.assert_allclose(samples.normal[ball], away / np.linalg.norm(away, axis=1, keepdims=True), atol=0.02)
    # the painted patch of the floor, counter-clockwise from above: x' = x cos + z sin
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    x, z = samples.position[:, 0], samples.position[:, 2] - 0.2
    inside = (np.abs(c * x - s * z) < 0.36) & (np.abs(s * x + c * z) < 0.16) & (samples.position[:, 1] < -0.99)
    inside &= samples.triangle < 12
    assert inside.sum() > 5
    np.testing.assert_allclose(
        brdf.base_color[inside], np.tile(np.minimum(np.array(GREY) * [0.2, 1.2, 0.2], 1), (inside.sum(), 1)), atol=0.02
    )


def test_a_textured_object_from_a_file(known, tmp_path):
    cube = {"file": str(write_cube_glb(tmp_path / "cube.glb")), "position": [0.2, 0, -0.1], "rotation": [0, 25, 0]}
    setup = {"objects": [cube | {"scale": 0.6, "drop": True}], "remove": [{"segment": 1}]}
    image, _, brdf = ours(known, setup)
    assert_alike(image, theirs(known, setup))
    assert len(np.unique(brdf.base_color.round(2), axis=0)) >= 4  # the room's and three of the image's


def test_a_box_takes_out_what_it_holds(known):
    setup = {"remove": [{"box": {"center": [-0.5, -0.7, -0.4], "size": [0.8, 0.8, 0.8]}}]}
    image, samples, _ = ours(known, setup, spp=128)
    assert_alike(image, theirs(known, setup, spp=256))
    assert not np.isin(samples.triangle, np.arange(12, 24)).any()


# --- spots --------------------------------------------------------------------------------------


def spot_shading(points, spots, wo=(0, 1, 0), roughness=0.4, mesh=None):
    """Ld and Ls0, Ls1 on a floor that nothing but spots lights."""
    from fipt.render.points import Points, random_keys
    from fipt.render.scene import RayScene
    from fipt.render.surface import SurfaceCache, Triangles
    from fipt.render.tracer import PathSettings, Shader

    mesh, voxels, n = mesh or scenes.floor(), scenes.grid(side=9.0), len(points)
    materials = scenes.sides(voxels, scenes.DIFFUSE, scenes.DIFFUSE)
    surface = SurfaceCache(voxels, voxels["radiance"], np.zeros(8, bool), materials)
    shader = Shader(
        RayScene(mesh), Triangles(mesh, None), surface, PathSettings(3, 1.0, light_at_first=True), spots=spots
    )
    wo = np.asarray(wo, float) / np.linalg.norm(wo)
    normal, wo = (np.tile(np.float32(v), (n, 1)) for v in ((0, 1, 0), wo))
    keys = random_keys("a", np.arange(n), np.zeros(n, int), 0)
    return shader.shade(Points(np.float32(points), normal, wo, keys), [roughness], [3, 3])


def spot(**keys):
    from fipt.render.spots import spots_of
    from fipt.scene.setup import SpotLight

    return spots_of([SpotLight(shape="spot", **keys)])


def test_a_spot_on_a_floor_has_its_closed_form(backend):
    """I falloff cos / d^2 / pi, whatever the number of samples; linear in the angle at the edge; none behind a wall."""
    height = 1.5
    emitter = spot(position=[0, height, 0], direction=[0, -1, 0], cone_angle=80, soft_edge=20, intensity=[3, 6, 9])
    x = np.linspace(0, 2.5, 40)
    points = np.stack([x, 0 * x, 0.3 * x], axis=1)
    radius = np.hypot(points[:, 0], points[:, 2])
    angle, distance2 = np.degrees(np.arctan2(radius, height)), radius**2 + height**2
    falloff = np.clip((40 - angle) / 20, 0, 1)
    expected = falloff * height / distance2**1.5 / np.pi
    got = spot_shading(points, emitter)
    np.testing.assert_allclose(got[:, 0], expected[:, None] * [3, 6, 9], rtol=5e-3, atol=1e-5)
    assert (falloff > 0).any()
    assert (falloff == 0).any()
    shade = scenes.joined(scenes.floor(), scenes.quad((-9, 1, -9), (18, 0, 0), (0, 0, 18)))
    assert not spot_shading(points, emitter, mesh=shade).any()


def test_two_spots_add_up_and_aim_at_their_targets(backend):
    a = {"position": [0.5, 1, 0], "cone_angle": 50, "soft_edge": 5, "intensity": [1, 2, 3]}
    points = np.float32([[0, 0, 0], [0.2, 0, 0.1], [0.5, 0, 0]])
    one, two = spot(**a, target=[0, 0, 0]), spot(**a, direction=[0, -2, 0])
    np.testing.assert_allclose(spot(**a, direction=[-1, -2, 0])[0].direction, one[0].direction)
    single = spot_shading(points, one), spot_shading(points, two)
    np.testing.assert_allclose(spot_shading(points, [*one, *two]), single[0] + single[1], rtol=1e-5, atol=1e-7)


def test_the_falloff_is_mitsubas(backend):
    import mitsuba as mi

    from fipt.render.reference import _spot

    (emitter,) = spot(position=[0.3, 1.2, -0.4], target=[1, 0, 0.2], cone_angle=70, soft_edge=15, intensity=[3, 2, 1])
    rng = np.random.default_rng(5)
    origin = rng.uniform(-1, 1, (500, 3)) * (1, 0.5, 1)
    points = mi.Point3f(*(mi.Float(np.float32(c)) for c in origin.T))
    got, wl, distance = emitter.at(points)
    si = mi.SurfaceInteraction3f()
    si.p = points
    direction, weight = mi.load_dict(_spot(emitter)).sample_direction(si, mi.Point2f(0.5))
    assert (np.array(weight) > 0).any()
    np.testing.assert_allclose(np.array(got), np.array(weight), rtol=2e-3, atol=1e-5)
    np.testing.assert_allclose(np.array(wl), np.array(direction.d), atol=1e-5)
    np.testing.assert_allclose(np.array(distance), np.array(direction.dist), rtol=1e-5)
