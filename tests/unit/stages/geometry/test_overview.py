"""The picture of where depth comes from."""

import numpy as np

from fipt.stages.geometry.completion import Completed
from fipt.stages.geometry.overview import overview
from tests.unit.stages.geometry.test_fusing import around


def test_views_with_most_walls_come_first():
    views = []
    for number, view in enumerate(around()):
        closed = np.zeros((60, 80), bool)
        closed[:, : 10 * number] = True
        views.append(Completed(view, ~closed, closed))
    image = overview(views)
    assert image.shape == (6 * 60, 3 * 80, 3)
    orange = image[:, 160:, 0] > image[:, 160:, 2]
    assert [round(row.mean() * 8) for row in np.split(orange, 6)] == [7, 6, 5, 4, 3, 2]
