import pytest

from fipt.config import load
from fipt.config.renamed import refuse_renamed
from fipt.errors import FiptError

ROOM = {"source": "procedural"}


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"hits": {"max_hits": 3}}, ["hits is samples now", "hits.max_hits is samples.max_samples now"]),
        ({"samples": {"max_hits": 3}}, ["samples.max_hits is samples.max_samples now"]),
        ({"background": {"mode": "none"}}, ["background is environment now"]),
        ({"lamps": {"views": 1}}, ["lamps is olat now"]),
        ({"fuse": {"colour": 0.2}}, ["fuse.colour is fuse.color now"]),
        ({"fit": {"colour_weight": 2}}, ["fit.colour_weight is fit.color_weight now"]),
        (
            {"emitters": {"two_sided": False}},
            ["emitters.two_sided is emitters.sides now: true is both, and false (one side, by winding) is gone"],
        ),
        (
            {"fit": {"evidence": 0}, "methods": {"plain": {"settings": {"fit": {"confidence": True}}}}},
            [
                "fit.evidence is fit.emission_threshold now",
                "methods.plain.settings.fit.confidence is methods.plain.settings.fit.confidence_weights now",
            ],
        ),
        ({"setups": {"night": {"background": {"scale": 0}}}}, ["setups.night.background is called environment now"]),
        (
            {"setups": {"off": {"emitters": [{"name": "lamp-2"}, {"names": ["lamp-10", "desk lamp"]}]}}},
            ["setups.off.emitters: lamp-2 is emitter-2 now", "setups.off.emitters: lamp-10 is emitter-10 now"],
        ),
        (
            {"scenes": {"attic": {**ROOM, "settings": {"hits": {}}, "setups": {"a": {"background": {}}}}}},
            [
                "scenes.attic.settings.hits is scenes.attic.settings.samples now",
                "scenes.attic.setups.a.background is called environment now",
            ],
        ),
    ],
)
def test_old_names_are_told_all_at_once(values, said):
    with pytest.raises(FiptError) as caught:
        load({"scenes": {"room": ROOM}} | values)
    assert caught.value.message.split("; ") == said
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("values", [{"scenes": []}, {"scenes": {"room": 3}}, {"setups": [1]}, {"setups": {"a": None}}])
def test_odd_configurations_are_left_to_the_check(values):
    refuse_renamed(values)
