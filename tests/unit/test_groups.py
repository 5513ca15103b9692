"""Groups of what is connected, and deviations that outliers do not move."""

import numpy as np
import pytest

from fipt.groups import connected_groups
from fipt.robust import deviation, spread


@pytest.mark.parametrize(
    ("pairs", "count", "groups"),
    [
        ([[4, 1], [2, 4]], 5, [0, 1, 1, 2, 1]),
        ([[], []], 3, [0, 1, 2]),
        ([[], []], 0, []),
        ([[1] * 300, [0] * 300], 2, [0, 0]),
        ([[0], [0]], 2, [0, 1]),
    ],
    ids=["by their first member", "no pair", "nothing", "often", "with itself"],
)
def test_connected_groups(pairs, count, groups):
    assert connected_groups(np.array(pairs, int), count).tolist() == groups


def test_outliers_do_not_move_deviations(np_rng):
    noise = np_rng.normal(5.0, [0.1, 2.0], (20_000, 2))
    noise[:200] = 1e6
    assert spread(noise) == pytest.approx([0.1, 2.0], rel=0.05)
    assert deviation(noise[:, 1] - 5) == pytest.approx(2.0, rel=0.05)
    assert deviation(np.array([3.0, -1.0, 2.0])) == pytest.approx(2 * 1.4826)
