"""Lights: environment maps against Mitsuba's own emitters, small lamps against their intensity."""

from __future__ import annotations

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.scene.environment import solid_angles, texel_directions
from fipt.synthetic.settings import SceneFile

Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def outside(tmp_path, body: str, turn: np.ndarray | None = None, version: str = "3.0.0"):
    from fipt.synthetic.scenefile.lights import outside
    from fipt.synthetic.scenefile.source import SceneFileReader
    from fipt.synthetic.scenefile.xml import read_tree

    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="{version}">{body}</scene>')
    source = SceneFileReader(path, SceneFile())
    return outside(read_tree(path).root, np.eye(3) if turn is None else turn, source), source


@pytest.fixture
def sky(tmp_path):
    rng = np.random.default_rng(3)
    image = np.repeat(np.repeat(rng.random((8, 16, 3)), 8, axis=0), 8, axis=1).astype(np.float32)
    write_exr(tmp_path / "sky.exr", {"": image})
    return image


@pytest.mark.parametrize(
    "turn",
    [
        "",
        '<rotate y="1" angle="70"/>',
        '<matrix value="0 0 1 0 0 1 0 0 -1 0 0 0 0 0 0 1"/>',
        '<rotate x="1" angle="90"/><rotate z="1" angle="20"/>',
    ],
)
@pytest.mark.parametrize("up", ["y", "z"])
def test_environment_maps_shine_as_in_mitsuba(turn, up, tmp_path, sky, backend):
    import mitsuba as mi

    body = (
        f'<emitter type="envmap"><string name="filename" value="sky.exr"/><float name="scale" value="2"/>'
        f'<transform name="to_world">{turn}</transform></emitter>'
    )
    world = Z_UP if up == "z" else np.eye(3)
    found, _ = outside(tmp_path, body, world)
    emitter = mi.load_file(str(tmp_path / "scene.xml")).environment()
    directions = np.random.default_rng(0).standard_normal((3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    si = mi.SurfaceInteraction3f()
    si.wi = -mi.Vector3f(*(mi.Float(axis.astype(np.float32)) for axis in directions.T))
    theirs = np.array(emitter.eval(si)).T
    ours = found.lookup(directions @ world.T)
    # Texels of the two lie half a texel apart: near the borders of the blocks they differ.
    assert np.median(np.abs(ours - theirs)) < 1e-3
    assert (np.abs(ours - theirs).max(axis=1) < 0.05).mean() > 0.6
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.97


def test_constant_and_directional_light_add_up(tmp_path, backend):
    body = (
        '<emitter type="constant"><rgb name="radiance" value="0.5 0.4 0.3"/></emitter>'
        '<emitter type="directional"><vector name="direction" x="1" y="-2" z="0.5"/>'
        '<rgb name="irradiance" value="7"/></emitter>'
    )
    found, source = outside(tmp_path, body)
    weight = solid_angles(*found.radiance.shape[:2])[..., None]
    sun = ((found.radiance - np.float32([0.5, 0.4, 0.3])) * weight).sum(axis=(0, 1))
    assert np.allclose(sun, 7, rtol=0.01)
    brightest = texel_directions(*found.radiance.shape[:2])[found.radiance.sum(axis=2).argmax()]
    toward = -np.array([1, -2, 0.5]) / np.linalg.norm([1, -2, 0.5])
    assert np.degrees(np.arccos(brightest @ toward)) < 2
    assert "directional" in source.notes[0]


def test_skies_shine_as_in_mitsuba(tmp_path, backend):
    import mitsuba as mi

    body = """<emitter type="sunsky"><float name="hour" value="17"/><float name="sun_scale" value="0"/>
      <rgb name="albedo" value="0.9 0.5 0.1"/>
      <transform name="to_world"><lookat origin="0, 0, 0" target="0, 1, 0" up="0, 0, -1"/></transform></emitter>"""
    found, _ = outside(tmp_path, body)
    emitter = mi.load_file(str(tmp_path / "scene.xml")).environment()
    directions = np.random.default_rng(0).standard_normal((2000, 3))
    directions[:, 1] = np.abs(directions[:, 1]) + 0.1
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    si = mi.SurfaceInteraction3f()
    si.wi = -mi.Vector3f(*(mi.Float(axis.astype(np.float32)) for axis in directions.T))
    assert np.allclose(found.lookup(directions), np.array(emitter.eval(si)).T, rtol=0.05, atol=1e-3)


@pytest.mark.parametrize(
    ("inside", "message"),
    [
        ('<float name="turbidity" value="12"/>', r"out of range \[1, 10\]"),
        ('<rgb name="albedo" value="1.5"/>', "must be in the range"),
        ('<integer name="year" value="2020"/><vector name="sun_direction" value="0 1 1"/>', "at the same time"),
    ],
)
def test_skies_that_mitsuba_refuses_name_their_line(inside, message, tmp_path, backend):
    with pytest.raises(FiptError, match=f"scene.xml line 1: Mitsuba refuses this sunsky: .*{message}") as error:
        outside(tmp_path, f'<emitter type="sunsky">{inside}</emitter>')
    assert "\n" not in str(error.value)


def test_sky_and_sun(tmp_path, backend):
    sun = '<emitter type="sunsky"><vector name="sunDirection" x="0.3" y="0.9" z="0.1"/></emitter>'
    found, source = outside(tmp_path, sun, version="0.6.0")
    brightest = texel_directions(*found.radiance.shape[:2])[found.radiance.sum(axis=2).argmax()]
    assert brightest @ np.array([0.3, 0.9, 0.1]) / np.linalg.norm([0.3, 0.9, 0.1]) > 0.999
    assert found.radiance[:100].min() > 0
    assert np.isfinite(found.radiance).all()
    assert any("model of Mitsuba 3" in note for note in source.notes)


@pytest.mark.parametrize("kind", ["point", "spot"])
def test_small_lamps_have_the_intensity_of_what_they_stand_for(kind, tmp_path, backend):
    from fipt.scene.mesh import Mesh
    from fipt.synthetic.scenefile.lights import emitter_radiance, emitter_shape, point_emitters
    from fipt.synthetic.scenefile.source import SceneFileReader
    from fipt.synthetic.scenefile.xml import read_tree

    path = tmp_path / "scene.xml"
    place = '<transform name="to_world"><lookat origin="1 2 3" target="1 0 3" up="1 0 0"/></transform>'
    path.write_text(
        f'<scene version="3"><emitter type="{kind}">{place}<spectrum name="intensity" value="0.8"/></emitter></scene>'
    )
    (emitter,) = point_emitters(read_tree(path).root, SceneFileReader(path, SceneFile()))
    scale = 0.1
    vertices, triangles = emitter_shape(emitter, emitter.position * scale, emitter.direction)
    mesh = Mesh(vertices.astype(np.float32), triangles)
    below = np.array([0, -1.0, 0])
    visible = np.maximum(mesh.area_normals @ below, 0).sum()
    # Half as far away in metres as in units: the same irradiance needs the square of the scale.
    assert np.allclose(emitter_radiance(emitter, scale) * visible, 0.8 * scale**2, rtol=0.03)
    assert np.allclose(mesh.vertices.mean(axis=0), [0.1, 0.2, 0.3], atol=1e-3)


def test_projectors_shine_as_in_mitsuba(tmp_path, backend):
    import mitsuba as mi

    from fipt.synthetic.scenefile.lights import point_emitters
    from fipt.synthetic.scenefile.source import SceneFileReader
    from fipt.synthetic.scenefile.xml import read_tree

    write_exr(tmp_path / "slide.exr", {"": np.full((8, 8, 3), (3, 4, 5), np.float32)})
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><integrator type="direct"/>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="180"/><translate z="2"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
        <emitter type="projector"><float name="fov" value="60"/><float name="scale" value="10"/>
          <texture name="irradiance" type="bitmap"><string name="filename" value="slide.exr"/></texture></emitter>
        <sensor type="perspective"><float name="fov" value="5"/>
          <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film>
          <transform name="to_world"><lookat origin="0 0 0" target="0 0 1" up="0 1 0"/></transform></sensor></scene>"""
    )
    (emitter,) = point_emitters(read_tree(path).root, SceneFileReader(path, SceneFile()))
    # White that is 2 units away reflects the irradiance over pi.
    theirs = np.array(mi.render(mi.load_file(str(path)), spp=16)).mean(axis=(0, 1)) * np.pi * 2**2
    assert np.allclose(emitter.intensity, theirs, rtol=0.01)
