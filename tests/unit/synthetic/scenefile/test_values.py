"""Transforms and colours, against Mitsuba's own parser and closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.formats.images import srgb_decode

TRANSFORMS = {
    "order": '<translate x="1"/><rotate z="1" angle="90"/><scale x="2" y="3" z="4"/>',
    "matrix": '<matrix value="1 2 3 4 0 1 0 5 0 0 2 6 0 0 0 1"/>',
    "axis": '<rotate x="0.48" y="0.6" z="0.64" angle="33"/>',
    "value": '<scale value="2"/><translate value="1, 2, 3"/>',
    "lookat": '<lookat origin="1 2 3" target="0 1 -4" up="0 1 0.2"/>',
}


@pytest.mark.parametrize("name", TRANSFORMS)
def test_transforms_are_mitsubas(name, parsed):
    import mitsuba as mi

    from fipt.synthetic.scenefile.values import transform

    inner = f'<transform name="to_world">{TRANSFORMS[name]}</transform>'
    ours = transform(parsed(f'<shape type="sphere">{inner}</shape>').get("to_world"))
    cubes = [mi.load_string(f'<scene version="3.0.0"><shape type="cube">{m}</shape></scene>') for m in ("", inner)]
    corners, moved = (np.array(mi.traverse(c.shapes()[0])["vertex_positions"]).reshape(-1, 3) for c in cubes)
    assert np.allclose(corners @ ours[:3, :3].T + ours[:3, 3], moved, atol=1e-5)


@pytest.mark.parametrize(
    ("element", "expected"),
    [
        ('<rgb name="c" value="0.1, 0.2 0.3"/>', (0.1, 0.2, 0.3)),
        ('<rgb name="c" value="0.4"/>', (0.4, 0.4, 0.4)),
        ('<rgb name="c" value="#ff8000"/>', (1, 128 / 255, 0)),
        ('<srgb name="c" value="#ff8000"/>', tuple(srgb_decode(np.array([1, 128 / 255, 0])))),
        ('<srgb name="c" value="0.5 0.5 0.5"/>', tuple(srgb_decode(np.array([0.5] * 3)))),
        ('<spectrum name="c" value="0.25"/>', (0.25, 0.25, 0.25)),
        ('<spectrum name="c" value="0.5, 0, 0"/>', (0.5, 0, 0)),
        ('<spectrum name="c" type="d65"><float name="scale" value="3"/></spectrum>', (3, 3, 3)),
        ('<spectrum name="c" type="d65"><rgb name="color" value="1 2 3"/></spectrum>', (1, 2, 3)),
        (
            '<spectrum name="c" type="d65"><rgb name="color" value="1 2 3"/><float name="scale" value="2"/></spectrum>',
            (2, 4, 6),
        ),
    ],
)
def test_colours(element, expected, parsed):
    from fipt.synthetic.scenefile.values import color

    assert np.allclose(color(parsed(element)), expected, atol=1e-6)


def test_flat_spectra_are_grey_and_blackbodies_have_their_colour(parsed):
    from fipt.synthetic.scenefile.values import color

    flat = color(parsed('<spectrum name="c" value="400:0.5, 550:0.5, 700:0.5"/>'))
    assert np.allclose(flat, 0.5, atol=0.01)
    # 6504 K is nearly sRGB's white; 2700 K has the published ratio of about 1 : 0.40 : 0.10 in linear sRGB.
    white, warm = (color(parsed(f'<blackbody name="c" temperature="{k}K"/>'), light=True) for k in (6504, 2700))
    assert np.ptp(white / white.mean()) < 0.1
    assert np.allclose(warm / warm[0], (1, 0.40, 0.10), atol=0.04)
    double = color(parsed('<blackbody name="c" temperature="2700" scale="2"/>'), light=True)
    assert np.allclose(double, 2 * warm)


@pytest.mark.parametrize(
    "element",
    [
        '<rgb name="c" value="1, 2"/>',
        '<rgb name="c" value="red"/>',
        '<spectrum name="c" value="500:1, 400:1"/>',
    ],
)
def test_what_is_no_colour_names_its_line(element, parsed):
    from fipt.synthetic.scenefile.values import color

    with pytest.raises(FiptError, match=r"one.xml line 1: .*must be"):
        color(parsed(element))
