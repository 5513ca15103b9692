"""Copies of a shape are found on the mesh, and vote on what they are made of."""

from dataclasses import replace

import numpy as np

from fipt.scene.metals import JudgedMetals
from fipt.stages.segment.copies import copied_regions, judged_with_copies, votes_of_copies
from fipt.stages.segment.material_evidence import HALF, ROUGHNESS, TRIALS, MaterialEvidence
from fipt.stages.segment.regroup import _copied_metals, _metals, _voters, _with_others, joined


def test_regions_are_copies_where_they_lie_at_one_place_of_a_shape():
    first = np.array([0, 1, 2, 3, 0, 1, 2, 3, 8, 9])
    # the second copy's region 8 has two of its three triangles where region 5 lies, and region 9 is of no copied shape
    region = np.array([5, 5, 6, 6, 8, 8, 8, 0, 9, 9], np.uint16)
    assert copied_regions(first, region, np.array([5, 6, 8, 9])).T.tolist() == [[0, 2]]
    assert copied_regions(first, region[:6], np.array([5, 6, 8])).T.tolist() == [[0, 2]], (
        "what no view shows is left out"
    )
    assert copied_regions(first, region, np.array([6, 8])).shape == (2, 0), "a region that no pixel fills"
    wide = np.concatenate([region, np.full(6, 8, np.uint16)])
    longer = np.concatenate([first, np.arange(10, 16)])
    assert copied_regions(longer, wide, np.array([5, 8])).T.tolist() == [[0, 1]], "half of the smaller one is enough"
    assert copied_regions(longer, np.where(wide == 5, 0, wide), np.array([6, 8])).shape == (2, 0)


def test_a_piece_may_be_a_copy_of_a_later_one_whose_end_no_view_shows():
    first = np.array([4, 5, 6, 7, 4, 5, 6, 7])
    region = np.array([5, 5, 5, 5, 6, 6], np.uint16)
    assert copied_regions(first, region, np.array([5, 6])).T.tolist() == [[0, 1]]


def legs(metal: list[bool], pixels: list[float], brightness: list[float]) -> MaterialEvidence:
    """Evidence of regions of one hue, which metal and dielectric explain alike."""
    count = len(metal)
    color = np.zeros((count, len(TRIALS), 3))
    color[..., 0] = np.array(brightness)[:, None]
    left, products = np.ones((count, 2 * HALF)), np.ones((count, 2 * HALF, 2 * HALF))
    number = np.array(pixels)
    some = np.full((count, 3), 0.01)
    return MaterialEvidence(left, products, color, number, number, 0 * number, np.array(metal), some)


def pairs(*numbers: tuple[int, int]) -> np.ndarray:
    """(2, N) pairs of regions."""
    return np.array(numbers, int).reshape(-1, 2).T


def test_copies_of_one_colour_are_what_most_of_their_pixels_are():
    evidence = legs([True, False, True, False, False], [40, 30, 20, 50, 10], [-1, -1.1, -0.9, -1, -1])
    copies = pairs((0, 1), (1, 2), (0, 2), (3, 4))
    assert judged_with_copies(evidence, copies).metal.tolist() == [True, True, True, False, False]
    few = replace(evidence, pixels=np.array([10.0, 30, 15, 50, 10]))
    assert not judged_with_copies(few, copies).metal.any()
    mute = replace(few, left=np.where(np.arange(5)[:, None] == 1, 0, few.left))
    assert judged_with_copies(mute, copies).metal.tolist() == [True, True, True, False, False], "it judges nothing"
    nobody = replace(evidence, left=np.zeros_like(evidence.left))
    assert judged_with_copies(nobody, copies).metal.tolist() == evidence.metal.tolist(), "nor does any"
    assert judged_with_copies(evidence, pairs()).metal.tolist() == evidence.metal.tolist(), "no copies"


def test_copies_of_two_colours_have_no_vote_on_each_other():
    evidence = legs([True, False, False], [40, 30, 5], [-1, -2, -1.9])
    assert judged_with_copies(evidence, pairs((0, 1), (1, 2), (0, 2))).metal.tolist() == [True, False, False]


def test_what_copies_leave_together_proves_metal_whatever_their_colours():
    """Metal leaves an eighth less of each, which 50 pixels do not prove, and 1000 do."""
    evidence = legs([False] * 21, [50] * 21, [-float(k) for k in range(21)])
    evidence.left[:, :HALF], evidence.left[:, HALF:], evidence.products[:] = 10, 8.8, 0  # 0.2 a pixel: all of it shows
    for k in range(21):  # chance that differs by 3 between the two kinds
        evidence.products[k, :HALF, :HALF] = 9
    evidence.left[20, HALF:] = 18
    copies = pairs(*((k, other) for k in range(20) for other in range(k)))
    assert judged_with_copies(evidence, copies).metal.tolist() == [True] * 20 + [False], "the last is no copy"
    assert not judged_with_copies(evidence, pairs((0, 1), (1, 2))).metal.any(), "three are too few"
    noisy = replace(evidence, usual=np.full(21, 5.0))
    assert not judged_with_copies(noisy, copies).metal.any(), "so much pieces leave in any case"
    all_copies = np.concatenate([copies, pairs((19, 20))], axis=1)
    told = judged_with_copies(evidence, all_copies).metal.tolist()
    assert told == [False] * 21, "what one of them leaves outweighs what is won"
    evidence.left[20, HALF:] = 17
    evidence.left[:20, HALF:] = 8
    assert judged_with_copies(evidence, all_copies).metal.tolist() == [True] * 20 + [False], "it clearly is none"


def test_a_metal_copy_that_judges_nothing_is_as_rough_as_the_metals_of_the_room():
    """Nineteen legs of brushed steel, and one whose pieces have too few pixels."""
    evidence = legs([False] * 20, [50] * 20, [-0.9 * k for k in range(20)])
    brushed = ROUGHNESS.index(0.45)
    evidence.left[:, HALF:], evidence.products[:] = 0.9, 0
    evidence.left[:, HALF + brushed] = 0.8
    evidence.left[19] = 0
    told = judged_with_copies(evidence, pairs(*((k, other) for k in range(20) for other in range(k))))
    assert told.metal.all()
    label = joined(told)
    assert _metals(told, label, np.ones(20, bool)).roughness[int(label[19]) + 1] == 0.45


def test_copies_vote_with_their_pixels():
    copies, label = pairs((0, 1), (0, 2), (2, 1)), np.array([0, 1, 0])
    assert votes_of_copies(copies, label, np.array([1.0, 10, 100]), (3, 2)).tolist() == [[100, 10], [0, 0], [0, 10]]


def test_pairs_with_others_are_one_of_each():
    first, region = np.array([0, 1, 0, 1, 0, 1]), np.array([5, 5, 6, 6, 8, 8], np.uint16)
    assert copied_regions(first, region, np.array([5, 6])).T.tolist() == [[0, 1]]
    found = copied_regions(first, region, np.array([8]), np.array([5, 6]))
    assert sorted(found.T.tolist()) == [[0, 0], [0, 1]]
    assert copied_regions(first, region, np.zeros(0, int), np.array([5, 6])).shape == (2, 0)


def test_what_tells_nothing_is_the_metal_that_its_copies_are():
    """Three frames of windows, two of them of brushed steel, and two of which no pixel tells."""
    evidence = legs([True, True, False], [50, 40, 30], [-1, -1, -3])
    evidence.left[:, HALF + ROUGHNESS.index(0.45)] = 0.8
    everybody, asked = np.ones(3, bool), np.array([7, 9])
    copies = pairs((0, 0), (0, 1), (0, 2), (1, 2))
    assert _copied_metals(evidence, everybody, asked, copies) == {7: 0.45}, "the other is as the painted one"
    one = replace(evidence, metal=np.array([True, False, False]))
    assert _copied_metals(one, everybody, asked, copies) == {}, "most of what its copies show is no metal"
    assert _copied_metals(evidence, everybody, asked, pairs()) == {}, "it has no copy"
    assert _copied_metals(evidence, ~everybody, asked, pairs()) == {}, "nobody votes"


def test_regions_tell_if_they_judge_by_most_of_their_pixels_or_clearly():
    evidence = legs([True, False, False, False], [50] * 4, [-1] * 4)
    evidence.left[3] = 0
    assert _voters(evidence, np.array([False, True, False, True])).tolist() == [True, True, False, False]


def test_parts_of_which_no_pixel_tells_are_no_metal_but_copies_of_one():
    part_of = np.array([0, 1, 2, 3, 4], np.uint16)
    found = JudgedMetals({1: 0.2}, frozenset({2}))
    judged = _with_others(found, part_of, np.array([3, 4]), {4: 0.45})
    assert judged == JudgedMetals({1: 0.2, 4: 0.45}, frozenset({2, 3}))


def test_metals_that_judge_nothing_join_by_their_colour_as_metals_of_the_room():
    """As mirrors the last two would differ."""
    evidence = legs([True, True, True], [50, 3, 3], [-3, -1, -1])
    evidence.left[0, HALF + ROUGHNESS.index(0.45)], evidence.left[1:] = 0.8, 0
    evidence.color[2, HALF, 0] = 1
    assert joined(evidence).tolist() == [0, 1, 1]
