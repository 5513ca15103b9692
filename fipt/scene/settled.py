"""How far the loop of fit and refinement has come: what a round changed in the shading, and whether it has settled.

``change.json`` in a shading folder says it of all views, the same in every shard; ``settled.json`` stands beside a
round's model. Both are written and read by stages that know nothing of each other.
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
        1 where the last round's shading was kept whole, since the emitters found give too little light; else 0.
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
        Of the shading; None in round 0.
    kd_change
        Root mean square of the change of kd at surface that views see; None in round 0.
    light_missing
        As in `ShadingChange`.
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


def read_change(folders: Sequence[Path]) -> ShadingChange | None:
    """What a refinement changed, which the folder of every shard says; None if they were baked.

    Raises
    ------
    FiptError
        If they are of several refinements, or a file is damaged.
    """
    paths = [Path(folder) / CHANGE for folder in folders]
    found = [_parsed(path, ShadingChange) if path.is_file() else None for path in paths]
    for path, each in zip(paths, found, strict=True):
        if each != found[0]:
            raise FiptError(f"{path} is of another refinement than {paths[0]}", "give the shading of one round")
    return found[0] if found else None


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
