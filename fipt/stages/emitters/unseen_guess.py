"""Light that no view shows: guessed emitters beside those that were found, where the photographs tell of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from fipt.groups import grouped_median
from fipt.scene.emitters import Emitters
from fipt.scene.environment import EnvironmentMap
from fipt.scene.mesh import Mesh
from fipt.scene.observed import ObservedShard
from fipt.scene.samples import median_footprint
from fipt.scene.surface_blocks import LEAST_BLOCKS, LEAST_SIGMA, Blocks, blocks_of
from fipt.stages.emitters.edges import without_edge
from fipt.stages.emitters.extract import Extracted
from fipt.stages.emitters.observations import guess_confidence
from fipt.stages.emitters.unseen import Lights, Transport, seen_light, with_more_rays, with_patches
from fipt.stages.emitters.unseen_fit import Guess, SearchSpace, Start, explain, explained, witnessed
from fipt.stages.emitters.unseen_surface import Patches, hidden_triangles, patches_as_before, patches_of, small_parts

_ENCLOSED = 0.3
"""Share of a patch's light that arrives at seen surface, below which it lies in a gap or a box: no lamp does."""
_LEVEL = 0.7
"""Cosine with the vertical above which a surface is floor or ceiling."""
_FINER = 2
"""How often the cells around patches that emit are halved: to 9 cm in a room, in which a strip is no whole cupboard."""
_OPEN = 0.15
"""Share of the light's directions that may leave the mesh unknown; more is an error like those of shading."""


@dataclass(frozen=True)
class Guessed:
    """Emitters with what was guessed, and what to say about it.

    Attributes
    ----------
    emitters
        Found ones, then guessed ones.
    warnings
        For people.
    figures
        For stats/.
    """

    emitters: Emitters
    warnings: tuple[str, ...]
    figures: Mapping[str, Any]


@dataclass(frozen=True)
class _Trial:
    """A guess beside given emitters: what was to be explained, by what, and how well."""

    blocks: Blocks
    transport: Transport
    patches: Patches
    guess: Guess

    @property
    def emits(self) -> np.ndarray:
        """(P,) bool: patches that emit."""
        return self.guess.radiance.max(axis=1) > 0

    @cached_property
    def light(self) -> np.ndarray:
        """(N,) irradiance over pi of the blocks, guessed light included."""
        light = self.transport.seen + self.transport.unseen @ self.guess.radiance
        return np.maximum(light.mean(axis=1), 1e-12)

    def ratio(self) -> np.ndarray:
        """(N,) radiance of the blocks over that of white surface."""
        return self.blocks.radiance.mean(axis=1) / self.light

    def share(self) -> np.ndarray:
        """(N,) share of the light of the blocks that is guessed."""
        return 1 - self.transport.seen.mean(axis=1) / self.light


@dataclass(frozen=True)
class _Judged:
    """Emitters that were found, judged by the light beside them.

    Attributes
    ----------
    emitters
        Those that no light explains.
    doubtful
        (E,) bool: which of these are doubtful.
    darkened
        Those that only the light of all that views show explains: they reflect, and some emitter was not found.
    trial
        The guess beside the emitters; None where nothing asks for one.
    """

    emitters: Emitters
    doubtful: np.ndarray
    darkened: Emitters
    trial: _Trial | None


def with_guess(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    extracted: Extracted,
    cache: Mapping[str, np.ndarray],
    environment: EnvironmentMap,
    at_most: np.ndarray,
    before: np.ndarray | None = None,
    asked: bool = False,
) -> Guessed:
    """Add the emission of unseen surface that explains the photographs, where seen light does not.

    What emits only because it is brighter than white may be lit by an emitter that no view shows. Light is guessed
    beside the certain emitters first; surface that it makes darker than white reflects. Where light is missing and no
    guess tells from where, it is undecided; it emits where with it only the level of the reflectances is unusual: the
    room is white. Where it has no edge (`fipt.stages.emitters.edges`) it does not emit in any case: it reflects if a
    guess lights it, else it is undecided.

    Parameters
    ----------
    shards
        The training views.
    extracted
        Emitters that views show.
    at_most
        (T,) radiance that is known to be the most of each triangle, the mean of the channels: 0 where a person said
        that it does not emit, what a mirror shows of it, inf elsewhere. No more than white surface has is no lamp.
    before
        (T,) int64 emitter that was guessed in the round before, -1 for none. It stays unless another guess gains more.
    asked
        Whether the refinement found that the emitters give too little light.
    """
    before = np.full(len(at_most), -1) if before is None else np.where(at_most > 0, before, -1)
    trial = partial(_trial, mesh, shards, cache=cache, environment=environment, at_most=at_most, before=before)
    judged = _judged(trial, shards, extracted, len(mesh.triangles), asked or bool((before >= 0).any()))
    found, tried, missing = judged.emitters, judged.trial, _missing(mesh, judged.darkened)
    if tried is None:
        return Guessed(found, missing, {"guess": {"tried": False}})  # nothing asks for it, or too little is seen
    guess, leaves = tried.guess, float(np.median(tried.transport.open))
    figures = {
        "explained": False,
        "determined": guess.determined,
        "patches": int(tried.emits.sum()),
        "gain": guess.gain,
        "share": guess.share,
        "spread": guess.spread,
        "residual": [guess.before, guess.left],
        "open": leaves,
    }
    if not guess.determined:
        if (before < 0).all() and not guess.even_before:
            found = replace(found.chosen(~judged.doubtful), undecided=found.undecided.joined(extracted.doubtful))
        return Guessed(found, missing + _undetermined(guess, leaves), {"guess": figures})
    emitters = _added(mesh, found, tried.patches, guess)
    own = ~np.isin(emitters.triangle, found.triangle)  # copies of lamps are guessed for another reason
    return Guessed(emitters, missing + _advice(mesh, emitters, own, guess, environment.up), {"guess": figures})


def _judged(
    trial: Callable[..., _Trial | None],
    shards: Sequence[ObservedShard],
    extracted: Extracted,
    triangles: int,
    asked: bool,
) -> _Judged:
    """Emitters that are not told to be lit, and the guess beside them.

    A guess needs another witness than how bright it is what asks for it. What has no edge is taken out of the emitters;
    it becomes undecided where no guess lights it. What the light of all that views show explains is taken out as well:
    it reflects.

    Parameters
    ----------
    trial
        Guesses light beside emitters.
    asked
        Whether other evidence than doubtful emitters says that light is missing.
    """
    found, doubtful = extracted.emitters, extracted.in_doubt
    if not doubtful.any():
        return _Judged(found, doubtful, found.chosen(doubtful), trial(found, asked=asked))
    number = np.where(doubtful, found.emitter, -1)
    fading = np.isin(number, without_edge(shards, _numbers(found, triangles)))
    tried = trial(found.chosen(~doubtful), asked=True)
    if tried is not None and not asked:
        asks = _numbers(found, triangles, doubtful)[tried.blocks.triangle] >= 0
        tried = replace(tried, guess=witnessed(tried.guess, tried.blocks, tried.patches, tried.transport, asks))
    lit = np.isin(number, _lit(tried, found, doubtful, triangles))
    lit_by_seen = np.isin(number, _lit_by_what_is_seen(tried, found, doubtful & _for_brightness(extracted), triangles))
    stays = ~(lit | fading | lit_by_seen)
    kept = found.chosen(stays)
    if not lit.any() and (fading != doubtful).any():  # else it was tried beside these already
        tried = trial(kept, asked=asked or bool(fading.any()))
    reflects = lit | lit_by_seen | np.isin(number, _lit(tried, found, fading, triangles, brightest=np.inf))
    if fading.any() and not asked and not reflects.any():
        tried = trial(kept, asked=False)  # a guess that lights nothing of what asked for it needs to be as sure as any
    unclear = extracted.doubtful.of(found.triangle[fading & ~reflects])
    kept = replace(kept, undecided=kept.undecided.joined(unclear))
    lit |= np.isin(number, _lit(tried, found, lit_by_seen, triangles, brightest=np.inf))
    return _Judged(kept, doubtful[stays], found.chosen(lit_by_seen & ~lit & ~fading), tried)


def _for_brightness(extracted: Extracted) -> np.ndarray:
    """(E,) bool: triangles of emitters of which a doubtful region is brighter than its material lets it be.

    Others were found since they are even.
    """
    found, asked = extracted.emitters, extracted.doubtful
    bright = (asked.reflects - asked.emits > asked.price)[asked.region]
    return np.isin(found.emitter, found.emitter[np.isin(found.triangle, asked.triangle[bright])])


def _numbers(found: Emitters, triangles: int, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(T,) number of the emitter of each of so many triangles, -1 for none, and for those not in ``rows`` (E,)."""
    number = np.full(triangles, -1)
    number[found.triangle[rows]] = found.emitter[rows]
    return number


def _trial(
    mesh: Mesh,
    shards: Sequence[ObservedShard],
    found: Emitters,
    cache: Mapping[str, np.ndarray],
    environment: EnvironmentMap,
    at_most: np.ndarray,
    before: np.ndarray,
    asked: bool = False,
) -> _Trial | None:
    """Guess light beside emitters; None where they explain the photographs, or too little is seen.

    If ``asked``, other evidence says that they do not.
    """
    emitting = np.zeros(len(mesh.triangles), bool)
    emitting[found.triangle] = True
    blocks = blocks_of(shards, mesh, emitting, cache)
    if len(blocks.radiance) < LEAST_BLOCKS:
        return None
    lights = Lights(mesh, hidden_triangles(mesh, shards, found), cache, found, environment, blocks.brightest)
    lights.beyond = blocks.beyond(mesh, lights.hidden, cache)
    known = seen_light(blocks, lights)
    if not asked and explained(blocks, known):
        return None
    hidden = lights.hidden & (at_most > blocks.white)  # what a mirror shows to be as dark as surface is no lamp
    met = hidden & (lights.met > 0)  # of the rays from what is seen
    part = small_parts(mesh, hidden, lights.met)
    met |= part >= 0  # few rays meet a bulb, and each of them one of its many triangles
    offered = partial(_offered, blocks, lights, known, _square_pixel(shards), asked)
    trial = _finer(offered(patches_of(mesh, met, part)), offered, mesh)
    if (hidden & (before >= 0)).any():
        old = patches_as_before(mesh, met | hidden & (before >= 0), part, before)
        again = offered(old, trial if trial.guess.determined else None, trial.guess.space)
        better = not trial.guess.determined or again.guess.gain >= trial.guess.gain
        trial = again if again.guess.determined and better else trial
    return _measured(trial, lights, asked) if trial.guess.determined else trial


def _finer(trial: _Trial, offered: Callable[..., _Trial], mesh: Mesh) -> _Trial:
    """The guess in smaller cells around the patches that emit, as long as it is determined: the one that gains most.

    Large cells only tell where: they shine beside the lamp, too, with up to three times its power. Small parts that
    emit are no cells: the search begins with them.
    """
    tried = [trial]
    for _ in range(_FINER if trial.guess.determined else 0):
        smaller = offered(tried[-1].patches.finer(tried[-1].emits, mesh), after=tried[-1])
        if not smaller.guess.determined:
            break
        tried.append(smaller)
    return max(tried[1:] or tried, key=lambda each: each.guess.gain)


def _square_pixel(shards: Sequence[ObservedShard]) -> float:
    """Square metres of surface that a pixel shows, in the median of all samples."""
    return median_footprint([shard.samples for shard in shards]) ** 2


def _offered(
    blocks: Blocks,
    lights: Lights,
    known: Transport,
    least: float,
    asked: bool,
    patches: Patches,
    after: _Trial | None = None,
    space: SearchSpace | None = None,
) -> _Trial:
    """Guess which patches emit, of those of an area of ``least`` or more, square metres: others hide in a mesh's gaps.

    ``after`` another guess, the search begins with its small parts, under its errors. Patches that were found in
    a larger ``space`` pay for all of it.
    """
    transport = with_patches(blocks, patches, lights, known)
    # of what a patch sends out, pi times its area and radiance, blocks have a sample
    seen_area = lights.mesh.areas[~lights.hidden].sum()
    lights_room = patches.lighting(transport.unseen.mean(axis=0) * seen_area, _ENCLOSED) & patches.at_least(least)
    transport = replace(transport, unseen=transport.unseen * lights_room)
    # nor does it shine as a part of a plane that lights the room elsewhere
    patches = replace(patches, piece=np.where(lights_room, patches.piece, -1))
    start = None
    if after is not None:
        start = Start(patches.columns_of(after.patches.small(after.emits)), after.guess.errors)
    return _Trial(blocks, transport, patches, explain(blocks, patches, transport, asked, start, space))


def _measured(trial: _Trial, lights: Lights, asked: bool) -> _Trial:
    """The powers of what emits, by many more rays to it: few rays tell which patches emit, and little of how much.

    If many rays say that none of it is worth its price, the guess is not determined.
    """
    emits = trial.emits
    patches, given = trial.patches.only(emits, lights.mesh), trial.transport
    of_these = replace(given, unseen=given.unseen[:, emits], straight=given.straight[:, emits])
    transport = with_more_rays(trial.blocks, patches, lights, of_these)
    # equally bright patches are one emitter
    piece = np.unique(trial.guess.radiance[emits], axis=0, return_inverse=True)[1].reshape(-1)
    patches = replace(patches, piece=piece, kept=np.ones(len(piece), bool))
    found = trial.guess
    again = explain(trial.blocks, patches, transport, asked, Start.of_all(patches, found), found.space)
    return _Trial(trial.blocks, transport, patches, again)


def _lit(
    trial: _Trial | None, found: Emitters, doubtful: np.ndarray, triangles: int, brightest: float = 1.0
) -> np.ndarray:
    """Numbers of the emitters that a guess lights, and that are no brighter then than so many times white.

    ``doubtful`` (E,) bool are those that are asked about. A guess that gives less there than what is traced may err by
    (`LEAST_SIGMA`) says nothing about an emitter: one that was found since it is even may be darker than white under
    any light.
    """
    if trial is None or not trial.guess.determined:
        return np.zeros(0, np.int64)
    asked, names, index = _blocks_of(trial, found, doubtful, triangles)
    ratio, share = (grouped_median(values[asked], index, len(names)) for values in (trial.ratio(), trial.share()))
    return names[(ratio <= brightest) & (share > LEAST_SIGMA)]


def _lit_by_what_is_seen(trial: _Trial | None, found: Emitters, bright: np.ndarray, triangles: int) -> np.ndarray:
    """Numbers of the emitters that are no brighter than white under the light of what views show.

    ``bright`` (E,) bool are those that emit since they are brighter than white under the traced light. That lacks what
    unseen lamps give; of the measured light only their own rays are missing.
    """
    if trial is None:
        return np.zeros(0, np.int64)
    asked, names, index = _blocks_of(trial, found, bright, triangles)
    white = np.maximum(trial.transport.seen[asked].mean(axis=1), 1e-12)
    return names[grouped_median(trial.blocks.radiance[asked].mean(axis=1) / white, index, len(names)) <= 1]


def _blocks_of(
    trial: _Trial, found: Emitters, chosen: np.ndarray, triangles: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N,) numbers of the blocks of chosen emitters (E,), (K,) numbers of these, and (N,) which of them each is of."""
    emitter = _numbers(found, triangles, chosen)[trial.blocks.triangle]
    asked = np.flatnonzero(emitter >= 0)
    names, index = np.unique(emitter[asked], return_inverse=True)
    return asked, names, index.reshape(-1)


def _added(mesh: Mesh, found: Emitters, patches: Patches, guess: Guess) -> Emitters:
    """Emitters with the triangles of every patch that emits; equally bright ones of a piece or part are one emitter."""
    emits = np.append(guess.radiance.max(axis=1) > 0, False)  # triangles of no patch do not
    # a doubtful emitter was no emitter when patches were chosen, and stays one where the guess does not light it
    triangle = np.setdiff1d(np.flatnonzero(emits[patches.number]), found.triangle)
    patch, count = patches.number[triangle], len(triangle)
    # a patch of no piece is one by itself
    owner = np.where(patches.piece[patch] >= 0, patches.piece[patch], -1 - patch)
    key = np.column_stack([owner, patches.part[triangle], guess.radiance[patch].mean(axis=1)])
    _, own = np.unique(key, axis=0, return_inverse=True)
    number = int(found.emitter.max(initial=-1)) + 1 + own.reshape(-1)
    return found.joined(
        Emitters(
            triangle=triangle.astype(np.int32),
            radiance=guess.radiance[patch].astype(np.float32),
            error=(guess.spread * guess.radiance[patch]).astype(np.float32),
            area=mesh.areas[triangle].astype(np.float32),
            emitter=number.astype(np.int32),
            views=np.zeros(count, np.int32),
            confidence=np.full(count, guess_confidence(guess.spread), np.float32),
            clipped=np.zeros(count, np.float32),
            lower_bound=np.zeros(count, bool),
            guessed=np.ones(count, bool),
            spread=np.full(count, guess.spread, np.float32),
        )
    )


def _advice(mesh: Mesh, emitters: Emitters, own: np.ndarray, guess: Guess, up: str) -> tuple[str, ...]:
    """What a person should know of the guess that some triangles (E,) emit: where to photograph, and how sure it is."""
    if not own.any():  # all of it lies on doubtful emitters, which it does not light
        return ()
    power = emitters.power
    share, power = float(power[own].sum() / power.sum()), power[own]
    triangle = emitters.triangle[own]
    strongest = emitters.emitter[own] == np.bincount(emitters.emitter[own], power).argmax()
    weight = power[strongest]
    centers = mesh.corners[triangle[strongest]].mean(axis=1)
    place = (centers * weight[:, None]).sum(axis=0) / weight.sum()
    text = ", ".join(f"{v:.2f}" for v in place)
    kind = _kind(mesh, triangle[strongest], place, up)
    return (
        f"the emitters that views show cannot explain the photographs: {100 * share:.0f} % of the power of all "
        f"emitters is guessed, and known within {100 * guess.spread:.0f} %; photograph the {kind} near ({text})",
    )


def _missing(mesh: Mesh, darkened: Emitters) -> tuple[str, ...]:
    """What to say of surface that reflects more than the light of the emitters, and that no guess lights."""
    if not len(darkened.triangle):
        return ()
    area, centers = mesh.areas[darkened.triangle], mesh.corners[darkened.triangle].mean(axis=1)
    largest = darkened.emitter == np.bincount(darkened.emitter, area).argmax()
    place = ", ".join(f"{v:.2f}" for v in np.average(centers[largest], axis=0, weights=area[largest]))
    return (
        f"light is missing: {area.sum():.2f} m2 of surface, the largest of it near ({place}), are brighter than white "
        "under the emitters found, and not under the light that views show; photograph what lights that place",
    )


def _kind(mesh: Mesh, triangles: np.ndarray, place: np.ndarray, up: str) -> str:
    """Ceiling, floor or wall."""
    axis = 1 if up == "y" else 2
    normal = np.abs(mesh.area_normals[triangles]).sum(axis=0)
    if normal[axis] < _LEVEL * np.linalg.norm(normal):
        return "wall"
    return "ceiling" if place[axis] > mesh.vertices[:, axis].mean() else "floor"


def _undetermined(guess: Guess, leaves: float) -> tuple[str, ...]:
    """What to say where seen light does not explain the photographs, and no guess does."""
    if leaves > _OPEN:
        return (
            f"the light that is seen cannot explain the photographs, and {100 * leaves:.0f} % of the directions leave "
            "the mesh to where no view looks: photograph the openings, or give environment.file",
        )
    if guess.before <= 2 * _OPEN:
        return ()
    return (
        "the light that is seen cannot explain the photographs, and where the rest comes from is not determined: "
        "photograph the ceiling, the windows and whatever else shines",
    )
