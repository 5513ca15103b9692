"""Segment ids of images by Mask2Former (supplement: COCO panoptic, Swin-L), a view at a time.

The network proposes Q masks, each with the probabilities of its classes; `panoptic` and `semantic` turn them into one
id a pixel (Cheng et al. 2021, section 3.4). Nothing is downloaded here, and nothing unpickled: weights are safetensors
in a folder, or in the local cache of huggingface_hub.
"""

import json
from collections.abc import Collection, Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fipt.errors import FiptError
from fipt.scene.dataset import Dataset
from fipt.stages.segment.checkpoint import model_folder
from fipt.stages.segment.settings import PredictedSegments

_COCO_CLASSES, _COCO_THINGS = 133, 80
"""Classes of COCO panoptic; those from 80 on (wall, floor, ...) are stuff: one segment a class, not one an object."""


class Mask2Former:
    """The network, ready to run.

    Attributes
    ----------
    names
        Class -> name; the classes are the checkpoint's labels + 1, since 0 means unknown.
    device
        ``cpu`` or ``cuda``.
    """

    def __init__(self, settings: PredictedSegments) -> None:
        self.settings = settings
        folder = model_folder(settings.model)
        if settings.threads:
            torch.set_num_threads(settings.threads)
        self.device = "cuda" if torch.cuda.is_available() else "cpu"
        self._model, self._processor = _loaded(folder)
        self._model.to(self.device).eval()
        labels = self._model.config.id2label
        self.names = {int(label) + 1: str(name) for label, name in labels.items()}
        self._stuff = range(_COCO_THINGS, _COCO_CLASSES) if len(labels) == _COCO_CLASSES else ()

    def views(self, data: Dataset, views: list[str]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Segment views of a dataset; those of one size go together in batches.

        Yields
        ------
        View, ids (H, W) uint16 with 0 = unknown, classes (K,) int32 of the ids.
        """

        def size(view: str) -> tuple[int, int]:
            return data.camera(view).height, data.camera(view).width

        for shape, group in groupby(views, size):
            alike = list(group)
            for first in range(0, len(alike), self.settings.batch):
                batch = alike[first : first + self.settings.batch]
                images = [network_input(data.image(view)[0], self.settings.exposure) for view in batch]
                for view, found in zip(batch, self._segmented(images, shape), strict=True):
                    yield view, *found

    @torch.inference_mode()
    def _segmented(self, images: list[np.ndarray], shape: tuple[int, int]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Ids and classes of images (H, W, 3) uint8 of one shape."""
        inputs = self._processor(images=images, input_data_format="channels_last", return_tensors="pt")
        half = self.device == "cuda" and self.settings.half
        with torch.autocast(self.device, torch.float16, enabled=half):
            found = self._model(**inputs.to(self.device))
        for classes, masks in zip(found.class_queries_logits, found.masks_queries_logits, strict=True):
            if self.settings.task == "semantic":
                yield semantic(classes.float(), masks.float(), shape)
            else:
                chosen = self.settings
                yield panoptic(classes.float(), masks.float(), shape, chosen.score, chosen.overlap, self._stuff)


def network_input(radiance: np.ndarray, exposure: float) -> np.ndarray:
    """(H, W, 3) uint8 image of linear radiance (H, W, 3): gamma 1/2.2, clipped to [0, 1] (supplement)."""
    return (np.clip(radiance * exposure, 0, 1) ** (1 / 2.2) * 255 + 0.5).astype(np.uint8)


def panoptic(
    class_logits: torch.Tensor,
    mask_logits: torch.Tensor,
    shape: tuple[int, int],
    score: float,
    overlap: float,
    stuff: Collection[int],
) -> tuple[np.ndarray, np.ndarray]:
    """One segment a pixel from the masks of all queries.

    Each pixel goes to the query whose class and mask are together the most probable. A query that loses most of its
    mask to others is dropped, and a pixel outside the mask of its query stays unknown. Written here rather than taken
    from transformers, which goes through masks of 384x384 pixels, gives numbers twice where stuff is merged
    (5.23), and needs memory for all masks at full size.

    Parameters
    ----------
    class_logits
        (Q, C + 1) float32; the last class is "nothing".
    mask_logits
        (Q, h, w) float32, of any resolution.
    shape
        (H, W) of the result.
    score
        Queries whose class is less probable are left out.
    overlap
        Share of its mask that a query must keep.
    stuff
        Labels of which all segments are one.

    Returns
    -------
    ids (H, W) uint16, 0 = unknown, and classes (K,) int32: label + 1.
    """
    scores, labels = class_logits.softmax(-1).max(-1)
    kept = torch.nonzero((labels < class_logits.shape[-1] - 1) & (scores > score))[:, 0].tolist()
    best = mask_logits.new_zeros(shape)
    owner = torch.full(shape, -1, dtype=torch.int32, device=best.device)
    inside = torch.zeros(shape, dtype=torch.bool, device=best.device)
    areas = {}
    for query in kept:  # a mask at a time: all of them at full size would be the largest arrays
        probability = _upsampled(mask_logits[query], shape).sigmoid()
        better = probability * scores[query] > best
        best[better] = probability[better] * scores[query]
        owner[better] = query
        inside = torch.where(better, probability >= 0.5, inside)
        areas[query] = int((probability >= 0.5).sum())
    best_query, inside_mask = owner.cpu().numpy(), inside.cpu().numpy()
    masks = (
        (int(labels[query]), own & inside_mask)
        for query in kept
        if (own := best_query == query).sum() >= overlap * areas[query]
    )
    return _numbered(masks, shape, stuff)


def _numbered(
    masks: Iterable[tuple[int, np.ndarray]], shape: tuple[int, int], stuff: Collection[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Ids (H, W) and classes (K,) of masks with their labels; masks of one label in ``stuff`` are one segment."""
    ids = np.zeros(shape, np.uint16)
    classes: list[int] = [0]
    merged: dict[int, int] = {}
    for label, mask in masks:
        if not mask.any():
            continue
        number = merged.get(label, len(classes))
        if number == len(classes):
            classes.append(label + 1)
        if label in stuff:
            merged[label] = number
        ids[mask] = number
    return ids, np.array(classes, np.int32)


def semantic(
    class_logits: torch.Tensor, mask_logits: torch.Tensor, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Class of every pixel: sum over queries of class probability times mask probability, the largest wins.

    Parameters and result as of `panoptic`; the ids are the classes, and no pixel is unknown.
    """
    weights = class_logits.softmax(-1)[:, :-1]
    maps = torch.einsum("qc,qhw->chw", weights, mask_logits.sigmoid())
    best = maps.new_full(shape, -1.0)
    ids = torch.zeros(shape, dtype=torch.int32, device=best.device)
    for label, coarse in enumerate(maps):
        fine = _upsampled(coarse, shape)
        ids[fine > best] = label + 1
        best = torch.maximum(best, fine)
    return ids.cpu().numpy().astype(np.uint16), np.arange(len(maps) + 1, dtype=np.int32)


def _upsampled(mask: torch.Tensor, shape: tuple[int, int]) -> torch.Tensor:
    """(H, W) of a coarser map (h, w), bilinear."""
    return torch.nn.functional.interpolate(mask[None, None], shape, mode="bilinear", align_corners=False)[0, 0]


def _loaded(folder: Path) -> tuple[Any, Any]:
    """Network and image processor of a folder; every weight must come from it."""
    from transformers.models.mask2former.image_processing_pil_mask2former import Mask2FormerImageProcessorPil
    from transformers.models.mask2former.modeling_mask2former import Mask2FormerForUniversalSegmentation
    from transformers.utils import logging

    logging.disable_progress_bar()
    logging.set_verbosity_error()
    remedy = "fetch the checkpoint again, or export it with save_pretrained"
    try:
        kind = json.loads((folder / "config.json").read_text(encoding="utf-8"))["model_type"]
        if kind != "mask2former":
            raise ValueError(f"it is a {kind}")
        loaded: Any = Mask2FormerForUniversalSegmentation.from_pretrained(
            folder,
            local_files_only=True,
            use_safetensors=True,
            ignore_mismatched_sizes=True,  # reported below
            output_loading_info=True,
        )
        model, info = loaded  # a pair, since the loading information is asked for
        processor = Mask2FormerImageProcessorPil.from_pretrained(folder, local_files_only=True)
    except Exception as error:  # parsers of JSON and safetensors, and transformers, each raise their own kinds
        raise FiptError(f"{folder} does not hold a readable Mask2Former ({error})", remedy) from error
    absent = {*info["missing_keys"], *(key for key, *_ in info["mismatched_keys"])}
    wrong = sorted(absent & {name for name, _ in model.named_parameters()})  # tables that it computes may be absent
    if wrong:
        raise FiptError(
            f"{folder} lacks {len(wrong)} weights of its Mask2Former, or has them in another size, such as {wrong[0]}",
            remedy,
        )
    return model, processor
