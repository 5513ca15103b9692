"""Scene files: unphysical numbers are taken as the nearest physical ones, and named."""

import logging

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.synthetic.scenefile.values import color
from fipt.synthetic.scenefile.xml import Node


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
