"""How far the loop of fit and refinement has come: what a round changed in the shading, and whether it has settled.

``change.json`` in a shading folder says it of a shard, ``settled.json`` beside a round's model of all shards. Both are
written and read by stages that know nothing of each other.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypeVar

from fipt.errors import FiptError
from fipt.formats.files import existing_file, write_text
from fipt.formats.text import MALFORMED

_T = TypeVar("_T")

CHANGE = "change.json"
"""Name of the file in a shading folder."""
SETTLED = "settled.json"
"""Name of the file beside the model."""


@dataclass(frozen=True)
class ShadingChange:
    """What a refinement found different from the shading before it, as the natural logarithm of diffuse shading.

    Attributes
    ----------
    change
        Root mean square of what all views of a surface find alike: 0.05 is a change by 5 %.
    noise
        Standard deviation of what is left of a single sample: noise of the rays and of denoising.
    kept
        Share of the last round's shading that was kept.
    samples
        Samples that were compared.
    light_missing
        Share of the shading that was kept whole, since the emitters that were found give too little light.
    """

    change: float
    noise: float
    kept: float
    samples: int
    light_missing: float = 0.0

    @property
    def figures(self) -> dict[str, float]:
        """Its attributes, rounded for people."""
        return {
            "change": round(self.change, 5),
            "noise": round(self.noise, 5),
            "kept": round(self.kept, 4),
            "samples": self.samples,
            "light_missing": round(self.light_missing, 4),
        }


@dataclass(frozen=True)
class RoundState:
    """What settled.json says of a round.

    Attributes
    ----------
    round
        Its number, 0 for the first fit.
    settled
        The round in which the loop settled; None: it has not. Later rounds are copies of that one.
    change, noise
        Of the shading, over all shards; None in round 0.
    kd_change
        Root mean square of the change of kd at surface that views see; None in round 0.
    light_missing
        As in `ShadingChange`, over all shards.
    """

    round: int
    settled: int | None = None
    change: float | None = None
    noise: float | None = None
    kd_change: float | None = None
    light_missing: float = 0.0

    @property
    def copied(self) -> bool:
        """Whether this round is a copy of the one in which the loop settled."""
        return self.settled is not None and self.round > self.settled

    def after(self) -> "RoundState":
        """State of the next round, where that is a copy of this one."""
        return replace(self, round=self.round + 1)


def write_change(folder: Path, found: ShadingChange) -> Path:
    """Write what a refinement changed into its shading folder; return the file."""
    write_text(folder / CHANGE, json.dumps(found.figures, indent=1, sort_keys=True) + "\n")
    return folder / CHANGE


def read_changes(folders: Sequence[Path]) -> list[ShadingChange]:
    """What the refinements of these shading folders changed; none of them if they were baked."""
    found = []
    for folder in folders:
        path = Path(folder) / CHANGE
        if path.is_file():
            found.append(_parsed(path, ShadingChange))
    return found


def together(changes: Sequence[ShadingChange]) -> ShadingChange | None:
    """One figure of several shards, weighted by their samples; None of no shard."""
    total = sum(each.samples for each in changes)
    if total == 0:
        return None

    def mean(of: Sequence[float]) -> float:
        return sum(each.samples * value for each, value in zip(changes, of, strict=True)) / total

    change = mean([each.change**2 for each in changes]) ** 0.5
    noise = mean([each.noise**2 for each in changes]) ** 0.5
    kept, missing = (mean([getattr(each, name) for each in changes]) for name in ("kept", "light_missing"))
    return ShadingChange(change, noise, kept, total, missing)


def write_state(path: Path, state: RoundState) -> None:
    """Write settled.json."""
    write_text(path, json.dumps(asdict(state), indent=1, sort_keys=True) + "\n")


def read_state(path: Path | None) -> RoundState | None:
    """Read settled.json; None where no file is named."""
    return None if path is None else _parsed(existing_file(path, "the state of a round"), RoundState)


def _parsed(path: Path, kind: type[_T]) -> _T:
    """Content of a file as ``kind``.

    Raises
    ------
    FiptError
        If the file is damaged.
    """
    try:
        return kind(**json.loads(path.read_text(encoding="utf-8")))
    except MALFORMED as error:
        raise FiptError(f"{path} is damaged ({error})", "run the stage again that wrote it") from error
