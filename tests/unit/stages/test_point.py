"""``fipt point``."""

import json

import numpy as np

from fipt.cli.main import main
from tests import scenes


def test_a_pixel_is_a_point_of_the_room(scene, capsys):
    """Straight ahead of a camera is where it looks."""
    eye, to = np.array([1.0, 1.2, 1.0]), np.array([2.4, 2.4, 3.4])
    data = str(scene / "dataset")
    assert main(["point", data, "c", str(scenes.WIDTH / 2), str(scenes.HEIGHT / 2)]) == 0
    first, second = capsys.readouterr().out.splitlines()[-2:]
    at = np.array(json.loads(first.removeprefix("at: ")))
    scale = min((scenes.SIZE - eye) / (to - eye))
    np.testing.assert_allclose(at, eye + scale * (to - eye), atol=2e-3)
    assert second.startswith("segment 0, ")
    assert main(["point", data, "c", "99", "0"]) == 2
    assert "column 99, row 0 is outside" in capsys.readouterr().err
