"""Groups of what is connected, what most of them say, and deviations that outliers do not move."""

import numpy as np
import pytest

from fipt.groups import connected_groups, most_frequent
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


def test_what_most_of_a_group_say_counts_and_of_equals_its_default():
    group = np.array([0, 0, 0, 2, 2, 3, 3, 3, 3])
    value = np.array([5, 7, 5, 4, 9, 1, 1, 8, 8])
    found = most_frequent(group, value, np.array([7, 6, 4, 2], np.int32))
    assert found.tolist() == [5, 6, 4, 8]  # by number, no vote, its own of equals, the largest of other equals
    assert found.dtype == np.int32
    assert most_frequent(group[:0], value[:0], np.array([3, 0])).tolist() == [3, 0]
