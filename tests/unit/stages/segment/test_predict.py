"""Mask2Former: its masks to ids, against brute force and transformers; real classes on a tiny random model, offline."""

import json
import shutil
import socket
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from huggingface_hub import constants
from safetensors.torch import load_file, save_file

from benchmarks import tiny_mask2former
from fipt.errors import FiptError
from fipt.formats.exr import write_exr
from fipt.scene.dataset import Dataset
from fipt.stages.segment.predict import Mask2Former, network_input, panoptic, semantic
from fipt.stages.segment.settings import PredictedSegments
from tests.fake_results import write_results

DECIDED = 8.0
"""A logit that is as good as certain."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Folder of a tiny Mask2Former with random weights."""
    return tiny_mask2former.save(tmp_path_factory.mktemp("model"))


@pytest.fixture(autouse=True)
def _offline(monkeypatch, tmp_path):
    """Whatever asks the network fails, and the cache is empty."""

    def refuse(*_, **__):
        pytest.fail("asks the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "hub"))


@pytest.fixture
def data(tmp_path, np_rng):
    """Three views of 8x6 pixels with coarse random pictures."""
    root = write_results(tmp_path / "room")
    for view in "abc":
        write_exr(root / "dataset" / "images" / f"{view}.exr", {"": np_rng.random((6, 8, 3)).astype(np.float32)})
    return Dataset(root / "dataset")


def settings(model, **keys):
    return PredictedSegments(model=str(model), **{"overlap": 0, "score": 0.2, **keys})


def logits(queries, classes=5):
    """Class logits (Q, classes + 1) of queries that are sure of a label; "nothing" is label ``classes``."""
    sure = torch.zeros(len(queries), classes + 1)
    sure[torch.arange(len(queries)), torch.tensor(queries)] = DECIDED
    return sure


def rectangles(shape, *boxes):
    """Mask logits (Q, H, W), sure of a box (rows, columns) each."""
    masks = torch.full((len(boxes), *shape), -DECIDED)
    for mask, (rows, columns) in zip(masks, boxes, strict=True):
        mask[rows, columns] = DECIDED
    return masks


def test_network_input_is_the_supplements_picture():
    radiance = np.array([[[0.0, 0.5, 1.0], [0.25, 3.0, 0.1]]])
    expected = [[[0, round(255 * 0.5 ** (1 / 2.2)), 255], [round(255 * 0.25 ** (1 / 2.2)), 255, 90]]]
    assert network_input(radiance, 1.0).tolist() == expected
    np.testing.assert_array_equal(network_input(radiance, 2.0), network_input(2 * radiance, 1.0))


def test_panoptic_against_brute_force(np_rng):
    classes = torch.tensor(3 * np_rng.normal(size=(9, 5)), dtype=torch.float32)
    masks = torch.tensor(2 * np_rng.normal(size=(9, 11, 13)), dtype=torch.float32)
    ids, of = panoptic(classes, masks, (11, 13), score=0.5, overlap=0.2, stuff=())

    probabilities = np.exp(classes.numpy()) / np.exp(classes.numpy()).sum(1, keepdims=True)
    inside = 1 / (1 + np.exp(-masks.numpy()))
    kept = [q for q in range(9) if probabilities[q].argmax() < 4 and probabilities[q].max() > 0.5]
    assert 3 <= len(kept) < 9
    owner = np.array(
        [[max(kept, key=lambda q: probabilities[q].max() * inside[q, y, x]) for x in range(13)] for y in range(11)]
    )
    expected, labels = np.zeros((11, 13), int), [0]
    for q in kept:
        mask = (owner == q) & (inside[q] >= 0.5)
        if mask.any() and (owner == q).sum() >= 0.2 * (inside[q] >= 0.5).sum():
            expected[mask] = len(labels)
            labels.append(probabilities[q].argmax() + 1)
    np.testing.assert_array_equal(ids, expected)
    assert of.tolist() == labels
    assert ids.dtype == np.uint16


def test_stuff_is_one_segment_and_no_number_is_given_twice():
    """Wall, chair, wall, chair: three segments."""
    boxes = [(slice(0, 8), slice(i, i + 2)) for i in (0, 2, 4, 6)]
    ids, classes = panoptic(logits([3, 0, 3, 0]), rectangles((8, 8), *boxes), (8, 8), 0.5, 0.8, stuff={3})
    assert ids[0].tolist() == [1, 1, 2, 2, 1, 1, 3, 3]
    assert classes.tolist() == [0, 4, 1, 1]


def test_what_is_not_sure_stays_unknown():
    boxes = [(slice(0, 4), slice(0, 4)), (slice(0, 4), slice(0, 1)), (slice(4, 8), slice(0, 8))]
    masks = rectangles((8, 8), *boxes)
    masks[1] += 1  # takes its column from the first, which keeps three quarters
    for overlap, number in ((0.7, 1), (0.8, 0)):
        ids, _ = panoptic(logits([0, 1, 5]), masks, (8, 8), 0.5, overlap, ())
        assert (ids[0, 1:4] == number).all()
        assert ids[0, 0] > 0
        assert not ids[4:].any()  # the third query sees nothing
        assert not ids[:4, 4:].any()  # in nobody's mask


def test_masks_are_brought_to_the_size_of_the_view():
    ids, _ = panoptic(
        logits([0, 1]),
        rectangles((4, 4), (slice(0, 4), slice(0, 2)), (slice(0, 4), slice(2, 4))),
        (30, 20),
        0.5,
        0.5,
        (),
    )
    assert (ids[:, :10] == 1).all()
    assert (ids[:, 10:] == 2).all()


@pytest.mark.parametrize("shape", [(384, 384), (200, 300)])
def test_against_the_post_processing_of_transformers(np_rng, shape):
    """At 384x384, where theirs does not resample; elsewhere semantic maps differ at edges."""
    coarse = torch.tensor(2 * np_rng.normal(size=(1, 7, 6, 6)), dtype=torch.float32)
    masks = torch.nn.functional.interpolate(coarse, (384, 384), mode="bilinear")
    classes = torch.tensor(4 * np_rng.normal(size=(1, 7, 4)), dtype=torch.float32)
    outputs = SimpleNamespace(class_queries_logits=classes, masks_queries_logits=masks)
    # here: every process of tests reads this file, and one runs it
    from transformers.models.mask2former.image_processing_pil_mask2former import Mask2FormerImageProcessorPil

    processor = Mask2FormerImageProcessorPil()
    expected = processor.post_process_semantic_segmentation(outputs, [shape])[0].numpy() + 1
    assert len(np.unique(expected)) == 3
    ids, of = semantic(classes[0], masks[0], shape)
    np.testing.assert_array_equal(ids, expected)
    assert of.tolist() == [0, 1, 2, 3]

    theirs = processor.post_process_panoptic_segmentation(outputs, 0.6, 0.5, 0.3, set(), [shape])[0]
    ids, of = panoptic(classes[0], masks[0], shape, 0.6, 0.3, ())
    known = ids > 0
    assert 0.3 < known.mean() < 1  # theirs gives an id to pixels outside the mask of their query too
    if shape == (384, 384):
        np.testing.assert_array_equal(ids[known], theirs["segmentation"].numpy()[known])
        assert of[1:].tolist() == [entry["label_id"] + 1 for entry in theirs["segments_info"]]


def test_the_true_classes_run_offline(model, data):
    found = {view: (ids, classes) for view, ids, classes in Mask2Former(settings(model)).views(data, ["a", "b", "c"])}
    assert list(found) == ["a", "b", "c"]
    for ids, classes in found.values():
        assert ids.shape == (6, 8)
        assert ids.dtype == np.uint16
        assert 0 < ids.max() < len(classes)
        assert 1 <= classes[1:].min() <= classes.max() <= 8
    assert any((found["a"][0] != found[view][0]).any() for view in "bc")
    together = Mask2Former(settings(model, batch=2))
    assert together.names == {k + 1: f"class {k}" for k in range(8)}
    for view, ids, classes in together.views(data, ["a", "b", "c"]):
        np.testing.assert_array_equal(ids, found[view][0])
        np.testing.assert_array_equal(classes, found[view][1])


def test_semantic_ids_are_classes(model, data):
    for _, ids, classes in Mask2Former(settings(model, task="semantic")).views(data, ["a"]):
        assert ids.min() > 0
        assert classes.tolist() == list(range(9))
        assert ids.max() <= 8


@pytest.mark.gpu
def test_half_precision_agrees(model, data, monkeypatch):
    half = {view: ids for view, ids, _ in Mask2Former(settings(model, task="semantic")).views(data, ["a", "b"])}
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    for view, ids, _ in Mask2Former(settings(model, task="semantic")).views(data, ["a", "b"]):
        assert (ids == half[view]).mean() > 0.9


def test_finds_a_checkpoint_in_the_cache(model, tmp_path):
    kept = tmp_path / "hub" / "models--someone--rooms"
    shutil.copytree(model, kept / "snapshots" / ("0" * 40))
    (kept / "refs").mkdir()
    (kept / "refs" / "main").write_text("0" * 40)
    assert len(Mask2Former(settings("someone/rooms")).names) == 8


def test_says_which_weights_are_missing(model, tmp_path):
    with pytest.raises(FiptError) as error:
        Mask2Former(PredictedSegments())
    for text in (
        "config.json, preprocessor_config.json, model.safetensors of facebook/mask2former-swin-large-coco-panoptic",
        str(tmp_path / "hub" / "models--facebook--mask2former-swin-large-coco-panoptic"),
        "hf download facebook/mask2former-swin-large-coco-panoptic config.json",
        "segment.mode: geometry needs none",
    ):
        assert text in str(error.value)
    with pytest.raises(FiptError, match=r"segment.model /no/where/at/all does not exist"):
        Mask2Former(settings("/no/where/at/all"))
    folder = shutil.copytree(model, tmp_path / "pickled")
    (folder / "model.safetensors").rename(folder / "pytorch_model.bin")
    with pytest.raises(FiptError, match=r"model.safetensors missing .*pickled weights are not read"):
        Mask2Former(settings(folder))


def test_says_what_is_wrong_with_a_model(model, tmp_path):
    def damaged(name, change):
        folder = shutil.copytree(model, tmp_path / "damaged", dirs_exist_ok=True)
        change(folder / name)
        with pytest.raises(FiptError) as error:
            Mask2Former(settings(folder))
        assert "\n" not in str(error.value)
        return str(error.value)

    def without_a_weight(path):
        weights = load_file(path)
        weights.pop("class_predictor.bias")
        save_file(weights, path, {"format": "pt"})

    def of_another_kind(path):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"model_type": "detr"}))

    def with_more_labels(path):
        config = json.loads(path.read_text())
        labels = {str(k): str(k) for k in range(20)}
        path.write_text(json.dumps(config | {"id2label": labels, "label2id": {v: int(k) for k, v in labels.items()}}))

    cut = damaged("model.safetensors", lambda path: path.write_bytes(path.read_bytes()[:5000]))
    assert "does not hold a readable Mask2Former" in cut
    assert "does not hold a readable Mask2Former" in damaged("config.json", lambda path: path.write_text("{"))
    assert "does not hold a readable" in damaged("preprocessor_config.json", lambda path: path.write_text("{"))
    assert "it is a detr" in damaged("config.json", of_another_kind)
    assert "lacks 1 weights of its Mask2Former, or has them in another size, such as class_predictor.bias" in damaged(
        "model.safetensors", without_a_weight
    )
    assert "lacks 2 weights" in damaged("config.json", with_more_labels)
