"""A Mask2Former with random weights, saved to a folder: ``python -m benchmarks.tiny_mask2former FOLDER``.

It has the classes and the files of the published checkpoint, and segments nothing sensibly: it is there to run the
whole way offline, in seconds. ``--full`` has the published architecture (Swin-L, 200 queries), to measure memory.
"""

import argparse
from pathlib import Path

TINY = {
    "backbone": {"embed_dim": 8, "depths": [1, 1, 1, 1], "num_heads": [1, 1, 2, 2], "window_size": 4},
    "network": {
        "feature_size": 32,
        "mask_feature_size": 32,
        "hidden_dim": 32,
        "encoder_feedforward_dim": 32,
        "dim_feedforward": 32,
        "encoder_layers": 1,
        "decoder_layers": 2,
        "num_attention_heads": 2,
        "num_queries": 12,
    },
    "size": {"shortest_edge": 64, "longest_edge": 128},
}
FULL = {
    "backbone": {
        "embed_dim": 192, "depths": [2, 2, 18, 2], "num_heads": [6, 12, 24, 48], "window_size": 12, "image_size": 384,
    },
    "network": {"num_queries": 200},
    "size": {"shortest_edge": 800, "longest_edge": 1333},
}  # fmt: skip

LAST_MASK_LAYER = "model.transformer_module.decoder.mask_predictor.mask_embedder.2.0.weight"


def save(folder: Path, labels: int = 8, seed: int = 0, shape: dict = TINY) -> Path:
    """Write config, weights (safetensors) and image processor to ``folder``; return it.

    Parameters
    ----------
    labels
        Number of classes; 133 are those of COCO panoptic.
    shape
        `TINY` or `FULL`.
    """
    import torch
    from transformers import Mask2FormerConfig, Mask2FormerForUniversalSegmentation, SwinConfig
    from transformers.models.mask2former.image_processing_pil_mask2former import Mask2FormerImageProcessorPil
    from transformers.utils import logging

    logging.disable_progress_bar()
    torch.manual_seed(seed)
    stages = ["stage1", "stage2", "stage3", "stage4"]
    backbone = SwinConfig(**shape["backbone"], out_features=stages)
    names = {label: f"class {label}" for label in range(labels)}
    config = Mask2FormerConfig(
        backbone_config=backbone, **shape["network"], id2label=names, label2id={name: k for k, name in names.items()}
    )
    model = Mask2FormerForUniversalSegmentation(config)
    with torch.no_grad():  # untrained, all queries would be equally unsure of everything: no segment at all
        model.class_predictor.weight *= 200
        model.get_parameter(LAST_MASK_LAYER).mul_(100)
    model.save_pretrained(folder)
    Mask2FormerImageProcessorPil(size=shape["size"], num_labels=labels).save_pretrained(folder)
    return folder


def main() -> None:
    """Save a model to the folder that is named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--full", action="store_true", help="the published architecture: 0.9 GB")
    chosen = parser.parse_args()
    print(f"wrote {save(chosen.folder, labels=133, shape=FULL if chosen.full else TINY)}")


if __name__ == "__main__":
    main()
