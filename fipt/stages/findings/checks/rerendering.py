"""Training views rendered with the model, against their photographs: the room as a whole, and views that stand out.

What all pixels of a view share is left to the light balance and the exposures: a view's figure is the median absolute
logarithm of the ratio about the view's own median.
"""

import numpy as np

from fipt.formats.images import psnr_of_error, srgb_encode
from fipt.robust import spread
from fipt.scene.findings import Measure, RoomFinding
from fipt.scene.observed import fully_weighted
from fipt.stages.findings.checks.light_balance import usable
from fipt.stages.findings.drawing import compared, log_ratio
from fipt.stages.findings.notes import Notes
from fipt.stages.findings.retakes import Retake
from fipt.stages.findings.room import JudgedRoom
from fipt.stages.findings.tolerance import OUTLIER, TOLERANCE, median_error


def check(room: JudgedRoom, notes: Notes) -> list[RoomFinding]:
    """Tell a room that is rendered unlike its photographs, and views that are while the others are not."""
    judged = [retake for retake in room.retakes if usable(retake).any()]
    if not judged:
        return []
    off = np.array([_off(retake) for retake in judged])
    return [*_whole(room, notes, judged, off), *_outliers(room, notes, judged, off)]


def _off(retake: Retake) -> float:
    ratio = log_ratio(retake.render, retake.photo)[usable(retake)]
    return float(np.median(np.abs(ratio - np.median(ratio))))


def psnr(retakes: list[Retake]) -> float:
    """Pooled PSNR of retakes against their photographs, clipped and with the sRGB curve, dB."""
    square = []
    for each in retakes:
        off = srgb_encode(np.clip(each.render, 0, 1)) - srgb_encode(np.clip(each.photo, 0, 1))
        square.append(np.square(off)[fully_weighted(each.weight)])
    return psnr_of_error(np.concatenate(square).mean())


def _whole(room: JudgedRoom, notes: Notes, judged: list[Retake], off: np.ndarray) -> list[RoomFinding]:
    measure = Measure(
        "typical difference of a pixel's radiance, rendered and photographed", float(np.median(off)), 2 * TOLERANCE
    )
    level = notes.judge("rerendering", measure, median_error(off))
    if level is None:
        return []
    typical = judged[int(np.abs(off - np.median(off)).argmin())]
    return [
        RoomFinding(
            "rerendering",
            level,
            f"Rendered with what was found, the room looks unlike its photographs: a typical pixel is off by "
            f"{100 * measure.value:.0f} %.",
            measure,
            "The other findings say why; where none does, check poses and mesh (the overlay in the report).",
            {"views": [typical.camera.name]},
            {"psnr": psnr(judged)},
            image=compared(typical.photo, typical.render, room.exposure),
        )
    ]


def _outliers(room: JudgedRoom, notes: Notes, judged: list[Retake], off: np.ndarray) -> list[RoomFinding]:
    usual, scatter = float(np.median(off)), spread(off)
    threshold = max(usual + OUTLIER * scatter, 2 * TOLERANCE)
    measure = Measure("largest typical difference of a view", float(off.max()), threshold)
    level = notes.judge("view-unlike", measure)
    if level is None:
        return []
    worst = np.argsort(-off)[: int((off > threshold).sum())]
    names = [judged[k].camera.name for k in worst]
    return [
        RoomFinding(
            "view-unlike",
            level,
            f"{'Views' if len(names) > 1 else 'View'} {', '.join(names)}: rendered with what was found, unlike the "
            f"photograph by {100 * off.max():.0f} % where the others are by {100 * usual:.0f} %.",
            measure,
            "Look at the picture: a wrong pose shifts edges, something that moved stands in one image only; leave such "
            "a view out.",
            {"views": names},
            image=compared(judged[worst[0]].photo, judged[worst[0]].render, room.exposure),
        )
    ]
