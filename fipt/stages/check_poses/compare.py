"""Second check of the cameras, once there is a mesh: every view must show what the others show of the same surface.

What a view sees is carried into another one through the mesh: the samples of its pixels are projected there, where
the other camera sees them too (a ray says so) and from the same side. Brightness changes with the view on glossy
surface, edges and texture stay in place: so the two views are compared by the correlation of their log luminance in
small windows. A camera that is mirrored, turned or swapped disagrees with all others, a good one only with the wrong
ones, which the median over its partners leaves out. (The two-step check of the paper's supplement, for any mesh.)
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates, uniform_filter

from fipt.errors import FiptError
from fipt.progress import progress
from fipt.render.scene import RayScene
from fipt.robust import deviation
from fipt.stages.check_poses.settings import CheckPosesSettings
from fipt.stages.check_poses.surface import ReducedView, shared_pixels, visible
from fipt.stages.check_poses.verdict import Verdict

_WINDOW = 9
"""Side of the windows of correlation, pixels."""

_FILLED = 0.6
"""Share of a window that both views must show."""

_FLAT = 0.04
"""Standard deviation of log luminance in a window below which it shows no structure."""

_STRONG = 0.4
"""Structure counts by its standard deviation up to this one: a lamp's edge must not outweigh all else."""

STRUCTURE = 0.02
"""Share of a view's pixels that must have structure in common with a partner for it to tell anything."""

_POOR = 0.2
"""Correlation below which a view fails, however poor the others are."""

_EXPOSED = 1.2
"""Ratio of a view's brightness to that of the others from which its exposure is named."""

_PASSES = 4
"""How often the brightness of all views is told anew: an error of a view reaches its witnesses' own by then."""

_WITNESSES = 3
"""Partners, and views, that must tell it."""

_SAMPLES = 0.02
"""Share of a view's pixels that must meet the mesh."""

_BEHIND = 0.1
"""Share of a view that others see from the other side of the surface, from which on the camera stands outside."""

_SAME = 0.2
"""Difference of log luminance up to which a pixel looks the same from both sides, as diffuse surface does."""


@dataclass(frozen=True)
class Comparison:
    """What one view shows of another's surface.

    Attributes
    ----------
    score
        Correlation of log luminance in windows, weighted by their structure, in [-1, 1].
    overlap, structure
        Shares of the first view's pixels that the second shows too, and of those with structure around them.
    color
        Share of the shared pixels whose luminance is the same.
    brighter
        Median difference of log luminance on shared pixels, first less second view.
    """

    score: float
    overlap: float
    structure: float
    color: float
    brighter: float


def enough(verdicts: Sequence[Verdict], settings: CheckPosesSettings) -> None:
    """Raise FiptError if fewer views than the share `keep` are left: most likely the mesh is not where cameras are."""
    failed = [verdict for verdict in verdicts if not verdict.accepted]
    if len(failed) > (1 - settings.keep) * len(verdicts):
        raise FiptError(
            f"at least {settings.keep:.0%} of the views must show what others show through the mesh; "
            f"{len(failed)} of {len(verdicts)} do not: {', '.join(v.view for v in failed)}; "
            f"{failed[0].view} {failed[0].reason}",
            "look at overlay.png: mesh and cameras must be in one frame and one unit",
        )


def judge(scene: RayScene, views: Sequence[ReducedView], settings: CheckPosesSettings) -> list[Verdict]:
    """Compare every view with those that share most with it, and reject the worst until all agree.

    The worst goes first, and the others are then judged without it. Who was rejected for wrong partners comes back
    where those that are left agree with it.
    """
    shared, behind = shared_pixels(scene, views)
    partners = [[int(j) for j in np.argsort(-row, kind="stable")[: settings.partners] if row[j] > 0] for row in shared]
    compared: dict[tuple[int, int], Comparison] = {}
    with progress("check poses", sum(map(len, partners)), " pairs") as bar:
        for i, chosen in enumerate(partners):
            for j in chosen:
                compared[i, j] = compare(scene, views[i], views[j])
            bar.advance(len(chosen), views[i].camera.name)

    def telling(i: int, among: set[int]) -> list[int]:
        return [j for j in partners[i] if j in among and compared[i, j].structure >= STRUCTURE]

    def score(i: int, among: set[int]) -> float | None:
        values = [compared[i, j].score for j in telling(i, among)]
        return float(np.median(values)) if values else None

    every = set(range(len(views)))
    accepted = set(every)
    least = _POOR
    while known := {i: s for i in sorted(accepted) if (s := score(i, accepted)) is not None}:
        least = max(settings.least_score * float(np.median(list(known.values()))), _POOR)
        worst = min(known, key=known.__getitem__)
        if known[worst] >= least:
            break
        accepted.remove(worst)
    accepted |= {i for i in every - accepted if (score(i, accepted) or 0.0) >= least}

    witnesses = [telling(i, accepted) or telling(i, every) for i in range(len(views))]
    verdicts = []
    for i, (view, used) in enumerate(zip(views, witnesses, strict=True)):
        value = score(i, set(used))
        overlap = max((compared[i, j].overlap for j in partners[i]), default=0.0)
        ok, reason = True, ""
        if view.hit.mean() < _SAMPLES:
            ok, reason = False, f"meets the mesh in {view.hit.mean():.1%} of its pixels only"
        elif behind[i] > max(_BEHIND, overlap):
            ok, reason = False, f"sees from behind what others see from the front, in {behind[i]:.0%} of its pixels"
        elif overlap < settings.least_overlap or value is None:
            reason = f"not judged: others show {overlap:.0%} of it, or it has no structure"
        elif i not in accepted:
            ok = False
            few = 2 * len(every - accepted) <= len(views)  # where most fail, the mistake is not theirs (`diagnose`)
            remark = _remark(scene, views, i, every - accepted, used, least) if few else ""
            reason = (
                f"does not show what {len(used)} others show of the same surface (correlation {value:.2f}, at least "
                f"{least:.2f}){remark}"
            )
        color = float(np.median([compared[i, j].color for j in used])) if used else None
        names = tuple(views[j].camera.name for j in used)
        verdicts.append(Verdict(view.camera.name, value, overlap, float(behind[i]), color, None, names, ok, reason))
    return _exposed(verdicts, _exposures(witnesses, compared), settings.correct_exposure)


def _exposures(
    witnesses: Sequence[Sequence[int]], compared: Mapping[tuple[int, int], Comparison]
) -> list[float | None]:
    """Brightness of each view over that of all others on the same surface; None where none tells.

    Each is the median over its witnesses, whose own brightness is taken out; most are as bright as most.
    """
    level = np.zeros(len(witnesses))
    for _ in range(_PASSES):
        levels = [
            np.median([compared[i, j].brighter + level[j] for j in own]) for i, own in enumerate(witnesses) if own
        ]
        level[[i for i, own in enumerate(witnesses) if own]] = np.array(levels) - np.median(levels or [0.0])
    return [float(np.exp(level[i])) if own else None for i, own in enumerate(witnesses)]


def _exposed(judged: Sequence[Verdict], exposures: Sequence[float | None], correct: bool) -> list[Verdict]:
    """Verdicts that also say whose exposure is off: that view stays, since its structure is that of the others."""
    verdicts = [replace(verdict, exposure=level) for verdict, level in zip(judged, exposures, strict=True)]
    found = np.log([v.exposure for v in verdicts if v.accepted and v.exposure and len(v.partners) >= _WITNESSES])
    if len(found) < _WITNESSES:
        return list(verdicts)
    limit = max(np.log(_EXPOSED), 5 * float(deviation(found)))

    def exposed(verdict: Verdict) -> Verdict:
        known = verdict.accepted and verdict.exposure and len(verdict.partners) >= _WITNESSES and not verdict.reason
        if not known or abs(np.log(verdict.exposure or 1.0)) < limit:
            return verdict
        reason = f"is {verdict.exposure:.2f} times as bright as others show the same surface: another exposure?"
        if not correct:
            return replace(verdict, reason=reason)
        return replace(verdict, reason=f"{reason} It is divided by that", gain=1 / (verdict.exposure or 1.0))

    return [exposed(verdict) for verdict in verdicts]


def _remark(
    scene: RayScene, views: Sequence[ReducedView], i: int, failed: set[int], partners: Sequence[int], least: float
) -> str:
    """Say what would fit instead at a camera that fails: another failing view's image, or its own, mirrored."""
    own = views[i]
    others = {
        f"; the image of {views[k].camera.name} fits there: are they swapped?": views[k]
        for k in sorted(failed - {i})
        if views[k].light.shape == own.light.shape
    }
    mirrored = replace(own, light=own.light[:, ::-1], valid=own.valid[:, ::-1])
    for remark, other in {**others, "; its image fits there mirrored": mirrored}.items():
        placed = replace(own, light=other.light, valid=other.valid)
        if np.median([compare(scene, placed, views[j]).score for j in partners]) >= least:
            return remark
    return ""


def compare(scene: RayScene, here: ReducedView, there: ReducedView) -> Comparison:
    """Carry what ``there`` shows into ``here`` through the mesh, and correlate the two."""
    points = here.points.reshape(-1, 3)
    pixels, from_front, _ = visible(scene, here, there, np.flatnonzero(here.hit))
    row, column = pixels[:, 1] - 0.5, pixels[:, 0] - 0.5
    light = np.zeros(len(points))
    light[from_front] = map_coordinates(there.light, [row[from_front], column[from_front]], order=1, mode="nearest")
    seen = np.zeros(len(points), bool)
    seen[from_front] = map_coordinates(
        there.valid.astype(np.float32), [row[from_front], column[from_front]], order=1, mode="nearest"
    ) > 0.99  # fmt: skip
    mask = seen.reshape(here.hit.shape) & here.valid
    light = light.reshape(mask.shape)

    share = uniform_filter(mask.astype(np.float64), _WINDOW, mode="constant")

    def mean(values: np.ndarray) -> np.ndarray:
        return uniform_filter(values * mask, _WINDOW, mode="constant") / np.maximum(share, 1e-9)

    a, b = here.light.astype(np.float64), light
    mean_a, mean_b = mean(a), mean(b)
    deviation_a, deviation_b = (
        np.sqrt(np.maximum(mean(x * x) - m * m, 0)) for x, m in ((a, mean_a), (b, mean_b))
    )  # fmt: skip
    together = mean(a * b) - mean_a * mean_b
    # Structure that only one of them shows counts in full: it is missing in the other.
    structure = np.maximum(deviation_a, deviation_b)
    used = mask & (share > _FILLED) & (structure > _FLAT)
    if not used.any():
        return Comparison(0.0, float(mask.mean()), 0.0, 0.0, 0.0)
    correlation = np.clip(together / np.maximum(deviation_a * deviation_b, (_FLAT / 2) ** 2), -1, 1)
    weight = np.minimum(structure, _STRONG)[used]
    return Comparison(
        float(weight @ correlation[used] / weight.sum()),
        float(mask.mean()),
        float(used.mean()),
        float((np.abs(a - b)[mask] < _SAME).mean()),
        float(np.median((a - b)[mask])),
    )


def table(verdicts: Sequence[Verdict]) -> str:
    """Return the verdicts for the terminal, the worst first."""
    lines = [f"{'view':<20} {'score':>6} {'shared':>7} {'color':>7} {'with':>5}  verdict"]
    for verdict in sorted(verdicts, key=lambda v: (v.accepted, v.score if v.score is not None else 2.0)):
        score = "-" if verdict.score is None else f"{verdict.score:.2f}"
        color = "-" if verdict.color is None else f"{verdict.color:.0%}"
        state = ("ok" if verdict.accepted else "REJECTED") + (f": {verdict.reason}" if verdict.reason else "")
        numbers = f"{score:>6} {verdict.overlap:>7.0%} {color:>7} {len(verdict.partners):>5}"
        lines.append(f"{verdict.view:<20} {numbers}  {state}")
    return "\n".join(lines)
