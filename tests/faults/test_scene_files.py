"""Scene files: unphysical numbers are taken as the nearest physical ones, and named."""

import logging
from pathlib import Path

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.synthetic.scenefile.values import color
from fipt.synthetic.scenefile.xml import Node, read_tree


def rgb(text: str) -> Node:
    return Node("rgb", {"name": "eta", "value": text}, [], "scene.xml line 7")


def test_a_slightly_negative_index_is_zero_and_named(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        np.testing.assert_allclose(color(rgb("0.143, -0.002, 1.44")), [0.143, 0, 1.44])
    assert "eta has negative numbers (0.143, -0.002, 1.44), which are taken as 0" in caplog.text
    caplog.clear()
    color(rgb("0.143, 0.002, 1.44"))
    assert not caplog.text


def test_what_is_no_number_is_refused() -> None:
    with pytest.raises(FiptError, match="must be a colour of one or three numbers"):
        color(rgb("nan, 0, 1"))


def test_light_beyond_all_suns_is_refused() -> None:
    with pytest.raises(FiptError, match=r"eta must be at most 1e\+12; found '1e300'"):
        color(rgb("1e300"))


def test_what_is_referred_to_has_one_meaning(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    twice = '<bsdf type="diffuse" id="a"/>' * 2
    path.write_text(f'<scene version="3.0.0">{twice}<shape type="cube"><ref id="a"/></shape></scene>')
    with pytest.raises(FiptError, match="the id 'a' is there twice"):
        read_tree(path)
    path.write_text(f'<scene version="3.0.0">{twice}<shape type="cube"/></scene>')
    assert read_tree(path)
