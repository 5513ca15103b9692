"""How far the loop of fit and refinement has come: what a round changed, and whether it has settled.

``settled.json`` beside a round's model is written and read by stages that know nothing of each other.
"""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from fipt.errors import FiptError
from fipt.formats.files import existing_file, write_text
from fipt.formats.text import MALFORMED

SETTLED = "settled.json"
"""Name of the file beside the model."""


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
        1 where the shading of the round before was kept whole, since the emitters found give too little light; else 0.
    kept
        Share of the shading of the round before that is kept.
    moved
        Share of the emitters' power that is not where it was in the round before.
    """

    round: int
    settled: int | None = None
    change: float | None = None
    noise: float | None = None
    kd_change: float | None = None
    light_missing: float = 0.0
    kept: float = 0.0
    moved: float = 0.0

    @property
    def copied(self) -> bool:
        """Whether this round is a copy of the one in which the loop settled."""
        return self.settled is not None and self.round > self.settled

    def after(self) -> "RoundState":
        """State of the next round, where that is a copy of this one."""
        return replace(self, round=self.round + 1)


def write_state(path: Path, state: RoundState) -> None:
    """Write settled.json."""
    write_text(path, json.dumps(asdict(state), indent=1, sort_keys=True) + "\n")


def read_state(path: Path | None) -> RoundState | None:
    """Read settled.json; None where no file is named.

    Raises
    ------
    FiptError
        If the file is missing or damaged.
    """
    if path is None:
        return None
    text = existing_file(path, "the state of a round").read_text(encoding="utf-8")
    try:
        return RoundState(**json.loads(text))
    except MALFORMED as error:
        raise FiptError(f"{path} is damaged ({error})", "run the stage again that wrote it") from error
