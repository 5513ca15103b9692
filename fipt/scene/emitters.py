"""emitters.npz for programs and emitters.json for people."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fipt.conventions import LUMINANCE
from fipt.errors import FiptError
from fipt.formats.arrays import load_npz, save_npz
from fipt.formats.files import existing_file, made_again, write_text
from fipt.formats.text import MALFORMED
from fipt.scene.mesh import Mesh
from fipt.scene.review import closest, ranges
from fipt.scene.setup import EmitterEdit

FRONT, BACK, BOTH = 1, 2, 3
"""Sides of a triangle that shine: the one that its winding faces, the other one, both."""


def emits(sides: np.ndarray, front: np.ndarray) -> np.ndarray:
    """(N,) bool: whether the front, where ``front`` (N,), or the back is of the sides (N,) that shine."""
    return (sides & np.where(front, FRONT, BACK)) > 0


@dataclass(frozen=True)
class Undecided:
    """Regions of U triangles that may emit or reflect: the photographs do not tell.

    Attributes
    ----------
    triangle, region
        (U,) int32 indices into the mesh; number of the region of each.
    reflects, emits, price
        (R,) float32 cost of the best material, of emission, and what emission should have explained better, all as
        negative log likelihoods.
    """

    triangle: np.ndarray
    region: np.ndarray
    reflects: np.ndarray
    emits: np.ndarray
    price: np.ndarray

    def joined(self, other: "Undecided") -> "Undecided":
        """Regions of both; a triangle of both stays in the first."""
        rest = other.of(np.setdiff1d(other.triangle, self.triangle))
        return Undecided(
            np.concatenate([self.triangle, rest.triangle]),
            np.concatenate([self.region, rest.region + np.int32(len(self.price))]),
            *(np.concatenate([getattr(self, name), getattr(rest, name)]) for name in ("reflects", "emits", "price")),
        )

    def of(self, triangles: np.ndarray) -> "Undecided":
        """The regions of some triangles (N,), as far as they reach there; numbered anew, without gaps."""
        rows = np.isin(self.triangle, triangles)
        names, region = np.unique(self.region[rows], return_inverse=True)
        costs = (getattr(self, name)[names] for name in ("reflects", "emits", "price"))
        return Undecided(self.triangle[rows], region.reshape(-1).astype(np.int32), *costs)

    def largest(self, areas: np.ndarray, count: int) -> "Undecided":
        """At most ``count`` regions, the largest; ``areas`` (T,) are those of the mesh's triangles."""
        area = np.bincount(self.region, areas[self.triangle], len(self.price))
        return self.of(self.triangle[np.isin(self.region, np.argsort(-area, kind="stable")[:count])])

    @classmethod
    def none(cls) -> "Undecided":
        """No region."""
        numbers, values = np.empty(0, np.int32), np.empty(0, np.float32)
        return cls(numbers, numbers, values, values, values)


@dataclass(frozen=True)
class Emitters:
    """Emitting triangles of a room.

    Attributes
    ----------
    triangle
        (E,) int32 indices into the mesh.
    radiance
        (E, 3) float32.
    area
        (E,) float32 square metres.
    emitter
        (E,) int32 number of the connected patch.
    views
        (E,) int32 training views that see the patch.
    confidence
        (E,) float32 in [0, 1]: agreement and number of the pixels that see it.
    clipped
        (E,) float32 share of the patch's pixels that are clipped.
    lower_bound
        (E,) bool: its radiance comes from clipped pixels, and may be higher.
    sides
        (E,) int8 which sides shine: `FRONT`, `BACK` or `BOTH`, as the triangle is wound. Left out: both.
    error
        (E, 3) float32 standard error of the patch's radiance; zero where nobody measured it.
    undecided
        What may emit, too.
    guessed
        (E,) bool: no view shows it; it explains the light of what views show, or has the shape of an emitter.
    spread
        (E,) float32 relative standard deviation of the power that was guessed with it; 0 where it is measured.
    raised
        (E,) float32 share by which its radiance is above what views show, since it lights its surroundings that much
        more than its surface in the mesh would; 0 as a rule.
    """

    triangle: np.ndarray
    radiance: np.ndarray
    area: np.ndarray
    emitter: np.ndarray
    views: np.ndarray
    confidence: np.ndarray
    clipped: np.ndarray
    lower_bound: np.ndarray
    sides: np.ndarray = field(default_factory=lambda: np.empty(0, np.int8))
    error: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    undecided: Undecided = field(default_factory=Undecided.none)
    guessed: np.ndarray = field(default_factory=lambda: np.empty(0, bool))
    spread: np.ndarray = field(default_factory=lambda: np.empty(0, np.float32))
    raised: np.ndarray = field(default_factory=lambda: np.empty(0, np.float32))

    def __post_init__(self) -> None:
        count = len(self.triangle)
        for name, left_out in (
            ("sides", np.full(count, BOTH, np.int8)),
            ("error", np.zeros((count, 3), np.float32)),  # measured, nobody knows how well
            ("guessed", np.zeros(count, bool)),
            ("spread", np.zeros(count, np.float32)),
            ("raised", np.zeros(count, np.float32)),
        ):
            given = len(getattr(self, name))
            if given not in (0, count):
                raise ValueError(f"{name} is of {given} triangles, not of {count}")
            if given != count:
                object.__setattr__(self, name, left_out)

    @property
    def possible(self) -> np.ndarray:
        """Triangles that emit or may emit."""
        return np.union1d(self.triangle, self.undecided.triangle)

    @property
    def power(self) -> np.ndarray:
        """(E,) flux of each triangle over pi, from the sides that shine, as the mean of the channels."""
        return self.area * self.radiance.mean(axis=1) * np.where(self.sides == BOTH, 2, 1)

    def chosen(self, rows: np.ndarray) -> "Emitters":
        """The triangles of ``rows``, (E,) bool or indices; emitters are numbered anew, without gaps."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        arrays["emitter"] = np.unique(arrays["emitter"], return_inverse=True)[1].reshape(-1).astype(np.int32)
        return replace(self, **arrays)

    def joined(self, other: "Emitters") -> "Emitters":
        """Triangles of both, ascending; emitters keep their numbers, and what is undecided is of the first."""
        order = np.argsort(np.concatenate([self.triangle, other.triangle]), kind="stable")
        return replace(
            self, **{name: np.concatenate([getattr(self, name), getattr(other, name)])[order] for name in _ARRAYS}
        )

    @classmethod
    def none(cls) -> "Emitters":
        """No emitting triangle."""
        numbers, values = np.empty(0, np.int32), np.empty(0, np.float32)
        return cls(numbers, np.empty((0, 3), np.float32), values, numbers, numbers, values, values, np.empty(0, bool))

    @classmethod
    def plain(cls, mesh: Mesh, triangle: np.ndarray, radiance: np.ndarray, emitter: np.ndarray) -> "Emitters":
        """Triangles (E,) with their radiance (E, 3) and a number (E,) that those of one emitter share."""
        numbers, values = np.zeros(len(triangle), np.int32), np.ones(len(triangle), np.float32)
        return cls(
            triangle.astype(np.int32),
            radiance.astype(np.float32),
            mesh.areas[triangle].astype(np.float32),
            np.unique(emitter, return_inverse=True)[1].astype(np.int32),
            numbers,
            values,
            0 * values,
            numbers > 0,
        )


_ARRAYS = (
    "triangle",
    "radiance",
    "area",
    "emitter",
    "views",
    "confidence",
    "clipped",
    "lower_bound",
    "sides",
    "error",
    "guessed",
    "spread",
    "raised",
)
_UNDECIDED = ("triangle", "region", "reflects", "emits", "price")
_FORMS = {
    **dict.fromkeys(("triangle", "emitter", "views", "sides"), "number E"),
    **dict.fromkeys(("area", "spread", "raised"), "amount E"),
    **dict.fromkeys(("confidence", "clipped"), "share E"),
    **dict.fromkeys(("lower_bound", "guessed"), "bool E"),
    "radiance": "amount E 3",
    "error": "float E 3",
    "undecided_triangle": "number U",
    "undecided_region": "number U",
    **{f"undecided_{name}": "float R" for name in ("reflects", "emits", "price")},
}


def default_name(number: int) -> str:
    """What an emitter is called to which nobody gave a name."""
    return f"emitter-{number}"


def emitter_triangles(emitters: Emitters) -> list[np.ndarray]:
    """Triangles of every emitter, in the order of their numbers."""
    count = int(emitters.emitter.max(initial=-1)) + 1
    return [emitters.triangle[emitters.emitter == number] for number in range(count)]


def question_triangles(emitters: Emitters) -> list[np.ndarray]:
    """Triangles of every region that may emit, in the order of `undecided_facts`, without those that do emit."""
    undecided, open_ = emitters.undecided, ~np.isin(emitters.undecided.triangle, emitters.triangle)
    return [undecided.triangle[open_ & (undecided.region == number)] for number in range(len(undecided.emits))]


def moved_power(emitters: Emitters, before: Emitters) -> float:
    """Share of the power that is not where it was ``before``: between two rounds of one mesh, at most 2."""
    count = max(int(each.triangle.max(initial=-1)) + 1 for each in (emitters, before))
    now, then = (np.bincount(each.triangle, each.power, count) for each in (emitters, before))
    return float(np.abs(now - then).sum() / max(now.sum(), then.sum(), 1e-12))


def emitter_facts(emitters: Emitters, mesh: Mesh) -> list[dict[str, Any]]:
    """What emitters.json says of every emitter.

    Power is the flux of a Lambertian emitter, of each channel, from the sides that shine; ``sides`` is how many do, as
    the mean over its area. ``share`` is that of the mean of the channels in the power of all emitters. ``spread`` is
    the relative standard deviation of the power of all that is ``guessed``; ``raised`` the share of the radiance that
    comes beside what views show, as what the emitter lights tells.
    """
    rows = []
    both = emitters.sides == BOTH
    centers = mesh.corners.mean(axis=1)
    for number, triangles in enumerate(emitter_triangles(emitters)):
        own = emitters.emitter == number
        area = emitters.area[own].astype(np.float64)
        radiance = (emitters.radiance[own] * area[:, None]).sum(0) / area.sum()
        emitting = area * (1 + both[own])
        rows.append(
            {
                "index": number,
                "name": default_name(number),
                "triangles": int(own.sum()),
                "ranges": ranges(triangles),
                "area": float(area.sum()),
                "radiance": [float(v) for v in radiance],
                "error": [float(v) for v in emitters.error[own].max(axis=0)],
                "power": [float(v) for v in np.pi * emitting @ emitters.radiance[own]],
                "sides": float(emitting.sum() / area.sum()),
                "center": [float(v) for v in (centers[triangles] * area[:, None]).sum(0) / area.sum()],
                "views": int(emitters.views[own].max()),
                "confidence": float(emitters.confidence[own].mean()),
                "clipped": float(emitters.clipped[own].mean()),
                "lower_bound": bool(emitters.lower_bound[own].any()),
                "guessed": bool(emitters.guessed[own].any()),
                "spread": float(emitters.spread[own].max()),
                "raised": float(emitters.raised[own].max()),
            }
        )
    total = sum(sum(row["power"]) for row in rows)
    return [row | {"share": sum(row["power"]) / total if total > 0 else 0.0} for row in rows]


def undecided_facts(undecided: Undecided, mesh: Mesh) -> list[dict[str, Any]]:
    """What emitters.json says of every region that may emit."""
    rows, areas, centers = [], mesh.areas, mesh.corners.mean(axis=1)
    costs = zip(undecided.reflects, undecided.emits, undecided.price, strict=True)
    for number, (reflects, emits, price) in enumerate(costs):
        own = undecided.triangle[undecided.region == number]
        center = (centers[own] * areas[own, None]).sum(axis=0) / max(areas[own].sum(), 1e-12)
        evidence = {"reflects": float(reflects), "emits": float(emits), "price": float(price)}
        where = {"area": float(areas[own].sum()), "center": [float(v) for v in center]}
        rows.append({"question": "emitter or mirror?", "ranges": ranges(own), **where, "evidence": evidence})
    return rows


def write_emitters(path: str | Path, emitters: Emitters, mesh: Mesh, radiance_scale: float = 1.0) -> None:
    """Write ``path`` (npz) and, beside it, the JSON for people; ``radiance_scale`` as of `in_source_unit`."""
    save_npz(
        path,
        **{name: getattr(emitters, name) for name in _ARRAYS},
        **{f"undecided_{name}": getattr(emitters.undecided, name) for name in _UNDECIDED},
    )
    questions = undecided_facts(emitters.undecided, mesh)
    rows = emitter_facts(in_source_unit(emitters, radiance_scale), mesh)
    write_list(Path(path).with_suffix(".json"), rows, questions)


def in_source_unit(emitters: Emitters, radiance_scale: float) -> Emitters:
    """Return emitters with the radiance of the source; ``radiance_scale`` is the dataset's factor from it."""
    unit = np.float32(1 / radiance_scale)
    return replace(emitters, radiance=emitters.radiance * unit, error=emitters.error * unit)


def write_list(path: Path, rows: list[dict[str, Any]], undecided: list[dict[str, Any]]) -> None:
    """Write emitters.json."""
    write_text(path, json.dumps({"emitters": rows, "undecided": undecided}, indent=1) + "\n")


def read_names(path: str | Path | None, emitters: Emitters) -> list[str]:
    """Name of every emitter as emitters.json of the stage review has them; ``emitter-N`` where there is no such file.

    Raises
    ------
    FiptError
        If it is missing, damaged or lists other emitters.
    """
    known = list(map(default_name, range(len(emitter_triangles(emitters)))))
    if path is None:
        return known
    content = existing_file(path, "the list of emitters").read_text(encoding="utf-8")
    try:
        rows = json.loads(content)["emitters"]
        names = [str(row["name"]) for row in rows]
        if [row.get("index", place) for place, row in enumerate(rows)] != list(range(len(rows))):
            raise ValueError("its emitters must be numbered from 0, in order")
    except MALFORMED as error:
        raise FiptError(f"{path} is not a list of emitters ({error!r})", "run fipt review again") from error
    if len(names) != len(known):
        raise FiptError(f"{path} must list {len(known)} emitters; it has {len(names)}", "run fipt review again")
    return names


def chosen_emitters(edit: EmitterEdit, names: Sequence[str]) -> list[int]:
    """Numbers of the emitters that an edit of a light setup is about.

    Parameters
    ----------
    names
        Of every emitter; ``emitter-N`` is always emitter N.

    Raises
    ------
    FiptError
        If there is no such emitter: lists those there are, closest first.
    """
    wanted = edit.called if edit.index is None else (default_name(edit.index),)
    if not wanted:
        return list(range(len(names)))
    called = [{name, default_name(number)} for number, name in enumerate(names)]
    unknown = next((name for name in wanted if not any(name in own for own in called)), None)
    if unknown is not None:
        what = f"emitter {unknown!r}" if edit.index is None else f"emitter {edit.index}"
        if names and unknown.startswith("lamp-"):
            raise FiptError(f"the light setup names {what}", "lamp-N is called emitter-N now")
        raise FiptError(
            f"the light setup names {what}, which is none of {len(names)} emitters",
            (f"there are {closest(unknown, names)}" if edit.index is None else f"indices are 0 to {len(names) - 1}")
            if names
            else "leave its emitters out",
        )
    return [number for number, own in enumerate(called) if not own.isdisjoint(wanted)]


def edited_radiance(radiance: np.ndarray, edit: EmitterEdit) -> np.ndarray:
    """Radiance (N, 3) after an edit: exact radiance, then colour (luminance kept), then scale; or none."""
    if edit.off:
        return np.zeros_like(radiance)
    if edit.radiance is not None:
        radiance = np.broadcast_to(np.array(edit.radiance), radiance.shape)
    if edit.color is not None:
        color = np.array(edit.color)
        radiance = (radiance @ np.array(LUMINANCE))[:, None] * color / max(float(color @ np.array(LUMINANCE)), 1e-9)
    return radiance * (1.0 if edit.scale is None else edit.scale)


def read_emitters(path: str | Path, mesh: Mesh | None = None) -> Emitters:
    """Read emitters.npz, which must be of ``mesh`` where that is given.

    Raises
    ------
    FiptError
        If it is missing or damaged, lacks an array, or one has values that it cannot have.
    """
    questions = {name: f"undecided_{name}" for name in _UNDECIDED}
    arrays = load_npz(path, forms=_FORMS)
    if arrays["undecided_region"].max(initial=-1) >= len(arrays["undecided_price"]):
        raise FiptError(f"{path}: every undecided triangle must be of one of its regions", made_again(path))
    triangles = np.concatenate([arrays["triangle"], np.unique(arrays["undecided_triangle"])])
    if len(np.unique(arrays["triangle"])) < len(arrays["triangle"]):
        raise FiptError(f"{path}: every emitting triangle must be listed once", made_again(path))
    if not np.isin(arrays["sides"], (FRONT, BACK, BOTH)).all():
        raise FiptError(f"{path}: sides must be {FRONT}, {BACK} or {BOTH}", made_again(path))
    if mesh is not None and triangles.max(initial=-1) >= len(mesh.triangles):
        raise FiptError(
            f"{path} names triangle {triangles.max()}; the mesh has {len(mesh.triangles)}: it is of another one",
            made_again(path),
        )
    undecided = Undecided(**{name: arrays[key] for name, key in questions.items()})
    known = {name: arrays[name] for name in _ARRAYS}
    return Emitters(**known, undecided=undecided)
