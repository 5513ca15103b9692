"""The board in the simulated room: where room.json says, and found there in a rendered view."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.stages.poses.room_boards import find_boards
from fipt.stages.poses.settings import SceneBoard
from fipt.synthetic.board import with_board
from fipt.synthetic.room import build
from fipt.synthetic.settings import SimulatedBoard, SynthesizeSettings
from fipt.synthetic.views import render_views
from tests import room_views

LYING = SimulatedBoard(enabled=True)
HANGING = SimulatedBoard(enabled=True, place="wall", position=(4.0, 1.7, 0), turn=0)


@pytest.mark.parametrize(
    ("board", "camera"),
    [
        (LYING, room_views.look_at("v", (3.2, 1.5, 2.9), (3.85, 0, 2.05), (320, 240), 40)),
        (HANGING, room_views.look_at("v", (3.4, 1.6, 1.8), (4.0, 1.7, 0), (320, 240), 40)),
    ],
    ids=["floor", "wall"],
)
def test_a_rendered_board_is_found_where_room_json_says(backend, board, camera):
    """Detected corners meet the true ones to a fraction of a pixel: neither turned, mirrored nor shifted."""
    room = with_board(build(0), board)
    known = room.description()["board"]
    settings = SynthesizeSettings(spp=8, max_depth=3, denoise=False, board=board)
    (_, image, _), = render_views(room, [camera], settings)  # fmt: skip
    (target,) = find_boards([camera], lambda view: image, SceneBoard())
    ids, pixels = target.seen["v"]
    assert len(ids) > 0.5 * board.columns * board.rows
    truth = camera.project(np.array(known["corners"])[ids])[0]
    assert np.abs((pixels - truth).mean(axis=0)).max() < 0.2
    assert np.sqrt(((pixels - truth) ** 2).sum(axis=1).mean()) < 0.5


def test_the_rest_of_the_room_keeps_its_numbers():
    room, bare = with_board(build(0), LYING), build(0)
    assert len(room.mesh.triangles) == len(bare.mesh.triangles) + 2
    np.testing.assert_array_equal(room.part[:-2], bare.part)
    np.testing.assert_array_equal(room.mesh.vertices[: len(bare.mesh.vertices)], bare.mesh.vertices)
    assert "board" not in bare.description()
    assert SynthesizeSettings().board.enabled is False


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"position": (4.9, 0, 2.0)}, "synthesize.board.position must put the board inside the room"),
        ({"marker": 0.1}, "synthesize.board.marker must be smaller than square; found 0.1 and 0.1"),
        ({"dictionary": "tags"}, "synthesize.board.dictionary must be one of OpenCV's; found 'tags'"),
    ],
)
def test_a_board_that_cannot_be_is_refused(keys, said):
    with pytest.raises(FiptError) as error:
        with_board(build(0), SimulatedBoard(enabled=True, **keys))
    assert said in str(error.value)
