"""Rendered views, their truth, and the dataset that holds them."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.ndimage import binary_dilation, binary_erosion

from fipt.cli.main import main
from fipt.errors import FiptError
from fipt.formats.exr import read_rgb
from fipt.formats.manifests import read_manifest
from fipt.model.albedo import reflectance
from fipt.scene.cameras import Camera
from fipt.scene.dataset import Dataset
from fipt.scene.mesh import Mesh, write_ply
from fipt.scene.setup import EmitterEdit, QuadLight, RelightSetup, SphereLight, parse_setup
from fipt.synthetic.room import build
from fipt.synthetic.settings import SynthesizeSettings
from tests import scenes
from tests.objects import write_cube_glb

TINY = {
    "train_views": 3,
    "val_views": 1,
    "width": 32,
    "height": 24,
    "spp": 8,
    "max_depth": 5,
    "denoise": False,
}
SETTINGS = SynthesizeSettings(**TINY)
KINDS = [
    ("images", "exr"),
    ("truth", "exr"),
    ("segments/part", "png"),
    ("segments/semantic", "png"),
]


@pytest.fixture(scope="module")
def views(backend):
    from fipt.synthetic import views

    return views


@pytest.fixture(scope="module")
def folder(backend, tmp_path_factory):
    """A dataset of two shards."""
    root = tmp_path_factory.mktemp("dataset")
    settings = json.dumps(TINY)
    assert main(["synthesize-room", "--dataset", str(root), "--settings", settings]) == 0
    for shard, names in {"train-000": "train_000,train_001", "val-000": "val_000"}.items():
        manifest = str(root / f"images.{shard}.manifest.json")
        assert main([
            "synthesize-views", "--dataset", str(root), "--views", names,
            "--settings", settings, "--manifest", manifest,
        ]) == 0  # fmt: skip
    return root


def looking(eye, target, width=32, height=24, fov=70.0) -> Camera:
    back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    right = np.cross((0, 1, 0), back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    focal = width / 2 / np.tan(np.radians(fov) / 2)
    return Camera("test", "val", width, height, focal, focal, width / 2, height / 2, pose)


def test_dataset_is_complete_and_readable(folder):
    dataset = Dataset(folder)
    assert dataset.views("train") == ["train_000", "train_001", "train_002"]
    assert len(dataset.mesh().triangles) == len(build(0).mesh.triangles)
    np.testing.assert_array_equal(dataset.mesh().vertices, build(0).mesh.vertices)
    np.testing.assert_array_equal(dataset.mesh().triangles, build(0).mesh.triangles)
    names = json.loads((folder / "segments" / "part.json").read_text())
    for view in ("train_000", "train_001", "val_000"):
        radiance, valid = dataset.image(view)
        assert valid.all()
        assert radiance.max() > 0
        ids = dataset.segments(view, "part")
        assert {str(i) for i in np.unique(ids)} <= set(names)
        assert set(dataset.truth(view)) == {
            "kd", "base_color", "reflectance", "emission", "roughness", "metallic", "emission_mask"
        }  # fmt: skip
    files = read_manifest(folder / "images.train-000.manifest.json", "synthesize")["files"]
    assert sorted(files) == sorted(
        f"{kind}/{view}.{ending}"
        for view in ("train_000", "train_001")
        for kind, ending in KINDS
    )  # fmt: skip


def test_truth_is_the_material_of_the_room(folder):
    dataset, room = Dataset(folder), build(0)
    for view in ("train_000", "train_001", "val_000"):
        truth, part = dataset.truth(view), dataset.segments(view, "part")
        for index in np.unique(part):
            known = room.materials[room.material[room.part == index][0]]
            here = part == index
            assert np.allclose(truth["roughness"][here], known.roughness)
            assert np.allclose(truth["metallic"][here], known.metallic)
            assert (truth["emission_mask"][here] == room.emits[room.part == index].any()).all()
            if known.base_color.size == 3:
                color = np.tile(known.base_color.ravel(), (here.sum(), 1))
                np.testing.assert_allclose(truth["base_color"][here], color, atol=2e-6)
        np.testing.assert_allclose(truth["kd"], truth["base_color"] * (1 - truth["metallic"][..., None]), atol=1e-6)
        emits = truth["emission_mask"] > 0
        assert not truth["reflectance"][emits].any()
        assert (truth["reflectance"][~emits] > truth["kd"][~emits]).all()


def test_reflectance_uses_the_angle_to_the_camera(views):
    camera = looking((2.5, 1.4, 2.0), (2.5, 0.0, 2.01))
    known = views.view_truth(views.Truth(build(0)), camera)
    layers = known.layers
    columns, rows = np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5)
    cos = -camera.directions(columns, rows)[..., 1]
    flat = known.ids["semantic"] == 7  # the rug
    expected = reflectance(layers["base_color"], layers["roughness.Y"], layers["metallic.Y"], cos)
    assert flat.mean() > 0.3
    top = flat & (np.abs(known.guides["normal"][..., 1] - 1) < 1e-4)
    np.testing.assert_allclose(layers["reflectance"][top], expected[top], atol=1e-4)


def test_texture_is_where_the_room_puts_it(views):
    """The floor's colour, looked up by hand from the texture."""
    room = build(0)
    floor = next(material for material in room.materials if material.name == "floor")
    x, z = np.float32([2.9, 4.3, 4.1]), np.float32([3.62, 2.1, 3.2])
    origins = np.stack([x, 0 * x + 0.05, z], axis=1)
    found = views.Truth(room).trace(origins, np.tile(np.float32([0, -1, 0]), (3, 1)))
    assert {room.parts[i - 1] for i in found["part"]} == {"floor"}
    height, width = floor.base_color.shape[:2]
    u, v = x / 5.0 * (width - 1), z / 4.0 * (height - 1)
    for k in range(3):
        j, i = int(u[k]), int(v[k])
        fu, fv = u[k] - j, v[k] - i
        block = floor.base_color[i : i + 2, j : j + 2]
        expected = (block[0, 0] * (1 - fu) + block[0, 1] * fu) * (1 - fv) + (
            block[1, 0] * (1 - fu) + block[1, 1] * fu
        ) * fv
        np.testing.assert_allclose(found["base_color"][k], expected, atol=5e-3)


def test_renderer_and_truth_agree_on_emission(views):
    """Seen head on, a lamp's pixels hold its radiance exactly: it absorbs what falls on it."""
    room = build(0)
    camera = looking((1.4, 1.3, 1.5), (1.4, 1.3, -0.18), fov=20.0)
    image = views.render_tracer(room, None, 3).render(camera, 4, 1)
    emission = views.view_truth(views.Truth(room), camera).layers["emission"]
    inside = np.zeros((24, 32), bool)
    inside[8:16, 8:24] = True
    assert emission[inside].any(axis=-1).all()
    np.testing.assert_allclose(image[inside], emission[inside], rtol=1e-5)


def test_renderer_and_truth_look_through_the_same_camera(views):
    """Lamps far from the picture's centre, with an off-centre principal point: emission only."""
    room = build(0)
    camera = replace(looking((3.3, 1.3, 3.0), (3.9, 1.9, 1.0), 64, 48), cx=26.0, cy=29.0)
    truth = views.view_truth(views.Truth(room), camera)
    emission, mask = truth.layers["emission"], truth.layers["emission_mask.Y"] > 0
    image = views.render_tracer(room, None, 0).render(camera, 16, 1)
    names = {room.parts[i - 1] for i in np.unique(truth.ids["part"][mask])}
    assert len(names) >= 2
    inner = binary_erosion(mask, np.ones((3, 3)))
    outer = ~binary_dilation(mask, np.ones((3, 3)))
    assert inner.sum() > 20
    np.testing.assert_allclose(image[inner], emission[inner], rtol=1e-5)
    assert not image[outer].any()


def test_every_view_has_its_own_noise(views):
    seeds = [views.path_seed(seed, view) for seed in (0, 1) for view in ("train_000", "val_000")]
    assert len(set(seeds)) == 4


def test_pictures_do_not_depend_on_the_shard(views, folder):
    cameras = [Dataset(folder).camera(name) for name in ("train_001", "val_000")]
    alone = [next(iter(views.render_views(build(0), [camera], SETTINGS)))[1] for camera in cameras]
    together = [image for _, image, _ in views.render_views(build(0), cameras[::-1], SETTINGS)][::-1]
    for first, second, camera in zip(alone, together, cameras, strict=True):
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(first, read_rgb(folder / "images" / f"{camera.name}.exr"))


def test_splitting_the_paths_keeps_the_mean(views, monkeypatch):
    from fipt.render import reference

    camera = looking((4.0, 1.5, 3.3), (1.2, 0.8, 1.0))
    tracer = views.render_tracer(build(0), None, 2)
    whole = tracer.render(camera, 48, 5)
    monkeypatch.setattr(reference, "_MAX_LANES", 32 * 24 * 20)
    parts = tracer.render(camera, 48, 5)
    assert np.median(parts) == pytest.approx(np.median(whole), rel=0.1)


@pytest.mark.parametrize("most", [1, 20, 64, 1000])
def test_paths_are_split_into_squares(views, most):
    from fipt.render.reference import _squares

    for paths in (1, 2, 3, 63, 64, 65, 96, 1000):
        counts = _squares(paths, most)
        assert sum(counts) == paths
        assert max(counts) <= most
        assert all(math.isqrt(count) ** 2 == count for count in counts)


def test_paths_of_a_pixel_are_stratified(views):
    """A lamp ends in the middle of a column of pixels: 64 independent paths would tell its share to 1/16."""
    from fipt.render import reference
    from fipt.render.texels import DeviceMaps

    corners = np.array([[-5, -5, -1], [0, -5, -1], [0, 5, -1], [-5, 5, -1]], np.float32)
    lamp = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    none = np.zeros((0, 3))
    room = reference.MappedMesh(
        Mesh(none.astype(np.float32), none.astype(np.int32)), none[:, :2], DeviceMaps(build(0).materials), none[:, 0]
    )
    scene = reference.load_scene(room, [reference.EmittingMesh(lamp, np.ones(3))])
    camera = looking((0, 0, 0), (0, 0, -1), width=31)
    image = reference.PathTracer(scene, 2).render(camera, 64, 3)[:, 15, 0]
    assert image.mean() == pytest.approx(0.5, abs=0.01)
    assert image.std() < 0.03


# --- an open window -----------------------------------------------------------------------------


def test_through_the_open_window_the_sky_is_seen(views):
    from fipt.synthetic.sky import sky

    settings = SETTINGS.model_copy(update={"opening": True, "denoise": False, "spp": 32, "max_depth": 1})
    room = build(0, True)
    closed = build(0)
    assert list(room.parts) == [name for name in closed.parts if name != "window pane"]
    camera = looking((1.4, 1.3, 1.5), (1.4, 1.35, -0.18), fov=20.0)
    ((_, image, truth),) = views.render_views(room, [camera], settings)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    outside = sky(settings.sky).lookup(camera.directions(columns + 0.5, rows + 0.5).reshape(-1, 3))
    inside = np.zeros((24, 32), bool)
    inside[10:14, 10:22] = True
    assert not truth.ids["part"][inside].any()
    assert not truth.layers["emission_mask.Y"][inside].any()
    np.testing.assert_allclose(image[inside], outside.reshape(24, 32, 3)[inside], rtol=0.05)
    for edit, factor in (({"scale": 0.5}, 0.5), ({"scale": 0}, 0)):
        setup = RelightSetup(environment=edit)
        ((_, relit, _),) = views.render_views(room, [camera], settings, setup)
        np.testing.assert_allclose(relit[inside], factor * image[inside], rtol=0.05)
    # the sky lights the room; its two halves differ, so that a turned map would show
    assert outside[:, 1].max() > 1.05 * outside[:, 1].min()


# --- light setups -----------------------------------------------------------------------------


def test_edits_change_the_lamps(views):
    room = build(0)
    before = [light.radiance for light in views.lights(room)]
    setup = RelightSetup(emitters=(EmitterEdit(index=0, scale=0), EmitterEdit(index=1, color=(1, 0.5, 0.2), scale=2)))
    after = [light.radiance for light in views.lights(room, setup)]
    weights = np.array([0.2126, 0.7152, 0.0722])
    assert not after[0].any()
    assert after[1] @ weights == pytest.approx(2 * before[1] @ weights)
    np.testing.assert_allclose(after[1] / after[1][0], (1, 0.5, 0.2))
    np.testing.assert_array_equal(after[2], before[2])


@pytest.mark.parametrize("edit", [{"name": "emitter-1"}, {"name": "ceiling lamp"}, {"index": 1}])
def test_true_lamps_are_called_as_room_json_calls_their_parts(views, edit):
    room = build(0)
    after = [light.radiance for light in views.lights(room, RelightSetup(emitters=(EmitterEdit(**edit, off=True),)))]
    assert [light.any() for light in after] == [True, False, True]


def test_an_unknown_lamp_of_the_truth_lists_those_there_are(views):
    setup = RelightSetup(emitters=(EmitterEdit(name="ceiling", off=True),))
    with pytest.raises(FiptError, match="none of 3 emitters; there are ceiling lamp, "):
        views.lights(build(0), setup)


def test_light_is_linear_in_the_lamps(views):
    """All lamps doubled: the same paths carry twice the light; none: black."""
    room, camera = build(0), looking((4.0, 1.5, 3.3), (1.2, 0.8, 1.0))

    def render(*edits):
        tracer = views.render_tracer(room, RelightSetup(emitters=edits), 4)
        return tracer.render(camera, 4, 3)

    np.testing.assert_allclose(render(EmitterEdit(scale=2)), 2 * render(), rtol=1e-4)
    assert not render(EmitterEdit(scale=0)).any()


@pytest.mark.parametrize(
    "light",
    [
        QuadLight(
            shape="quad",
            radiance=(3, 2, 1),
            center=(2.5, 1.4, 2.0),
            normal=(0, 0, 1),
            size=(0.6, 0.4),
        ),
        SphereLight(shape="sphere", radiance=(3, 2, 1), center=(2.5, 1.4, 2.0), radius=0.25),
    ],
    ids=["quad", "sphere"],
)
@pytest.mark.parametrize("z", [3.4, 0.6], ids=["front", "back"])
def test_new_lights_shine_to_both_sides(views, light, z):
    room = build(0)
    setup = RelightSetup(emitters=(EmitterEdit(scale=0),), lights=(light,))
    camera = looking((2.5, 1.4, z), (2.5, 1.4, 2.0))
    image = views.render_tracer(room, setup, 3).render(camera, 16, 2)
    np.testing.assert_allclose(image[11:13, 15:17].reshape(-1, 3), [(3, 2, 1)] * 4, rtol=1e-5)
    assert (image[:3].mean(axis=(0, 1)) > 0).all()
    truth = views.Truth(room, [views.new_light(light)])
    known = views.view_truth(truth, camera)
    assert known.ids["part"][12, 16] == 0
    np.testing.assert_allclose(known.guides["albedo"][12, 16], 1, atol=1e-6)


def test_sides_of_new_quads(views):
    for normal, sides in (((0, -1, 0), (0.4, 0, 0.6)), ((0, 0, 2), (0.6, 0.4, 0))):
        light = QuadLight(shape="quad", radiance=(1, 1, 1), center=(2, 1, 2), normal=normal, size=(0.6, 0.4))
        mesh = views.new_light(light).mesh
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), sides, atol=1e-6)
        unit = np.array(normal) / np.linalg.norm(normal)
        np.testing.assert_allclose(mesh.normals, [unit, unit], atol=1e-6)
        np.testing.assert_allclose(mesh.vertices.mean(axis=0), (2, 1, 2), atol=1e-6)


def test_new_lights_are_those_of_the_relight_stage(views):
    """Both stages make their own triangles; relit views are judged by this truth."""
    from fipt.stages.render import lights as stage

    for light in (
        QuadLight(shape="quad", radiance=(1, 1, 1), center=(2, 1, 2), normal=(0.2, -1, 0.3)),
        QuadLight(shape="quad", radiance=(1, 1, 1), center=(2, 1, 2), normal=(1, 0.2, 0)),
        SphereLight(shape="sphere", radiance=(1, 1, 1), center=(2, 1, 2), radius=0.2),
    ):
        vertices, triangles = stage._geometry(light)
        mesh = views.new_light(light).mesh
        area = Mesh(vertices.astype(np.float32), triangles).areas.sum()
        assert mesh.areas.sum() == pytest.approx(area, rel=1e-4)
        ours = mesh.vertices[np.lexsort(np.round(mesh.vertices, 4).T)]
        theirs = vertices[np.lexsort(np.round(vertices, 4).T)]
        np.testing.assert_allclose(ours, theirs, atol=1e-4)


def test_relit_truth_is_written_beside_the_dataset(folder):
    setup = {"emitters": [{"scale": 0.5}]}
    manifest = folder / "relight_truth" / "dim.manifest.json"
    code = main([
        "synthesize-relit", "--dataset", str(folder), "--views", "val_000",
        "--settings", json.dumps(TINY),
        "--setup", json.dumps(setup), "--setup-name", "dim", "--manifest", str(manifest),
    ])  # fmt: skip
    assert code == 0
    relit = read_rgb(folder / "relight_truth" / "dim" / "val_000.exr")
    np.testing.assert_allclose(relit, 0.5 * read_rgb(folder / "images" / "val_000.exr"), rtol=1e-4)
    assert list(read_manifest(manifest, "synthesize")["files"]) == ["dim/val_000.exr"]


def test_the_example_of_the_documentation_fits_the_demo_room(views, tmp_path, monkeypatch, caplog):
    text = (Path(__file__).parents[3] / "docs" / "stages" / "relight.md").read_text(encoding="utf-8")
    example = yaml.safe_load(text.partition("```yaml\n")[2].partition("```")[0])["setups"]["everything"]
    write_ply(tmp_path / "ring.ply", scenes.turned(scenes.box((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1))))
    write_cube_glb(tmp_path / "chair.glb")
    monkeypatch.chdir(tmp_path)
    room, setup = build(0), parse_setup(json.dumps(example))
    change = views.changed(room, setup)
    low = [thing.mesh.vertices[:, 1].min() for thing in change.objects]
    np.testing.assert_allclose(low, 0.015, atol=2e-3)  # on the rug
    named = {room.parts[part - 1] for part in room.part[change.gone]}
    assert named == {"armchair"}
    assert {room.parts[part - 1] for part in room.part[change.edits[0].where]} == {"rug"}
    assert [record for record in caplog.records if record.levelname == "WARNING"] == []
    assert [light.mesh.areas.sum() > 0 for light in views.area_lights(setup)] == [True] * 3


# --- bad input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("verb", "arguments", "message"),
    [
        ("views", ["--views", "train_009"], "no view train_009"),
        ("views", ["--views", "train_000", "--settings", json.dumps(TINY | {"seed": 5})], "other settings"),
        ("views", ["--views", "train_000", "--settings", json.dumps(TINY | {"width": 64})], "other settings"),
        (
            "relit",
            ["--views", "train_000", "--setup", '{"lamps": []}', "--setup-name", "x"],
            "unknown key setup.lamps",
        ),
        ("relit", ["--views", "train_000", "--setup", "{}", "--setup-name", "../x"], "cannot be used"),
    ],
)
def test_bad_input_gets_one_line_and_code_2(folder, capsys, verb, arguments, message):
    if "--settings" not in arguments:
        arguments = [*arguments, "--settings", json.dumps(TINY)]
    before = sorted(folder.rglob("*"))
    assert main([f"synthesize-{verb}", "--dataset", str(folder), *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert len(error.splitlines()) == 1
    assert sorted(folder.rglob("*")) == before


def test_modules_can_be_imported_before_the_variant_is_chosen():
    code = "import fipt.synthetic.dataset, mitsuba; assert mitsuba.variant() is None"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_views_before_the_room_are_refused(backend, tmp_path, capsys):
    assert main(["synthesize-views", "--dataset", str(tmp_path), "--views", "train_000"]) == 2
    assert f"transforms.json is missing: {tmp_path}" in capsys.readouterr().err
