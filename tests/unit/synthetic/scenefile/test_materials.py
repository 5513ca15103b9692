"""Materials: the stated rules, against closed forms and published optical constants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fipt.formats.exr import write_exr
from fipt.formats.images import srgb_decode
from fipt.synthetic.settings import SceneFile


def made(parsed, element: str, tmp_path: Path = Path(), **settings):
    """The material and the look of a bsdf, and what was noted."""
    from fipt.synthetic.scenefile.materials import converted, material
    from fipt.synthetic.scenefile.source import SceneFileReader

    source = SceneFileReader(tmp_path / "one.xml", SceneFile(**settings))
    found = converted(parsed(element), source)
    return material("m", found, source.settings.smoothest), found, source


def rgb(name: str, value: str) -> str:
    return f'<rgb name="{name}" value="{value}"/>'


DIFFUSE = '<bsdf type="diffuse">' + rgb("reflectance", "0.2 0.3 0.4") + "</bsdf>"
STEEL = rgb("eta", "1.65746, 0.880369, 0.521229") + rgb("k", "9.22387, 6.26952, 4.837")
F0_STEEL = [
    ((n - 1) ** 2 + k**2) / ((n + 1) ** 2 + k**2)
    for n, k in ((1.65746, 9.22387), (0.880369, 6.26952), (0.521229, 4.837))
]
COLOR = (0.2, 0.3, 0.4)

RULES = {
    "diffuse": (DIFFUSE, COLOR, 0.9, 0),
    "diffuse-default": ('<bsdf type="diffuse"/>', (0.5, 0.5, 0.5), 0.9, 0),
    "roughdiffuse": (DIFFUSE.replace('"diffuse"', '"roughdiffuse"'), COLOR, 0.9, 0),
    "black-white": ('<bsdf type="diffuse">' + rgb("reflectance", "0, 1, 0.5") + "</bsdf>", (0.01, 0.9, 0.5), 0.9, 0),
    "twosided": (f'<bsdf type="twosided">{DIFFUSE}</bsdf>', COLOR, 0.9, 0),
    "bump": (f'<bsdf type="bumpmap"><texture type="bitmap"/>{DIFFUSE}</bsdf>', COLOR, 0.9, 0),
    "plastic": ('<bsdf type="plastic">' + rgb("diffuseReflectance", "0.2 0.3 0.4") + "</bsdf>", COLOR, 0.15, 0),
    "roughplastic": (
        '<bsdf type="roughplastic"><float name="alpha" value="0.16"/><boolean name="nonlinear" value="true"/>'
        + rgb("diffuse_reflectance", "0.2 0.3 0.4") + "</bsdf>", COLOR, 0.4, 0,
    ),
    "mirror": ('<bsdf type="conductor"><string name="material" value="none"/></bsdf>', (0.95, 0.95, 0.95), 0.15, 1),
    "conductor": (f'<bsdf type="conductor">{STEEL}</bsdf>', F0_STEEL, 0.15, 1),
    "conductor-eta": (f'<bsdf type="conductor">{rgb("eta", "0.2")}</bsdf>', (1.64 / 2.44,) * 3, 0.15, 1),
    "tinted": (
        f'<bsdf type="roughconductor"><float name="alpha" value="0.25"/>{STEEL}'
        + rgb("specularReflectance", "0.5") + "</bsdf>",
        np.multiply(F0_STEEL, 0.5), 0.5, 1,
    ),
    "anisotropic": (
        '<bsdf type="roughconductor"><string name="material" value="Al"/><float name="alphaU" value="0.04"/>'
        '<float name="alphaV" value="0.25"/></bsdf>', F0_STEEL, 0.1**0.5, 1,
    ),
    "phong": (
        '<bsdf type="phong"><float name="exponent" value="256"/>' + rgb("diffuseReflectance", "0.2 0.3 0.4")
        + '<spectrum name="specularReflectance" value="0.1"/></bsdf>', COLOR, (2 / 258) ** 0.25, 0,
    ),
    "ward-metal": (
        '<bsdf type="ward"><float name="alphaU" value="0.09"/><float name="alphaV" value="0.09"/>'
        + rgb("diffuseReflectance", "0") + rgb("specularReflectance", "0.6 0.5 0.4") + "</bsdf>",
        (0.6, 0.5, 0.4), 0.3, 1,
    ),
    "principled": (
        '<bsdf type="principled">' + rgb("base_color", "0.2 0.3 0.4") + '<float name="roughness" value="0.35"/>'
        '<float name="metallic" value="0.25"/></bsdf>', COLOR, 0.35, 0.25,
    ),
    "opaque-glass": (f'<bsdf type="dielectric">{rgb("specular_transmittance", "0")}</bsdf>', (0.01,) * 3, 0.15, 0),
    "coating": (f'<bsdf type="roughcoating"><float name="alpha" value="0.09"/>{DIFFUSE}</bsdf>', COLOR, 0.3, 0),
    "blend": (
        f'<bsdf type="blendbsdf"><float name="weight" value="0.25"/>{DIFFUSE}<bsdf type="conductor">'
        '<string name="material" value="none"/></bsdf></bsdf>', np.array(COLOR) * 0.75 + 0.25, 0.75 * 0.9, 0.25,
    ),
    "mixture": (
        f'<bsdf type="mixturebsdf"><string name="weights" value="0.5, 0.5"/>{DIFFUSE}<bsdf type="diffuse"/></bsdf>',
        np.array(COLOR) / 2 + 0.25, 0.9, 0,
    ),
    "mask-constant": (f'<bsdf type="mask">{rgb("opacity", "0.612")}{DIFFUSE}</bsdf>', COLOR, 0.9, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", RULES)
def test_rules(name, parsed):
    element, base, roughness, metallic = RULES[name]
    material, converted, source = made(parsed, element)
    assert not converted.clear
    assert not source.unknown
    assert material.base_color.shape == (1, 1, 3)
    assert material.base_color.dtype == np.float32
    assert np.allclose(material.base_color[0, 0], base, atol=1e-3)
    assert material.roughness[0, 0] == pytest.approx(roughness, abs=1e-5)
    assert material.metallic[0, 0] == pytest.approx(metallic)


@pytest.mark.parametrize(
    ("metal", "eta", "k"),
    [
        ("Au", (0.143119, 0.374957, 1.44248), (3.98316, 2.38572, 1.60322)),
        ("Cr", (4.36968, 2.9167, 1.6547), (5.20643, 4.23136, 3.75495)),
    ],
)
def test_named_metals_have_the_constants_that_others_publish(metal, eta, k, parsed):
    eta, k = np.array(eta), np.array(k)
    material, _, _ = made(parsed, f'<bsdf type="conductor"><string name="material" value="{metal}"/></bsdf>')
    expected = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    assert np.allclose(material.base_color[0, 0], expected.clip(0.01, 0.95), atol=2e-3)


@pytest.mark.parametrize(
    "element",
    [
        '<bsdf type="dielectric"/>',
        '<bsdf type="twosided"><bsdf type="thindielectric"/></bsdf>',
        '<bsdf type="roughdielectric"><float name="alpha" value="0.1"/></bsdf>',
        '<bsdf type="null"/>',
        f'<bsdf type="mask"><float name="opacity" value="0.3"/>{DIFFUSE}</bsdf>',
        '<bsdf type="principled"><float name="spec_trans" value="1"/></bsdf>',
        f'<bsdf type="blendbsdf"><float name="weight" value="0.8"/>{DIFFUSE}<bsdf type="null"/></bsdf>',
    ],
)
def test_what_lets_light_through_is_dropped(element, parsed):
    assert made(parsed, element)[1].clear


def test_unknown_plugins_are_problems_and_flagged(parsed):
    material, converted, source = made(parsed, '<bsdf type="twosided"><bsdf type="hairy" id="H"/></bsdf>')
    assert material.flagged
    assert converted.flagged
    assert source.unknown == ["bsdf hairy (one.xml line 1)"]
    _, _, source = made(parsed, '<bsdf type="conductor"><string name="material" value="../Al"/></bsdf>')
    assert source.unknown == ["conductor ../Al (one.xml line 1)"]


def bitmap(name: str, file: str, more: str = "") -> str:
    return f'<texture name="{name}" type="bitmap"><string name="filename" value="{file}"/>{more}</texture>'


def test_pictures_are_decoded_and_their_first_row_is_v_0(tmp_path, parsed):
    codes = np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10
    Image.fromarray(codes).save(tmp_path / "p.png")
    material, converted, source = made(
        parsed, f'<bsdf type="diffuse">{bitmap("reflectance", "p.png")}</bsdf>', tmp_path
    )
    assert np.allclose(material.base_color, srgb_decode(codes / 255).clip(0.01, 0.9), atol=1e-5)
    assert converted.base.image == "p.png"
    assert source.files == [tmp_path / "p.png"]
    raw = bitmap("reflectance", "p.png", '<boolean name="raw" value="true"/>')
    material, _, _ = made(parsed, f'<bsdf type="diffuse">{raw}</bsdf>', tmp_path)
    assert np.allclose(material.base_color, (codes / 255).clip(0.01, 0.9), atol=1e-5)


def test_texture_coordinates_are_turned_as_mitsuba_does(tmp_path, parsed):
    import mitsuba as mi

    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 255, (16, 16, 3)).astype(np.uint8)).save(tmp_path / "p.png")
    place = (
        '<transform name="to_uv"><scale x="2" y="3"/><rotate z="1" angle="30"/><translate x="0.2" y="0.1"/></transform>'
    )
    texture = bitmap("reflectance", "p.png", place)
    _, converted, _ = made(parsed, f'<bsdf type="diffuse">{texture}</bsdf>', tmp_path)
    exact = texture.replace("</texture>", '<boolean name="accel" value="false"/></texture>')  # GPUs filter in 8 bits
    (tmp_path / "t.xml").write_text(
        f'<scene version="3.0.0"><shape type="rectangle"><bsdf type="diffuse" id="b">{exact}</bsdf></shape></scene>'
    )
    bsdf = mi.load_file(str(tmp_path / "t.xml")).shapes()[0].bsdf()
    uv = rng.random((200, 2))
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(*(mi.Float(axis.astype(np.float32)) for axis in uv.T))
    theirs = np.array(bsdf.eval_diffuse_reflectance(si)).T
    place = (uv @ converted.base.from_uv[:, :2].T + converted.base.from_uv[:, 2]) * 16 - 0.5
    low = np.floor(place).astype(int)
    part = (place - low)[:, None]
    value = sum(
        converted.base.values[(low[:, 1] + j) % 16, (low[:, 0] + i) % 16]
        * ((part[..., 0] if i else 1 - part[..., 0]) * (part[..., 1] if j else 1 - part[..., 1]))
        for i in (0, 1)
        for j in (0, 1)
    )
    assert np.allclose(value, theirs, atol=2e-3)


TILED = '<boolean name="raw" value="true"/><transform name="to_uv"><scale x="4" y="4"/></transform>'


@pytest.mark.parametrize("name", ["roughness", "metallic"])
def test_one_map_says_where_texels_lie_and_what_lies_otherwise_is_averaged_and_told(name, tmp_path, parsed):
    from fipt.synthetic.scenefile.materials import described

    codes = np.repeat(np.array([60, 230], np.uint8), 8).reshape(4, 4)
    Image.fromarray(codes).save(tmp_path / "p.png")
    tiled = bitmap(name, "p.png", TILED)
    material, converted, _ = made(
        parsed, f'<bsdf type="principled">{rgb("base_color", "0.5")}{tiled}</bsdf>', tmp_path, smoothest=0.02
    )
    assert np.allclose(getattr(material, name), codes / 255, atol=1e-5)
    assert np.allclose(converted.from_uv, [[4, 0, 0], [0, 4, 0]])
    assert "lies otherwise" not in described(material, converted)
    material, converted, _ = made(
        parsed, f'<bsdf type="principled">{bitmap("base_color", "p.png")}{tiled}</bsdf>', tmp_path, smoothest=0.02
    )
    assert np.allclose(getattr(material, name), [[145 / 255]], atol=1e-5)
    assert np.allclose(converted.from_uv, np.eye(3)[:2])
    assert f"its {name} lies otherwise on the surface: the mean is used" in described(material, converted)


def test_older_scales_and_offsets(parsed):
    from fipt.synthetic.scenefile.textures import read_map

    board = parsed(
        '<texture type="checkerboard"><float name="uscale" value="4"/><float name="voffset" value="0.5"/>'
        f"{rgb('color0', '0.1')}{rgb('color1', '0.9')}</texture>"
    )
    found = read_map(board, 0.5, None)
    assert found.from_uv.tolist() == [[4, 0, 0], [0, 1, 0.5]]
    assert found.values[:32, :32].max() == np.float32(0.1)
    assert found.mean == pytest.approx([0.5] * 3)


def test_huge_pictures_are_averaged_after_decoding(tmp_path, parsed):
    codes = np.zeros((300, 700, 3), np.uint8)
    codes[:, ::2] = 255
    Image.fromarray(codes).save(tmp_path / "p.png")
    element = f'<bsdf type="diffuse">{bitmap("reflectance", "p.png")}</bsdf>'
    material, _, source = made(parsed, element, tmp_path, max_texture=70)
    assert material.base_color.shape == (30, 70, 3)
    assert np.allclose(material.base_color, 0.5, atol=1e-5)
    assert source.notes == ["texture p.png: 700x300 averaged down to 70x30 (max_texture)"]


def test_texels_that_are_no_colour_are_black_and_told(parsed, tmp_path, caplog):
    pixels = np.full((2, 2, 3), 0.25, np.float32)
    pixels[0, 0], pixels[1, 1, 2] = np.nan, -1
    write_exr(tmp_path / "p.exr", {"": pixels})
    element = f'<bsdf type="diffuse">{bitmap("reflectance", "p.exr")}</bsdf>'
    found, _, _ = made(parsed, element, tmp_path)
    assert "p.exr: 4 of 12 values are negative or not finite; they count as 0" in caplog.text
    assert np.isfinite(found.base_color).all()
    assert (found.base_color.reshape(-1, 3).min(axis=0) < 0.05).all()


def test_float_textures_have_a_colour_or_one_value(parsed, tmp_path):
    element = f'<bsdf type="diffuse">{bitmap("reflectance", "p.exr")}</bsdf>'
    for name in "YA":
        write_exr(tmp_path / f"{name}.exr", {name: np.full((2, 2), 0.25, np.float32)})
        found = made(parsed, element.replace("p.exr", f"{name}.exr"), tmp_path)[0]
        assert found.base_color == pytest.approx(np.full((2, 2, 3), 0.25), abs=1e-3)
    write_exr(tmp_path / "p.exr", {name: np.full((2, 2), 0.25, np.float32) for name in ("depth", "Z")})
    found, _, source = made(parsed, element, tmp_path)
    assert found.base_color == pytest.approx(0.5, abs=1e-3)  # grey, as of every picture that cannot be read
    notes = source.notes
    assert any("p.exr must have the channels R, G and B, or one besides A; it has" in note for note in notes)


def test_a_masks_alpha_channel_is_its_opacity(tmp_path, parsed):
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[:2, :, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "leaf.png")
    leaf = f'<bsdf type="mask">{bitmap("opacity", "leaf.png")}<bsdf type="diffuse"/></bsdf>'
    _, converted, _ = made(parsed, leaf, tmp_path)
    assert np.array_equal(converted.opacity.grey, np.repeat([0, 0, 1, 1], 4).reshape(4, 4))


def test_a_blend_of_masks_is_cut_where_most_of_it_is_clear(tmp_path, parsed):
    pixels = np.full((4, 4, 4), 255, np.uint8)
    pixels[:2, :, 3] = 0
    Image.fromarray(pixels).save(tmp_path / "leaf.png")
    leaf = f'<bsdf type="mask">{bitmap("opacity", "leaf.png")}<bsdf type="diffuse"/></bsdf>'
    weight = '<float name="weight" value="0.25"/>'
    for second, clear in ((leaf, 0), (DIFFUSE, 0.25)):
        _, converted, _ = made(parsed, f'<bsdf type="blendbsdf">{weight}{leaf}{second}</bsdf>', tmp_path)
        assert np.allclose(converted.opacity.grey, np.repeat([clear, clear, 1, 1], 4).reshape(4, 4))
    _, converted, _ = made(parsed, f'<bsdf type="blendbsdf">{weight}{DIFFUSE}{DIFFUSE}</bsdf>', tmp_path)
    assert converted.opacity is None


def test_textured_roughness_is_the_root_of_alpha(tmp_path, parsed):
    Image.fromarray(np.array([[0, 64, 255]], np.uint8)).save(tmp_path / "a.png")
    alpha = bitmap("alpha", "a.png", '<boolean name="raw" value="true"/>')
    material, _, _ = made(parsed, f'<bsdf type="roughplastic">{alpha}</bsdf>', tmp_path, smoothest=0.02)
    assert np.allclose(material.roughness, [[0.02, (64 / 255) ** 0.5, 1]], atol=1e-5)


@pytest.mark.parametrize("ending", ["tif", "png", "pgm"])
def test_grey_pictures_of_16_bits_keep_them(ending, tmp_path, parsed):
    codes = np.array([[1000, 16384], [32768, 65535]], np.uint16)
    Image.fromarray(codes).save(tmp_path / f"p.{ending}")
    rough = bitmap("roughness", f"p.{ending}", '<boolean name="raw" value="true"/>')
    material, _, source = made(parsed, f'<bsdf type="principled">{rough}</bsdf>', tmp_path, smoothest=0.02)
    assert np.allclose(material.roughness, np.maximum(codes / 65535, 0.02), atol=1e-6)
    assert not source.unknown


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_grey_pictures_of_32_bits_are_problems(kind, tmp_path, parsed):
    Image.fromarray(np.full((2, 2), 0.25 if kind is np.float32 else 25000, kind)).save(tmp_path / "p.tif")
    _, _, source = made(parsed, f'<bsdf type="diffuse">{bitmap("reflectance", "p.tif")}</bsdf>', tmp_path)
    assert source.unknown == ["picture p.tif, which cannot be read (one.xml line 1)"]
    assert "it has 32 bits a channel" in source.notes[0]


@pytest.mark.parametrize("damaged", [b"", b"\x89PNG\r\n\x1a\nxxxx", b"nonsense"])
def test_damaged_pictures_are_problems(damaged, tmp_path, parsed):
    (tmp_path / "p.png").write_bytes(damaged)
    material, _, source = made(parsed, f'<bsdf type="diffuse">{bitmap("reflectance", "p.png")}</bsdf>', tmp_path)
    assert material.flagged
    assert source.unknown == ["picture p.png, which cannot be read (one.xml line 1)"]
