"""The tree of a scene file: defaults, references, refusals."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from fipt.errors import FiptError
from fipt.synthetic.scenefile.xml import inside, read_tree, snake


def read(tmp_path, text: str):
    (tmp_path / "scene.xml").write_text(text)
    return read_tree(tmp_path / "scene.xml").root


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("toWorld", "to_world"),
        ("intIOR", "int_ior"),
        ("diffuseReflectance", "diffuse_reflectance"),
        ("to_world", "to_world"),
        ("alphaU", "alpha_u"),
    ],
)
def test_names_become_snake_case(name, expected):
    assert snake(name) == expected


def test_defaults_and_references(tmp_path):
    root = read(
        tmp_path,
        """<scene version="0.6.0"><default name="rough" value="0.3"/>
        <bsdf type="twosided" id="Outer"><bsdf type="roughplastic" id="Inner">
          <float name="alpha" value="$rough"/><float name="intIOR" value="$unset"/></bsdf></bsdf>
        <shape type="obj"><ref id="Inner"/></shape><shape type="obj"><ref id="Inner"/></shape>
        <shape type="obj"><ref name="other" id="Inner"/></shape></scene>""",
    )
    first, second, third = (shape.children[0] for shape in root.objects("shape"))
    assert first is second
    assert first.number("alpha", 0) == 0.3
    assert third.name == "other"
    assert third.type == "roughplastic"
    with pytest.raises(FiptError, match=r"scene.xml line 3: int_ior must be a number; found '\$unset'"):
        first.number("int_ior", 1.5)


def test_a_default_holds_from_its_first_value(tmp_path):
    root = read(
        tmp_path,
        '<scene version="3"><default name="a" value="1"/><default name="a" value="2"/><shape id="$a$a"/></scene>',
    )
    assert root.children[0].id == "11"


def test_includes_come_from_the_folder_only(tmp_path):
    (tmp_path / "more.xml").write_text('<scene version="2.0.0"><bsdf type="diffuse" id="D"/></scene>')
    root = read(
        tmp_path, '<scene version="3"><include filename="more.xml"/><shape type="cube"><ref id="D"/></shape></scene>'
    )
    assert root.objects("shape")[0].objects("bsdf")[0].type == "diffuse"
    with pytest.raises(FiptError, match=r"outside the scene's folder"):
        read(tmp_path, '<scene version="3"><include filename="../more.xml"/></scene>')
    for included in ('<include filename="scene.xml"/>', '<include filename="more.xml"/>' * 2):
        with pytest.raises(FiptError, match=r"(scene|more).xml is included twice, or includes itself"):
            read(tmp_path, f'<scene version="3">{included}</scene>')


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<scene version="3"><shape></scene>', "not well-formed XML"),
        ("<world/>", "first element is <world>, not <scene>"),
        (
            '<scene version="3"><shape type="obj"><ref id="Nobody"/></shape></scene>',
            "line 1: nothing has the id 'Nobody'",
        ),
        (
            '<scene version="3"><bsdf type="twosided" id="A"><ref id="A"/></bsdf><shape><ref id="A"/></shape></scene>',
            "itself",
        ),
        ('<scene version="0.4.0"><luminaire type="constant"/></scene>', r"0.5 to 3; found '0.4.0'"),
        ('<scene version="0.5.0"><luminaire type="constant"/></scene>', "have no element <luminaire>"),
        ('<scene version="3">' + "<bsdf>" * 60 + "</bsdf>" * 60 + "</scene>", "nested more than 40 deep"),
    ],
)
def test_broken_files_are_one_line(tmp_path, text, message):
    with pytest.raises(FiptError, match=message):
        read(tmp_path, text)


def test_references_cannot_double_for_ever(tmp_path):
    blends = "".join(f'<bsdf type="blendbsdf" id="a{k + 1}">{f"""<ref id="a{k}"/>""" * 2}</bsdf>' for k in range(60))
    with pytest.raises(FiptError, match="references make more than 2000000 elements of it"):
        read(
            tmp_path,
            f'<scene version="3"><bsdf type="diffuse" id="a0"/>{blends}<shape><ref id="a60"/></shape></scene>',
        )


def test_document_types_are_refused_before_anything_expands(tmp_path):
    lines = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(12))
    start = time.perf_counter()
    with pytest.raises(FiptError, match="document type"):
        read(tmp_path, f'<!DOCTYPE scene [<!ENTITY a0 "x">{lines}]><scene version="3">&a12;</scene>')
    with pytest.raises(FiptError, match="document type"):
        read(tmp_path, '<!DOCTYPE scene [<!ENTITY e SYSTEM "file:///etc/passwd">]><scene version="3">&e;</scene>')
    assert time.perf_counter() - start < 1


def test_paths_stay_inside_the_folder_even_through_links(tmp_path):
    folder = tmp_path / "scene"
    folder.mkdir()
    (tmp_path / "secret").write_text("x")
    (folder / "link").symlink_to(tmp_path / "secret")
    assert inside(folder, "models\\a.obj") == folder / "models/a.obj"
    for text in ("../secret", "/etc/passwd", "link", "a/../../secret"):
        assert inside(folder, text) is None


def test_listing_files_loads_nothing_heavy(tmp_path):
    (tmp_path / "scene.xml").write_text('<scene version="3"/>')
    code = (
        "import sys; from fipt.synthetic.scenefile.xml import scene_files; "
        f"assert len(scene_files({str(tmp_path / 'scene.xml')!r})) == 1; "
        "sys.exit(any(name in sys.modules for name in ('mitsuba', 'numpy', 'torch')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
