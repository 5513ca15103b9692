"""Surface that no training view shows: its materials are those of the part around it, or guessed.

Counted on the held-out views, which look where people look; without any, on surface that the training views show. A
place is seen by the views of which a pixel's centre falls into its cell, which is two pixels wide.
"""

from collections.abc import Sequence

import numpy as np

from fipt.scene.confidence import records
from fipt.scene.display import tone_mapped
from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.samples import FootprintSamples, scene_box
from fipt.stages.findings.drawing import row
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import mean_error

_PIXELS = 2.0
"""Width of a cell, pixels."""
_UNSEEN = 0.07
"""Share at which unseen surface, whose base colours err 2.2 times as much as others', costs all of them one decibel.

1 + s (2.2^2 - 1) = 10^0.1; measured on the living room, docs/stages/findings.md.
"""
_MOST = 256
"""Cells along the room at most."""


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell how much of what the held-out views show no training view has seen."""
    if not room.held_out:
        return []
    counts = seen_counts([shard.samples for shard in room.shards], room.held_out)
    every = np.concatenate([count for _, count, _ in counts])
    if not len(every):
        return []
    shares = [(count == 0).mean() if len(count) else 0.0 for _, count, _ in counts]
    share = float((every == 0).mean())
    measure = Measure("held-out pixels that no training view shows", share, _UNSEEN)
    level = notes.judge("unseen", measure, mean_error(np.array(shares)))
    if level is None:
        return []
    view, count, (number, index) = counts[int(np.argmax(shares))]
    return [
        RoomFinding(
            "unseen",
            level,
            f"{100 * share:.0f} % of what the held-out views show is seen by no training view: its materials are "
            "guessed.",
            measure,
            "Take more photographs, from other places: above all of what is outlined in the picture.",
            {"views": [view]},
            {"seen_by_one": float((every == 1).mean())},
            image=_drawn(room, view, count, room.held_out[number], index),
        )
    ]


def seen_counts(
    train: Sequence[FootprintSamples], wanted: Sequence[FootprintSamples]
) -> list[tuple[str, np.ndarray, tuple[int, int]]]:
    """For each wanted view: its name, the training views that see each pixel whose centre hits, shard and number."""
    center, side = scene_box([*train, *wanted])
    footprint = np.mean(np.concatenate([shard.footprint for shard in train]), dtype=np.float64)
    resolution = int(np.clip(side / (_PIXELS * footprint), 8, _MOST))

    def cells(samples: FootprintSamples, index: int) -> np.ndarray:
        pixels = samples.pixels(index)
        chosen = np.asarray(samples.offsets[pixels])[np.asarray(samples.center[pixels]) > 0]
        return records(
            np.asarray(samples.position)[chosen], np.asarray(samples.normal)[chosen], center, side, resolution
        )

    known = [np.unique(cells(shard, index)) for shard in train for index in range(len(shard.views))]
    cell, views = np.unique(np.concatenate(known), return_counts=True)
    found = []
    for number, shard in enumerate(wanted):
        for index, view in enumerate(shard.views):
            own = cells(shard, index)
            place = np.minimum(np.searchsorted(cell, own), len(cell) - 1)
            found.append((view, np.where(cell[place] == own, views[place], 0), (number, index)))
    return found


def _drawn(room: JudgedRoom, view: str, count: np.ndarray, samples: FootprintSamples, index: int) -> np.ndarray:
    shape, pixels = samples.shapes[index], samples.pixels(index)
    mask = np.zeros(shape[0] * shape[1], bool)
    mask[np.asarray(samples.center[pixels]) > 0] = count == 0
    photo = tone_mapped(room.data.image(view)[0], room.exposure)
    return row({f"{view}: unseen, outlined": photo}, mask.reshape(shape))
