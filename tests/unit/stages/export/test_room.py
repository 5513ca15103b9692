"""From the fit to the asset: the world turned upright, emitters apart, textures averaged, cameras for COLMAP."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fipt.meshing.atlas import texels, unwrap
from fipt.model.networks import Brdf, SceneBox
from fipt.scene.confidence import Confidence
from fipt.scene.emitters import BACK, BOTH, FRONT, Emitters, default_name
from fipt.scene.environment import NOTHING, EnvironmentMap, texel_directions
from fipt.stages.export.cameras import write_colmap
from fipt.stages.export.room import mesh_name, room_asset, upright
from fipt.stages.export.textures import confidence_texture, coverage, emission_texture, surface_brdf, surface_textures
from tests import assets, scenes


def emitters(triangle, radiance, emitter) -> Emitters:
    n = len(triangle)
    rest = [np.ones(n, kind) for kind in (np.float32, np.int32)]
    emit = np.asarray(radiance, np.float32).reshape(n, 3)
    numbers = np.asarray(triangle, np.int32), np.asarray(emitter, np.int32)
    return Emitters(numbers[0], emit, rest[0], numbers[1], rest[1], rest[0], rest[0], rest[0] < 0)


@pytest.fixture(scope="module")
def box():
    mesh = scenes.box((0, 0, 0), (2, 1, 1.5))
    groups = np.zeros(12, int)
    groups[:3] = 1
    atlas = unwrap(mesh, groups, 40.0, 2, 4096)
    return mesh, atlas, texels(atlas), emitters([0, 1, 2], [[4, 3, 2]] * 2 + [[1, 0, 0]], [0, 0, 0])


class Everywhere:
    """A field whose base colour is the position, and that notes what it is asked."""

    box = SceneBox((1.0, 0.5, 0.75), 2.1)

    def __init__(self):
        self.asked, self.normals = [], []

    def place(self, points, normals):
        self.normals.append(normals)
        return points

    def query(self, points, footprint):
        self.asked.append((points, footprint))
        unit = points / [2, 1, 1.5]
        return Brdf(unit.astype(np.float32), np.full(len(points), 0.5, np.float32), np.full(len(points), 0.25))


def one_pixel(footprint, normal):
    """A view of one pixel, on triangle 0, with this normal (3,) to the viewer."""
    place, triangle = np.float32([[0.1, 0.1, 0.1]]), np.zeros(1, np.int32)
    width = np.float32([footprint])
    return SimpleNamespace(position=place, footprint=width, normal=np.float32([normal]), triangle=triangle)


@pytest.mark.parametrize("side", [1, -1])
def test_texels_are_of_the_side_that_views_see(box, side):
    mesh, atlas, known, _ = box
    field = Everywhere()
    seen = coverage(field, mesh, [one_pixel(0.2, side * mesh.normals[0])])
    surface_brdf(field, mesh, atlas, known, seen, 1, 0.5)
    normals, owner = np.concatenate(field.normals), known.triangle
    np.testing.assert_array_equal(normals, side * mesh.normals[owner], "what no pixel shows is wound alike")


def test_most_pixels_tell_the_side(box):
    mesh = box[0]
    views = [one_pixel(0.2, sign * mesh.normals[0]) for sign in (-1, 1, -1)]
    np.testing.assert_array_equal(coverage(Everywhere(), mesh, views).normals[0], -mesh.normals[0])


def test_texels_are_means_of_what_the_model_says_there(box):
    mesh, atlas, known, _ = box
    field = Everywhere()
    shard = one_pixel(0.2, mesh.normals[0])
    brdf = surface_brdf(field, mesh, atlas, known, coverage(field, mesh, [shard]), 3, 0.5)
    own = np.einsum("nk,nkd->nd", known.weights, mesh.corners[known.triangle]) / [2, 1, 1.5]
    # at most half a texel off, which is where a texel reaches over an edge
    assert np.abs(brdf.base_color - own).max() < 0.5 / 40 + 1e-4
    assert np.abs(brdf.base_color - own).mean() < 2e-3
    assert sum(len(points) for points, _ in field.asked) == 9 * len(known.index)
    # everywhere as wide as the only pixel, times the fit's scale
    assert {float(f) for _, footprint in field.asked for f in np.unique(footprint)} == {np.float32(0.1)}


def test_no_query_is_finer_than_a_texel(box):
    mesh, atlas, known, _ = box
    field = Everywhere()
    shard = one_pixel(0.001, mesh.normals[0])
    surface_brdf(field, mesh, atlas, known, coverage(field, mesh, [shard]), 1, 0.5)
    np.testing.assert_allclose(field.asked[0][1], 0.5 / 40)


def test_lamps_are_black_in_the_textures_and_bright_in_the_emission(box):
    _, atlas, known, found = box
    n = len(known.index)
    brdf = Brdf(np.full((n, 3), 0.5), np.full(n, 0.3), np.full(n, 1.0))
    textures = surface_textures(brdf, found, atlas, known)
    emission = emission_texture(found, atlas, known)
    emitter = np.zeros(atlas.height * atlas.width, bool)
    emitter[known.index[np.isin(known.triangle, found.triangle)]] = True
    other = np.zeros_like(emitter)
    other[known.index] = True
    other &= ~emitter
    flat = textures.base_color.reshape(-1, 3)
    assert (flat[emitter] == 0).all()
    assert (flat[other] == 188).all()  # 0.5, sRGB encoded
    assert set(textures.roughness.ravel()[emitter]) == {255}
    assert set(textures.metallic.ravel()[other]) == {255}
    assert (emission.reshape(-1, 3)[other] == 0).all()
    assert emission.max() == 4
    assert emission.shape == (atlas.height, atlas.width, 3)


def predicted(record) -> Confidence:
    """An error of 30 dB in the records (K,) of a box of one voxel: confidence 0.8."""
    count = len(record)
    errors = np.full(count, 10**-1.5), np.zeros(count), np.zeros(count)
    return Confidence(np.array([1.0, 0.5, 0.75]), 2.1, 1, record, *errors, np.ones(count, bool), np.zeros(3))


def test_confidence_is_that_of_the_better_seen_side(box):
    mesh, atlas, known, _ = box
    confidence = predicted(np.arange(6))
    one = confidence_texture(confidence, mesh, atlas, known)
    assert set(one.ravel()) == {204}
    # facing +x only: walls at both ends, whichever way their winding faces
    facing = predicted(np.array([1]))
    texture = confidence_texture(facing, mesh, atlas, known).ravel()[known.index]
    along_x = np.abs(mesh.normals[known.triangle][:, 0]) > 0.5
    assert set(texture[along_x]) == {204}
    assert set(texture[~along_x]) == {0}


def looking(up) -> list:
    pose = np.eye(4)
    right = np.cross(up, np.roll(up, 1))
    pose[:3, :3] = np.stack([right, up, np.cross(right, up)], axis=1)
    camera = assets.camera()
    return [type(camera)(**{**vars(camera), "world_from_camera": pose})]


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0)])
def test_the_world_is_turned_upright_and_pictures_stay(box, up):
    mesh, atlas, _, found = box
    cameras = looking(np.array(up, float))
    turn = upright(cameras)
    np.testing.assert_allclose(turn @ up, [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    sky = EnvironmentMap("map", np.random.default_rng(0).random((16, 32, 3)).astype(np.float32), "z", 30.0)
    asset = room_asset("room", mesh, atlas, assets.textures(), found, cameras, sky)
    # what a camera sees of a point, and of the outside, is what it saw
    before, _ = cameras[0].project(mesh.vertices)
    after, _ = asset.cameras[0].project(mesh.vertices @ turn.T)
    np.testing.assert_allclose(after, before, rtol=1e-6)
    directions = texel_directions(8, 16)
    difference = asset.outside.lookup(directions @ turn.T) - sky.lookup(directions)
    assert np.abs(difference).max() < 0.05
    assert (asset.outside.up, asset.outside.rotation) == ("y", 0)


def test_a_world_with_y_up_stays_as_it_is():
    np.testing.assert_array_equal(upright(looking(np.array([0.1, 0.9, -0.2]))), np.eye(3))


def test_every_lamp_is_a_mesh_of_one_radiance(box):
    mesh, atlas, _, found = box
    asset = room_asset("room", mesh, atlas, assets.textures(), found, [assets.camera()], NOTHING)
    assert [emitter.name for emitter in asset.emitters] == ["emitter_0_0", "emitter_0_1"]
    assert [emitter.radiance.tolist() for emitter in asset.emitters] == [[1, 0, 0], [4, 3, 2]]
    corners = [piece.mesh.corners for piece in (*asset.emitters, asset.surface)]
    assert [len(part) for part in corners] == [1, 2, 9]
    np.testing.assert_allclose(np.concatenate([corners[1], corners[0], corners[2]]), mesh.corners)


def test_meshes_of_lamps_face_where_they_shine(box):
    mesh, atlas, _, found = box
    found = replace(found, sides=np.int8([FRONT, BACK, BOTH]))
    asset = room_asset("room", mesh, atlas, assets.textures(), found, [assets.camera()], NOTHING)
    assert [emitter.two_sided for emitter in asset.emitters] == [True, False, False]
    normals = np.concatenate([emitter.mesh.normals for emitter in asset.emitters])
    np.testing.assert_allclose(normals, mesh.normals[[2, 0, 1]] * [[1], [1], [-1]], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (default_name(3), "emitter_3"),
        ("desk lamp", "emitter_3_desk_lamp"),
        ("../Ätna</a>", "emitter_3_tna_a"),
        ("灯", "emitter_3"),
    ],
)
def test_meshes_of_emitters_have_plain_names(name, expected):
    assert mesh_name(3, name) == expected


def test_emitters_carry_the_names_that_people_gave(box):
    mesh, atlas, _, found = box
    views = assets.textures(), found, [assets.camera()], NOTHING
    asset = room_asset("room", mesh, atlas, *views, ["desk lamp"])
    assert [emitter.name for emitter in asset.emitters] == ["emitter_0_desk_lamp_0", "emitter_0_desk_lamp_1"]


def test_colmap_projects_as_our_cameras_do(tmp_path):
    cameras = [assets.camera("a"), assets.camera("b", 0.7, cx=13.0, cy=14.5, fy=30.0)]
    write_colmap(tmp_path, cameras)
    rows = [line.split() for line in (tmp_path / "cameras.txt").read_text().splitlines() if line[0] != "#"]
    models = {row[0]: row[1:] for row in rows}
    lines = [line for line in (tmp_path / "images.txt").read_text().split("\n") if not line.startswith("#")]
    points = np.random.default_rng(0).uniform((-1, 0, -2), (1, 2, 0), (20, 3))
    for camera, line in zip(cameras, lines[::2], strict=False):
        _, *pose, model, name = line.split()
        assert name == f"{camera.name}.exr"
        w, x, y, z, *t = map(float, pose)
        local = Rotation.from_quat([x, y, z, w]).apply(points) + t  # x right, y down, z ahead
        kind, width, height, fx, fy, cx, cy = models[model]
        assert (kind, int(width), int(height)) == ("PINHOLE", camera.width, camera.height)
        pixel = local[:, :2] / local[:, 2:] * [float(fx), float(fy)] + [float(cx), float(cy)]
        np.testing.assert_allclose(pixel, camera.project(points)[0], atol=1e-9)
    assert lines[1::2][:2] == ["", ""]  # images without points
